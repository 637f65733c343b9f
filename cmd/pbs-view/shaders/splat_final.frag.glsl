// Pass 5: sums divided by weights, onto the canvas.

layout(binding = 0) uniform sampler2D sums;
layout(binding = 1) uniform sampler2D coverages;
layout(binding = 2) uniform sampler2D depths;
uniform ivec2 margin; // from the canvas to the sums
layout(location = 0) out vec4 colour;

void main() {
    ivec2 p = ivec2(gl_FragCoord.xy) + margin;
    vec4 sum = texelFetch(sums, p, 0);
    float depth = texelFetch(depths, p, 0).r, coverage = texelFetch(coverages, p, 0).r;
    bool bare = sum.a == 0.0, outside = depth == 0.0;
    if (coverage < 1.0 || outside) {
        // The ring around all discs; or, with discs around it, the place of one whose surfel has
        // lost its pixel to another one.
        int on = 0;
        for (int k = 0; k < 9; k++) {
            ivec2 q = p + ivec2(k % 3, k / 3) - 1;
            float d = texelFetch(depths, q, 0).r;
            on += int(d != 0.0);
            if (outside) depth = max(depth, d);
            if (bare) sum += texelFetch(sums, q, 0);
        }
        if (on >= 7) coverage = 1.0;
    }
    if (sum.a == 0.0 || coverage == 0.0) discard;
    colour = vec4(sum.rgb / sum.a, coverage);
    gl_FragDepth = depth;
}
