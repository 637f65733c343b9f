// A point as a triangle around its disc.

out vec2 at; // in the disc: inside the unit circle
flat out vec3 lit;
flat out float sag;

void main() {
    // Corners of a triangle around the unit circle.
    const vec2 corner[3] = vec2[3](vec2(-1.7320508, -1.0), vec2(1.7320508, -1.0), vec2(0.0, 2.0));
    uint i = uint(gl_VertexID) / 3u;
    vec3 c = place_of(i);
    float half_axis, grown = grown_of(i, c, half_axis);
    at = corner[gl_VertexID % 3];
    lit = vec3(0);
    sag = 0.0;
    gl_Position = vec4(0, 0, -1, 0); // nowhere
    if (grown <= 0.0) return;

    vec3 v = -normalize(c), n = normal_of(i, c), t = cross(n, v);
    float tilt = length(t);
    t = tilt > 1e-3 ? t / tilt : normalize(cross(n, abs(n.x) < 0.7 ? vec3(1, 0, 0) : vec3(0, 1, 0)));
    vec3 b = cross(n, t), across = cross(t, v);
    float wider = max(smallest * grown * -c.z - half_axis * abs(dot(n, v)), 0.0);
    vec3 place = c + half_axis * (at.x * t + at.y * b) +
                 at.y * wider * (dot(across, b) < 0.0 ? -1.0 : 1.0) * across;
    sag = 0.25 * half_axis;
    lit = light_of(i, c);
    gl_Position = vec4(place.xy * project.xy, project.z, -place.z);
}
