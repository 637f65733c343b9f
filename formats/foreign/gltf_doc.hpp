/* gltf_doc.hpp: what a glTF file says, as tables.
 *
 * The JSON of a CAD export may have hundreds of megabytes. A tree of all its values costs 15 bytes
 * for each of them (tinygltf's, measured), so there is never one of the whole: the lists that grow
 * with the scene (nodes, meshes, accessors, ...) go through simdjson, some objects at a time, into
 * the tables below (gltf_lists.cpp); tinygltf gets the small rest, and each material when it is
 * used (gltf_parse.cpp). One way for files of every size.
 *
 * Indices of the file are kept as they are, right or wrong; who follows one checks it. */
#ifndef PBS_GLTF_DOC_HPP
#define PBS_GLTF_DOC_HPP

#include "formats/foreign/guard.hpp"
#include <climits>
#include <cstdint>
#include <string>
#include <string_view>

namespace pbs::gltf {

struct bytes {
    const uint8_t *data = nullptr;
    uint64_t size = 0;
};

/* Of a map of a file: its pages stay in the system's cache and come back from there, but they are
 * no more this program's memory. Nothing happens to bytes without data. */
void let_go(const bytes &map);
/* Pages are held for so many bytes that were looked at. */
static constexpr uint64_t hold_bytes = 32 << 20;

/* A growing array of plain values, counted by the run; places in it fit 32 bits. */
template <class T> class list {
  public:
    list(pbs_run *run, const char *what, pbs_err *err) : run_(run), what_(what), err_(err) {}
    list(const list &) = delete;
    list &operator=(const list &) = delete;
    ~list() { pbs_free(run_, data_); }
    uint32_t push(const T &value) {
        uint32_t at = grow(1); /* first: it moves data_ */
        data_[at] = value;
        return at;
    }
    /* n more elements, not set; the place of the first. */
    uint32_t grow(size_t n) {
        if (n > UINT32_MAX - size_) fail(err_, PBS_DATA, "too much for one file: %s", what_);
        check(pbs_grow(run_, &data_, &room_, size_ + n, sizeof(T), what_, err_));
        size_ += n;
        return (uint32_t)(size_ - n);
    }
    void assign(size_t n, const T &value) {
        size_ = 0;
        grow(n);
        for (size_t i = 0; i < n; i++) data_[i] = value;
    }
    void pop() { size_--; }
    void clear() { size_ = 0; }
    void shrink(size_t n) { size_ = n; } /* to the first n */
    size_t size() const { return size_; }
    bool empty() const { return !size_; }
    T *data() { return data_; }
    T &operator[](size_t i) { return data_[i]; }
    const T &operator[](size_t i) const { return data_[i]; }
    T &back() { return data_[size_ - 1]; }
    T *begin() { return data_; }
    T *end() { return data_ + size_; }

  private:
    pbs_run *run_;
    const char *what_;
    pbs_err *err_;
    T *data_ = nullptr;
    size_t size_ = 0, room_ = 0;
};

/* An index that is not in the file. Negative ones that are remain what they are. */
static constexpr int32_t absent = INT32_MIN;
static constexpr uint32_t no_name = UINT32_MAX;

/* uri is the JSON string as written, escapes and all, because a data URI may be as large as the
 * file: a view into it. */
struct buffer_entry {
    std::string_view uri;
    uint64_t length;
    bool has_uri, fallback;
};
struct image_entry {
    std::string_view uri;
    int32_t view;
    uint32_t name;
    bool has_uri;
};
/* What an animation can move. */
enum path { TRANSLATION, ROTATION, SCALE, MATRIX };
static constexpr uint32_t path_numbers[4] = {3, 4, 3, 16};

struct node_entry {
    uint32_t name, first_child, child_count;
    uint32_t numbers; /* the first of those that `has` (a bit for each path) lists, in its order */
    int32_t mesh, instancing; /* instancing: a place in the table, or absent */
    uint32_t has;
};
struct instancing_entry {
    int32_t accessor[3]; /* by path */
};
struct mesh_entry {
    uint32_t name, first, count;
};
enum semantic { POSITION = -1, NORMAL = -2, COLOR_0 = -3 }; /* n from 0: TEXCOORD_n */
struct attribute_entry {
    int32_t semantic, accessor, draco; /* draco: the id in the compressed mesh */
};
struct primitive_entry {
    int32_t mode, indices, material, draco_view;
    uint32_t first, count; /* attributes */
};
struct sparse_entry {
    uint64_t count, where_offset, values_offset;
    int32_t where_view, where_type, values_view;
};
struct accessor_entry {
    uint64_t offset, count;
    int32_t view, sparse, type;
    uint8_t components;
    bool normalized;
};
struct view_entry {
    uint64_t offset, length;
    int64_t stride;
    int32_t buffer, meshopt;
};
/* EXT_meshopt_compression: where the bytes of a view come from. */
enum meshopt_mode { ATTRIBUTES, TRIANGLES, INDICES };
enum meshopt_filter { NO_FILTER, OCTAHEDRAL, QUATERNION, EXPONENTIAL };
struct meshopt_entry {
    uint64_t offset, length, count, stride;
    int32_t buffer;
    uint8_t mode, filter;
};
struct channel_entry {
    int32_t node, input, output; /* accessors */
    uint32_t animation;
    uint8_t path, way; /* way: pbs_motion_way */
    bool moves;        /* it does more than to repeat the pose at rest */
};

struct document {
    document(pbs_run *run, pbs_err *err);

