in vec2 at;
flat in vec3 lit;
flat in float sag;
uniform int samples;
layout(depth_less) out float gl_FragDepth; // reversed: less is farther
out vec4 colour;

void main() {
    // Tested per sample, so that the edge of a silhouette is as smooth as a triangle's.
    int mask = 0;
    for (int i = 0; i < samples; i++) {
        vec2 p = interpolateAtSample(at, i);
        mask |= int(dot(p, p) <= 1.0) << i;
    }
    if (mask == 0) discard;
    gl_SampleMask[0] = mask;
    // Depth is near / distance, and w 1 / distance. The rim counts as farther than it is: of
    // discs that overlap in one plane the one whose middle is nearest wins, and not the rounding.
    gl_FragDepth = gl_FragCoord.z / (1.0 + sag * dot(at, at) * gl_FragCoord.w);
    colour = vec4(lit, 1);
}
