// What the passes of deferred splatting share (paper 4): the table of objects and the identifiers.

const uint NONE = 0xffffffffu, SMALL = 0x80000000u;

struct Object {
    vec4 to_view[3], disc[3], normal[3]; // rows; disc: its radius in the node to view, and
                                         // disc[0].w a disc's longest half axis there
    uvec4 records;                       // first word, stride, how many, how many of the node before
    uvec4 flags;                         // first flag, that in the last frame or NONE, records then,
                                         // number of the buffer
    uvec4 octaves;                       // first word or NONE, stride, surfels of the node, octaves
    ivec4 field;                         // word of normal, colour, material, emissive, or -1
    uvec4 more;                          // identifier of record 0; octave of the prefix, a float;
                                         // of the part of the node that lies in this buffer: records
                                         // before it, and its own at most
};
layout(std430, binding = 1) readonly buffer Objects { Object object[]; };

// Paper 4, section 4.2: one bit says how the others are divided. Large objects have 11 bits, and 20
// for their surfels; small ones 14 and 17. They follow the large ones in the table.
uint object_of(uint id, uint larges) {
    return (id & SMALL) == 0u ? id >> 20 : larges + (id >> 17 & 0x3fffu);
}
uint index_of(uint id) { return id & ((id & SMALL) == 0u ? 0xfffffu : 0x1ffffu); }

#ifndef COLLECT
// Records of the buffer that is bound, and which of them a vertex belongs to.
layout(std430, binding = 0) readonly buffer Records { uint word[]; };
layout(std430, binding = 2) readonly buffer List { uint list[]; };
layout(std430, binding = 3) readonly buffer Places { uint place[]; };

uniform uint direct; // the object that is drawn whole, or NONE: those in the list
uniform uint larges; // of the frame that the list is of
uniform uint group;  // surfels that an entry of the list stands for
uniform bool moved;  // the list is the last frame's: `place` says where its objects are now
uniform vec3 project; // x and y scale, near
uniform float pixel;  // side of one, at distance 1

bool find_surfel(uint n, out uint o, out uint i) {
    if (direct != NONE) {
        o = direct;
        i = n;
        return true;
    }
    uint id = list[n / group];
    o = object_of(id, larges);
    i = index_of(id) + n % group;
    if (moved) o = place[o];
    return o != NONE && i < object[o].records.z;
}

vec3 centre_of(uint o, uint i) {
    uint w = object[o].records.x + i * object[o].records.y;
    vec4 q = vec4(word[w] & 0xffffu, word[w] >> 16, word[w + 1u] & 0xffffu, 1.0);
    return vec3(dot(object[o].to_view[0], q), dot(object[o].to_view[1], q),
                dot(object[o].to_view[2], q));
}

// In the node, of length 1; 0: it has none, as points of clouds, and its disc faces the viewer.
vec3 local_normal(uint o, uint i) {
    int field = object[o].field.x;
    if (field < 0) return vec3(0);
    uint n = word[object[o].records.x + i * object[o].records.y + uint(field)];
    return n == 0x80008000u ? vec3(0) : normalize(octahedral_normal(unpackSnorm2x16(n)));
}

vec3 to_view_normal(uint o, vec3 n) {
    return vec3(dot(object[o].normal[0].xyz, n), dot(object[o].normal[1].xyz, n),
                dot(object[o].normal[2].xyz, n));
}

// Beyond the paper: half axis of the smallest disc that holds a pixel's centre wherever it lies.
float least_at(vec3 c) { return 0.70710678 * pixel * -c.z; }

// Beyond the paper: a surfel that is looked at from behind counts as farther, by more than what
// is added up lies apart. Where a front covers it, at the edges of solids and in thin plates, it is
// not seen and none of its colour gets through; where nothing does, as inside of a hull, it stays.
float farther(uint o, vec3 c, vec3 n) {
    if (!(dot(n, c) > 0.0)) return 1.0;
    return 1.0 + 3.0 * max(object[o].disc[0].w, least_at(c)) / -c.z;
}
#endif
