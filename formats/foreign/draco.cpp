/* draco.cpp: module draco: meshes of whole numbers, packed with Draco's edgebreaker. Attributes are
 * given to it as integers, which it does not round. */
#include "formats/readers/module.h"
#include "formats/foreign/guard.hpp"
#include <draco/compression/expert_encode.h>
#include <draco/compression/mesh/mesh_edgebreaker_decoder.h>
#include <cstring>

namespace {

using pbs::check;
using pbs::counted;

enum { SPEED = 3 }; /* of 0, the smallest result, to 10, the fastest */

/* The arrays of a mesh that there are, in the order in which they are attributes. Texture
 * coordinates are not called so, for the prediction that they would get takes memory as it is told
 * to when it is unpacked; nor are normals, which would be rounded. */
struct channel {
    draco::GeometryAttribute::Type type;
    draco::DataType number;
    int8_t components;
    size_t size;
    uint8_t *data;
};

int channels_of(const pbs_draco_mesh &m, channel out[4]) {
    const channel all[4] = {
        {draco::GeometryAttribute::POSITION, draco::DT_INT32, 3, 12, (uint8_t *)m.position},
        {draco::GeometryAttribute::GENERIC, draco::DT_INT16, 2, 4, (uint8_t *)m.normal},
        {draco::GeometryAttribute::GENERIC, draco::DT_INT32, 2, 8, (uint8_t *)m.uv},
        {draco::GeometryAttribute::COLOR, draco::DT_UINT8, 4, 4, m.colour}};
    int n = 0;
    for (const channel &c : all)
        if (c.data) out[n++] = c;
    return n;
}

size_t memory_of(const pbs_draco_mesh &m) {
    return (size_t)m.triangles * 64 + (size_t)m.vertices * 96;
}

/* ---- packing ---- */

void fill(draco::Mesh &mesh, const pbs_draco_mesh &m) {
    channel c[4];
    int n = channels_of(m, c);
    mesh.SetNumFaces(m.triangles);
    for (uint32_t t = 0; t < m.triangles; t++) {
        draco::Mesh::Face f;
        for (size_t i = 0; i < 3; i++) f[i] = draco::PointIndex(m.index[3 * t + i]);
        mesh.SetFace(draco::FaceIndex(t), f);
    }
    mesh.set_num_points(m.vertices);
    for (int k = 0; k < n; k++) {
        draco::GeometryAttribute a;
        a.Init(c[k].type, nullptr, (uint8_t)c[k].components, c[k].number, false, (int64_t)c[k].size,
               0);
        int id = mesh.AddAttribute(a, true, m.vertices);
        for (uint32_t i = 0; i < m.vertices; i++)
            mesh.attribute(id)->SetAttributeValue(draco::AttributeValueIndex(i),
                                                  c[k].data + c[k].size * i);
    }
    /* So that what meets at a place is one corner of the surface, whatever its normals are. */
    mesh.DeduplicateAttributeValues();
}

pbs_code pack(pbs_run *run, const pbs_draco_mesh *m, uint8_t **out, size_t *size,
              uint32_t *vertices, pbs_err *err) {
    *out = nullptr;
    *size = 0;
    return pbs::guard(err, [&] {
        counted memory(run, 4 * memory_of(*m), "packing with Draco", err);
        draco::Mesh mesh;
        fill(mesh, *m);
        draco::ExpertEncoder encoder(mesh);
        encoder.SetEncodingMethod(draco::MESH_EDGEBREAKER_ENCODING);
        encoder.SetSpeedOptions(SPEED, SPEED);
        encoder.SetTrackEncodedProperties(true);
        draco::EncoderBuffer buffer;
        if (!encoder.EncodeToBuffer(&buffer).ok()) return;
        if (encoder.num_encoded_faces() != m->triangles) return;
        check(pbs_alloc(run, out, buffer.size(), 1, "a packed mesh", err));
        memcpy(*out, buffer.data(), buffer.size());
        *size = buffer.size();
        *vertices = (uint32_t)encoder.num_encoded_points();
    });
}

/* ---- unpacking ---- */

bool varint(const uint8_t *p, size_t size, size_t &at, uint32_t &out) {
    out = 0;
    for (int shift = 0; shift < 35; shift += 7) {
        if (at >= size) return false;
        uint8_t c = p[at++];
        out |= (uint32_t)(c & 0x7f) << shift;
        if (c < 0x80) return true;
    }
    return false;
}

/* Bitstream 2.2, a mesh, edgebreaker, no metadata, and so large as it must be: the library takes
 * memory by these numbers before it looks at the data. */
bool header_fits(const uint8_t *p, size_t size, const pbs_draco_mesh &m) {
    uint32_t vertices, triangles;
    size_t at = 12; /* behind the kind of traversal */
    if (size < at || memcmp(p, "DRACO", 5) != 0 || p[5] != 2 || p[6] != 2 || p[7] != 1 ||
        p[8] != 1 || p[10] & 0x80)
        return false;
    return varint(p, size, at, vertices) && varint(p, size, at, triangles) &&
           triangles == m.triangles && vertices <= m.vertices;
}

/* Attributes say how large they are, and get their memory before their data is looked at; some
 * predictions say how large their tables are, up to 2^32. So attributes must be the channels, each
 * with a decoder of its own, whose first byte is its prediction: one that has no table, or a table
 * that cannot be larger than the mesh. */
class careful : public draco::MeshEdgebreakerDecoder {
  public:
    explicit careful(const pbs_draco_mesh &m) : m_(m) {}

