/* gltf_scan.hpp: a scanner that only knows where the values of a JSON text begin and end: no
 * memory, and nothing is looked at twice. On texts that are not JSON it throws or finds nonsense;
 * the parsers behind it have the last word. */
#ifndef PBS_GLTF_SCAN_HPP
#define PBS_GLTF_SCAN_HPP

#include "formats/foreign/gltf_doc.hpp"
#include <cstring>

namespace pbs::gltf {

/* Deeper JSON would take tinygltf's recursion over "extras" to the end of the stack. */
static constexpr int max_depth = 256;

/* What ends a number or a word. */
struct delimiters {
    bool of[256] = {};
    constexpr delimiters() {
        for (const char *c = " \n\r\t,:\"[]{}"; *c; c++) of[(uint8_t)*c] = true;
        of[0] = true;
    }
};

struct scanner {
    const char *p, *end;
    pbs_err *err;

    scanner(std::string_view text, pbs_err *e)
        : p(text.data()), end(text.data() + text.size()), err(e) {}

    [[noreturn]] void bad() {
        throw not_json{{pbs_fail(err, PBS_DATA, "the JSON is damaged or cut off")}};
    }
    char peek() {
        while (p < end && (*p == ' ' || *p == '\n' || *p == '\r' || *p == '\t')) p++;
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
    /* A number or a word. */
    void word() {
        static constexpr delimiters ends;
        const char *begin = p;
        while (p < end && !ends.of[(uint8_t)*p]) p++;
        if (p == begin) bad();
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
                word();
            }
        } while (depth);
        return {begin, (size_t)(p - begin)};
    }
    /* Behind an element or a member: true if another one follows. */
    bool more(char close) {
        char c = peek();
        if (c != ',' && c != close) bad();
        p++;
        return c == ',';
    }
    /* Opens an array or an object; false if it is empty, and then it is closed again. */
    bool enter(char close) {
        p++;
        if (peek() != close) return true;
        p++;
        return false;
    }
    /* f() for every element of the array at p, which it has to step over. */
    template <class F> void elements(F f) {
        if (!enter(']')) return;
        do {
            peek();
            f();
        } while (more(']'));
    }
    /* f(key, value) for every member of the object at p. */
    template <class F> void members(F f) {
        if (!enter('}')) return;
        do {
            if (peek() != '"') bad();
            p++;
            std::string_view key = string();
            std::string plain;
            if (memchr(key.data(), '\\', key.size())) key = plain = unescape(key);
            if (peek() != ':') bad();
            p++;
            f(key, value());
        } while (more('}'));
    }
};

/* f(key, value) for every member; false if text is no object. */
template <class F> bool each_member(std::string_view text, pbs_err *err, F f) {
    if (text.empty() || text[0] != '{') return false;
    scanner(text, err).members(f);
    return true;
}

} // namespace pbs::gltf
#endif
