layout(location = 0) in vec3 position;
layout(location = 1) in vec2 octahedral;
layout(location = 2) in vec2 texture_place;
layout(location = 3) in vec4 vertex_colour;

uniform mat4x3 to_view;
uniform mat3 to_view_normal;
uniform vec3 project; // x and y scale, near

out vec3 where, normal;
out vec2 uv;
out vec4 tint;

void main() {
    normal = to_view_normal * normalize(octahedral_normal(octahedral));
    where = to_view * vec4(position, 1.0);
    uv = texture_place;
    tint = vec4(linear_from_srgb(vertex_colour.rgb), vertex_colour.a);
    gl_Position = vec4(where.xy * project.xy, project.z, -where.z);
}
