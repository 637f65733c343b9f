/* gltf_lists.cpp: from the lists of the JSON to tables, through simdjson, a batch at a time.
 *
 * The scanner walks over a list and copies the members that we read into a batch; simdjson parses
 * that, checks it, and the batch is forgotten. So the cost is the tables and one batch, whatever
 * the size of the file, and a file whose unread members are odd (NaN as a bound) is still read. */
#include "formats/foreign/gltf_scan.hpp"
#include "formats/foreign/gltf_table.hpp"

namespace pbs::gltf {

document::document(pbs_run *run, pbs_err *err)
    : names(run, "the names", err), buffers(run, "the buffers", err),
      images(run, "the images", err), views(run, "the bufferViews", err),
      meshopt(run, "the bufferViews", err), accessors(run, "the accessors", err),
      sparse(run, "the accessors", err), meshes(run, "the meshes", err),
      primitives(run, "the meshes", err), attributes(run, "the meshes", err),
      nodes(run, "the nodes", err), instancing(run, "the nodes", err),
      numbers(run, "the nodes", err), children(run, "the nodes", err),
      materials(run, "the materials", err), animations(run, "the animations", err),
      channels(run, "the animations", err), roots(run, "the scene", err) {}

uint32_t document::add_name(std::string_view s) {
    if (s.empty()) return no_name;
    uint32_t at = names.grow(s.size() + 1);
    memcpy(&names[at], s.data(), s.size());
    names[at + s.size()] = 0;
    return at;
}

void find_lists(document &doc, pbs_err *err) {
    auto &t = doc.lists;
    const struct {
        const char *key;
        std::string_view *text;
    } keys[] = {
        {"bufferViews", &t.views}, {"accessors", &t.accessors},   {"buffers", &t.buffers},
        {"images", &t.images},     {"nodes", &t.nodes},           {"meshes", &t.meshes},
        {"scenes", &t.scenes},     {"animations", &t.animations}, {"materials", &t.materials}};
    static const char *const small[] = {"asset", "extensionsRequired", "scene", "textures",
                                        "samplers"};
    doc.head = "{";
    scanner s(doc.json, err);
    s.members([&](std::string_view key, std::string_view v) {
        for (const auto &l : keys)
            if (key == l.key) *l.text = v;
        for (const char *k : small)
            if (key == k) doc.head.append("\"").append(key).append("\":").append(v).append(",");
    });
    if (s.p != s.end) s.bad();
    let_go(doc.map);
    doc.head.back() = '}';
    if (doc.head.size() == 1) doc.head = "{  }"; /* tinygltf takes nothing shorter */
}

/* f(scanner, i) for every element of a list, which f has to step over. */
template <class F>
static void walk(const document &doc, const char *what, std::string_view text, pbs_run *run,
                 pbs_err *err, F f) {
    if (text.empty() || text == "null") return;
    if (text[0] != '[') fail(err, PBS_DATA, "%s is not a list", what);
    scanner s(text, err);
    const char *held = s.p;
    size_t i = 0;
    s.elements([&] {
        if (i % 256 == 0) check(pbs_run_check(run, err));
        if ((uint64_t)(s.p - held) > hold_bytes) {
            let_go(doc.map);
            held = s.p;
        }
        f(s, i++);
    });
}

static std::string_view unquote(std::string_view text) {
    if (text.size() < 2 || text[0] != '"') return {};
    return text.substr(1, text.size() - 2);
}

static buffer_entry parse_buffer(std::string_view object, size_t i, pbs_err *err) {
    buffer_entry b = {};
    bool sized = false;
    bool valid = each_member(object, err, [&](std::string_view key, std::string_view v) {
        if (key == "uri") b.uri = unquote(v), b.has_uri = true;
        if (key == "extensions" && v.find("meshopt_compression") != v.npos) b.fallback = true;
        if (key != "byteLength") return;
        std::string text(v.substr(0, 64));
        char *end;
        double d = strtod(text.c_str(), &end);
        if (!*end && d >= 0 && d < 9e15 && d == (double)(uint64_t)d)
            b.length = (uint64_t)d, sized = true;
    });
    if (!valid || !sized) fail(err, PBS_DATA, "buffer %zu: no valid byteLength", i);
    return b;
}

static image_entry parse_image(document &doc, std::string_view text, size_t i, pbs_err *err) {
    image_entry e = {{}, absent, no_name, false};
    bool valid = each_member(text, err, [&](std::string_view key, std::string_view v) {
        if (key == "uri") e.uri = unquote(v), e.has_uri = true;
        if (key == "name") e.name = doc.add_name(unescape(unquote(v)));
        if (key != "bufferView") return;
        std::string number(v.substr(0, 24));
        char *end;
        double d = strtod(number.c_str(), &end);
        if (*end || !(d >= -1 && d < INT32_MAX) || d != (double)(int32_t)d)
            fail(err, PBS_DATA, "image %zu: bufferView is not an index", i);
        e.view = (int32_t)d;
    });
    if (!valid) fail(err, PBS_DATA, "image %zu is not an object", i);
    return e;
}

/* What simdjson takes for a byte of text: places, tape and strings, as it allocates them. */
static const size_t tape_cost = 15;
static const size_t batch_size = 1 << 16;

/* Objects on their way to simdjson. */
class batch {
  public:
    batch(const document &doc, pbs_run *run, pbs_err *err) : doc_(doc), run_(run), err_(err) {}
    ~batch() { pbs_mem_give(run_, counted_); }

