// The light, the same for discs and triangles. View coordinates; colours are linear.

uniform vec3 sky; // unit vector, up in the world

vec3 linear_from_srgb(vec3 c) {
    return mix(c / 12.92, pow((c + 0.055) / 1.055, vec3(2.4)), greaterThan(c, vec3(0.04045)));
}

// Not of length 1; see vec.h.
vec3 octahedral_normal(vec2 o) {
    vec3 n = vec3(o, 1.0 - abs(o.x) - abs(o.y));
    float t = max(-n.z, 0.0);
    n.xy -= vec2(n.x < 0.0 ? -t : t, n.y < 0.0 ? -t : t);
    return n;
}

vec3 surroundings(float up) {
    return mix(vec3(0.17, 0.16, 0.15), vec3(0.44, 0.46, 0.49), smoothstep(-1.0, 1.0, up));
}

// A key light over the left shoulder, a weak fill from the right, the sky; all move with the
// viewer except the sky. n: length 1, either way; p: the point, the eye is at 0.
vec3 shade(vec3 p, vec3 n, vec3 albedo, float metallic, float roughness, vec3 emissive) {
    const vec3 key = vec3(-0.40, 0.58, 0.71), fill = vec3(0.77, -0.10, 0.63);
    vec3 v = -normalize(p);
    n = faceforward(n, p, n);
    float lit = 0.54 * max(dot(n, key), 0.0) + 0.14 * max(dot(n, fill), 0.0);
    vec3 diffuse = albedo * (1.0 - 0.75 * metallic) * (lit + surroundings(dot(n, sky)));

    // Blinn and Phong for the key light; what a rough surface mirrors is spread thin.
    vec3 f0 = mix(vec3(0.04), albedo, metallic);
    float fresnel = pow(clamp(1.0 - dot(n, v), 0.0, 1.0), 5.0), gloss = 1.0 - roughness;
    float shine = exp2(1.0 + 8.0 * gloss);
    float spot = pow(max(dot(n, normalize(key + v)), 0.0), shine) * (shine + 8.0) / 32.0;
    vec3 mirror = surroundings(dot(reflect(-v, n), sky)) + spot * max(dot(n, key), 0.0);
    return diffuse + mirror * (f0 + (1.0 - f0) * fresnel * gloss * gloss) * mix(gloss, 1.0, metallic)
           + emissive;
}
