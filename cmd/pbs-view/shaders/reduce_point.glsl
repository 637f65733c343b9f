// Points that a pass has taken, as they are drawn now; paper 3, section 3.3.2: a point's size is the
// spacing wanted there, and less at the distance where it comes in.

struct Point { float x, y, z, spacing; uint colour, normal; };
layout(std430, binding = 0) readonly buffer Points { Point point[]; };

uniform mat4x3 to_view;    // from the view of the pass to that of now
uniform mat3 to_view_normal;
uniform float stretch;     // of lengths, in that
uniform vec3 project;      // x and y scale, near
uniform float smallest;    // least half axis of a disc's picture, at distance 1
uniform float spacing, fall, least, fade, size, floor_size;
uniform bool periphery;

vec3 place_of(uint i) { return to_view * vec4(point[i].x, point[i].y, point[i].z, 1.0); }

vec3 normal_of(uint i, vec3 c) {
    if (point[i].normal == 0x80008000u) return -normalize(c);
    return normalize(to_view_normal * octahedral_normal(unpackSnorm2x16(point[i].normal)));
}

// How far a point has come in; 0: it is not drawn. half_axis: of its disc.
float grown_of(uint i, vec3 c, out float half_axis) {
    half_axis = 0.0;
    if (-c.z < project.z) return 0.0;
    float wanted = spacing * length(c), own = point[i].spacing * stretch;
    if (periphery) wanted /= max(1.0 - fall * length(c.xy * project.xy / c.z), least);
    float grown = fade < 1.0 ? clamp((own - wanted) / (own * (1.0 - fade)), 0.0, 1.0)
                             : float(own >= wanted);
    half_axis = grown * max(0.5 * max(size * wanted, floor_size), smallest * -c.z);
    return grown;
}

vec3 light_of(uint i, vec3 c) {
    vec3 albedo = linear_from_srgb(unpackUnorm4x8(point[i].colour).rgb);
    return shade(c, normal_of(i, c), albedo, 0.0, 1.0, vec3(0));
}
