/* gltf_parse.cpp: tinygltf, compiled once, and its errors in one line. */
#include <fstream> /* which tinygltf forgets without its file functions */
#define TINYGLTF_IMPLEMENTATION
#include "formats/foreign/gltf.hpp"
#include <cctype>

namespace pbs::gltf {

/* The library's words without its prefix. tinygltf sees another text than the user's file, so the
 * place of a syntax error comes from a look at the original, which keeps nothing. */
std::string syntax_error(const document &doc) {
    try {
        auto keep_nothing = [](int, nlohmann::json::parse_event_t, nlohmann::json &) {
            return false;
        };
        nlohmann::json rest = nlohmann::json::parse(doc.json.begin(), doc.json.end(), keep_nothing);
    } catch (const std::exception &e) {
        std::string text = e.what();
        size_t prefix = text.find("] ");
        return prefix == text.npos ? text : text.substr(prefix + 2);
    }
    return "";
}

static std::string first_line(const std::string &text) {
    return text.substr(0, text.find('\n'));
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

/* Returns what tinygltf says against the text. */
static std::string load(tinygltf::Model &model, std::string text, unsigned needed, pbs_err *err) {
    std::string problem, warning;
    if (text.size() > UINT_MAX) fail(err, PBS_DATA, "more than 4 GiB of JSON");
    mend_utf8(text.data(), text.size());
    mend_numbers(text);
    tinygltf::TinyGLTF loader;
    if (loader.LoadASCIIFromString(&model, &problem, &warning, text.data(), (unsigned)text.size(),
                                   "", needed))
        return "";
    return problem.empty() ? "tinygltf refuses the file" : first_line(problem);
}

void parse_head(tinygltf::Model &model, const document &doc, pbs_err *err) {
    std::string problem = load(model, doc.head, tinygltf::REQUIRE_VERSION, err);
    if (problem.compare(0, 7, "\"asset\"") == 0)
        problem = "asset.version is missing: this is not glTF 2.0";
    if (!problem.empty()) throw not_json{{pbs_fail(err, PBS_DATA, "%s", problem.c_str())}};
}

void parse_material(tinygltf::Material &m, std::string_view text, pbs_err *err) {
    tinygltf::Model model;
    std::string all = "{\"materials\":[";
    std::string problem = load(model, all.append(text).append("]}"), tinygltf::NO_REQUIRE, err);
    if (!problem.empty()) throw not_json{{pbs_fail(err, PBS_DATA, "%s", problem.c_str())}};
    if (model.materials.size() != 1) fail(err, PBS_DATA, "not an object");
    m = std::move(model.materials[0]);
}

} // namespace pbs::gltf
