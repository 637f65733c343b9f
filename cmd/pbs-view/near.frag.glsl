struct Material {
    vec4 base, emissive;       // linear
    vec4 rest;                 // metallic, roughness, alpha below which is a hole
};
layout(std430, binding = 3) readonly buffer Palette { Material materials[]; };

in vec3 where, normal;
in vec4 tint;
flat in uint material;
out vec4 colour;

void main() {
    Material m = materials[min(material, uint(materials.length()) - 1u)];
    vec4 c = m.base * tint;
    if (c.a < m.rest.z) discard;
    vec3 n = normal;
    if (dot(n, n) == 0.0) n = cross(dFdx(where), dFdy(where));
    colour = vec4(shade(where, normalize(n), c.rgb, m.rest.x, m.rest.y, m.emissive.rgb), 1);
}
