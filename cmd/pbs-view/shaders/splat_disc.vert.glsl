// A surfel as a triangle around its disc, for the passes 1 and 3, which fill the depth buffer, and
// with EWA defined for pass 4, which adds up colours.

out vec2 at; // in the disc: inside the unit circle

#ifdef EWA
flat out vec3 lit;
flat out vec2 disc, splat; // half axes in pixels: of the disc's picture, of what is drawn
flat out vec3 kernel;      // at to the exponent's root along both axes; weight at the centre
#endif

// Half axis along d of the picture of a disc in the node, normal n there.
float reach(uint o, vec3 d, vec3 n) {
    vec3 g = d.x * object[o].disc[0].xyz + d.y * object[o].disc[1].xyz + d.z * object[o].disc[2].xyz;
    float along = dot(g, n);
    return sqrt(max(dot(g, g) - along * along, 0.0));
}

#ifdef EWA
struct Look {
    vec3 normal, albedo, emissive;
    vec2 material;
};

Look look_at(uint w, ivec4 field) {
    Look l = Look(vec3(0), vec3(1), vec3(0), vec2(0, 1));
    if (field.x >= 0 && word[w + uint(field.x)] != 0x80008000u)
        l.normal = normalize(octahedral_normal(unpackSnorm2x16(word[w + uint(field.x)])));
    if (field.y >= 0) l.albedo = linear_from_srgb(unpackUnorm4x8(word[w + uint(field.y)]).rgb);
    if (field.z >= 0) l.material = unpackUnorm4x8(word[w + uint(field.z)]).xy;
    if (field.w >= 0) l.emissive = linear_from_srgb(unpackUnorm4x8(word[w + uint(field.w)]).rgb);
    return l;
}

// Surfels of an octave: see average.h.
uint octave_length(uint n, uint k) {
    return (n >> 2u * k) + uint((n & (1u << 2u * k) - 1u) != 0u);
}

// Entries of an octave that lie in the object's buffer.
uint entries_here(uint o, uint k) {
    uint n = octave_length(object[o].octaves.z, k), before = object[o].more.z;
    return n > before ? min(n - before, object[o].more.w) : 0u;
}

Look look_in(uint o, uint i, uint k) {
    uvec4 octaves = object[o].octaves;
    ivec4 field = object[o].field;
    if (k == 0u) return look_at(object[o].records.x + i * object[o].records.y, field);
    uint entry = i + object[o].records.w - object[o].more.z;
    for (uint j = k + 1u; j <= octaves.w; j++) entry += entries_here(o, j);
    return look_at(octaves.x + entry * octaves.y, field - 2 * ivec4(greaterThanEqual(field, ivec4(0))));
}

// Surfel mipmaps (paper 4, section 4.4): an octave farther for every half of a pixel that the disc
// is smaller than one, blended, as far as the surfel has octaves.
Look look_of(uint o, uint i, float half_axis) {
    uvec4 octaves = object[o].octaves;
    if (octaves.x == NONE) return look_in(o, i, 0u);
    float wanted = uintBitsToFloat(object[o].more.y) + max(-log2(max(half_axis, 1e-9)), 0.0);
    uint k = uint(clamp(floor(wanted), 0.0, float(octaves.w))), whole = i + object[o].records.w;
    while (k > 0u && whole >= octave_length(octaves.z, k)) k--;
    Look a = look_in(o, i, k);
    float blend = clamp(wanted - float(k), 0.0, 1.0);
    if (k == octaves.w || blend == 0.0 || whole >= octave_length(octaves.z, k + 1u)) return a;
    Look b = look_in(o, i, k + 1u);
    // Opposite normals have no mean.
    if (dot(a.normal, b.normal) < -0.99) b.normal = a.normal;
    return Look(mix(a.normal, b.normal, blend), mix(a.albedo, b.albedo, blend),
                mix(a.emissive, b.emissive, blend), mix(a.material, b.material, blend));
}
#endif

void main() {
    // Corners of a triangle around the unit circle.
    const vec2 corner[3] = vec2[3](vec2(-1.7320508, -1.0), vec2(1.7320508, -1.0), vec2(0.0, 2.0));
    uint o, i, n_vertex = uint(gl_VertexID);
    at = corner[n_vertex % 3u];
#ifdef EWA
    lit = kernel = vec3(0);
    disc = splat = vec2(1);
#endif
    gl_Position = vec4(0, 0, -1, 0); // nowhere
    if (!find_surfel(n_vertex / 3u, o, i)) return;
    vec3 c = centre_of(o, i);
    if (-c.z < project.z) return;
    vec3 v = -normalize(c), local = local_normal(o, i), n = to_view_normal(o, local);
    float away = farther(o, c, n);
    bool faces = local == vec3(0);
    if (faces)
        local = normalize(v.x * object[o].disc[0].xyz + v.y * object[o].disc[1].xyz +
                          v.z * object[o].disc[2].xyz);
    n = faces ? v : normalize(n);

    // t across the line of sight, b the axis that is foreshortened. Edge-on a disc is widened along
    // b's picture, and not turned: the depth that it spans stays. A large one gets a quarter of a
    // pixel only, or silhouettes would grow.
    float side = pixel * -c.z, least = least_at(c);
    vec3 t = cross(n, v);
    float tilt = length(t);
    t = tilt > 1e-3 ? t / tilt : normalize(cross(n, abs(n.x) < 0.7 ? vec3(1, 0, 0) : vec3(0, 1, 0)));
    vec3 b = cross(n, t), across = cross(t, v);
    float radius = reach(o, t, local), s = reach(o, b, local), flat_s = s * abs(dot(n, v));
    float a = max(radius, least);
    float narrow = max(flat_s, least * clamp(1.75 - 0.75 * s / least, 0.25, 1.0)), ring = 0.0;
#ifdef EWA
    // The disc's Gaussian, whose deviation is half the disc, and a pixel's, of half a pixel: their
    // variances add. Drawn half a pixel farther than the disc, so that its edge is smooth.
    ring = 0.5 * side;
    disc = vec2(a, narrow) / side;
    splat = disc + 0.5;
    vec2 wide = 0.5 * sqrt(disc * disc + 1.0);
    kernel = vec3(0.70710678 * splat / wide, 0.25 * disc.x * disc.y / (wide.x * wide.y));
    Look look = look_of(o, i, radius / side);
    if (!faces && look.normal != vec3(0)) n = normalize(to_view_normal(o, look.normal));
    lit = shade(c, n, look.albedo, look.material.x, look.material.y, look.emissive);
#endif
    float wider = (narrow + ring - flat_s) * (dot(across, b) < 0.0 ? -1.0 : 1.0);
    vec3 p = c + at.x * (a + ring) * t + at.y * (s * b + wider * across);
#ifndef EWA
    // Along the line of sight away by a disc's diameter: what is added up there passes, also a side
    // that goes steeply down behind an edge over which the disc reaches.
    p *= 1.0 + 2.0 * a / -c.z;
#endif
    p *= away;
    gl_Position = vec4(p.xy * project.xy, project.z, -p.z);
}
