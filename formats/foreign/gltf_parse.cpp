/* gltf_parse.cpp: tinygltf, compiled once, and its errors in one line. */
#include <fstream> /* which tinygltf forgets without its file functions */
#define TINYGLTF_IMPLEMENTATION
#include "formats/foreign/gltf.hpp"
#include <climits>

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

void parse(tinygltf::Model &model, const document &doc, pbs_err *err) {
    std::string problem, warning;
    if (doc.slim.size() > UINT_MAX) fail(err, PBS_DATA, "more than 4 GiB of JSON");
    /* It clears these, which keeps their room, and then adds one by one. */
    model.bufferViews.reserve(doc.views + 1);
    model.accessors.reserve(doc.accessors);
    model.nodes.reserve(doc.nodes);
    model.meshes.reserve(doc.meshes);
    tinygltf::TinyGLTF loader;
    bool good =
        loader.LoadASCIIFromString(&model, &problem, &warning, doc.slim.data(),
                                   (unsigned)doc.slim.size(), "", tinygltf::REQUIRE_VERSION);
    /* tinygltf drops a primitive without a valid list of attributes and goes on. */
    if (good && problem.find("'attributes'") == problem.npos) return;
    std::string text = syntax_error(doc);
    if (text.empty() && problem.compare(0, 7, "\"asset\"") == 0)
        text = "asset.version is missing: this is not glTF 2.0";
    if (text.empty()) text = first_line(problem);
    fail(err, PBS_DATA, "%s", text.empty() ? "tinygltf refuses the file" : text.c_str());
}

} // namespace pbs::gltf
