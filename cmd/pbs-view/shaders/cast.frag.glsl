// The point that has won a pixel, lit, onto the canvas.

#ifdef WIDE
layout(std430, binding = 1) readonly buffer Pixels { uvec2 pixel[]; }; // number, depth
#else
layout(std430, binding = 1) readonly buffer Depths { uint depth[]; };
layout(std430, binding = 2) readonly buffer Numbers { uint number[]; };
#endif

uniform uvec2 extent;
uniform int from; // its first column on the canvas
out vec4 colour;

void main() {
    uint p = uint(gl_FragCoord.y) * extent.x + uint(int(gl_FragCoord.x) - from);
#ifdef WIDE
    uvec2 won = pixel[p];
#else
    uvec2 won = uvec2(number[p], depth[p]);
#endif
    if (won.x == 0u) discard;
    colour = vec4(light_of(won.x - 1u, place_of(won.x - 1u)), 1);
    gl_FragDepth = uintBitsToFloat(won.y);
}
