/* gltf_draco.cpp: KHR_draco_mesh_compression. A primitive is decoded whole, into arrays of the
 * form its accessors promise. */
#include "formats/foreign/gltf.hpp"
#include <draco/compression/decode.h>

namespace pbs::gltf {

typedef unsigned long long ull;

static bool varint(const bytes &b, uint64_t &at, uint32_t &out) {
    out = 0;
    for (int shift = 0; shift < 35; shift += 7) {
        if (at >= b.size) return false;
        uint8_t c = b.data[at++];
        out |= (uint32_t)(c & 0x7f) << shift;
        if (c < 0x80) return true;
    }
    return false;
}

/* The numbers of faces and points in a Draco header (bitstream 2.2, without metadata). The
 * library allocates by them before it looks at the data, so that 20 bytes can ask for 30 GB. */
static bool peek(const bytes &b, uint32_t &faces, uint32_t &points) {
    if (b.size < 12 || b.data[5] != 2 || b.data[6] < 2 || b.data[7] != 1 || b.data[10] & 0x80)
        return false;
    uint64_t at = 11;
    if (b.data[8] == 0) return varint(b, at, faces) && varint(b, at, points);
    at++; /* the kind of traversal */
    return varint(b, at, points) && varint(b, at, faces);
}

template <class T>
static bool copy_attribute(const draco::Mesh &mesh, const draco::PointAttribute &a, uint8_t *out) {
    int n = a.num_components();
    for (draco::PointIndex i(0); i < mesh.num_points(); ++i) {
        T v[4] = {0, 0, 0, 0};
        if (!a.ConvertValue<T>(a.mapped_index(i), (int8_t)n, v)) return false;
        memcpy(out, v, sizeof(T) * (size_t)n);
        out += sizeof(T) * (size_t)n;
    }
    return true;
}

static bool copy_as(int type, const draco::Mesh &mesh, const draco::PointAttribute &a,
                    uint8_t *out) {
    switch (type) {
    case TINYGLTF_COMPONENT_TYPE_FLOAT:
        return copy_attribute<float>(mesh, a, out);
    case TINYGLTF_COMPONENT_TYPE_BYTE:
        return copy_attribute<int8_t>(mesh, a, out);
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE:
        return copy_attribute<uint8_t>(mesh, a, out);
    case TINYGLTF_COMPONENT_TYPE_SHORT:
        return copy_attribute<int16_t>(mesh, a, out);
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT:
        return copy_attribute<uint16_t>(mesh, a, out);
    default:
        return copy_attribute<uint32_t>(mesh, a, out);
    }
}

/* Only positions, normals, the chosen texture coordinates and colours come here; see
 * open_primitive. s: from the accessor, without data yet. */
static void decode_attribute(pbs_run *run, const draco::Mesh &mesh, int id, stream &s,
                             primitive &out, pbs_err *err) {
    const draco::PointAttribute *a = mesh.GetAttributeByUniqueId((uint32_t)id);
    if (!a) fail(err, PBS_DATA, "Draco: attribute %d is missing", id);
    if (a->num_components() != s.components)
        fail(err, PBS_DATA, "Draco: attribute %d has %d components, its accessor %d", id,
             a->num_components(), s.components);
    array<uint8_t> data(run, (size_t)mesh.num_points() * s.element, "a decoded mesh", err);
    if (!copy_as(s.type, mesh, *a, data.data()))
        fail(err, PBS_DATA, "Draco: attribute %d cannot be converted", id);
    s.data = data.data();
    s.stride = s.element;
    s.count = mesh.num_points();
    s.where = s.values = nullptr;
    s.sparse_count = 0;
    out.owned_bytes += data.size();
    out.owned.push_back(std::move(data));
}

void reader::decode_draco(const primitive_entry &p, int uv_set, primitive &out) {
    bytes in = whole_view(p.draco_view);
    touch(in.size);
    uint32_t faces = 0, points = 0;
    bool known = peek(in, faces, points);
    if (known && p.mode == TINYGLTF_MODE_TRIANGLES && out.index &&
        (uint64_t)faces * 3 != out.index.count)
        fail(err_, PBS_DATA, "Draco: %u triangles, but the accessor has %llu indices", faces,
             (ull)out.index.count);
    /* Corner table, symbols and attributes, from what the decoder was seen to take. */
    counted memory(run_, known ? (size_t)faces * 64 + (size_t)points * 96 : in.size * 40,
                   "decoding Draco", err_);
    draco::DecoderBuffer buffer;
    buffer.Init((const char *)in.data, in.size);
    draco::Decoder decoder;
    auto result = decoder.DecodeMeshFromBuffer(&buffer);
    if (!result.ok()) fail(err_, PBS_DATA, "Draco: %s", result.status().error_msg());
    const draco::Mesh &mesh = *result.value();

    const struct {
        int semantic;
        stream *s;
    } attributes[] = {{POSITION, &out.position},
                      {NORMAL, &out.normal},
                      {uv_set, &out.uv},
                      {COLOR_0, &out.colour}};
    for (auto &a : attributes) {
        const attribute_entry *e = *a.s ? find_attribute(p, a.semantic) : nullptr;
        if (e && e->draco != absent) decode_attribute(run_, mesh, e->draco, *a.s, out, err_);
    }
    /* Some may be decoded and others not, and their numbers are different claims. */
    for (const stream *s : {&out.normal, &out.uv, &out.colour})
        if (*s && s->count < out.position.count)
            fail(err_, PBS_DATA, "Draco: an attribute has %llu elements, POSITION has %llu",
                 (ull)s->count, (ull)out.position.count);
    array<uint8_t> index(run_, (size_t)mesh.num_faces() * 12, "a decoded mesh", err_);
    for (draco::FaceIndex f(0); f < mesh.num_faces(); ++f)
        for (size_t k = 0; k < 3; k++) {
            uint32_t v = mesh.face(f)[k].value();
            memcpy(index.data() + ((size_t)f.value() * 3 + k) * 4, &v, 4);
        }
    out.index = stream();
    out.index.data = index.data();
    out.index.stride = out.index.element = 4;
    out.index.count = (uint64_t)mesh.num_faces() * 3;
    out.index.type = TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT;
    out.index.components = 1;
    out.owned_bytes += index.size();
    out.owned.push_back(std::move(index));
    /* Strips come out of the decoder as single triangles. */
    out.mode = TINYGLTF_MODE_TRIANGLES;
}

} // namespace pbs::gltf