    /* add(object, i) for every object of a list, whose members are only those in keep (ends with
     * NULL). what: one of them, for messages. */
    template <class F>
    void run(const char *list, const char *what, std::string_view text, const char *const *keep,
             F add) {
        first_ = 0;
        used_ = objects_ = 0;
        walk(doc_, list, text, run_, err_, [&](scanner &s, size_t i) {
            if (*s.p != '{') fail(err_, PBS_DATA, "%s %zu is not an object", what, i);
            if (used_ > batch_size) flush(what, add);
            copy(s, keep);
        });
        flush(what, add);
    }

  private:
    void append(std::string_view s) {
        if (s.size() > room_ - used_) grow(used_ + s.size());
        memcpy(text_.data() + used_, s.data(), s.size());
        used_ += s.size();
    }
    void grow(size_t need) {
        size_t room = need < 4096 ? 4096 : need + need / 2;
        array<char> more(run_, room + simdjson::SIMDJSON_PADDING, "the scene's JSON", err_);
        check(pbs_mem_take(run_, (room - room_) * tape_cost, "the scene's JSON", err_));
        counted_ += (room - room_) * tape_cost;
        if (used_) memcpy(more.data(), text_.data(), used_);
        text_ = std::move(more);
        room_ = room;
    }
    void copy(scanner &s, const char *const *keep) {
        append(objects_++ ? "," : "[");
        append("{");
        s.members([&](std::string_view key, std::string_view v) {
            for (const char *const *k = keep; *k; k++)
                if (key == *k) {
                    if (text_[used_ - 1] != '{') append(",");
                    append("\"");
                    append(key);
                    append("\":");
                    append(v);
                }
        });
        append("}");
    }
    template <class F> void flush(const char *what, F add) {
        if (!objects_) return;
        append("]");
        memset(text_.data() + used_, 0, simdjson::SIMDJSON_PADDING);
        if (!simdjson::validate_utf8(text_.data(), used_)) mend_utf8(text_.data(), used_);
        simdjson::dom::array list;
        auto error = parser_.parse(text_.data(), used_, false).get(list);
        if (error == simdjson::MEMALLOC) throw std::bad_alloc();
        if (error)
            throw not_json{{pbs_fail(err_, PBS_DATA, "%s %zu or behind: %s", what, first_,
                                     simdjson::error_message(error))}};
        size_t i = first_;
        for (json_value v : list) {
            json_object object;
            if (!v.get(object)) add(object, i);
            i++;
        }
        first_ = i;
        used_ = objects_ = 0;
    }

