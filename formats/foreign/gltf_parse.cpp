/* gltf_parse.cpp: tinygltf, compiled once, and its errors in one line. */
#define TINYGLTF_IMPLEMENTATION
#include "formats/foreign/gltf.hpp"
#include <climits>

namespace pbs::gltf {

/* The library's own words without its prefix. It has seen another text than the user's file, so
 * the place of a syntax error comes from a second look at the original, which keeps nothing. */
static std::string syntax_error(const document &doc) {
    try {
        nlohmann::json::parse(doc.json.begin(), doc.json.end(),
                              [](int, nlohmann::json::parse_event_t, nlohmann::json &) {
                                  return false;
                              });
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

void parse(tinygltf::Model &model, const document &doc, pbs_err *err) {
    std::string problem, warning;
    if (doc.slim.size() > UINT_MAX) fail(err, PBS_DATA, "more than 4 GiB of JSON");
    tinygltf::TinyGLTF loader;
    bool good = loader.LoadASCIIFromString(&model, &problem, &warning, doc.slim.data(),
                                           (unsigned)doc.slim.size(), "",
                                           tinygltf::REQUIRE_VERSION);
    /* tinygltf drops a primitive without a valid list of attributes and goes on. */
    if (good && problem.find("'attributes'") == problem.npos) return;
    std::string text = syntax_error(doc);
    if (text.empty()) text = first_line(problem);
    fail(err, PBS_DATA, "%s", text.empty() ? "tinygltf refuses the file" : text.c_str());
}

} // namespace pbs::gltf
