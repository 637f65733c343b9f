layout(binding = 0) uniform sampler2D depths; // of pass 1
flat in uint id;
flat in uint behind;
flat in vec2 slope;
layout(location = 0) out uint colour;

// At an edge the pixel's centre may lie outside of the front that covers the surfel. What its own
// plane has there covers nothing, though a disc edge-on reaches farther than its plane.
bool covered() {
    for (int k = 0; k < 9; k++) {
        ivec2 step = ivec2(k % 3, k / 3) - 1, p = ivec2(gl_FragCoord.xy) + step;
        float depth = texelFetch(depths, clamp(p, ivec2(0), textureSize(depths, 0) - 1), 0).r;
        float own = max(dot(slope, vec2(step)) + 1.25 * length(slope), 0.0);
        if (depth > gl_FragCoord.z + own) return true;
    }
    return false;
}

void main() {
    if (behind != 0u && covered()) discard;
    colour = id;
}