    std::string_view json; /* of the whole file */
    bytes bin;             /* of a GLB */
    bytes map;             /* the whole file, if it is a map */
    /* The lists as they are in the file; empty: not there. */
    struct {
        std::string_view buffers, images, views, accessors, meshes, nodes, materials, animations,
            scenes;
    } lists;
    std::string head; /* JSON for tinygltf: what is left */

    list<char> names; /* each with a zero byte behind */
    list<buffer_entry> buffers;
    list<image_entry> images;
    list<view_entry> views;
    list<meshopt_entry> meshopt;
    list<accessor_entry> accessors;
    list<sparse_entry> sparse;
    list<mesh_entry> meshes;
    list<primitive_entry> primitives;
    list<attribute_entry> attributes;
    list<node_entry> nodes;
    list<instancing_entry> instancing;
    list<double> numbers;
    list<int32_t> children;
    list<std::string_view> materials; /* their texts in the file */
    list<uint32_t> animations;        /* their names */
    list<channel_entry> channels;
    list<int32_t> roots; /* of the scene */
    size_t scenes = 0;   /* how many */
    uint32_t scene_name = no_name;

    uint32_t add_name(std::string_view name);
    /* NULL: none */
    const char *name(uint32_t at) const { return at == no_name ? nullptr : &names[at]; }
};

/* The text is not JSON; what is said already may be improved by syntax_error. */
struct not_json : failure {};

/* Runs body; an error of the file that it meets gets the place in front. name: NULL or of it. */
template <class F>
void in_place(pbs_err *err, const char *what, size_t i, const char *name, F body) {
    try {
        body();
    } catch (const failure &e) {
        if (e.code != PBS_DATA) throw;
        if (name)
            pbs_fail_in(err, "%s %zu (%.100s)", what, i, name);
        else
            pbs_fail_in(err, "%s %zu", what, i);
        throw;
    }
}

/* gltf_json.cpp. Takes the container apart. */
void open_container(document &doc, const void *data, size_t size, pbs_err *err);
std::string unescape(std::string_view raw);
bool is_data_uri(std::string_view raw);
/* The decoded bytes of a data URI. */
array<uint8_t> decode_data_uri(pbs_run *run, std::string_view raw, uint64_t *size, pbs_err *err);
/* CAD exporters write names in Latin-1, and every parser refuses such a text as a whole: every
 * byte that is not UTF-8 becomes '?'. */
void mend_utf8(char *text, size_t size);

/* gltf_lists.cpp. Finds the lists, fills head. */
void find_lists(document &doc, pbs_err *err);
/* Fills the tables. scene: which one, absent: the first. */
void read_lists(document &doc, int32_t scene, pbs_run *run, pbs_err *err);

} // namespace pbs::gltf
#endif
