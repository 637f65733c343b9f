// A voxel as those of its faces that look at the eye, at most three: paper 2, section 4, with pulled
// vertices instead of a geometry shader. Seven vertices: the corner nearest to the eye, its three
// neighbours along the axes, and the far corners of the three faces, which carry the faces' light. A
// face that is not there has its far corner at the near one, and no area.

layout(std430, binding = 0) readonly buffer Arrays { uint word[]; };
layout(std430, binding = 1) readonly buffer Faces { uint attribute_of_face[]; };

layout(std140, binding = 0) uniform Node {
    vec4 to_view[3];           // cells to view, rows
    vec4 to_view_normal[3];    // its cofactors
    vec3 eye;                  // in cells
    float hand;                // -1 if it mirrors
    ivec4 look;                // first word of each array; of those that are absent, -1: normal,
                               // colour, material, emissive
    int place, face, faces;    // where its faces begin in the list; that list
    uint face_count, face_colours, number;
} node;

uniform uint batch;            // voxels of an instance
uniform vec3 project;          // x and y scale, near

flat out uint number;
flat out vec3 lit;

const uint TWO_SIDED = 64u;

vec3 normal_of(uint bits) {
    ivec3 n = ivec3(bits << 22, bits << 12, bits << 2) >> 22;
    return vec3(n);
}

mat3 rows(vec4 r[3]) {
    return transpose(mat3(r[0].xyz, r[1].xyz, r[2].xyz));
}

// The attribute of the face that is bit `face` of the mask.
void dress(uint i, uint flags, int face, inout vec3 albedo, inout vec2 material,
           inout vec3 emissive) {
    uint at = word[uint(node.face) + i] + uint(bitCount(flags & ((1u << face) - 1u)));
    uint a = attribute_of_face[uint(node.faces) + min(at, node.face_count - 1u)];
    if (node.face_colours != 0u) {
        albedo = linear_from_srgb(unpackUnorm4x8(a).rgb);
        return;
    }
    Material m = material_of(a);
    albedo = m.base.rgb;
    material = m.rest.xy;
    emissive = m.emissive.rgb;
}

vec3 light(uint i, uint flags, vec3 c, vec3 face, int bit) {
    vec3 n = face, albedo = vec3(1), emissive = vec3(0), v = -normalize(c);
    vec2 material = vec2(0, 1);
    ivec4 look = node.look;
    mat3 to_view_normal = rows(node.to_view_normal);
    if (look.x >= 0 && word[uint(look.x) + i] != 0u) n = normal_of(word[uint(look.x) + i]);
    if (look.y >= 0) albedo = linear_from_srgb(unpackUnorm4x8(word[uint(look.y) + i]).rgb);
    if (look.z >= 0) material = unpackUnorm4x8(word[uint(look.z) + i]).xy;
    if (look.w >= 0) emissive = linear_from_srgb(unpackUnorm4x8(word[uint(look.w) + i]).rgb);
    if (node.face >= 0) dress(i, flags, bit, albedo, material, emissive);
    n = normalize(node.hand * (to_view_normal * n));
    // shade() turns normals to the viewer. A mean normal may look away from one who sees the face,
    // of thin parts often; where the other side is none of the surface the face has its own then.
    if (dot(n, v) < 0.0 && (flags & TWO_SIDED) == 0u)
        n = normalize(node.hand * (to_view_normal * face));
    return shade(c, n, albedo, material.x, material.y, emissive);
}

vec3 view(vec3 cell) {
    vec4 q = vec4(cell, 1.0);
    return vec3(dot(node.to_view[0], q), dot(node.to_view[1], q), dot(node.to_view[2], q));
}

void main() {
    number = node.number;
    uint i = uint(gl_InstanceID) * batch + uint(gl_VertexID) / 7u;
    int corner = gl_VertexID % 7, k = (corner + 2) % 3; // 1 and 4 are of x
    uint p = word[uint(node.place) + i], flags = p >> 24;
    vec3 low = vec3(p & 255u, p >> 8 & 255u, p >> 16 & 255u);
    vec3 eye = node.eye, at = step(low + 0.5, eye); // the near corner, in the voxel
    bool upper = at[k] > 0.0;
    bool seen = (upper ? eye[k] > low[k] + 1.0 : eye[k] < low[k]) &&
                (flags >> (2 * k + int(upper)) & 1u) != 0u;
    lit = vec3(0);
    vec3 face = vec3(0);
    face[k] = upper ? 1.0 : -1.0;
    if (corner >= 4 && seen) {
        lit = light(i, flags, view(low + 0.5), face, 2 * k + int(upper));
        at = mix(1.0 - at, at, abs(face));
    } else if (corner >= 1 && corner < 4) {
        at = mix(at, 1.0 - at, abs(face));
    }
    vec3 v = view(low + at);
    gl_Position = vec4(v.xy * project.xy, project.z, -v.z);
}
