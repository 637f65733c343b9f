layout(binding = 0) uniform sampler2D base_texture;
layout(binding = 1) uniform sampler2D material_texture;
layout(binding = 2) uniform sampler2D emissive_texture;

uniform vec4 base;
uniform vec3 emissive;
uniform vec2 metal_rough;
uniform float cutoff; // alpha below it is a hole; 0: none
uniform mat3x2 base_uv, material_uv, emissive_uv;

in vec3 where, normal;
in vec2 uv;
in vec4 tint;
out vec4 colour;

void main() {
    vec4 c = base * tint * texture(base_texture, base_uv * vec3(uv, 1.0));
    vec2 m = metal_rough * texture(material_texture, material_uv * vec3(uv, 1.0)).bg;
    vec3 e = emissive * texture(emissive_texture, emissive_uv * vec3(uv, 1.0)).rgb;
    if (c.a < cutoff) discard;
    colour = vec4(shade(where, normalize(normal), c.rgb, m.x, m.y, e), 1);
}
