/* gltf.cpp: the module "gltf": glTF 2.0 and GLB by simdjson, tinygltf, Draco and meshoptimizer.
 *
 * One part for a mesh, however many nodes show it; one assembly for a node with several things
 * below; a node with nothing but a mesh is only a placing of its part. Nodes without any geometry
 * below (cameras, lights, bones) leave no trace. Skins show their bind pose, morph targets their
 * base. */
#include "formats/foreign/gltf.hpp"
#include "formats/readers/module.h"
#include <cmath>
#include <cstring>

namespace pbs::gltf {

reader::reader(const char *path, const pbs_sink *sink, pbs_err *err)
    : folder_(path ? path : ""), sink_(sink), run_(sink->run), err_(err), doc_(run_, err),
      image_id_(run_, "the images", err), part_id_(run_, "the meshes", err),
      node_id_(run_, "the nodes", err), materials_(run_, "the materials", err),
      node_state_(run_, "the nodes", err), moves_(run_, "the nodes", err),
      motion_id_(run_, "the motions", err), animation_id_(run_, "the animations", err),
      first_channel_(run_, "the animations", err), channel_(run_, "the animations", err),
      children_(run_, "placings", err), stack_(run_, "nested nodes", err) {
    folder_.erase(folder_.rfind('/') == std::string::npos ? 0 : folder_.rfind('/') + 1);
}

/* Extensions that we read, or that change nothing that we read. */
static bool understood(const std::string &name) {
    static const char *const exact[] = {"KHR_draco_mesh_compression",
                                        "EXT_meshopt_compression",
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
    for (const std::string &name : head_.extensionsRequired)
        if (!understood(name))
            fail(err_, PBS_DATA, "needs the extension %.100s, which is not supported",
                 name.c_str());
}

/* Noise that exporters leave in the last row of a matrix, which is to be 0 0 0 1. */
static const double row_noise = 1e-6;

void reader::local_matrix(int n, double m[12]) {
    const node_entry &node = doc_.nodes[(size_t)n];
    uint32_t at = node.numbers;
    pbs_trs pose = rest_pose(doc_, node);
    if (!(node.has >> MATRIX & 1)) return pbs_trs_matrix(&pose, m);
    for (int p = TRANSLATION; p <= SCALE; p++) at += node.has >> p & 1 ? path_numbers[p] : 0;
    for (uint32_t r = 0; r < 3; r++)
        for (uint32_t c = 0; c < 4; c++) m[4 * r + c] = doc_.numbers[at + 4 * c + r];
    for (uint32_t c = 0; c < 4; c++)
        if (!(fabs(doc_.numbers[at + 4 * c + 3] - (c == 3)) <= row_noise))
            in_place(err_, "node", (size_t)n, doc_.name(node.name), [&] {
                fail(err_, PBS_DATA, "matrix: the last row is not 0 0 0 1: this is no placing");
            });
}

/* EXT_mesh_gpu_instancing: an assembly of as many placings. */
uint32_t reader::instances(int n, const instancing_entry &e, uint32_t part) {
    stream trs[3];
    static const char *const names[] = {"TRANSLATION", "ROTATION", "SCALE"};
    uint64_t count = 0;
    bool any = false;
    forget_views();
    for (int k = 0; k < 3; k++) {
        if (e.accessor[k] == absent) continue;
        trs[k] = open_stream(e.accessor[k]);
        if (trs[k].components != (k == 1 ? 4 : 3) || (any && trs[k].count != count))
            fail(err_, PBS_DATA, "EXT_mesh_gpu_instancing: %s does not fit", names[k]);
        count = trs[k].count;
        any = true;
    }
    array<pbs_child> children(run_, count, "instances", err_);
    for (uint64_t i = 0; i < count; i++) {
        if (i % 65536 == 0) check(pbs_run_check(run_, err_));
        pbs_trs pose = PBS_TRS_IDENTITY;
        double *const to[3] = {pose.translation, pose.rotation, pose.scale};
        for (int k = 0; k < 3; k++)
            if (trs[k]) trs[k].get(i, to[k]);
        pbs_child c = {};
        c.node = part;
        pbs_trs_matrix(&pose, c.m);
        children[i] = c;
    }
    uint32_t id = PBS_NONE;
    check(sink_->assembly(sink_->ctx, doc_.name(doc_.nodes[(size_t)n].name), children.data(), count,
                          &id, err_));
    return id;
}

uint32_t reader::mesh_or_instances(int n) {
    const node_entry &node = doc_.nodes[(size_t)n];
    if (node.mesh < 0) return PBS_NONE;
    uint32_t id = PBS_NONE;
    bool out = left_out([&] {
        id = part(node.mesh);
        if (node.instancing != absent)
            in_place(err_, "node", (size_t)n, doc_.name(node.name),
                     [&] { id = instances(n, doc_.instancing[(size_t)node.instancing], id); });
    });
    return out ? PBS_NONE : id;
}

/* A placing has its node's own name, also where the sink finds out that the assemblies of two
 * nodes are equal and keeps one. */
void reader::add_child(int n) {
    pbs_child c = {};
    c.node = node_id_[(size_t)n];
    if (c.node == PBS_NONE) return;
    c.name = doc_.name(doc_.nodes[(size_t)n].name);
    c.flags = moves_[(size_t)n] ? (uint32_t)PBS_CHILD_MOVES : 0;
    if (left_out([&] { local_matrix(n, c.m); })) return;
    c.motion = c.flags ? motion(n) : 0;
    children_.push(c);
}

/* All below is known: gives the node its id. */
void reader::finish_node(int n) {
    const node_entry &node = doc_.nodes[(size_t)n];
    uint32_t own = mesh_or_instances(n), &id = node_id_[(size_t)n];
    children_.clear();
    if (own != PBS_NONE) {
        pbs_child c = {};
        c.node = own;
        memcpy(c.m, PBS_IDENTITY, sizeof c.m);
        c.name = doc_.name(doc_.meshes[(size_t)node.mesh].name);
        children_.push(c);
    }
    for (uint32_t k = 0; k < node.child_count; k++) add_child(doc_.children[node.first_child + k]);
    id = own;
    if (children_.size() == (own != PBS_NONE)) return;
    check(sink_->assembly(sink_->ctx, doc_.name(node.name), children_.data(), children_.size(), &id,
                          err_));
}

enum { UNSEEN, OPEN, DONE };

void reader::enter(int n, int from) {
    if (n < 0 || (size_t)n >= doc_.nodes.size())
        fail(err_, PBS_DATA, "%s refers to node %d, but there are %zu",
             from < 0 ? "the scene" : ("node " + std::to_string(from)).c_str(), n,
             doc_.nodes.size());
    uint8_t &state = node_state_[(size_t)n];
    if (state == OPEN) fail(err_, PBS_DATA, "node %d: the hierarchy has a cycle", n);
    if (state == UNSEEN) stack_.push({n, 0}), state = OPEN;
}

/* Depth first without recursion: files may be as deep as they like. */
void reader::walk(int root) {
    enter(root, -1);
    while (!stack_.empty()) {
        step &top = stack_.back();
        const node_entry &n = doc_.nodes[(size_t)top.node];
        if (top.next < n.child_count) {
            int parent = top.node;
            enter(doc_.children[n.first_child + top.next++], parent);
            continue;
        }
        finish_node(top.node);
        node_state_[(size_t)top.node] = DONE;
        stack_.pop();
    }
}

/* The default scene, or the first, or without scenes all nodes that are nobody's child. */
void reader::find_roots() {
    if (doc_.scenes) {
        if (head_.defaultScene >= (int64_t)doc_.scenes)
            fail(err_, PBS_DATA, "scene %d, but there are %zu", head_.defaultScene, doc_.scenes);
        return;
    }
    list<uint8_t> child(run_, "the nodes", err_);
    child.assign(doc_.nodes.size(), 0);
    for (int32_t c : doc_.children)
        if (c >= 0 && (size_t)c < child.size()) child[(size_t)c] = 1;
    for (size_t i = 0; i < child.size(); i++)
        if (!child[i]) doc_.roots.push((int32_t)i);
    if (doc_.roots.empty() && !child.empty())
        fail(err_, PBS_DATA, "node 0: the hierarchy has a cycle");
}

/* All that can be said before the first node. */
void reader::begin() {
    parse_head(head_, doc_, err_);
    if (head_.asset.version.compare(0, 2, "2.") != 0)
        fail(err_, PBS_DATA, "glTF version %.20s is not supported, only 2",
             head_.asset.version.c_str());
    refuse_unknown_extensions();
    read_lists(doc_, head_.defaultScene, run_, err_);
    buffers_.resize(doc_.buffers.size());
    image_id_.assign(doc_.images.size(), not_yet);
    materials_.assign(doc_.materials.size(), {not_yet, 0});
    part_id_.assign(doc_.meshes.size(), not_yet);
    node_id_.assign(doc_.nodes.size(), PBS_NONE);
    node_state_.assign(doc_.nodes.size(), UNSEEN);
    mark_moving();
    find_roots();
}

void reader::read(const void *data, size_t size) {
    if (sink_->mapped) doc_.map = {(const uint8_t *)data, size};
    open_container(doc_, data, size, err_);
    try {
        find_lists(doc_, err_);
        counted memory(run_, bytes_for_json * doc_.head.size(), "the scene's JSON", err_);
        begin();
        let_go_of_files();
        for (int32_t n : doc_.roots) walk(n);
        children_.clear();
        for (int32_t n : doc_.roots) add_child(n);
    } catch (const not_json &) {
        std::string text = syntax_error(doc_);
        if (!text.empty()) pbs_fail(err_, PBS_DATA, "%s", text.c_str());
        throw;
    }
    uint32_t id = PBS_NONE;
    check(sink_->assembly(sink_->ctx, doc_.name(doc_.scene_name), children_.data(),
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
