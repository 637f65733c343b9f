// A point as a triangle around its disc; paper 3, section 3.3.2: its size is the spacing wanted
// there, and less at the distance where it comes in.

struct Point { float x, y, z, spacing; uint colour, normal; };
layout(std430, binding = 0) readonly buffer Points { Point point[]; };

uniform mat4x3 to_view;    // from the view of the pass to that of now
uniform mat3 to_view_normal;
uniform float stretch;     // of lengths, in that
uniform vec3 project;      // x and y scale, near
uniform float smallest;    // least half axis of a disc's picture, at distance 1
uniform float spacing, fall, least, fade, size, floor_size;
uniform bool periphery;

out vec2 at; // in the disc: inside the unit circle
flat out vec3 lit;
flat out float sag;

void main() {
    // Corners of a triangle around the unit circle.
    const vec2 corner[3] = vec2[3](vec2(-1.7320508, -1.0), vec2(1.7320508, -1.0), vec2(0.0, 2.0));
    Point p = point[gl_VertexID / 3];
    vec3 c = to_view * vec4(p.x, p.y, p.z, 1.0);
    at = corner[gl_VertexID % 3];
    lit = vec3(0);
    sag = 0.0;
    gl_Position = vec4(0, 0, -1, 0); // nowhere
    if (-c.z < project.z) return;
    float wanted = spacing * length(c), own = p.spacing * stretch;
    if (periphery) wanted /= max(1.0 - fall * length(c.xy * project.xy / c.z), least);
    float grown = fade < 1.0 ? clamp((own - wanted) / (own * (1.0 - fade)), 0.0, 1.0)
                             : float(own >= wanted);
    if (grown <= 0.0) return;
    float half_axis = grown * max(0.5 * max(size * wanted, floor_size), smallest * -c.z);

    vec3 v = -normalize(c), n = v;
    if (p.normal != 0x80008000u)
        n = normalize(to_view_normal * octahedral_normal(unpackSnorm2x16(p.normal)));
    vec3 t = cross(n, v);
    float tilt = length(t);
    t = tilt > 1e-3 ? t / tilt : normalize(cross(n, abs(n.x) < 0.7 ? vec3(1, 0, 0) : vec3(0, 1, 0)));
    vec3 b = cross(n, t), across = cross(t, v);
    float wider = max(smallest * grown * -c.z - half_axis * abs(dot(n, v)), 0.0);
    vec3 place = c + half_axis * (at.x * t + at.y * b) +
                 at.y * wider * (dot(across, b) < 0.0 ? -1.0 : 1.0) * across;
    sag = 0.25 * half_axis;
    lit = shade(c, n, linear_from_srgb(unpackUnorm4x8(p.colour).rgb), 0.0, 1.0, vec3(0));
    gl_Position = vec4(place.xy * project.xy, project.z, -place.z);
}
