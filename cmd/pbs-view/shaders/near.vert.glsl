// Source geometry from storage buffers: three vertices a triangle, pulled as they are in the file.

layout(std430, binding = 0) readonly buffer Arrays { uint word[]; };

layout(std140, binding = 0) uniform Mesh {
    vec4 to_view[3];           // rows
    vec4 to_view_normal[3];    // its cofactors
    int index;                 // in halves of words; the others in words, -1: absent
    int position, normal, colour, triangle_material;
    uint material;
    int uv;
} mesh;

uniform vec3 project;          // x and y scale, near

out vec3 where, normal;
out vec4 tint;
flat out uint material;
#ifdef TEXTURED
out vec2 base_at, material_at, emissive_at;
#endif

void main() {
    uint corner = uint(mesh.index) + uint(gl_VertexID);
    uint i = word[corner / 2u] >> 16 * (corner & 1u) & 0xffffu, p = uint(mesh.position) + 3u * i;
    vec4 q = vec4(uintBitsToFloat(word[p]), uintBitsToFloat(word[p + 1u]),
                  uintBitsToFloat(word[p + 2u]), 1.0);
    where = vec3(dot(mesh.to_view[0], q), dot(mesh.to_view[1], q), dot(mesh.to_view[2], q));
    normal = vec3(0);
    if (mesh.normal >= 0) {
        vec3 n = normalize(octahedral_normal(unpackSnorm2x16(word[uint(mesh.normal) + i])));
        normal = vec3(dot(mesh.to_view_normal[0].xyz, n), dot(mesh.to_view_normal[1].xyz, n),
                      dot(mesh.to_view_normal[2].xyz, n));
    }
    tint = vec4(1);
    if (mesh.colour >= 0) {
        tint = unpackUnorm4x8(word[uint(mesh.colour) + i]);
        tint.rgb = linear_from_srgb(tint.rgb);
    }
    material = mesh.material;
    if (mesh.triangle_material >= 0)
        material = word[uint(mesh.triangle_material) + uint(gl_VertexID) / 3u];
#ifdef TEXTURED
    uint t = uint(mesh.uv) + 2u * i;
    vec2 uv = vec2(uintBitsToFloat(word[t]), uintBitsToFloat(word[t + 1u]));
    base_at = texture_place(material, 0, uv);
    material_at = texture_place(material, 1, uv);
    emissive_at = texture_place(material, 2, uv);
#endif
    gl_Position = vec4(where.xy * project.xy, project.z, -where.z);
}
