layout(location = 0) in vec3 position;
layout(location = 1) in vec2 octahedral;
layout(location = 2) in vec2 uv;
layout(location = 3) in vec4 vertex_colour;

uniform mat4x3 to_view;
uniform mat3 to_view_normal;
uniform vec3 project; // x and y scale, near
uniform uint number;  // of the material

out vec3 where, normal;
out vec2 base_at, material_at, emissive_at;
out vec4 tint;
flat out uint material;

void main() {
    normal = to_view_normal * normalize(octahedral_normal(octahedral));
    where = to_view * vec4(position, 1.0);
    material = number;
    base_at = texture_place(number, 0, uv);
    material_at = texture_place(number, 1, uv);
    emissive_at = texture_place(number, 2, uv);
    tint = vec4(linear_from_srgb(vertex_colour.rgb), vertex_colour.a);
    gl_Position = vec4(where.xy * project.xy, project.z, -where.z);
}
