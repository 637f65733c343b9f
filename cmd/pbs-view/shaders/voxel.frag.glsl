// NOTED: paper 2, section 4: what passes the depth test is written down, into one buffer for all nodes.
#ifdef NOTED
layout(early_fragment_tests) in;
layout(std430, binding = 2) writeonly buffer Notes { uint seen[]; };
#endif
flat in uint number;
flat in vec3 lit;
out vec4 colour;

void main() {
#ifdef NOTED
    seen[number] = 1u;
#endif
    colour = vec4(lit, 1);
}
