/* gltf_json.cpp: the container, the strings in its JSON, and the data URIs. */
#include "formats/foreign/gltf_doc.hpp"
#include <cstdlib>
#include <cstring>

namespace pbs::gltf {

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

/* The bytes of the UTF-8 sequence at p; 0: it is none. */
static size_t sequence(const char *p, size_t left) {
    auto c = (uint8_t)p[0];
    size_t n = c < 0x80                ? 1
               : c >= 0xc2 && c < 0xe0 ? 2
               : c >= 0xe0 && c < 0xf0 ? 3
               : c >= 0xf0 && c < 0xf5 ? 4
                                       : 0;
    if (!n || n > left) return 0;
    for (size_t k = 1; k < n; k++)
        if (((uint8_t)p[k] & 0xc0) != 0x80) return 0;
    if (n < 3) return n;
    auto d = (uint8_t)p[1]; /* overlong, surrogate, beyond the last */
    bool bad = (c == 0xe0 && d < 0xa0) || (c == 0xed && d >= 0xa0) || (c == 0xf0 && d < 0x90) ||
               (c == 0xf4 && d >= 0x90);
    return bad ? 0 : n;
}

void mend_utf8(char *text, size_t size) {
    for (size_t i = 0; i < size;) {
        size_t n = sequence(text + i, size - i);
        if (!n) text[i] = '?';
        i += n ? n : 1;
    }
}

} // namespace pbs::gltf
