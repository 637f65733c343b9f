/* gltf_mesh.cpp: a mesh becomes one part, its primitives become triangles. */
#include "formats/foreign/gltf.hpp"
#include <algorithm>
#include <cmath>
#include <cstring>

namespace pbs::gltf {

typedef unsigned long long ull;

/* So many are read between two looks at what was read. */
static const uint64_t block = 4096;

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

const attribute_entry *reader::find_attribute(const primitive_entry &p, int semantic) const {
    for (uint32_t k = p.first; k < p.first + p.count; k++)
        if (doc_.attributes[k].semantic == semantic) return &doc_.attributes[k];
    return nullptr;
}

uint64_t reader::corner_count(const primitive_entry &p) {
    if (p.indices >= 0) return open_stream(p.indices).count;
    const attribute_entry *position = find_attribute(p, POSITION);
    return position ? open_stream(position->accessor).count : 0;
}

/* What is not triangles is counted; true if p is such. */
bool reader::skip_mode(const primitive_entry &p) {
    if (p.mode < 0 || p.mode > TINYGLTF_MODE_TRIANGLE_FAN)
        fail(err_, PBS_DATA, "mode %d is not known", p.mode);
    if (p.mode >= TINYGLTF_MODE_TRIANGLES && find_attribute(p, POSITION)) return false;
    forget_views();
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

static std::string semantic_name(int semantic) {
    if (semantic >= 0) return "TEXCOORD_" + std::to_string(semantic);
    return semantic == POSITION ? "POSITION" : semantic == NORMAL ? "NORMAL" : "COLOR_0";
}

stream reader::attribute(const primitive_entry &p, int semantic, int components,
                         uint64_t vertices) {
    const attribute_entry *a = find_attribute(p, semantic);
    if (!a) return stream();
    stream s = open_stream(a->accessor);
    bool colour = semantic == COLOR_0 && s.components == 4;
    if (s.components != components && !colour)
        fail(err_, PBS_DATA, "%s has %d components", semantic_name(semantic).c_str(), s.components);
    if (s.count < vertices)
        fail(err_, PBS_DATA, "%s has %llu elements, POSITION has %llu",
             semantic_name(semantic).c_str(), (ull)s.count, (ull)vertices);
    return s;
}

primitive reader::open_primitive(const primitive_entry &p) {
    primitive out;
    out.mode = p.mode;
    forget_views();
    out.position = attribute(p, POSITION, 3, 0);
    const known_material m = material(p.material);
    out.material = m.id;
    uint64_t vertices = out.position.count;
    out.normal = attribute(p, NORMAL, 3, vertices);
    if (m.set >= 0) out.uv = attribute(p, m.set, 2, vertices);
    out.colour = attribute(p, COLOR_0, 3, vertices);
    if (p.indices >= 0) {
        out.index = open_stream(p.indices);
        if (out.index.components != 1 || out.index.normalized ||
            (out.index.type != TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE &&
             out.index.type != TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT &&
             out.index.type != TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT))
            fail(err_, PBS_DATA, "indices are not unsigned integers");
    }
    if (p.draco_view != absent) decode_draco(p, m.set, out);

    uint64_t n = out.index ? out.index.count : out.position.count;
    bool triples = out.mode == TINYGLTF_MODE_TRIANGLES;
    out.triangles = triples ? n / 3 : n >= 3 ? n - 2 : 0;
    out.corners = triples ? 3 * out.triangles : out.triangles ? n : 0;
    out.torn = triples ? n % 3 : n > 0 && n < 3;
    return out;
}

/* Extends box by all corners that are finite, and checks the indices on the way: an error is
 * found before the part begins. */
void reader::bound(const primitive &p, pbs_box &box) {
    for (uint64_t i = 0; i < p.corners; i++) {
        if (i % 65536 == 0) check(pbs_run_check(run_, err_));
        if (i % block == 0)
            touch(std::min(block, p.corners - i) * (p.position.element + p.index.element));
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
        if (t % block == 0) touch(3 * std::min(block, p.triangles - t) * p.corner_bytes());
        uint64_t v[3];
        p.triangle(t, v);
        for (int k = 0; k < 3; k++) load_corner(p, v[k], corner[k]);
        check(sink_->triangle(sink_->ctx, corner, p.material, err_));
    }
}

/* What a first look over a mesh finds out. Decoded primitives are kept from it to the writing up to
 * so many bytes, or a sixteenth of what is left; the others are decoded twice, so that a mesh never
 * lies decoded in memory as a whole. */
static const uint64_t keep_decoded = 32 << 20;

struct reader::survey {
    survey(pbs_run *run, pbs_err *err) : drawn(run, "the primitives", err) {}
    pbs_box box = {{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}};
    uint32_t corners = 0; /* attributes */
    list<uint8_t> drawn;  /* 1: has triangles */
    std::vector<std::pair<uint32_t, primitive>> kept;
    uint64_t kept_bytes = 0;
};

void reader::look_at(const primitive_entry &e, uint32_t place, survey &s) {
    if (skip_mode(e)) return;
    primitive p = open_primitive(e);
    pbs_box box = s.box; /* a primitive that is left out has no part in it */
    bound(p, box);
    s.box = box;
    s.drawn[place] = 1;
    if (p.torn) sink_->skip(sink_->ctx, PBS_SKIP_POLYGON, 1);
    s.corners |= (p.normal ? (uint32_t)PBS_CORNER_NORMAL : 0) |
                 (p.uv ? (uint32_t)PBS_CORNER_UV : 0) |
                 (p.colour ? (uint32_t)PBS_CORNER_COLOUR : 0);
    /* What lies in a decoded view may be gone later. */
    if (!p.owned_bytes || !doc_.meshopt.empty() || s.kept_bytes + p.owned_bytes > keep_decoded ||
        p.owned_bytes > pbs_mem_left(run_) / 16)
        return;
    s.kept_bytes += p.owned_bytes;
    s.kept.emplace_back(place, std::move(p));
}

uint32_t reader::part(int i) {
    if (i < 0 || (size_t)i >= doc_.meshes.size())
        fail(err_, PBS_DATA, "mesh %d, but there are %zu", i, doc_.meshes.size());
    uint32_t &id = part_id_[(size_t)i];
    if (id != not_yet) return id;
    const mesh_entry m = doc_.meshes[(size_t)i];
    const char *name = doc_.name(m.name);
    auto at = [&](uint32_t k, auto f) {
        in_place(err_, "mesh", (size_t)i, name, [&] {
            in_place(err_, "primitive", k, nullptr, [&] { f(doc_.primitives[m.first + k]); });
        });
    };
    survey s(run_, err_);
    s.drawn.assign(m.count, 0);
    for (uint32_t k = 0; k < m.count; k++)
        left_out([&] { at(k, [&](const primitive_entry &e) { look_at(e, k, s); }); });
    double origin[3] = {0, 0, 0};
    for (int k = 0; k < 3 && !pbs_box_is_empty(&s.box); k++)
        origin[k] = s.box.min[k] / 2 + s.box.max[k] / 2;
    check(sink_->part_begin(sink_->ctx, name, origin, s.corners, err_));
    size_t next = 0;
    for (uint32_t k = 0; k < m.count; k++)
        at(k, [&](const primitive_entry &e) {
            if (next < s.kept.size() && s.kept[next].first == k)
                emit(s.kept[next++].second);
            else if (s.drawn[k])
                emit(open_primitive(e));
        });
    check(sink_->part_end(sink_->ctx, &id, err_));
    pbs_run_progress(run_, "reading", (uint64_t)i + 1, doc_.meshes.size());
    return id;
}

} // namespace pbs::gltf
