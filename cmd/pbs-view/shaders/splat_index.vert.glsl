// Pass 2: every surfel of an object as one pixel, its identifier as the colour.

flat out uint id;

void main() {
    uint i = uint(gl_VertexID);
    vec3 c = centre_of(direct, i);
    id = object[direct].more.x + i;
    gl_Position = vec4(c.xy * project.xy, project.z, -c.z);
}