  protected:
    bool DecodeAllAttributes() override {
        channel c[4];
        int n = channels_of(m_, c);
        const draco::PointCloud *cloud = point_cloud();
        if (cloud->num_attributes() != n || cloud->num_points() > m_.vertices) return false;
        for (int k = 0; k < n; k++) {
            const draco::PointAttribute *a = cloud->attribute(k);
            if (a->attribute_type() != c[k].type || a->data_type() != c[k].number ||
                a->num_components() != c[k].components)
                return false;
        }
        for (int i = 0; i < num_attributes_decoders(); i++) {
            auto *one = const_cast<draco::AttributesDecoderInterface *>(attributes_decoder(i));
            if (one->GetNumAttributes() != 1 || !prediction_fits()) return false;
            if (!one->DecodeAttributes(buffer())) return false;
        }
        return true;
    }

  private:
    bool prediction_fits() {
        int8_t method;
        return buffer()->Peek(&method) &&
               (method == draco::PREDICTION_NONE || method == draco::PREDICTION_DIFFERENCE ||
                method == draco::MESH_PREDICTION_PARALLELOGRAM ||
                method == draco::MESH_PREDICTION_CONSTRAINED_MULTI_PARALLELOGRAM);
    }

    const pbs_draco_mesh &m_;
};

bool copy_out(const draco::Mesh &mesh, const pbs_draco_mesh &m) {
    channel c[4];
    int n = channels_of(m, c);
    if (mesh.num_points() != m.vertices || mesh.num_faces() != m.triangles ||
        mesh.num_attributes() != n)
        return false;
    for (int k = 0; k < n; k++) {
        const draco::PointAttribute *a = mesh.attribute(k);
        if (a->byte_stride() != (int64_t)c[k].size) return false;
        for (uint32_t i = 0; i < m.vertices; i++) {
            draco::AttributeValueIndex v = a->mapped_index(draco::PointIndex(i));
            if (v.value() >= a->size()) return false;
            a->GetValue(v, c[k].data + c[k].size * i);
        }
    }
    for (uint32_t t = 0; t < m.triangles; t++)
        for (size_t i = 0; i < 3; i++) {
            uint32_t v = mesh.face(draco::FaceIndex(t))[i].value();
            if (v >= m.vertices) return false;
            m.index[3 * t + i] = (uint16_t)v;
        }
    return true;
}

pbs_code unpack(pbs_run *run, const pbs_draco_mesh *m, const void *from, size_t size,
                pbs_err *err) {
    return pbs::guard(err, [&] {
        if (!header_fits((const uint8_t *)from, size, *m))
            pbs::fail(err, PBS_DATA, "Draco: header");
        counted memory(run, memory_of(*m), "unpacking with Draco", err);
        draco::DecoderBuffer buffer;
        buffer.Init((const char *)from, size);
        draco::Mesh mesh;
        careful decoder(*m);
        draco::DecoderOptions options;
        if (!decoder.Decode(options, &buffer, &mesh).ok() || !copy_out(mesh, *m))
            pbs::fail(err, PBS_DATA, "Draco: damaged");
    });
}

} // namespace

extern "C" __attribute__((visibility("default")))
const pbs_module_draco pbs_module = {PBS_MODULE_ABI, pack, unpack};
