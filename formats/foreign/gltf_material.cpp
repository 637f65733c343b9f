/* gltf_material.cpp: materials and textures, handed over when the first primitive uses them.
 *
 * A part carries one set of texture coordinates: the one of its base texture (else of the
 * metallic-roughness, else of the emissive texture). A texture of the same material that uses
 * another set is left out and counted. */
#include "formats/foreign/gltf.hpp"
#include <cmath>

namespace pbs::gltf {

/* A reference to a texture, from the core or from an extension. */
struct reader::texture_slot {
    int index = -1, set = 0;
    double offset[2] = {0, 0}, scale[2] = {1, 1}, rotation = 0;
};

typedef tinygltf::Value value;

static const value *find(const tinygltf::ExtensionMap &map, const char *name) {
    auto it = map.find(name);
    return it != map.end() && it->second.IsObject() ? &it->second : nullptr;
}

static double number(const value &object, const char *key, double otherwise) {
    const value &v = object.Get(key);
    return v.IsNumber() ? v.GetNumberAsDouble() : otherwise;
}

static void numbers(const value &object, const char *key, int n, double *out) {
    const value &v = object.Get(key);
    for (int k = 0; v.IsArray() && k < n && (size_t)k < v.ArrayLen(); k++)
        if (v.Get(k).IsNumber()) out[k] = v.Get(k).GetNumberAsDouble();
}

static int index_of(const value &object, const char *key, int otherwise) {
    const value &v = object.Get(key);
    return v.IsInt() ? v.GetNumberAsInt() : otherwise;
}

template <class Slot> static void apply_transform(Slot &slot, const value *t) {
    if (!t) return;
    numbers(*t, "offset", 2, slot.offset);
    numbers(*t, "scale", 2, slot.scale);
    slot.rotation = number(*t, "rotation", 0);
    slot.set = index_of(*t, "texCoord", slot.set);
}

template <class Slot> static Slot slot_of(const tinygltf::TextureInfo &info) {
    Slot slot;
    slot.index = info.index;
    slot.set = info.texCoord;
    apply_transform(slot, find(info.extensions, "KHR_texture_transform"));
    return slot;
}

/* The same from an extension, where tinygltf keeps plain values. */
template <class Slot> static Slot slot_of(const value &info) {
    Slot slot;
    if (!info.IsObject()) return slot;
    slot.index = index_of(info, "index", -1);
    slot.set = index_of(info, "texCoord", 0);
    const value &ext = info.Get("extensions");
    if (ext.IsObject() && ext.Get("KHR_texture_transform").IsObject())
        apply_transform(slot, &ext.Get("KHR_texture_transform"));
    return slot;
}

template <class Slot> static Slot base_slot(const tinygltf::Material &m) {
    const value *sg = find(m.extensions, "KHR_materials_pbrSpecularGlossiness");
    if (sg) return slot_of<Slot>(sg->Get("diffuseTexture"));
    return slot_of<Slot>(m.pbrMetallicRoughness.baseColorTexture);
}

template <class Slot> static Slot roughness_slot(const tinygltf::Material &m) {
    if (find(m.extensions, "KHR_materials_pbrSpecularGlossiness")) return Slot();
    return slot_of<Slot>(m.pbrMetallicRoughness.metallicRoughnessTexture);
}

template <class Slot> static int uv_set(const tinygltf::Material &m) {
    for (const Slot &s :
         {base_slot<Slot>(m), roughness_slot<Slot>(m), slot_of<Slot>(m.emissiveTexture)})
        if (s.index >= 0) return s.set;
    return 0;
}

void reader::read_image(int i, uint32_t &id) {
    const image_entry &e = doc_.images[(size_t)i];
    const char *given = doc_.name(e.name);
    std::string name = given ? given : "image " + std::to_string(i);
    if (e.view >= 0) {
        bytes b = whole_view(e.view);
        touch(b.size);
        check(sink_->texture(sink_->ctx, name.c_str(), b.data, b.size, &id, err_));
    } else if (e.has_uri && is_data_uri(e.uri)) {
        uint64_t size = 0;
        array<uint8_t> data = decode_data_uri(run_, e.uri, &size, err_);
        check(sink_->texture(sink_->ctx, name.c_str(), data.data(), size, &id, err_));
    } else {
        mapping file;
        std::string uri = unescape(e.uri);
        if (find_file(uri, file))
            check(sink_->texture(sink_->ctx, uri.c_str(), file.view().data, file.view().size, &id,
                                 err_));
        else
            check(sink_->missing(sink_->ctx, uri.empty() ? name.c_str() : uri.c_str(), &id, err_));
    }
}

/* The image's id at the sink. */
uint32_t reader::image(int i) {
    if (i < 0 || (size_t)i >= doc_.images.size())
        fail(err_, PBS_DATA, "image %d, but there are %zu", i, doc_.images.size());
    uint32_t &id = image_id_[(size_t)i];
    if (id == not_yet && left_out([&] { read_image(i, id); })) id = PBS_NONE;
    return id;
}

uint32_t reader::image_of_texture(const tinygltf::Texture &t) {
    if (t.source >= 0) return image(t.source);
    /* No fallback: WebP and AVIF are for the decoder to judge, Basis is certainly not read. */
    for (const char *name : {"EXT_texture_webp", "EXT_texture_avif"}) {
        const value *ext = find(t.extensions, name);
        if (ext) return image(index_of(*ext, "source", -1));
    }
    uint32_t id = PBS_NONE;
    const char *name = find(t.extensions, "KHR_texture_basisu") ? "a KHR_texture_basisu texture"
                                                                : "a texture without an image";
    check(sink_->missing(sink_->ctx, name, &id, err_));
    return id;
}

static uint8_t wrap_mode(int mode) {
    if (mode == TINYGLTF_TEXTURE_WRAP_CLAMP_TO_EDGE) return 1;
    return mode == TINYGLTF_TEXTURE_WRAP_MIRRORED_REPEAT ? 2 : 0;
}

pbs_texture_use reader::texture_use(const texture_slot &slot, int set) {
    pbs_texture_use use = {PBS_NONE, 0, 0, {1, 0, 0, 0, 1, 0}};
    if (slot.index < 0) return use;
    if (slot.set != set) {
        sink_->skip(sink_->ctx, PBS_SKIP_TEXTURE, 1);
        return use;
    }
    if ((size_t)slot.index >= head_.textures.size())
        fail(err_, PBS_DATA, "texture %d, but there are %zu", slot.index, head_.textures.size());
    const tinygltf::Texture &t = head_.textures[(size_t)slot.index];
    use.texture = image_of_texture(t);
    if (t.sampler >= 0) {
        if ((size_t)t.sampler >= head_.samplers.size())
            fail(err_, PBS_DATA, "sampler %d, but there are %zu", t.sampler, head_.samplers.size());
        use.wrap_u = wrap_mode(head_.samplers[(size_t)t.sampler].wrapS);
        use.wrap_v = wrap_mode(head_.samplers[(size_t)t.sampler].wrapT);
    }
    /* v grows downwards, so a counterclockwise turn has its sines the other way round. */
    double c = cos(slot.rotation), s = sin(slot.rotation);
    double m[6] = {c * slot.scale[0],  s * slot.scale[1], slot.offset[0],
                   -s * slot.scale[0], c * slot.scale[1], slot.offset[1]};
    for (int k = 0; k < 6; k++) use.transform[k] = (float)m[k];
    return use;
}

static void factors(const tinygltf::Material &m, pbs_material &out) {
    double base[4] = {1, 1, 1, 1};
    const value *sg = find(m.extensions, "KHR_materials_pbrSpecularGlossiness");
    if (sg) {
        numbers(*sg, "diffuseFactor", 4, base);
        out.metallic = 0;
        out.roughness = (float)(1 - number(*sg, "glossinessFactor", 1));
    } else {
        const auto &pbr = m.pbrMetallicRoughness;
        for (size_t k = 0; k < 4 && k < pbr.baseColorFactor.size(); k++)
            base[k] = pbr.baseColorFactor[k];
        out.metallic = (float)pbr.metallicFactor;
        out.roughness = (float)pbr.roughnessFactor;
    }
    for (int k = 0; k < 4; k++) out.base[k] = (float)base[k];
    const value *strength = find(m.extensions, "KHR_materials_emissive_strength");
    double s = strength ? number(*strength, "emissiveStrength", 1) : 1;
    for (size_t k = 0; k < 3 && k < m.emissiveFactor.size(); k++)
        out.emissive[k] = (float)(m.emissiveFactor[k] * s);
}

void reader::read_material(int i, known_material &known) {
    std::string_view text = doc_.materials[(size_t)i];
    counted memory(run_, bytes_for_json * text.size(), "a material's JSON", err_);
    tinygltf::Material m;
    in_place(err_, "material", (size_t)i, nullptr, [&] { parse_material(m, text, err_); });
    in_place(err_, "material", (size_t)i, m.name.empty() ? nullptr : m.name.c_str(), [&] {
        pbs_material out = {};
        factors(m, out);
        out.alpha = m.alphaMode == "MASK"    ? PBS_ALPHA_MASK
                    : m.alphaMode == "BLEND" ? PBS_ALPHA_BLEND
                                             : PBS_ALPHA_OPAQUE;
        out.alpha_cutoff = (float)m.alphaCutoff;
        out.double_sided = m.doubleSided;
        int set = uv_set<texture_slot>(m);
        out.base_texture = texture_use(base_slot<texture_slot>(m), set);
        out.material_texture = texture_use(roughness_slot<texture_slot>(m), set);
        out.emissive_texture = texture_use(slot_of<texture_slot>(m.emissiveTexture), set);
        out.name = m.name.empty() ? nullptr : m.name.c_str();
        check(sink_->material(sink_->ctx, &out, &known.id, err_));
        known.set = set;
    });
}

const reader::known_material &reader::material(int i) {
    static const known_material none = {PBS_NONE, 0};
    if (i < 0) return none;
    if ((size_t)i >= doc_.materials.size())
        fail(err_, PBS_DATA, "material %d, but there are %zu", i, doc_.materials.size());
    known_material &known = materials_[(size_t)i];
    if (known.id == not_yet && left_out([&] { read_material(i, known); })) known = none;
    return known;
}

} // namespace pbs::gltf
