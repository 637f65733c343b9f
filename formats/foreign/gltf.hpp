/* gltf.hpp: what the files of the module "gltf" share.
 *
 * tinygltf keeps the whole file and a copy of every buffer in memory, so it is given the JSON
 * only, without buffers and images (gltf_json.cpp); vertices are read from the mapped files in
 * place (gltf_data.cpp). Every offset, count and length in a file is somebody else's claim:
 * reader::slice() is the only way from a number in the JSON to a pointer. */
#ifndef PBS_GLTF_HPP
#define PBS_GLTF_HPP

#define TINYGLTF_NO_STB_IMAGE
#define TINYGLTF_NO_STB_IMAGE_WRITE
#define TINYGLTF_NO_EXTERNAL_IMAGE
#define TINYGLTF_NO_FS
#include <tiny_gltf.h>

#include "formats/foreign/guard.hpp"
#include "formats/sink.h"
#include <string>
#include <string_view>
#include <vector>

namespace pbs::gltf {

struct bytes {
    const uint8_t *data = nullptr;
    uint64_t size = 0;
};

/* A file mapped read-only. */
class mapping {
  public:
    mapping() = default;
    mapping(mapping &&o) noexcept { std::swap(view_, o.view_); }
    mapping(const mapping &) = delete;
    mapping &operator=(const mapping &) = delete;
    ~mapping();
    /* False, with errno, if it cannot be opened or is not a plain file. */
    bool open(const std::string &path);
    bytes view() const { return view_; }

  private:
    bytes view_;
};

/* The members of "buffers" and "images" that count; views into the mapped file. uri is the JSON
 * string as written, escapes and all, because a data URI may be as large as the file. */
struct buffer_entry {
    std::string_view uri;
    bool has_uri = false, fallback = false;
    uint64_t length = 0;
};
struct image_entry {
    std::string_view uri;
    bool has_uri = false;
    int view = -1;
    std::string name;
};

/* gltf_json.cpp */
struct document {
    std::string_view json; /* of the whole file */
    bytes bin;             /* of a GLB */
    std::string slim;      /* JSON for tinygltf: no buffers, no images, nothing that nobody reads */
    size_t views = 0, accessors = 0, nodes = 0, meshes = 0; /* their numbers */
    std::vector<buffer_entry> buffers;
    std::vector<image_entry> images;
};
/* Takes the container apart. */
void open_container(document &doc, const void *data, size_t size, pbs_err *err);
/* Fills slim, buffers, images. tinygltf refuses an accessor of indices that has no bufferView,
 * which Draco files have: slim gets one more bufferView, and such accessors point to it. */
void split_json(document &doc, pbs_err *err);
std::string unescape(std::string_view raw);
bool is_data_uri(std::string_view raw);
/* The decoded bytes of a data URI. */
array<uint8_t> decode_data_uri(pbs_run *run, std::string_view raw, uint64_t *size, pbs_err *err);

/* gltf_parse.cpp: tinygltf itself. */
void parse(tinygltf::Model &model, const document &doc, pbs_err *err);
/* What is wrong with the JSON of the file, with line and column; empty: nothing. */
std::string syntax_error(const document &doc);

/* The elements of an accessor, wherever and in whatever form they lie. */
struct stream {
    const uint8_t *data = nullptr;
    uint64_t stride = 0, count = 0;
    int type = 0, components = 0;
    bool normalized = false;
    /* sparse: element where[j] is values[j] */
    const uint8_t *where = nullptr, *values = nullptr;
    uint64_t sparse_count = 0;
    int where_type = 0;
    uint32_t element = 0; /* bytes of one */

