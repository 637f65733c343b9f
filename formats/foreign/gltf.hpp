/* gltf.hpp: what the files of the module "gltf" share, and the reader that walks over a document
 * (gltf_doc.hpp).
 *
 * Vertices are read from the mapped files in place (gltf_data.cpp). Every offset, count and length
 * in a file is somebody else's claim: reader::slice() is the only way from a number in the JSON to
 * a pointer. */
#ifndef PBS_GLTF_HPP
#define PBS_GLTF_HPP

#define TINYGLTF_NO_STB_IMAGE
#define TINYGLTF_NO_STB_IMAGE_WRITE
#define TINYGLTF_NO_EXTERNAL_IMAGE
#define TINYGLTF_NO_FS
#include <tiny_gltf.h>

#include "formats/foreign/gltf_doc.hpp"
#include "formats/readers/sink.h"
#include <vector>

namespace pbs::gltf {

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

/* gltf_parse.cpp: tinygltf itself. What the JSON costs as its tree and then as its structures was
 * measured as 15 bytes for one of the text, which is copied once. */
static constexpr size_t bytes_for_json = 16;
/* asset, extensions, textures, samplers. */
void parse_head(tinygltf::Model &model, const document &doc, pbs_err *err);
void parse_material(tinygltf::Material &m, std::string_view text, pbs_err *err);
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
    uint64_t owned_bytes = 0;
    int mode = 0;
    bool torn = false; /* corners are left over that make no triangle */
    uint32_t material = PBS_NONE;
    uint64_t corners = 0, triangles = 0; /* corners: those that triangles use */

    uint64_t corner(uint64_t i) const { return index ? load_index(index.at(i), index.type) : i; }
    uint64_t corner_bytes() const {
        return position.element + normal.element + uv.element + colour.element + index.element;
    }
    /* The three corners of triangle t. */
    void triangle(uint64_t t, uint64_t out[3]) const;
};

/* gltf_moving.cpp. Of nodes without a matrix: where they are without animation. */
pbs_trs rest_pose(const document &doc, const node_entry &n);

class reader {
  public:
    reader(const char *path, const pbs_sink *sink, pbs_err *err);
    void read(const void *data, size_t size);

  private:
    /* gltf.cpp: the hierarchy */
    void refuse_unknown_extensions();
    void find_roots();
    void begin();
    void walk(int root);
    void enter(int n, int from);
    void finish_node(int n);
    template <class F> bool left_out(F body);
    void add_child(int n);
    uint32_t mesh_or_instances(int n);
    uint32_t instances(int n, const instancing_entry &e, uint32_t part);
    void local_matrix(int n, double m[12]);

    /* gltf_moving.cpp */
    void mark_moving();
    bool moves(const channel_entry &c);
    struct keys;
    void add_keys(const channel_entry &c, keys &k);
    void add_channel(const channel_entry &c, keys &k);
    uint32_t motion(int n);
    void send_animations();

    /* gltf_data.cpp */
    const bytes &buffer(int i);
    bytes slice(int view, uint64_t offset, uint64_t length);
    bytes whole_view(int view);
    bytes range(int buffer, uint64_t offset, uint64_t length, int view);
    stream open_stream(int accessor);
    void place_stream(stream &s, const accessor_entry &a);
    void open_sparse(stream &s, const sparse_entry &sp);
    bool find_file(const std::string &uri, mapping &file);
    void touch(uint64_t size);
    void let_go_of_files();

    /* gltf_meshopt.cpp. What slice() gave lives until the next forget_views(). */
    bytes decoded_view(int view);
    bool drop_oldest_view();
    void forget_views() { era_++; }

    /* gltf_material.cpp */
    struct known_material {
        uint32_t id;
        int32_t set; /* of texture coordinates */
    };
    const known_material &material(int i);
    void read_material(int i, known_material &known);
    struct texture_slot;
    pbs_texture_use texture_use(const texture_slot &slot, int set);
    uint32_t image(int i);
    void read_image(int i, uint32_t &id);
    uint32_t image_of_texture(const tinygltf::Texture &t);

    /* gltf_mesh.cpp */
    uint32_t part(int mesh);
    struct survey;
    void look_at(const primitive_entry &e, uint32_t place, survey &s);
    primitive open_primitive(const primitive_entry &p);
    const attribute_entry *find_attribute(const primitive_entry &p, int semantic) const;
    stream attribute(const primitive_entry &p, int semantic, int components, uint64_t vertices);
    bool skip_mode(const primitive_entry &p);
    uint64_t corner_count(const primitive_entry &p);
    void bound(const primitive &p, pbs_box &box);
    void emit(const primitive &p);

    /* gltf_draco.cpp */
    void decode_draco(const primitive_entry &p, int uv_set, primitive &out);

    std::string folder_; /* of the file, with the slash */
    const pbs_sink *sink_;
    pbs_run *run_;
    pbs_err *err_;
    uint64_t touched_ = 0;
    document doc_;
    tinygltf::Model head_;

    struct loaded_buffer {
        bool loaded = false;
        mapping file;
        array<uint8_t> decoded;
        bytes view;
    };
    std::vector<loaded_buffer> buffers_;
    struct view_bytes {
        array<uint8_t> data;
        int meshopt;
        uint64_t era;
    };
    std::vector<view_bytes> decoded_; /* some, by age */
    uint64_t decoded_bytes_ = 0, era_ = 0;

    /* Ids at the sink; not_yet until first used, PBS_NONE: there is nothing. */
    static constexpr uint32_t not_yet = UINT32_MAX - 1;
    list<uint32_t> image_id_, part_id_, node_id_;
    list<known_material> materials_;
    list<uint8_t> node_state_, moves_;
    list<uint32_t> motion_id_, animation_id_;
    list<uint32_t> first_channel_, channel_; /* of each node: places in the document's list */
    list<pbs_child> children_;
    struct step {
        int node;
        uint32_t next;
    };
    list<step> stack_;
};

/* Runs body; true if the file is wrong there and the sink goes on without. Not where the text is
 * no JSON at all. */
template <class F> bool reader::left_out(F body) {
    try {
        body();
        return false;
    } catch (const not_json &) {
        throw;
    } catch (const failure &e) {
        if (e.code != PBS_DATA || !sink_->failed) throw;
        sink_->failed(sink_->ctx, err_);
        return true;
    }
}

} // namespace pbs::gltf
#endif
