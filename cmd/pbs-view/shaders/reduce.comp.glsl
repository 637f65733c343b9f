// Paper 3, section 3.3.1: records of one buffer that pass go to the buffer of points. A work group
// takes 1024 records of one node. Everything that decides is `precise`, so that a processor with
// the same numbers decides the same.

layout(local_size_x = 128) in;

struct Slice {
    vec4 to_view[3], normal[3]; // rows, for this pass's camera
    uvec4 records;              // first word, stride, how many, index in its node of the first
    ivec4 field;                // of normal and colour in a record, or -1; first work group; seed
    vec4 unit;                  // x: spacing 1 of a record, in view coordinates
};
struct Point { float x, y, z, spacing; uint colour, normal; };

layout(std430, binding = 0) readonly buffer Records { uint word[]; };
layout(std430, binding = 1) readonly buffer Slices { Slice slice[]; };
layout(std430, binding = 2) writeonly buffer Points { Point point[]; };
layout(std430, binding = 3) buffer Command { uint vertices, instances, first, base, taken, most; };
layout(std430, binding = 4) readonly buffer Shares { float share[256]; };

uniform uvec2 slices; // of this buffer: first, behind the last
uniform uint group;   // number of the first work group
uniform vec3 project; // x and y scale, near
uniform float wide, spacing, fall, least;
uniform bool periphery, steps;

shared uint mine, here;
Slice now; // this work group's, read once

float half_value(uint h) { // never infinite; see quant.h
    uint e = h >> 10u & 31u, m = h & 1023u;
    float v = e == 0u ? float(m) * 5.9604644775390625e-8 : uintBitsToFloat(e + 112u << 23u | m << 13u);
    return (h & 0x8000u) != 0u ? -v : v;
}

uint number(uint i, uint seed) {
    uint h = (i ^ seed) * 747796405u + 2891336453u;
    h = (h >> (h >> 28u) + 4u ^ h) * 277803737u;
    return (h >> 22u ^ h) & 255u;
}

float dot4(vec4 row, vec3 q) {
    precise float sum = row.x * q.x;
    sum = sum + row.y * q.y;
    sum = sum + row.z * q.z;
    return sum + row.w;
}

// Whether record i of the slice is wanted; c, s: its place and spacing.
bool wanted(uint w, uint i, out vec3 c, out float s) {
    vec3 q = vec3(word[w] & 0xffffu, word[w] >> 16, word[w + 1u] & 0xffffu);
    c = vec3(dot4(now.to_view[0], q), dot4(now.to_view[1], q),
             dot4(now.to_view[2], q));
    precise float d = -c.z, x = c.x * project.x, y = c.y * project.y, edge = wide * d;
    precise float own = half_value(word[w + 1u] >> 16) * now.unit.x;
    if (!steps) own = own * share[number(i, uint(now.field.w))];
    s = own;
    if (!(d >= project.z && abs(x) <= edge && abs(y) <= edge)) return false;
    precise float density = 1.0;
    if (periphery) {
        precise float u = x / d, v = y / d;
        precise float square = u * u + v * v;
        density = max(1.0 - fall * sqrt(square), least);
    }
    precise float square = c.x * c.x;
    square = square + c.y * c.y;
    square = square + c.z * c.z;
    precise float limit = spacing * spacing * square, reach = own * density;
    return own > 0.0 && reach * reach >= limit;
}

void put(uint w, vec3 c, float s, uint at) {
    uint colour = 0xffffffffu, normal = 0x80008000u;
    ivec4 field = now.field;
    if (field.y >= 0) colour = word[w + uint(field.y)];
    if (field.x >= 0) {
        vec3 n = octahedral_normal(unpackSnorm2x16(word[w + uint(field.x)]));
        n = vec3(dot(now.normal[0].xyz, n), dot(now.normal[1].xyz, n),
                 dot(now.normal[2].xyz, n));
        n /= max(abs(n.x) + abs(n.y) + abs(n.z), 1e-30);
        if (n.z < 0.0)
            n.xy = (1.0 - abs(n.yx)) * mix(vec2(-1), vec2(1), greaterThanEqual(n.xy, vec2(0)));
        normal = packSnorm2x16(n.xy);
    }
    point[at] = Point(c.x, c.y, c.z, s, colour, normal);
}

void main() {
    uint number_of_group = group + gl_WorkGroupID.x, low = slices.x, high = slices.y;
    while (high - low > 1u) {
        uint mid = low + high >> 1u;
        if (uint(slice[mid].field.z) <= number_of_group) low = mid;
        else high = mid;
    }
    now = slice[low];
    uvec4 records = now.records;
    uint begin = (number_of_group - uint(now.field.z)) * 1024u;
    for (uint round = 0u; round < 8u; round++) {
        uint i = begin + round * 128u + gl_LocalInvocationID.x, at = 0u;
        vec3 c = vec3(0);
        float s = 0.0;
        uint w = records.x + i * records.y;
        if (gl_LocalInvocationID.x == 0u) mine = 0u;
        memoryBarrierShared();
        barrier();
        bool take = i < records.z && wanted(w, i + records.w, c, s);
        if (take) at = atomicAdd(mine, 1u);
        memoryBarrierShared();
        barrier();
        if (gl_LocalInvocationID.x == 0u) here = mine == 0u ? 0u : atomicAdd(taken, mine);
        memoryBarrierShared();
        barrier();
        if (take && here + at < most) put(w, c, s, here + at);
    }
}