    const document &doc_;
    pbs_run *run_;
    pbs_err *err_;
    array<char> text_;
    size_t room_ = 0, used_ = 0, objects_ = 0, first_ = 0, counted_ = 0;
    simdjson::dom::parser parser_;
};

/* An animation is not parsed as one: a single one may move every node of the scene. */
static void read_animations(document &doc, batch &objects, table &t, pbs_run *run, pbs_err *err) {
    static const char *const channel[] = {"sampler", "target", nullptr};
    static const char *const sampler[] = {"input", "output", "interpolation", nullptr};
    walk(doc, "animations", doc.lists.animations, run, err, [&](scanner &s, size_t i) {
        std::string_view channels, samplers, name;
        std::string place = "animation " + std::to_string(i);
        bool valid = each_member(s.value(), err, [&](std::string_view key, std::string_view v) {
            if (key == "channels") channels = v;
            if (key == "samplers") samplers = v;
            if (key == "name") name = v;
        });
        if (!valid) fail(err, PBS_DATA, "%s is not an object", place.c_str());
        doc.animations.push(name.empty() ? no_name : doc.add_name(unescape(unquote(name))));
        t.begin_animation();
        objects.run((place + ": samplers").c_str(), (place + ": sampler").c_str(), samplers,
                    sampler, [&](json_object o, size_t) { t.add_sampler(o); });
        objects.run((place + ": channels").c_str(), (place + ": channel").c_str(), channels,
                    channel, [&](json_object o, size_t) { t.add_channel(o); });
    });
}

static void read_scene(document &doc, batch &objects, table &t, int32_t scene) {
    static const char *const keep[] = {"name", "nodes", nullptr};
    size_t chosen = scene < 0 ? 0 : (size_t)scene;
    objects.run("scenes", "scene", doc.lists.scenes, keep, [&](json_object o, size_t i) {
        doc.scenes++;
        if (i == chosen) t.add_scene(o);
    });
}

void read_lists(document &doc, int32_t scene, pbs_run *run, pbs_err *err) {
    walk(doc, "buffers", doc.lists.buffers, run, err,
         [&](scanner &s, size_t i) { doc.buffers.push(parse_buffer(s.value(), i, err)); });
    walk(doc, "images", doc.lists.images, run, err,
         [&](scanner &s, size_t i) { doc.images.push(parse_image(doc, s.value(), i, err)); });
    walk(doc, "materials", doc.lists.materials, run, err,
         [&](scanner &s, size_t) { doc.materials.push(s.value()); });
    batch objects(doc, run, err);
    table t(doc, run, err);
    static const char *const keep[][9] = {
        {"buffer", "byteOffset", "byteLength", "byteStride", "extensions"},
        {"bufferView", "byteOffset", "componentType", "normalized", "count", "type", "sparse"},
        {"name", "primitives"},
        {"name", "mesh", "children", "matrix", "translation", "rotation", "scale", "extensions"}};
    objects.run("bufferViews", "bufferView", doc.lists.views, keep[0],
                [&](json_object o, size_t i) { t.add_view(o, i); });
    objects.run("accessors", "accessor", doc.lists.accessors, keep[1],
                [&](json_object o, size_t i) { t.add_accessor(o, i); });
    objects.run("meshes", "mesh", doc.lists.meshes, keep[2],
                [&](json_object o, size_t i) { t.add_mesh(o, i); });
    objects.run("nodes", "node", doc.lists.nodes, keep[3],
                [&](json_object o, size_t i) { t.add_node(o, i); });
    read_scene(doc, objects, t, scene);
    read_animations(doc, objects, t, run, err);
}

} // namespace pbs::gltf
