/* gltf_table.cpp: one object of the JSON to one line of a table. */
#include "formats/foreign/gltf_table.hpp"
#include "libcore/data/motion.h"

namespace pbs::gltf {

/* A member that is there and not null. */
static bool find(json_object o, const char *key, json_value &out) {
    return !o[key].get(out) && !out.is_null();
}

/* Some writers have one kind of number and write 3.0 for 3. */
static bool whole(json_value v, int64_t &out) {
    double d;
    if (!v.get(out)) return true;
    if (!v.is_double() || v.get(d) || !(d >= -9e15 && d <= 9e15)) return false;
    out = (int64_t)d;
    return (double)out == d;
}

static int32_t index_of(json_value v, const char *what, pbs_err *err) {
    int64_t i;
    if (!whole(v, i) || i > INT32_MAX || i <= absent)
        fail(err, PBS_DATA, "%.40s is not an index", what);
    return (int32_t)i;
}

int32_t table::index(json_object o, const char *key, int32_t otherwise) {
    json_value v;
    return find(o, key, v) ? index_of(v, key, err_) : otherwise;
}

uint64_t table::size(json_object o, const char *key, uint64_t otherwise) {
    json_value v;
    uint64_t n;
    int64_t i;
    if (!find(o, key, v)) return otherwise;
    if (!v.get(n)) return n;
    if (!whole(v, i)) fail(err_, PBS_DATA, "%s is not a whole number", key);
    if (i < 0) fail(err_, PBS_DATA, "%s is negative", key);
    return (uint64_t)i;
}

uint32_t table::name(json_object o) {
    json_value v;
    std::string_view text;
    return find(o, "name", v) && !v.get(text) ? doc_.add_name(text) : no_name;
}

bool table::object(json_object o, const char *key, json_object &out) {
    json_value v;
    if (!find(o, key, v)) return false;
    if (v.get(out)) fail(err_, PBS_DATA, "%s is not an object", key);
    return true;
}

bool table::extension(json_object o, const char *key, json_object &out) {
    json_object all;
    return object(o, "extensions", all) && object(all, key, out);
}

/* One of a list of words that ends with NULL; -1: another one. */
static int word(json_object o, const char *key, const char *const *words, int otherwise,
                std::string_view &text) {
    json_value v;
    if (!find(o, key, v)) return otherwise;
    if (v.get(text)) text = "?";
    for (int i = 0; words[i]; i++)
        if (text == words[i]) return i;
    return -1;
}

void table::add_view(json_object o, size_t i) {
    in_place(err_, "bufferView", i, nullptr, [&] {
        view_entry v = {};
        v.buffer = index(o, "buffer", -1);
        v.offset = size(o, "byteOffset");
        v.length = size(o, "byteLength");
        v.stride = index(o, "byteStride", 0);
        v.meshopt = absent;
        json_object compressed;
        if (extension(o, "EXT_meshopt_compression", compressed)) add_meshopt(compressed, v);
        doc_.views.push(v);
    });
}

void table::add_meshopt(json_object o, view_entry &v) {
    static const char *const modes[] = {"ATTRIBUTES", "TRIANGLES", "INDICES", nullptr};
    static const char *const filters[] = {"NONE", "OCTAHEDRAL", "QUATERNION", "EXPONENTIAL",
                                          nullptr};
    std::string_view mode_text = "missing", filter_text;
    int mode = word(o, "mode", modes, -1, mode_text);
    int filter = word(o, "filter", filters, NO_FILTER, filter_text);
    if (mode < 0)
        fail(err_, PBS_DATA, "EXT_meshopt_compression: mode %.40s", std::string(mode_text).c_str());
    if (filter < 0)
        fail(err_, PBS_DATA, "EXT_meshopt_compression: filter %.40s",
             std::string(filter_text).c_str());
    meshopt_entry e = {};
    e.buffer = index(o, "buffer", -1);
    e.offset = size(o, "byteOffset");
    e.length = size(o, "byteLength");
    e.stride = size(o, "byteStride");
    e.count = size(o, "count");
    e.mode = (uint8_t)mode;
    e.filter = (uint8_t)filter;
    v.meshopt = (int32_t)doc_.meshopt.push(e);
}

void table::add_accessor(json_object o, size_t i) {
    static const char *const types[] = {"SCALAR", "VEC2", "VEC3", "VEC4",
                                        "MAT2",   "MAT3", "MAT4", nullptr};
    static const uint8_t components[] = {1, 2, 3, 4, 4, 9, 16};
    in_place(err_, "accessor", i, nullptr, [&] {
        accessor_entry a = {};
        std::string_view text = "missing";
        int type = word(o, "type", types, -1, text);
        if (type < 0) fail(err_, PBS_DATA, "type %.40s", std::string(text).c_str());
        json_value v;
        if (find(o, "normalized", v) && v.get(a.normalized))
            fail(err_, PBS_DATA, "normalized is neither true nor false");
        a.view = index(o, "bufferView");
        a.offset = size(o, "byteOffset");
        a.count = size(o, "count");
        a.type = index(o, "componentType", 0);
        a.components = components[type];
        a.sparse = absent;
        json_object sparse;
        if (object(o, "sparse", sparse)) add_sparse(sparse, a);
        doc_.accessors.push(a);
    });
}

void table::add_sparse(json_object o, accessor_entry &a) {
    json_object where, values;
    if (!object(o, "indices", where) || !object(o, "values", values))
        fail(err_, PBS_DATA, "sparse is not complete");
    sparse_entry s = {};
    s.count = size(o, "count");
    s.where_view = index(where, "bufferView", -1);
    s.where_offset = size(where, "byteOffset");
    s.where_type = index(where, "componentType", 0);
    s.values_view = index(values, "bufferView", -1);
    s.values_offset = size(values, "byteOffset");
    a.sparse = (int32_t)doc_.sparse.push(s);
}

void table::add_mesh(json_object o, size_t i) {
    mesh_entry m = {name(o), (uint32_t)doc_.primitives.size(), 0};
    in_place(err_, "mesh", i, doc_.name(m.name), [&] {
        json_value v;
        simdjson::dom::array list;
        if (!find(o, "primitives", v)) return;
        if (v.get(list)) fail(err_, PBS_DATA, "primitives is not a list");
        for (json_value p : list)
            in_place(err_, "primitive", m.count, nullptr, [&] {
                json_object primitive;
                if (p.get(primitive)) fail(err_, PBS_DATA, "not an object");
                add_primitive(primitive);
                m.count++;
            });
    });
    doc_.meshes.push(m);
}

void table::add_primitive(json_object o) {
    json_object list, draco, ids;
    primitive_entry p = {};
    p.mode = index(o, "mode", 4);
    p.indices = index(o, "indices");
    p.material = index(o, "material");
    p.draco_view = absent;
    p.first = (uint32_t)doc_.attributes.size();
    if (!object(o, "attributes", list)) fail(err_, PBS_DATA, "attributes are missing");
    bool compressed = extension(o, "KHR_draco_mesh_compression", draco);
    if (compressed) {
        p.draco_view = index(draco, "bufferView");
        if (p.draco_view == absent || !object(draco, "attributes", ids))
            fail(err_, PBS_DATA, "KHR_draco_mesh_compression is not complete");
    }
    add_attributes(list, compressed ? &ids : nullptr);
    p.count = (uint32_t)doc_.attributes.size() - p.first;
    doc_.primitives.push(p);
}

static bool semantic_of(std::string_view key, int32_t &out) {
    if (key == "POSITION") return out = POSITION, true;
    if (key == "NORMAL") return out = NORMAL, true;
    if (key == "COLOR_0") return out = COLOR_0, true;
    if (key.substr(0, 9) != "TEXCOORD_" || key.size() < 10 || key.size() > 13) return false;
    out = 0;
    for (char c : key.substr(9)) {
        if (c < '0' || c > '9') return false;
        out = out * 10 + (c - '0');
    }
    return true;
}

void table::add_attributes(json_object list, const json_object *draco) {
    for (auto member : list) {
        attribute_entry a = {0, 0, absent};
        if (!semantic_of(member.key, a.semantic)) continue;
        std::string key(member.key);
        a.accessor = index_of(member.value, ("attributes: " + key).c_str(), err_);
        if (draco) a.draco = index(*draco, key.c_str());
        doc_.attributes.push(a);
    }
}

void table::add_node(json_object o, size_t i) {
    static const char *const keys[] = {"translation", "rotation", "scale", "matrix"};
    node_entry n = {};
    n.name = name(o);
    in_place(err_, "node", i, doc_.name(n.name), [&] {
        n.mesh = index(o, "mesh");
        n.numbers = (uint32_t)doc_.numbers.size();
        for (int p = TRANSLATION; p <= MATRIX; p++) add_numbers(o, keys[p], (path)p, n);
        add_children(o, n);
        add_instancing(o, n);
    });
    doc_.nodes.push(n);
}

void table::add_numbers(json_object o, const char *key, path p, node_entry &n) {
    json_value v;
    simdjson::dom::array list;
    if (!find(o, key, v)) return;
    if (v.get(list)) fail(err_, PBS_DATA, "%s is not a list", key);
    if (list.size() == 0) return;
    if (list.size() != path_numbers[p])
        fail(err_, PBS_DATA, "%s has %zu numbers", key, list.size());
    uint32_t at = doc_.numbers.grow(path_numbers[p]);
    for (json_value number : list)
        if (number.get(doc_.numbers[at++]))
            fail(err_, PBS_DATA, "%s has something that is not a number", key);
    n.has |= 1u << p;
}

void table::add_children(json_object o, node_entry &n) {
    json_value v;
    simdjson::dom::array list;
    n.first_child = (uint32_t)doc_.children.size();
    if (!find(o, "children", v)) return;
    if (v.get(list)) fail(err_, PBS_DATA, "children is not a list");
    for (json_value c : list) doc_.children.push(index_of(c, "a child", err_));
    n.child_count = (uint32_t)doc_.children.size() - n.first_child;
}

void table::add_instancing(json_object o, node_entry &n) {
    static const char *const keys[] = {"TRANSLATION", "ROTATION", "SCALE"};
    json_object ext, list;
    n.instancing = absent;
    if (!extension(o, "EXT_mesh_gpu_instancing", ext) || !object(ext, "attributes", list)) return;
    instancing_entry e;
    bool any = false;
    for (int k = 0; k < 3; k++) {
        e.accessor[k] = index(list, keys[k]);
        any |= e.accessor[k] != absent;
    }
    if (any) n.instancing = (int32_t)doc_.instancing.push(e);
}

void table::add_scene(json_object o) {
    doc_.scene_name = name(o);
    json_value v;
    simdjson::dom::array list;
    if (!find(o, "nodes", v)) return;
    if (v.get(list)) fail(err_, PBS_DATA, "the scene's nodes are not a list");
    for (json_value n : list) doc_.roots.push(index_of(n, "a node of the scene", err_));
}

void table::add_sampler(json_object o) {
    json_value v;
    std::string_view text;
    uint8_t way = PBS_MOTION_LINEAR;
    if (find(o, "interpolation", v) && !v.get(text)) {
        if (text == "STEP") way = PBS_MOTION_STEP;
        if (text == "CUBICSPLINE") way = PBS_MOTION_CUBIC;
    }
    samplers_.push({index(o, "input"), index(o, "output"), way});
}

/* "/nodes/7/rotation" */
static bool pointed_at(std::string_view text, int32_t &node, std::string_view &what) {
    if (text.substr(0, 7) != "/nodes/") return false;
    text.remove_prefix(7);
    size_t slash = text.find('/');
    if (slash == text.npos || slash == 0 || slash > 9) return false;
    node = 0;
    for (char c : text.substr(0, slash)) {
        if (c < '0' || c > '9') return false;
        node = node * 10 + (c - '0');
    }
    what = text.substr(slash + 1);
    return true;
}

void table::add_channel(json_object o) {
    static const char *const paths[] = {"translation", "rotation", "scale"};
    json_object target, ext;
    json_value v;
    std::string_view what, text;
    if (!object(o, "target", target)) return;
    int32_t node = index(target, "node"), sampler = index(o, "sampler");
    if (find(target, "path", v) && v.get(what)) return;
    if (extension(target, "KHR_animation_pointer", ext) &&
        !(find(ext, "pointer", v) && !v.get(text) && pointed_at(text, node, what)))
        return;
    for (int k = 0; k < 3; k++)
        if (what == paths[k] && node >= 0) {
            sampler_entry s = {absent, absent, PBS_MOTION_LINEAR};
            if (sampler >= 0 && (size_t)sampler < samplers_.size()) s = samplers_[(size_t)sampler];
            doc_.channels.push({node, s.input, s.output, (uint32_t)doc_.animations.size() - 1,
                                (uint8_t)k, s.way, false});
        }
}

} // namespace pbs::gltf
