// A voxel as those of its faces that look at the eye, at most three: paper 2, section 4, with pulled
// vertices instead of a geometry shader. Seven vertices: the corner nearest to the eye, its three
// neighbours along the axes, and the far corners of the three faces, which carry the faces' light. A
// face that is not there has its far corner at the near one, and no area.

layout(std430, binding = 0) readonly buffer Arrays { uint word[]; };

uniform uint batch;            // voxels of an instance
uniform uint place;            // first word of each array; of those that may be absent, or -1
uniform ivec4 look;            // normal, colour, material, emissive
uniform mat4x3 to_view;        // cells to view
uniform mat3 to_view_normal;   // its cofactors,
uniform float hand;            // and -1 if it mirrors
uniform vec3 eye;              // in cells
uniform vec3 project;          // x and y scale, near

flat out vec3 lit;

const uint TWO_SIDED = 64u;

vec3 normal_of(uint bits) {
    ivec3 n = ivec3(bits << 22, bits << 12, bits << 2) >> 22;
    return vec3(n);
}

vec3 light(uint i, uint flags, vec3 c, vec3 face) {
    vec3 n = face, albedo = vec3(1), emissive = vec3(0), v = -normalize(c);
    vec2 material = vec2(0, 1);
    if (look.x >= 0 && word[uint(look.x) + i] != 0u) n = normal_of(word[uint(look.x) + i]);
    if (look.y >= 0) albedo = linear_from_srgb(unpackUnorm4x8(word[uint(look.y) + i]).rgb);
    if (look.z >= 0) material = unpackUnorm4x8(word[uint(look.z) + i]).xy;
    if (look.w >= 0) emissive = linear_from_srgb(unpackUnorm4x8(word[uint(look.w) + i]).rgb);
    n = normalize(hand * (to_view_normal * n));
    // shade() turns normals to the viewer. A mean normal may look away from one who sees the face;
    // where the other side is none of the surface it only goes as far as the horizon.
    float away = dot(n, v);
    if (away < 0.0 && (flags & TWO_SIDED) == 0u) n = normalize(n - 1.001 * away * v);
    return shade(c, n, albedo, material.x, material.y, emissive);
}

void main() {
    uint i = uint(gl_InstanceID) * batch + uint(gl_VertexID) / 7u;
    int corner = gl_VertexID % 7, k = (corner + 2) % 3; // 1 and 4 are of x
    uint p = word[place + i], flags = p >> 24;
    vec3 low = vec3(p & 255u, p >> 8 & 255u, p >> 16 & 255u);
    vec3 at = step(low + 0.5, eye); // the near corner, in the voxel
    bool upper = at[k] > 0.0;
    bool seen = (upper ? eye[k] > low[k] + 1.0 : eye[k] < low[k]) &&
                (flags >> (2 * k + int(upper)) & 1u) != 0u;
    lit = vec3(0);
    vec3 face = vec3(0);
    face[k] = upper ? 1.0 : -1.0;
    if (corner >= 4 && seen) {
        lit = light(i, flags, to_view * vec4(low + 0.5, 1.0), face);
        at = mix(1.0 - at, at, abs(face));
    } else if (corner >= 1 && corner < 4) {
        at = mix(at, 1.0 - at, abs(face));
    }
    vec3 v = to_view * vec4(low + at, 1.0);
    gl_Position = vec4(v.xy * project.xy, project.z, -v.z);
}
