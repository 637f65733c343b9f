// One triangle a surfel, around its disc; records are pulled from the buffer as they are in the
// file. Paper 1, section 4.2, with triangles instead of points: they know no largest size.

layout(std430, binding = 0) readonly buffer Records { uint word[]; };

uniform uint first, stride;    // in words
uniform ivec4 field;           // word of normal, colour, material, emissive in a record, or -1
uniform mat4x3 to_view;        // lattice to view
uniform mat3 to_view_linear;   // node's unit to view
uniform mat3 to_view_normal;   // its cofactors
uniform float radius;          // node's unit
uniform float smallest;        // least half axis of a disc's picture, at distance 1
uniform vec3 project;          // x and y scale, near

out vec2 at;                   // in the disc: inside the unit circle
out vec3 where;
flat out vec3 normal, albedo, emissive;
flat out vec2 material;

// Half axis along d of the picture of a disc in the node, normal n there.
float reach(vec3 d, vec3 n) {
    vec3 g = d * to_view_linear;
    float along = dot(g, n);
    return radius * sqrt(max(dot(g, g) - along * along, 0.0));
}

void main() {
    // Corners of a triangle around the unit circle.
    const vec2 corner[3] = vec2[3](vec2(-1.7320508, -1.0), vec2(1.7320508, -1.0), vec2(0.0, 2.0));
    uint w = first + uint(gl_VertexID / 3) * stride;
    at = corner[gl_VertexID % 3];
    vec3 c = to_view * vec4(word[w] & 0xffffu, word[w] >> 16, word[w + 1u] & 0xffffu, 1.0);
    vec3 v = -normalize(c), n = v, local = v * to_view_linear;
    if (field.x >= 0) {
        vec2 o = unpackSnorm2x16(word[w + uint(field.x)]);
        local = vec3(o, 1.0 - abs(o.x) - abs(o.y));
        float t = max(-local.z, 0.0);
        local.xy -= vec2(o.x < 0.0 ? -t : t, o.y < 0.0 ? -t : t);
        n = to_view_normal * local;
    }
    local = normalize(local);
    n = normalize(n);

    // Axes: t across the line of sight, b the one that is foreshortened; w is b's picture. Where
    // the disc's picture is thinner than a pixel it is widened there, not turned: the depth it
    // spans stays, and its edge moves by less than a pixel.
    vec3 t = cross(n, v);
    float tilt = length(t);
    t = tilt > 1e-3 ? t / tilt : normalize(cross(n, abs(n.x) < 0.7 ? vec3(1, 0, 0) : vec3(0, 1, 0)));
    vec3 b = cross(n, t);
    float least = smallest * -c.z, a = max(reach(t, local), least), s = reach(b, local);
    float thin = s * abs(dot(n, v));
    vec3 across = cross(t, v);
    across = dot(across, b) < 0.0 ? -across : across;
    where = c + at.x * a * t + at.y * (s * b + max(least - thin, 0.0) * across);

    normal = n;
    albedo = vec3(1);
    material = vec2(0, 1);
    emissive = vec3(0);
    if (field.y >= 0) albedo = linear_from_srgb(unpackUnorm4x8(word[w + uint(field.y)]).rgb);
    if (field.z >= 0) material = unpackUnorm4x8(word[w + uint(field.z)]).xy;
    if (field.w >= 0) emissive = linear_from_srgb(unpackUnorm4x8(word[w + uint(field.w)]).rgb);
    gl_Position = vec4(where.xy * project.xy, project.z, -where.z);
}
