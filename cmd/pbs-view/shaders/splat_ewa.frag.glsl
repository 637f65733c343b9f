in vec2 at;
flat in vec3 lit;
flat in vec2 disc, splat;
flat in vec3 kernel;
layout(location = 0) out vec4 sum;       // of weighted colours, and of weights
layout(location = 1) out float coverage; // the largest of all

void main() {
    if (dot(at, at) > 1.0) discard;
    vec2 k = at * kernel.xy, p = at * splat;
    float w = kernel.z * exp(-dot(k, k));
    sum = vec4(lit * w, w);
    // Half a pixel outside of the disc it ends.
    float f = length(p / disc);
    coverage = clamp(1.0 - 2.0 * length(p) * (1.0 - 1.0 / max(f, 1.0)), 0.0, 1.0);
}
