// When a pass is done: the indirect draw and dispatch of what it has taken.

layout(local_size_x = 1) in;
layout(std430, binding = 3) buffer Command { uint vertices, instances, first, base, taken, most, groups[3]; };

void main() {
    vertices = 3u * min(taken, most);
    groups[0] = (vertices / 3u + 127u) / 128u; // for cast.comp.glsl
    groups[1] = groups[2] = 1u;
}
