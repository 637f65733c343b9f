/* gltf_mesh.cpp: a mesh becomes one part, its primitives become triangles. */
#include "formats/foreign/gltf.hpp"
#include <cmath>
#include <cstring>

namespace pbs::gltf {

typedef unsigned long long ull;

void primitive::triangle(uint64_t t, uint64_t out[3]) const {
    /* The order of the standard, section 3.7.2.1. */
    if (mode == TINYGLTF_MODE_TRIANGLES)
        out[0] = 3 * t, out[1] = 3 * t + 1, out[2] = 3 * t + 2;
    else if (mode == TINYGLTF_MODE_TRIANGLE_FAN)
        out[0] = t + 1, out[1] = t + 2, out[2] = 0;
    else
        out[0] = t, out[1] = t + 1 + t % 2, out[2] = t + 2 - t % 2;
    for (int k = 0; k < 3; k++) out[k] = corner(out[k]);
}

uint64_t reader::corner_count(const tinygltf::Primitive &p) {
    if (p.indices >= 0) return open_stream(p.indices).count;
    auto it = p.attributes.find("POSITION");
    return it == p.attributes.end() ? 0 : open_stream(it->second).count;
}

/* What is not triangles is counted; true if p is such. */
bool reader::skip_mode(const tinygltf::Primitive &p) {
    if (p.mode < 0 || p.mode > TINYGLTF_MODE_TRIANGLE_FAN)
        fail(err_, PBS_DATA, "mode %d is not known", p.mode);
    bool placed = p.attributes.count("POSITION") > 0;
    if (p.mode >= TINYGLTF_MODE_TRIANGLES && placed) return false;
    uint64_t n = corner_count(p), less = n ? n - 1 : 0;
    switch (p.mode) {
    case TINYGLTF_MODE_POINTS:
        sink_->skip(sink_->ctx, PBS_SKIP_POINTS, n);
        break;
    case TINYGLTF_MODE_LINE:
        sink_->skip(sink_->ctx, PBS_SKIP_LINES, n / 2);
        break;
    case TINYGLTF_MODE_LINE_LOOP:
        sink_->skip(sink_->ctx, PBS_SKIP_LINES, n);
        break;
    case TINYGLTF_MODE_LINE_STRIP:
        sink_->skip(sink_->ctx, PBS_SKIP_LINES, less);
        break;
    default: /* triangles without positions */
        sink_->skip(sink_->ctx, PBS_SKIP_POLYGON, n >= 3 ? n / 3 : 1);
    }
    return true;
}

stream reader::attribute(const tinygltf::Primitive &p, const char *name, int components,
                         uint64_t vertices) {
    auto it = p.attributes.find(name);
    if (it == p.attributes.end()) return stream();
    stream s = open_stream(it->second);
    bool colour = name[0] == 'C' && s.components == 4;
    if (s.components != components && !colour)
        fail(err_, PBS_DATA, "%s has %d components", name, s.components);
    if (s.count < vertices)
        fail(err_, PBS_DATA, "%s has %llu elements, POSITION has %llu", name, (ull)s.count,
             (ull)vertices);
    return s;
}

primitive reader::open_primitive(const tinygltf::Primitive &p) {
    primitive out;
    out.mode = p.mode;
    out.position = attribute(p, "POSITION", 3, 0);
    uint64_t vertices = out.position.count;
    out.normal = attribute(p, "NORMAL", 3, vertices);
    std::string uv = "TEXCOORD_" + std::to_string(uv_set(p.material));
    out.uv = attribute(p, uv.c_str(), 2, vertices);
    out.colour = attribute(p, "COLOR_0", 3, vertices);
    if (p.indices >= 0) {
        out.index = open_stream(p.indices);
        if (out.index.components != 1 || out.index.normalized ||
            (out.index.type != TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE &&
             out.index.type != TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT &&
             out.index.type != TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT))
            fail(err_, PBS_DATA, "indices are not unsigned integers");
    }
    auto draco = p.extensions.find("KHR_draco_mesh_compression");
    if (draco != p.extensions.end()) decode_draco(p, draco->second, out);

    uint64_t n = out.index ? out.index.count : out.position.count;
    bool list = out.mode == TINYGLTF_MODE_TRIANGLES;
    out.triangles = list ? n / 3 : n >= 3 ? n - 2 : 0;
    out.corners = list ? 3 * out.triangles : out.triangles ? n : 0;
    if (list ? n % 3 : n > 0 && n < 3) sink_->skip(sink_->ctx, PBS_SKIP_POLYGON, 1);
    out.material = material(p.material);
    return out;
}

/* Extends box by all corners that are finite, and checks the indices on the way: an error is
 * found before the part begins. */
void reader::bound(const primitive &p, pbs_box &box) {
    for (uint64_t i = 0; i < p.corners; i++) {
        if (i % 65536 == 0) check(pbs_run_check(run_, err_));
        uint64_t v = p.corner(i);
        if (v >= p.position.count)
            fail(err_, PBS_DATA, "index %llu at place %llu, but there are %llu vertices", (ull)v,
                 (ull)i, (ull)p.position.count);
        double at[3];
        p.position.get(v, at);
        if (std::isfinite(at[0]) && std::isfinite(at[1]) && std::isfinite(at[2]))
            pbs_box_add(&box, at);
    }
}

/* Linear light in 16 bits to sRGB in 8. */
struct srgb_table {
    uint8_t of[65536];
    srgb_table() {
        for (int i = 0; i < 65536; i++) of[i] = pbs_unorm8(pbs_linear_to_srgb((float)i / 65535.0f));
    }
};

static void load_colour(const stream &s, uint64_t v, uint8_t out[4]) {
    static const srgb_table table;
    double c[4] = {1, 1, 1, 1};
    s.get(v, c);
    /* Integers are normalized, also where the file forgets to say so. */
    double full = 1;
    if (!s.normalized && s.type == TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE) full = 255;
    if (!s.normalized && s.type == TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT) full = 65535;
    if (full > 1 && s.components == 3) c[3] = full;
    for (int k = 0; k < 3; k++) {
        double x = c[k] / full;
        out[k] = table.of[x >= 1 ? 65535 : x > 0 ? (int)(x * 65535 + 0.5) : 0];
    }
    out[3] = pbs_unorm8((float)(c[3] / full));
}

static void load_corner(const primitive &p, uint64_t v, pbs_corner &c) {
    double t[3];
    p.position.get(v, c.position);
    if (p.normal) {
        p.normal.get(v, t);
        for (int k = 0; k < 3; k++) c.normal[k] = (float)t[k];
    }
    if (p.uv) {
        p.uv.get(v, t);
        c.uv[0] = (float)t[0], c.uv[1] = (float)t[1];
    }
    if (p.colour) load_colour(p.colour, v, c.colour);
}

void reader::emit(const primitive &p) {
    pbs_corner corner[3] = {};
    for (pbs_corner &c : corner) memset(c.colour, 255, sizeof c.colour);
    for (uint64_t t = 0; t < p.triangles; t++) {
        if (t % 65536 == 0) check(pbs_run_check(run_, err_));
        uint64_t v[3];
        p.triangle(t, v);
        for (int k = 0; k < 3; k++) load_corner(p, v[k], corner[k]);
        check(sink_->triangle(sink_->ctx, corner, p.material, err_));
    }
}

uint32_t reader::part(int i) {
    if ((size_t)i >= model_.meshes.size())
        fail(err_, PBS_DATA, "mesh %d, but there are %zu", i, model_.meshes.size());
    uint32_t &id = part_id_[(size_t)i];
    if (id != not_yet) return id;
    const tinygltf::Mesh &m = model_.meshes[(size_t)i];
    std::vector<primitive> primitives;
    pbs_box box = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
    uint32_t corners = 0;
    in("mesh", i, m.name, [&] {
        for (size_t k = 0; k < m.primitives.size(); k++)
            in("primitive", (int)k, "", [&] {
                if (skip_mode(m.primitives[k])) return;
                primitive p = open_primitive(m.primitives[k]);
                bound(p, box);
                corners |= (p.normal ? (uint32_t)PBS_CORNER_NORMAL : 0) |
                           (p.uv ? (uint32_t)PBS_CORNER_UV : 0) |
                           (p.colour ? (uint32_t)PBS_CORNER_COLOUR : 0);
                primitives.push_back(std::move(p));
            });
    });
    double origin[3] = {0, 0, 0};
    for (int k = 0; k < 3 && !pbs_box_is_empty(&box); k++)
        origin[k] = box.min[k] / 2 + box.max[k] / 2;
    check(sink_->part_begin(sink_->ctx, m.name.empty() ? nullptr : m.name.c_str(), origin, corners,
                            err_));
    for (const primitive &p : primitives) emit(p);
    check(sink_->part_end(sink_->ctx, &id, err_));
    pbs_run_progress(run_, "reading", (uint64_t)i + 1, model_.meshes.size());
    return id;
}

} // namespace pbs::gltf
