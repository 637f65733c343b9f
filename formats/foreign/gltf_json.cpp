/* gltf_json.cpp: the container, and the cut through its JSON.
 *
 * A scanner that only knows where values begin and end runs over the text (about 1 GB/s, no
 * memory); what tinygltf needs is copied, the rest, data URIs above all, stays in the mapped
 * file. */
#include "formats/foreign/gltf.hpp"
#include <cctype>
#include <cstdlib>
#include <cstring>

namespace pbs::gltf {

/* Deeper JSON would take tinygltf's recursion over "extras" to the end of the stack. */
static const int max_depth = 256;

static uint32_t le32(const uint8_t *p) {
    return p[0] | (uint32_t)p[1] << 8 | (uint32_t)p[2] << 16 | (uint32_t)p[3] << 24;
}

static void open_glb(document &doc, const uint8_t *p, uint64_t size, pbs_err *err) {
    if (size < 12) fail(err, PBS_DATA, "the file ends inside its header");
    uint32_t version = le32(p + 4), total = le32(p + 8);
    if (version != 2) fail(err, PBS_DATA, "glTF version %u is not supported, only 2", version);
    if (total > size)
        fail(err, PBS_DATA, "the file ends at byte %llu of %u: it is cut off",
             (unsigned long long)size, total);
    bool json = false;
    for (uint64_t at = 12; total >= at + 8;) {
        uint64_t length = le32(p + at);
        uint32_t kind = le32(p + at + 4);
        at += 8;
        if (length > total - at)
            fail(err, PBS_DATA, "the chunk at byte %llu is longer than the file",
                 (unsigned long long)at - 8);
        if (!json && kind != 0x4e4f534a) fail(err, PBS_DATA, "the first chunk is not JSON");
        if (!json)
            doc.json = {(const char *)p + at, (size_t)length};
        else if (kind == 0x004e4942 && !doc.bin.data)
            doc.bin = {p + at, length};
        json = true;
        at += (length + 3) & ~(uint64_t)3;
    }
    if (!json) fail(err, PBS_DATA, "the file has no JSON chunk");
}

void open_container(document &doc, const void *data, size_t size, pbs_err *err) {
    const auto *p = (const uint8_t *)data;
    if (!size) fail(err, PBS_DATA, "the file is empty");
    if (size >= 4 && !memcmp(p, "glTF", 4)) {
        open_glb(doc, p, size, err);
    } else {
        doc.json = {(const char *)p, size};
        if (size >= 3 && !memcmp(p, "\xef\xbb\xbf", 3)) doc.json.remove_prefix(3);
    }
    /* Some writers pad with zero bytes. */
    while (!doc.json.empty() && (!doc.json.back() || strchr(" \t\r\n", doc.json.back())))
        doc.json.remove_suffix(1);
    while (!doc.json.empty() && strchr(" \t\r\n", doc.json.front())) doc.json.remove_prefix(1);
    if (doc.json.empty() || doc.json.front() != '{')
        fail(err, PBS_DATA, "this is neither GLB nor glTF");
}

/* The scanner. Texts that are not JSON make it throw or find nonsense; tinygltf has the last
 * word on syntax. */
struct scanner {
    const char *p, *end;
    pbs_err *err;

