// The surface of source geometry. TEXTURED: with the textures that are bound, which are white where
// the material has none.
#ifdef TEXTURED
layout(binding = 0) uniform sampler2D base_texture;
layout(binding = 1) uniform sampler2D material_texture;
layout(binding = 2) uniform sampler2D emissive_texture;
in vec2 base_at, material_at, emissive_at;
#endif

in vec3 where, normal;
in vec4 tint;
flat in uint material;
out vec4 colour;

void main() {
    Material m = material_of(material);
    vec4 c = m.base * tint;
    vec2 metal_rough = m.rest.xy;
    vec3 emissive = m.emissive.rgb;
#ifdef TEXTURED
    c *= texture(base_texture, base_at);
    metal_rough *= texture(material_texture, material_at).bg;
    emissive *= texture(emissive_texture, emissive_at).rgb;
#endif
    vec3 n = normal;
    if (dot(n, n) == 0.0) n = cross(dFdx(where), dFdy(where));
    if (c.a < m.rest.z) discard;
    colour = vec4(shade(where, normalize(n), c.rgb, metal_rough.x, metal_rough.y, emissive), 1);
}
