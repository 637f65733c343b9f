// Pass 5: sums divided by weights, onto the canvas.

layout(binding = 0) uniform sampler2D sums;
layout(binding = 1) uniform sampler2D coverages;
layout(binding = 2) uniform sampler2D depths;
uniform int margin;
layout(location = 0) out vec4 colour;

void main() {
    ivec2 p = ivec2(gl_FragCoord.xy) + margin;
    vec4 sum = texelFetch(sums, p, 0);
    float depth = texelFetch(depths, p, 0).r, coverage = texelFetch(coverages, p, 0).r;
    if (depth == 0.0 && sum.a == 0.0) discard;
    // On a disc whose surfel has lost its pixel to another one, or just outside of all: as beside it.
    bool bare = sum.a == 0.0, outside = depth == 0.0;
    if (bare || outside)
        for (int k = 0; k < 9; k++) {
            ivec2 q = p + ivec2(k % 3, k / 3) - 1;
            if (bare) sum += texelFetch(sums, q, 0);
            if (outside) depth = max(depth, texelFetch(depths, q, 0).r);
        }
    if (sum.a == 0.0) discard;
    colour = vec4(sum.rgb / sum.a, bare ? 1.0 : coverage);
    gl_FragDepth = depth;
}