    [[noreturn]] void bad() { fail(err, PBS_DATA, "the JSON is damaged or cut off"); }
    void space() {
        while (p < end && (*p == ' ' || *p == '\n' || *p == '\r' || *p == '\t')) p++;
    }
    char peek() {
        space();
        if (p == end) bad();
        return *p;
    }
    /* p is behind the opening quote; returns the text, p is behind the closing one. */
    std::string_view string() {
        const char *begin = p;
        for (;;) {
            p = (const char *)memchr(p, '"', (size_t)(end - p));
            if (!p) {
                p = end;
                bad();
            }
            const char *b = p;
            while (b > begin && b[-1] == '\\') b--;
            if ((p - b) % 2 == 0) break;
            p++;
        }
        return {begin, (size_t)(p++ - begin)};
    }
    std::string_view value() {
        peek();
        const char *begin = p;
        int depth = 0;
        do {
            switch (peek()) {
            case '"':
                p++;
                string();
                break;
            case '{':
            case '[':
                if (++depth > max_depth)
                    fail(err, PBS_DATA, "the JSON is nested deeper than %d", max_depth);
                p++;
                break;
            case '}':
            case ']':
                if (!depth--) bad();
                p++;
                break;
            case ',':
            case ':':
                if (!depth) bad();
                p++;
                break;
            default:
                while (p < end && !strchr(" \n\r\t,:\"[]{}", *p)) p++;
                if (p < end && !*p) bad();
            }
        } while (depth);
        return {begin, (size_t)(p - begin)};
    }
};

/* f(value) for every element; false if text is no array. */
template <class F> static bool each_element(std::string_view text, pbs_err *err, F f) {
    if (text.empty() || text[0] != '[') return false;
    scanner s{text.data() + 1, text.data() + text.size(), err};
    if (s.peek() == ']') return true;
    for (;;) {
        f(s.value());
        char c = s.peek();
        s.p++;
        if (c == ']') return true;
        if (c != ',') s.bad();
    }
}

/* f(key, value) for every member; false if text is no object. */
template <class F> static bool each_member(std::string_view text, pbs_err *err, F f) {
    if (text.empty() || text[0] != '{') return false;
    scanner s{text.data() + 1, text.data() + text.size(), err};
    if (s.peek() == '}') return true;
    for (;;) {
        if (s.peek() != '"') s.bad();
        s.p++;
        std::string_view key = s.string();
        std::string plain;
        if (memchr(key.data(), '\\', key.size())) key = plain = unescape(key);
        if (s.peek() != ':') s.bad();
        s.p++;
        f(key, s.value());
        char c = s.peek();
        s.p++;
        if (c == '}') return true;
        if (c != ',') s.bad();
    }
}

static void append_utf8(std::string &out, uint32_t c) {
    if (c < 0x80)
        out += (char)c;
    else if (c < 0x800)
        (out += (char)(0xc0 | c >> 6)) += (char)(0x80 | (c & 63));
    else if (c < 0x10000)
        ((out += (char)(0xe0 | c >> 12)) += (char)(0x80 | (c >> 6 & 63))) +=
            (char)(0x80 | (c & 63));
    else
        (((out += (char)(0xf0 | c >> 18)) += (char)(0x80 | (c >> 12 & 63))) +=
         (char)(0x80 | (c >> 6 & 63))) += (char)(0x80 | (c & 63));
}

static uint32_t hex4(std::string_view s, size_t at) {
    char digits[5] = {0};
    s.copy(digits, 4, at < s.size() ? at : s.size());
    return (uint32_t)strtoul(digits, nullptr, 16) & 0xffff;
}

std::string unescape(std::string_view s) {
    static const char from[] = "bfnrt", to[] = "\b\f\n\r\t";
    std::string out;
    for (size_t i = 0; i < s.size(); i++) {
        if (s[i] != '\\' || i + 1 == s.size()) {
            out += s[i];
            continue;
        }
        char c = s[++i];
        const char *f = strchr(from, c);
        if (c == 'u') {
            uint32_t u = hex4(s, i + 1);
            i += 4;
            if (u >= 0xd800 && u < 0xdc00 && i + 2 < s.size() && s[i + 1] == '\\') {
                u = 0x10000 + ((u & 0x3ff) << 10) + (hex4(s, i + 3) & 0x3ff);
                i += 6;
            }
            append_utf8(out, u);
        } else
            out += f && c ? to[f - from] : c;
    }
    return out;
}

bool is_data_uri(std::string_view raw) {
    return raw.substr(0, 5) == "data:";
}

static int base64_digit(char c) {
    if (c >= 'A' && c <= 'Z') return c - 'A';
    if (c >= 'a' && c <= 'z') return c - 'a' + 26;
    if (c >= '0' && c <= '9') return c - '0' + 52;
    return c == '+' || c == '-' ? 62 : c == '/' || c == '_' ? 63 : -1;
}

array<uint8_t> decode_data_uri(pbs_run *run, std::string_view raw, uint64_t *size, pbs_err *err) {
    size_t comma = raw.find(',');
    if (comma == raw.npos || raw.substr(0, comma).rfind(";base64") == raw.npos)
        fail(err, PBS_DATA, "a data URI that is not base64");
    raw.remove_prefix(comma + 1);
    array<uint8_t> out(run, raw.size() / 4 * 3 + 3, "an embedded buffer", err);
    uint32_t group = 0;
    int digits = 0;
    uint64_t n = 0;
    for (char c : raw) {
        int d = base64_digit(c);
        if (d < 0) {
            if (c == '\\') continue; /* JSON may write \/ */
            if (c == '=') break;
            fail(err, PBS_DATA, "a data URI has a character that is not base64");
        }
        group = group << 6 | (uint32_t)d;
        if (++digits % 4 == 0)
            for (int k = 16; k >= 0; k -= 8) out[n++] = (uint8_t)(group >> k);
    }
    digits %= 4;
    if (digits >= 2) out[n++] = (uint8_t)(digits == 2 ? group >> 4 : group >> 10);
    if (digits == 3) out[n++] = (uint8_t)(group >> 2);
    *size = n;
    return out;
}

static bool to_int(std::string_view text, int *out) {
    char buf[24] = {0}, *end;
    text.copy(buf, sizeof buf - 1);
    long v = strtol(buf, &end, 10);
    if (end == buf || *end || v < INT32_MIN || v > INT32_MAX) return false;
    *out = (int)v;
    return true;
}

static std::string_view unquote(std::string_view text) {
    if (text.size() < 2 || text[0] != '"') return {};
    return text.substr(1, text.size() - 2);
}

static buffer_entry parse_buffer(std::string_view object, int i, pbs_err *err) {
    buffer_entry b;
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
    if (!valid || !sized) fail(err, PBS_DATA, "buffer %d: no valid byteLength", i);
    return b;
}

static image_entry parse_image(std::string_view text, int i, pbs_err *err) {
    image_entry e;
    bool valid = each_member(text, err, [&](std::string_view key, std::string_view v) {
        if (key == "uri") e.uri = unquote(v), e.has_uri = true;
        if (key == "name") e.name = unescape(unquote(v));
        if (key == "bufferView" && !to_int(v, &e.view))
            fail(err, PBS_DATA, "image %d: bufferView is not a number", i);
    });
    if (!valid) fail(err, PBS_DATA, "image %d is not an object", i);
    return e;
}

/* The members that we read; the others, like bounds and extras, are often most of the text. */
static bool kept(std::string_view list, std::string_view key) {
    static const char *const keys[][8] = {
        {"bufferViews", "buffer", "byteOffset", "byteLength", "byteStride"},
        {"accessors", "bufferView", "byteOffset", "componentType", "normalized", "count", "type",
         "sparse"},
        {"meshes", "name", "primitives"},
        {"nodes", "name", "mesh", "children", "matrix", "translation", "rotation", "scale"}};
    if (list == "nodes" && key == "extensions") return true;
    for (const auto &row : keys)
        for (int k = 1; list == row[0] && k < 8 && row[k]; k++)
            if (key == row[k]) return true;
    return false;
}

/* The bufferView of accessor i; -1: none. */
static int view_of(std::string_view number, size_t i, size_t views, pbs_err *err) {
    int view = -1;
    if (!to_int(number, &view) || view < 0 || (size_t)view >= views)
        fail(err, PBS_DATA, "accessor %zu: bufferView %.*s, but there are %zu", i,
             (int)(number.size() < 20 ? number.size() : 20), number.data(), views);
    return view;
}

/* Copies an array of objects without the members that nobody reads; returns their number. */
static size_t copy_list(std::string &out, std::string_view list, std::string_view text,
                        size_t views, pbs_err *err) {
    size_t n = 0;
    bool accessors = list == "accessors";
    auto member = [&](std::string_view key, std::string_view v) {
        out.append("\"").append(key).append("\":").append(v).append(",");
    };
    out.append("\"").append(list).append("\":[");
    each_element(text, err, [&](std::string_view object) {
        int view = -1;
        out += '{';
        bool valid = each_member(object, err, [&](std::string_view key, std::string_view v) {
            if (kept(list, key)) member(key, v);
            if (accessors && key == "bufferView") view = view_of(v, n, views, err);
        });
        if (!valid) fail(err, PBS_DATA, "%.20s %zu is not an object", list.data(), n);
        if (accessors && view < 0) member("bufferView", std::to_string(views));
        if (out.back() == ',') out.pop_back();
        out += "},";
        n++;
    });
    if (list == "bufferViews") out += "{\"buffer\":0,\"byteLength\":1},";
    if (out.back() == ',') out.pop_back();
    out += "],";
    return n;
}

/* tinygltf's parser refuses a text with one byte of Latin-1 in a name, and CAD exporters write
 * such names: every byte that is not UTF-8 becomes '?'. */
static void mend_utf8(std::string &s) {
    for (size_t i = 0; i < s.size();) {
        auto c = (uint8_t)s[i];
        size_t n = c < 0x80                ? 1
                   : c >= 0xc2 && c < 0xe0 ? 2
                   : c >= 0xe0 && c < 0xf0 ? 3
                   : c >= 0xf0 && c < 0xf5 ? 4
                                           : 0;
        bool good = n && i + n <= s.size();
        for (size_t k = 1; good && k < n; k++) good = ((uint8_t)s[i + k] & 0xc0) == 0x80;
        if (good && n >= 3) { /* overlong, surrogate, beyond the last */
            auto d = (uint8_t)s[i + 1];
            good = !(c == 0xe0 && d < 0xa0) && !(c == 0xed && d >= 0xa0) &&
                   !(c == 0xf0 && d < 0x90) && !(c == 0xf4 && d >= 0x90);
        }
        if (!good) s[i] = '?';
        i += good ? n : 1;
    }
}

/* Some writers have one kind of number and write 3.0 for 3; tinygltf takes that for no integer,
 * and for most members it would go on without them. */
static void mend_numbers(std::string &s) {
    size_t to = 0;
    bool text = false;
    for (size_t i = 0; i < s.size(); i++) {
        char c = s[i];
        if (text && c == '\\' && i + 1 < s.size()) {
            s[to++] = c;
            c = s[++i];
        } else if (c == '"') {
            text = !text;
        } else if (c == '.' && !text) {
            size_t end = s.find_first_not_of('0', i + 1);
            if (end > i + 1 && end < s.size() && !isdigit((unsigned char)s[end]) && s[end] != 'e' &&
                s[end] != 'E')
                c = s[i = end];
        }
        s[to++] = c;
    }
    s.resize(to);
}

/* The members of the whole that are copied as they are. */
static bool wanted(std::string_view key) {
    static const char *const keys[] = {"asset",    "extensionsUsed", "extensionsRequired",
                                       "scenes",   "scene",          "materials",
                                       "textures", "samplers",       "animations"};
    for (const char *k : keys)
        if (key == k) return true;
    return false;
}

void split_json(document &doc, pbs_err *err) {
    std::string_view views, accessors, buffers, images, nodes, meshes;
    const struct {
        const char *key;
        std::string_view *text;
    } lists[] = {{"bufferViews", &views}, {"accessors", &accessors}, {"buffers", &buffers},
                 {"images", &images},     {"nodes", &nodes},         {"meshes", &meshes}};
    doc.slim = "{";
    each_member(doc.json, err, [&](std::string_view key, std::string_view v) {
        for (const auto &l : lists)
            if (key == l.key) *l.text = v;
        if (wanted(key)) doc.slim.append("\"").append(key).append("\":").append(v).append(",");
    });
    doc.views = copy_list(doc.slim, "bufferViews", views, 0, err);
    doc.accessors = copy_list(doc.slim, "accessors", accessors, doc.views, err);
    doc.nodes = copy_list(doc.slim, "nodes", nodes, 0, err);
    doc.meshes = copy_list(doc.slim, "meshes", meshes, 0, err);
    doc.slim.back() = '}';
    mend_utf8(doc.slim);
    mend_numbers(doc.slim);
    each_element(buffers, err, [&](std::string_view v) {
        doc.buffers.push_back(parse_buffer(v, (int)doc.buffers.size(), err));
    });
    each_element(images, err, [&](std::string_view v) {
        doc.images.push_back(parse_image(v, (int)doc.images.size(), err));
    });
}

} // namespace pbs::gltf
