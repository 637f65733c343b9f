layout(std430, binding = 0) readonly buffer Faces { vec4 face_normal[]; }; // part's frame
layout(binding = 0) uniform sampler2D base_texture;
layout(binding = 1) uniform sampler2D material_texture;
layout(binding = 2) uniform sampler2D emissive_texture;

uniform mat3 to_view_normal;
uniform int first_face; // of this call in face_normal; -1: normals come from the vertices
uniform vec4 base;
uniform vec3 emissive;
uniform vec2 metal_rough;
uniform float cutoff; // alpha below it is a hole; 0: none
uniform mat3x2 base_uv, material_uv, emissive_uv;

in vec3 where, smooth_normal;
in vec2 uv;
in vec4 tint;
out vec4 colour;

void main() {
    vec4 c = base * tint * texture(base_texture, base_uv * vec3(uv, 1.0));
    vec2 m = metal_rough * texture(material_texture, material_uv * vec3(uv, 1.0)).bg;
    vec3 e = emissive * texture(emissive_texture, emissive_uv * vec3(uv, 1.0)).rgb;
    if (c.a < cutoff) discard;
    vec3 n = smooth_normal;
    if (first_face >= 0) n = to_view_normal * face_normal[first_face + gl_PrimitiveID].xyz;
    colour = vec4(shade(where, normalize(n), c.rgb, m.x, m.y, e), 1);
}
