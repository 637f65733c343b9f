// After pass 2: the picture of identifiers becomes lists, one for each buffer of records, which the
// next passes draw without the processor having seen them (paper 4, sections 4.3 and 6): the
// visible surfels, those of them that are new, and the groups in which there are any.

layout(local_size_x = 16, local_size_y = 16) in;

struct Command { uint count, instances, first, base; };
layout(std430, binding = 2) writeonly buffer Visible { uint visible[]; };
layout(std430, binding = 3) writeonly buffer Fresh { uint fresh[]; };
layout(std430, binding = 4) writeonly buffer Groups { uint groups[]; };
layout(std430, binding = 5) buffer Flags { uint flag[]; };
layout(std430, binding = 6) readonly buffer Last { uint last[]; };
layout(std430, binding = 7) buffer Commands { Command command[]; };
layout(binding = 0) uniform usampler2D ids;

uniform uint larges, group, buffers;
uniform uvec2 size;
uniform bool remember; // for the next frame

// Place in the list that the command draws; three vertices a surfel.
uint append(uint which, uint vertices) {
    return (command[which].first + atomicAdd(command[which].count, vertices)) / vertices;
}

void main() {
    ivec2 p = ivec2(gl_GlobalInvocationID.xy);
    if (any(greaterThanEqual(gl_GlobalInvocationID.xy, size))) return;
    uint id = texelFetch(ids, p, 0).r;
    if (id == NONE) return;
    uint o = object_of(id, larges), i = index_of(id), at;
    uvec4 f = object[o].flags;
    at = append(f.w, 3u);
    if (at < uint(visible.length())) visible[at] = id;
    if (!remember) return;

    uint bit = f.x + i / group;
    uint before = atomicOr(flag[bit / 32u], 1u << bit % 32u) >> bit % 32u & 1u;
    if (group > 1u && before == 0u) {
        at = append(2u * buffers + f.w, 3u * group);
        if (at < uint(groups.length())) groups[at] = id - i % group;
    }
    bit = f.y + i / group;
    if (f.y != NONE && i < f.z && (last[bit / 32u] >> bit % 32u & 1u) != 0u) return;
    at = append(buffers + f.w, 3u);
    if (at < uint(fresh.length())) fresh[at] = id;
}
