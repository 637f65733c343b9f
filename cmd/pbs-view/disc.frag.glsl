in vec2 at;
in vec3 where;
flat in vec3 normal, albedo, emissive;
flat in vec2 material;
out vec4 colour;

void main() {
    if (dot(at, at) > 1.0) discard;
    colour = vec4(shade(where, normal, albedo, material.x, material.y, emissive), 1);
}
