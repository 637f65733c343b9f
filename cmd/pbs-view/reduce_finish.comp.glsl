// When a pass is done: the indirect draw of what it has taken, three vertices a point.

layout(local_size_x = 1) in;
layout(std430, binding = 3) buffer Command { uint vertices, instances, first, base, taken, most; };

void main() {
    vertices = 3u * min(taken, most);
}
