/* gltf.cpp: the module "gltf": glTF 2.0 and GLB by tinygltf and Draco.
 *
 * One part for a mesh, however many nodes show it; one assembly for a node with several things
 * below; a node with nothing but a mesh is only a placing of its part. Nodes without any geometry
 * below (cameras, lights, bones) leave no trace. Skins show their bind pose, morph targets their
 * base. */
#include "formats/foreign/gltf.hpp"
#include "formats/module.h"
#include <algorithm>
#include <cmath>
#include <cstring>

namespace pbs::gltf {

typedef tinygltf::Value value;

reader::reader(const char *path, const pbs_sink *sink, pbs_err *err)
    : folder_(path ? path : ""), sink_(sink), run_(sink->run), err_(err) {
    folder_.erase(folder_.rfind('/') == std::string::npos ? 0 : folder_.rfind('/') + 1);
}

/* Extensions that we read, or that change nothing that we read. */
static bool understood(const std::string &name) {
    static const char *const exact[] = {"KHR_draco_mesh_compression",
                                        "KHR_mesh_quantization",
                                        "KHR_texture_transform",
                                        "EXT_mesh_gpu_instancing",
                                        "KHR_lights_punctual",
                                        "KHR_animation_pointer",
                                        "EXT_texture_webp",
                                        "EXT_texture_avif",
                                        "EXT_mesh_features",
                                        "EXT_structural_metadata",
                                        "EXT_instance_features",
                                        "CESIUM_primitive_outline",
                                        "EXT_lights_image_based",
                                        "EXT_lights_ies",
                                        "KHR_audio",
                                        "KHR_node_selectability",
                                        "KHR_node_hoverability",
                                        "KHR_xmp_json_ld",
                                        "KHR_xmp"};
    for (const char *e : exact)
        if (name == e) return true;
    return name.compare(0, 14, "KHR_materials_") == 0;
}

void reader::refuse_unknown_extensions() {
    for (const std::string &name : model_.extensionsRequired)
        if (!understood(name))
            fail(err_, PBS_DATA, "needs the extension %.100s, which is not supported",
                 name.c_str());
}

void reader::mark_moving() {
    moves_.assign(model_.nodes.size(), 0);
    for (const tinygltf::Animation &a : model_.animations)
        for (const tinygltf::AnimationChannel &c : a.channels) {
            bool rigid = c.target_path == "translation" || c.target_path == "rotation" ||
                         c.target_path == "scale";
            if (rigid && c.target_node >= 0 && (size_t)c.target_node < moves_.size())
                moves_[(size_t)c.target_node] = 1;
        }
}

static void copy_numbers(const std::vector<double> &from, size_t n, const char *what, double *to,
                         pbs_err *err) {
    if (from.empty()) return;
    if (from.size() != n) fail(err, PBS_DATA, "%s has %zu numbers", what, from.size());
    std::copy(from.begin(), from.end(), to);
}

/* translation, rotation (x y z w, any length) and scale as three rows of a matrix. */
static void from_trs(double m[12], const double t[3], const double r[4], const double s[3]) {
    double l = sqrt(r[0] * r[0] + r[1] * r[1] + r[2] * r[2] + r[3] * r[3]);
    double i = l > 0 ? 1 / l : 1;
    double x = r[0] * i, y = r[1] * i, z = r[2] * i, w = r[3] * i;
    double q[9] = {1 - 2 * (y * y + z * z), 2 * (x * y - z * w),     2 * (x * z + y * w),
                   2 * (x * y + z * w),     1 - 2 * (x * x + z * z), 2 * (y * z - x * w),
                   2 * (x * z - y * w),     2 * (y * z + x * w),     1 - 2 * (x * x + y * y)};
    for (int row = 0; row < 3; row++) {
        for (int c = 0; c < 3; c++) m[4 * row + c] = q[3 * row + c] * s[c];
        m[4 * row + 3] = t[row];
    }
}

void reader::local_matrix(int n, double m[12]) {
    const tinygltf::Node &node = model_.nodes[(size_t)n];
    in("node", n, node.name, [&] {
        if (!node.matrix.empty()) {
            double columns[16];
            copy_numbers(node.matrix, 16, "matrix", columns, err_);
            for (int r = 0; r < 3; r++)
                for (int c = 0; c < 4; c++) m[4 * r + c] = columns[4 * c + r];
            return;
        }
        double t[3] = {0, 0, 0}, r[4] = {0, 0, 0, 1}, s[3] = {1, 1, 1};
        copy_numbers(node.translation, 3, "translation", t, err_);
        copy_numbers(node.rotation, 4, "rotation", r, err_);
        copy_numbers(node.scale, 3, "scale", s, err_);
        from_trs(m, t, r, s);
    });
}

/* EXT_mesh_gpu_instancing: an assembly of as many placings. */
uint32_t reader::instances(int n, const value &ext, uint32_t part) {
    const value &list = ext.IsObject() ? ext.Get("attributes") : ext;
    stream trs[3];
    static const char *const names[] = {"TRANSLATION", "ROTATION", "SCALE"};
    uint64_t count = 0;
    bool any = false;
    for (int k = 0; k < 3 && list.IsObject(); k++) {
        if (!list.Has(names[k])) continue;
        const value &accessor = list.Get(names[k]);
        trs[k] = open_stream(accessor.IsInt() ? accessor.GetNumberAsInt() : -1);
        if (trs[k].components != (k == 1 ? 4 : 3) || (any && trs[k].count != count))
            fail(err_, PBS_DATA, "EXT_mesh_gpu_instancing: %s does not fit", names[k]);
        count = trs[k].count;
        any = true;
    }
    if (!any) return part;
    array<pbs_child> children(run_, count, "instances", err_);
    for (uint64_t i = 0; i < count; i++) {
        double v[3][4] = {{0, 0, 0, 0}, {0, 0, 0, 1}, {1, 1, 1, 0}};
        for (int k = 0; k < 3; k++)
            if (trs[k]) trs[k].get(i, v[k]);
        pbs_child c = {};
        c.node = part;
        from_trs(c.m, v[0], v[1], v[2]);
        children[i] = c;
    }
    const std::string &name = model_.nodes[(size_t)n].name;
    uint32_t id = PBS_NONE;
    check(sink_->assembly(sink_->ctx, name.empty() ? nullptr : name.c_str(), children.data(), count,
                          &id, err_));
    return id;
}

uint32_t reader::mesh_or_instances(int n) {
    const tinygltf::Node &node = model_.nodes[(size_t)n];
    if (node.mesh < 0) return PBS_NONE;
    uint32_t id = part(node.mesh);
    auto it = node.extensions.find("EXT_mesh_gpu_instancing");
    if (it != node.extensions.end())
        in("node", n, node.name, [&] { id = instances(n, it->second, id); });
    return id;
}

pbs_child reader::child_of(int n) {
    pbs_child c = {};
    const std::string &name = model_.nodes[(size_t)n].name;
    c.node = node_id_[(size_t)n];
    c.name = name.empty() ? nullptr : name.c_str();
    c.flags = moves_[(size_t)n] ? (uint32_t)PBS_CHILD_MOVES : 0;
    local_matrix(n, c.m);
    return c;
}

/* All below is known: gives the node its id. */
void reader::finish_node(int n) {
    const tinygltf::Node &node = model_.nodes[(size_t)n];
    uint32_t own = mesh_or_instances(n), &id = node_id_[(size_t)n];
    children_.clear();
    for (int c : node.children)
        if (node_id_[(size_t)c] != PBS_NONE) children_.push_back(child_of(c));
    id = own;
    if (children_.empty()) return;
    if (own != PBS_NONE) {
        pbs_child c = {};
        c.node = own;
        memcpy(c.m, PBS_IDENTITY, sizeof c.m);
        const std::string &name = model_.meshes[(size_t)node.mesh].name;
        c.name = name.empty() ? nullptr : name.c_str();
        children_.insert(children_.begin(), c);
    }
    check(sink_->assembly(sink_->ctx, node.name.empty() ? nullptr : node.name.c_str(),
                          children_.data(), children_.size(), &id, err_));
}

/* Depth first without recursion: files may be as deep as they like. */
void reader::walk(int root) {
    enum { unseen, open, done };
    struct step {
        int node;
        size_t next;
    };
    std::vector<step> stack;
    auto enter = [&](int n, int from) {
        if (n < 0 || (size_t)n >= model_.nodes.size())
            fail(err_, PBS_DATA, "%s refers to node %d, but there are %zu",
                 from < 0 ? "the scene" : ("node " + std::to_string(from)).c_str(), n,
                 model_.nodes.size());
        uint8_t &state = node_state_[(size_t)n];
        if (state == open) fail(err_, PBS_DATA, "node %d: the hierarchy has a cycle", n);
        if (state == unseen) stack.push_back({n, 0}), state = open;
    };
    enter(root, -1);
    while (!stack.empty()) {
        step &top = stack.back();
        const std::vector<int> &children = model_.nodes[(size_t)top.node].children;
        if (top.next < children.size()) {
            enter(children[top.next++], top.node);
            continue;
        }
        finish_node(top.node);
        node_state_[(size_t)top.node] = done;
        stack.pop_back();
    }
}

/* The default scene, or the first, or without scenes all nodes that are nobody's child. */
std::vector<int> reader::root_nodes(std::string &name) {
    int s = model_.defaultScene;
    if (!model_.scenes.empty()) {
        if (s >= (int)model_.scenes.size())
            fail(err_, PBS_DATA, "scene %d, but there are %zu", s, model_.scenes.size());
        const tinygltf::Scene &scene = model_.scenes[s < 0 ? 0 : (size_t)s];
        name = scene.name;
        return scene.nodes;
    }
    std::vector<uint8_t> child(model_.nodes.size());
    for (const tinygltf::Node &n : model_.nodes)
        for (int c : n.children)
            if (c >= 0 && (size_t)c < child.size()) child[(size_t)c] = 1;
    std::vector<int> roots;
    for (size_t i = 0; i < child.size(); i++)
        if (!child[i]) roots.push_back((int)i);
    if (roots.empty() && !child.empty()) fail(err_, PBS_DATA, "node 0: the hierarchy has a cycle");
    return roots;
}

/* What the JSON text costs as a tree and then as tinygltf's structures, measured. */
static const size_t bytes_for_json = 15;

void reader::read(const void *data, size_t size) {
    open_container(doc_, data, size, err_);
    try {
        split_json(doc_, err_);
    } catch (const failure &) {
        std::string text = syntax_error(doc_);
        if (!text.empty()) pbs_fail(err_, PBS_DATA, "%s", text.c_str());
        throw;
    }
    counted memory(run_, (bytes_for_json + 1) * doc_.slim.size(), "the scene's JSON", err_);
    parse(model_, doc_, err_);
    view_count_ = (int)doc_.views;
    if (model_.asset.version.compare(0, 2, "2.") != 0)
        fail(err_, PBS_DATA, "glTF version %.20s is not supported, only 2",
             model_.asset.version.c_str());
    refuse_unknown_extensions();
    mark_moving();
    buffers_.resize(doc_.buffers.size());
    image_id_.assign(doc_.images.size(), not_yet);
    material_id_.assign(model_.materials.size(), not_yet);
    part_id_.assign(model_.meshes.size(), not_yet);
    node_id_.assign(model_.nodes.size(), PBS_NONE);
    node_state_.assign(model_.nodes.size(), 0);

    std::string name;
    std::vector<int> roots = root_nodes(name);
    for (int n : roots) walk(n);
    children_.clear();
    for (int n : roots)
        if (node_id_[(size_t)n] != PBS_NONE) children_.push_back(child_of(n));
    uint32_t id = PBS_NONE;
    check(sink_->assembly(sink_->ctx, name.empty() ? nullptr : name.c_str(), children_.data(),
                          children_.size(), &id, err_));
    check(sink_->root(sink_->ctx, id, err_));
}

static pbs_code import(const char *path, const void *data, size_t size, const pbs_sink *sink,
                       pbs_err *err) {
    pbs_err local;
    pbs_err *e = err ? err : &local;
    return guard(e, [&] { reader(path, sink, e).read(data, size); });
}

} // namespace pbs::gltf

extern "C" __attribute__((visibility("default")))
const pbs_module_gltf pbs_module = {PBS_MODULE_ABI, pbs::gltf::import};
