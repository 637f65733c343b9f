// Pass 2: every surfel of an object as one pixel, its identifier as the colour.

flat out uint id;
flat out uint behind; // it is looked at from behind
flat out vec2 slope;  // of its plane's depth, a pixel

void main() {
    uint i = uint(gl_VertexID);
    vec3 c = centre_of(direct, i);
    vec3 n = to_view_normal(direct, local_normal(direct, i));
    float away = farther(direct, c, n);
    id = object[direct].more.x + i;
    behind = uint(away > 1.0);
    c *= away;
    slope = behind != 0u ? project.z * pixel / dot(n, c) * n.xy : vec2(0);
    gl_Position = vec4(c.xy * project.xy, project.z, -c.z);
}
