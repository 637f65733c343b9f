// Materials by their numbers; behind the last is that of what has none. As gpu_material has it
// (draw_look.c).
struct Material {
    vec4 base, emissive;       // linear
    vec4 rest;                 // metallic, roughness, alpha below which is a hole
    vec4 place[6];             // two rows each: where base, material and emission are in textures
};
layout(std430, binding = 3) readonly buffer Palette { Material materials[]; };

Material material_of(uint number) {
    return materials[min(number, uint(materials.length()) - 1u)];
}

// Where a use of a texture (0: base, 1: material, 2: emission) is. For vertices: a fragment's
// derivatives must not come from what is read, which those outside of a triangle may not do.
vec2 texture_place(uint number, int use, vec2 uv) {
    uint i = min(number, uint(materials.length()) - 1u);
    vec3 at = vec3(uv, 1.0);
    return vec2(dot(materials[i].place[2 * use].xyz, at),
                dot(materials[i].place[2 * use + 1].xyz, at));
}