    explicit operator bool() const { return data != nullptr; }
    const uint8_t *at(uint64_t i) const;
    /* components numbers; the rest of out is left alone */
    void get(uint64_t i, double *out) const;
};
uint32_t component_size(int type);
/* An unsigned integer, for indices. */
inline uint32_t load_index(const uint8_t *p, int type) {
    if (type == TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT) {
        uint16_t v;
        memcpy(&v, p, sizeof v);
        return v;
    }
    if (type == TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE) return *p;
    uint32_t v;
    memcpy(&v, p, sizeof v);
    return v;
}

/* What a primitive needs from the JSON, ready to be walked. */
struct primitive {
    stream index, position, normal, uv, colour;
    std::vector<array<uint8_t>> owned; /* where decoded streams lie */
    int mode = 0;
    uint32_t material = PBS_NONE;
    uint64_t corners = 0, triangles = 0; /* corners: those that triangles use */

    uint64_t corner(uint64_t i) const { return index ? load_index(index.at(i), index.type) : i; }
    /* The three corners of triangle t. */
    void triangle(uint64_t t, uint64_t out[3]) const;
};

class reader {
  public:
    reader(const char *path, const pbs_sink *sink, pbs_err *err);
    void read(const void *data, size_t size);

  private:
    /* gltf.cpp: the hierarchy */
    void refuse_unknown_extensions();
    void mark_moving();
    std::vector<int> root_nodes(std::string &name);
    void walk(int root);
    void finish_node(int n);
    pbs_child child_of(int n);
    uint32_t mesh_or_instances(int n);
    uint32_t instances(int n, const tinygltf::Value &ext, uint32_t part);
    void local_matrix(int n, double m[12]);

    /* gltf_data.cpp */
    const bytes &buffer(int i);
    bytes slice(int view, uint64_t offset, uint64_t length);
    stream open_stream(int accessor);
    void open_sparse(stream &s, const tinygltf::Accessor &a);
    bool find_file(const std::string &uri, mapping &file);

    /* gltf_material.cpp */
    uint32_t material(int i);
    int uv_set(int material);
    struct texture_slot;
    pbs_texture_use texture_use(const texture_slot &slot, int set);
    uint32_t image(int i);
    uint32_t image_of_texture(const tinygltf::Texture &t);

    /* gltf_mesh.cpp */
    uint32_t part(int mesh);
    primitive open_primitive(const tinygltf::Primitive &p);
    stream attribute(const tinygltf::Primitive &p, const char *name, int components,
                     uint64_t vertices);
    bool skip_mode(const tinygltf::Primitive &p);
    uint64_t corner_count(const tinygltf::Primitive &p);
    void bound(const primitive &p, pbs_box &box);
    void emit(const primitive &p);

    /* gltf_draco.cpp */
    void decode_draco(const tinygltf::Primitive &p, const tinygltf::Value &ext, primitive &out);

    /* Runs body; an error of the file that it meets gets the place in front. */
    template <class F> void in(const char *what, int i, const std::string &name, F body) {
        try {
            body();
        } catch (const failure &e) {
            if (e.code != PBS_DATA) throw;
            if (name.empty())
                pbs_fail_in(err_, "%s %d", what, i);
            else
                pbs_fail_in(err_, "%s %d (%.100s)", what, i, name.c_str());
            throw;
        }
    }

    std::string folder_; /* of the file, with the slash */
    const pbs_sink *sink_;
    pbs_run *run_;
    pbs_err *err_;
    document doc_;
    tinygltf::Model model_;
    int view_count_ = 0; /* bufferViews in the file */

    struct loaded_buffer {
        bool loaded = false;
        mapping file;
        array<uint8_t> decoded;
        bytes view;
    };
    std::vector<loaded_buffer> buffers_;

    /* Ids at the sink; not_yet until first used, PBS_NONE: there is nothing. */
    static constexpr uint32_t not_yet = UINT32_MAX - 1;
    std::vector<uint32_t> image_id_, material_id_, part_id_, node_id_;
    std::vector<uint8_t> node_state_, moves_;
    std::vector<pbs_child> children_;
};

} // namespace pbs::gltf
#endif
