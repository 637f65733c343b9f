// Points as discs that face the eye, without the rasteriser: every point goes through the pixels
// under its disc. With WIDE one 64-bit maximum of depth and number; else two runs, the second for
// the number of the point whose depth has won.

layout(local_size_x = 128) in;

#ifdef WIDE
layout(std430, binding = 1) buffer Pixels { uint64_t pixel[]; };
#else
layout(std430, binding = 1) buffer Depths { uint depth[]; };
layout(std430, binding = 2) buffer Numbers { uint number[]; };
uniform bool second;
#endif
layout(std430, binding = 3) readonly buffer Command { uint vertices; };

uniform uvec2 extent;  // of the picture, pixels

void meet(uint p, uint bits, uint i) {
#ifdef WIDE
    atomicMax(pixel[p], uint64_t(bits) << 32 | uint64_t(i + 1u));
#else
    if (!second) atomicMax(depth[p], bits);
    else if (depth[p] == bits) atomicMax(number[p], i + 1u);
#endif
}

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= vertices / 3u) return;
    vec3 c = place_of(i);
    float half_axis, grown = grown_of(i, c, half_axis);
    if (grown <= 0.0) return;
    // y grows downwards; the middle of pixel 0 is at 0.5.
    vec2 size_of = vec2(extent), middle = (0.5 + 0.5 * vec2(1, -1) * c.xy * project.xy / -c.z) * size_of;
    float radius = 0.5 * half_axis * project.y / -c.z * size_of.y;
    if (any(greaterThan(abs(middle - 0.5 * size_of), 0.5 * size_of + radius))) return;
    ivec2 low = ivec2(max(ceil(middle - radius - 0.5), 0.0));
    ivec2 high = ivec2(min(floor(middle + radius - 0.5), size_of - 1.0));
    for (int y = low.y; y <= high.y; y++)
        for (int x = low.x; x <= high.x; x++) {
            vec2 d = (vec2(x, y) + 0.5 - middle) / radius;
            precise float away = dot(d, d);
            // The rim counts as farther than it is, see disc.frag.glsl.
            precise float z = project.z / (-c.z + 0.25 * half_axis * away);
            if (away <= 1.0) meet(uint(y) * extent.x + uint(x), floatBitsToUint(z), i);
        }
}
