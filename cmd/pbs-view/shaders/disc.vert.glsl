// One triangle a surfel, around its disc; records are pulled from the buffer as they are in the
// file. Paper 1, section 4.2, with triangles instead of points: they know no largest size. A
// surfel is lit once: its normal is one, and a fragment costs less.

layout(std430, binding = 0) readonly buffer Records { uint word[]; };

// Looks of the surfels: normal, colour, material, emissive. Those of the octave that is too fine
// (first word, stride) and, of the first of them, those of the one that is too coarse (count), of
// which `blend` is taken. w of that: surfels of the node before the first one here.
layout(std140, binding = 0) uniform Node {
    vec4 to_view[3];           // lattice to view, rows
    vec4 disc_to_view[3];      // disc's radius in the node to view
    vec4 to_view_normal[3];    // its cofactors
    uint first, stride;        // words
    uvec2 fine;
    uvec4 coarse;
    ivec4 fine_field, coarse_field; // word of each, or -1
    float blend;
    float wanted, unit, slack; // radius that is wanted at distance 1, or 0; of spacing 1; in radii
} node;

uniform float smallest;        // least half axis of a disc's picture, at distance 1
uniform vec3 project;          // x and y scale, near

out vec2 at;                   // in the disc: inside the unit circle
flat out vec3 lit;
flat out float sag;            // how much farther a disc's rim counts than it is

mat3 rows(vec4 r[3]) {
    return transpose(mat3(r[0].xyz, r[1].xyz, r[2].xyz));
}

// Half axis along d of the picture of a disc in the node, normal n there.
float reach(vec3 d, vec3 n, mat3 disc_to_view) {
    vec3 g = d * disc_to_view;
    float along = dot(g, n);
    return sqrt(max(dot(g, g) - along * along, 0.0));
}

struct Look {
    vec3 normal, albedo, emissive;
    vec2 material;
};

Look look_at(uint w, ivec4 field) {
    Look l = Look(vec3(0), vec3(1), vec3(0), vec2(0, 1));
    // 0x80008000: it has none, as points of clouds; its disc faces the viewer.
    if (field.x >= 0 && word[w + uint(field.x)] != 0x80008000u)
        l.normal = normalize(octahedral_normal(unpackSnorm2x16(word[w + uint(field.x)])));
    if (field.y >= 0) l.albedo = linear_from_srgb(unpackUnorm4x8(word[w + uint(field.y)]).rgb);
    if (field.z >= 0) l.material = unpackUnorm4x8(word[w + uint(field.z)]).xy;
    if (field.w >= 0) l.emissive = linear_from_srgb(unpackUnorm4x8(word[w + uint(field.w)]).rgb);
    return l;
}

Look look_of(uint i) {
    Look a = look_at(node.fine.x + i * node.fine.y, node.fine_field);
    if (i >= node.coarse.z) return a;
    Look b = look_at(node.coarse.x + i * node.coarse.y, node.coarse_field);
    float blend = node.blend;
    // Opposite normals have no mean.
    if (dot(a.normal, b.normal) < -0.99) b.normal = a.normal;
    return Look(mix(a.normal, b.normal, blend), mix(a.albedo, b.albedo, blend),
                mix(a.emissive, b.emissive, blend), mix(a.material, b.material, blend));
}

void main() {
    // Corners of a triangle around the unit circle.
    const vec2 corner[3] = vec2[3](vec2(-1.7320508, -1.0), vec2(1.7320508, -1.0), vec2(0.0, 2.0));
    uint i = uint(gl_VertexID / 3), w = node.first + i * node.stride;
    mat3 disc_to_view = rows(node.disc_to_view);
    at = corner[gl_VertexID % 3];
    vec4 q = vec4(word[w] & 0xffffu, word[w] >> 16, word[w + 1u] & 0xffffu, 1.0);
    vec3 c = vec3(dot(node.to_view[0], q), dot(node.to_view[1], q), dot(node.to_view[2], q));
    // Beyond the paper: the prefix is that of the node's nearest point. A surfel farther away whose
    // spacing is within the radius that is wanted there is covered by those before it, as large.
    float far = max(1.0, node.wanted * -c.z);
    if (node.wanted > 0.0 && i + node.coarse.w > 0u && far > 1.0) {
        float spacing = node.unit * unpackHalf2x16(word[w + 1u]).y;
        if (spacing + node.slack <= far) {
            lit = vec3(0);
            sag = 0.0;
            gl_Position = vec4(0, 0, -1, 1);
            return;
        }
        disc_to_view *= far;
    }
    Look look = look_of(i);
    vec3 v = -normalize(c), n = v, local = v * disc_to_view;
    if (look.normal != vec3(0)) {
        local = look.normal;
        n = rows(node.to_view_normal) * local;
    }
    local = normalize(local);
    n = normalize(n);

    // Axes: t across the line of sight, b the one that is foreshortened. A disc smaller than a
    // pixel grows to one. One that is seen edge-on is widened along b's picture, and not turned:
    // the depth it spans stays. A large one gets a quarter of that only, which is enough for a
    // line; more would be seen around every silhouette.
    vec3 t = cross(n, v);
    float tilt = length(t);
    t = tilt > 1e-3 ? t / tilt : normalize(cross(n, abs(n.x) < 0.7 ? vec3(1, 0, 0) : vec3(0, 1, 0)));
    vec3 b = cross(n, t), across = cross(t, v);
    float least = smallest * -c.z, a = max(reach(t, local, disc_to_view), least), s = reach(b, local, disc_to_view);
    float wanted = least * clamp(1.75 - 0.75 * s / least, 0.25, 1.0);
    float wider = max(wanted - s * abs(dot(n, v)), 0.0) * (dot(across, b) < 0.0 ? -1.0 : 1.0);
    vec3 p = c + at.x * a * t + at.y * (s * b + wider * across);

    sag = 0.25 * a;
    lit = shade(c, n, look.albedo, look.material.x, look.material.y, look.emissive);
    gl_Position = vec4(p.xy * project.xy, project.z, -p.z);
}
