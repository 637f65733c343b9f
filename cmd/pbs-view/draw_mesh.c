/* draw_mesh.c: source geometry: meshes, materials, textures. */
#include "cmd/pbs-view/draw_internal.h"
#include <stdlib.h>

enum { VERTEX_SIZE = 28 }; /* bytes of a vertex with all attributes */

/* sRGB and linear versions of a texture are two for the GPU. */
typedef struct textures {
    const pbs_meshes *scene;
    GLuint *made; /* 2 a texture: linear, sRGB; 0: not yet */
} textures;

void pbs_mesh_painter_init(pbs_canvas *c) {
    static const GLint wrap[3] = {GL_REPEAT, GL_CLAMP_TO_EDGE, GL_MIRRORED_REPEAT};
    static const uint8_t one[4] = {255, 255, 255, 255};
    const pbs_gl *gl = c->gl;
    mesh_painter *p = &c->mesh;
    gl->CreateBuffers(1, &p->vertices);
    gl->CreateBuffers(1, &p->indices);
    gl->CreateVertexArrays(1, &p->array);
    for (GLuint i = 0; i < 4; i++) gl->VertexArrayAttribBinding(p->array, i, i);
    gl->VertexArrayAttribFormat(p->array, 0, 3, GL_FLOAT, GL_FALSE, 0);
    gl->VertexArrayAttribFormat(p->array, 1, 2, GL_SHORT, GL_TRUE, 0);
    gl->VertexArrayAttribFormat(p->array, 2, 2, GL_FLOAT, GL_FALSE, 0);
    gl->VertexArrayAttribFormat(p->array, 3, 4, GL_UNSIGNED_BYTE, GL_TRUE, 0);
    gl->VertexArrayElementBuffer(p->array, p->indices);
    gl->CreateTextures(GL_TEXTURE_2D, 1, &p->white);
    gl->TextureStorage2D(p->white, 1, GL_RGBA8, 1, 1);
    gl->TextureSubImage2D(p->white, 0, 0, 0, 1, 1, GL_RGBA, GL_UNSIGNED_BYTE, one);
    gl->CreateSamplers(9, p->sampler);
    for (int i = 0; i < 9; i++) {
        gl->SamplerParameteri(p->sampler[i], GL_TEXTURE_WRAP_S, wrap[i / 3]);
        gl->SamplerParameteri(p->sampler[i], GL_TEXTURE_WRAP_T, wrap[i % 3]);
        gl->SamplerParameteri(p->sampler[i], GL_TEXTURE_MIN_FILTER, GL_LINEAR_MIPMAP_LINEAR);
        gl->SamplerParameteri(p->sampler[i], GL_TEXTURE_MAG_FILTER, GL_LINEAR);
    }
}

void pbs_mesh_painter_free(pbs_canvas *c) {
    const pbs_gl *gl = c->gl;
    mesh_painter *p = &c->mesh;
    gl->DeleteProgram(p->program);
    gl->DeleteBuffers(1, &p->vertices);
    gl->DeleteBuffers(1, &p->indices);
    gl->DeleteVertexArrays(1, &p->array);
    gl->DeleteTextures(1, &p->white);
    gl->DeleteSamplers(9, p->sampler);
    pbs_free(c->run, p->runs);
    pbs_free(c->run, p->order);
    pbs_free(c->run, p->index);
    pbs_free(c->run, p->corner);
}

static int levels(uint32_t w, uint32_t h) {
    int n = 1;
    for (uint32_t side = w > h ? w : h; side > 1; side /= 2) n++;
    return n;
}

static pbs_code make_texture(const pbs_canvas *c, const pbs_image *image, bool srgb, GLuint *out,
                             pbs_err *err) {
    const pbs_gl *gl = c->gl;
    GLsizei w = (GLsizei)image->width, h = (GLsizei)image->height;
    uint32_t largest = (uint32_t)gl->max_texture;
    if (image->width > largest || image->height > largest)
        return pbs_fail(err, PBS_LIMIT, "texture of %u x %u pixels: %s takes up to %u x %u",
                        image->width, image->height, gl->device, largest, largest);
    gl->CreateTextures(GL_TEXTURE_2D, 1, out);
    gl->TextureStorage2D(*out, levels(image->width, image->height),
                         srgb ? GL_SRGB8_ALPHA8 : GL_RGBA8, w, h);
    gl->PixelStorei(GL_UNPACK_ALIGNMENT, 4);
    gl->TextureSubImage2D(*out, 0, 0, 0, w, h, GL_RGBA, GL_UNSIGNED_BYTE, image->rgba);
    gl->GenerateTextureMipmap(*out);
    return pbs_gl_check(gl, "texture", err);
}

static pbs_code bind_texture(const pbs_canvas *c, textures *t, GLuint unit,
                             const pbs_texture_use *use, bool srgb, const char *matrix,
                             pbs_err *err) {
    const pbs_gl *gl = c->gl;
    GLuint texture = c->mesh.white;
    if (use->texture < t->scene->texture_count) {
        const pbs_image *image = &t->scene->textures[use->texture];
        GLuint *made = &t->made[2 * (size_t)use->texture + srgb];
        if (image->rgba && image->width && image->height && !*made) {
            pbs_code code = make_texture(c, image, srgb, made, err);
            if (code) return code;
        }
        if (*made) texture = *made;
    }
    int u = use->wrap_u < 3 ? use->wrap_u : 0, v = use->wrap_v < 3 ? use->wrap_v : 0;
    gl->BindTextureUnit(unit, texture);
    gl->BindSampler(unit, c->mesh.sampler[3 * u + v]);
    gl->UniformMatrix3x2fv(gl->GetUniformLocation(c->mesh.program, matrix), 1, GL_TRUE,
                           use->transform);
    return PBS_OK;
}

static pbs_code set_material(const pbs_canvas *c, textures *t, uint32_t id, pbs_err *err) {
    const pbs_gl *gl = c->gl;
    GLuint program = c->mesh.program;
    pbs_material m = PBS_MATERIAL_DEFAULT;
    if (id < t->scene->material_count) m = t->scene->materials[id];
    gl->Uniform4fv(gl->GetUniformLocation(program, "base"), 1, m.base);
    gl->Uniform3fv(gl->GetUniformLocation(program, "emissive"), 1, m.emissive);
    gl->Uniform2f(gl->GetUniformLocation(program, "metal_rough"), m.metallic, m.roughness);
    gl->Uniform1f(gl->GetUniformLocation(program, "cutoff"),
                  m.alpha == PBS_ALPHA_MASK ? m.alpha_cutoff : 0);
    pbs_code code = bind_texture(c, t, 0, &m.base_texture, true, "base_uv", err);
    if (!code) code = bind_texture(c, t, 1, &m.material_texture, false, "material_uv", err);
    if (!code) code = bind_texture(c, t, 2, &m.emissive_texture, true, "emissive_uv", err);
    return code;
}

static int by_material(const void *a, const void *b) {
    uint64_t x, y;
    memcpy(&x, a, sizeof x);
    memcpy(&y, b, sizeof y);
    return (x > y) - (x < y);
}

static pbs_code add_run(pbs_canvas *c, uint32_t material, uint32_t first, pbs_err *err) {
    mesh_painter *p = &c->mesh;
    pbs_code code = pbs_grow(c->run, &p->runs, &p->run_room, p->run_count + 1, sizeof *p->runs,
                             "material runs", err);
    if (!code) p->runs[p->run_count++] = (material_run){material, first, 1};
    return code;
}

/* Sorts the triangles by material, so that each material is one call. */
static pbs_code sort_triangles(pbs_canvas *c, const pbs_mesh *mesh, pbs_err *err) {
    mesh_painter *p = &c->mesh;
    size_t n = mesh->triangles;
    pbs_code code =
        pbs_grow(c->run, &p->order, &p->order_room, n, sizeof *p->order, "triangle order", err);
    if (!code)
        code = pbs_grow(c->run, &p->index, &p->index_room, 3 * n, sizeof *p->index,
                        "triangle indices", err);
    if (code) return code;
    for (size_t i = 0; i < n; i++) p->order[i] = (uint64_t)mesh->triangle_material[i] << 32 | i;
    qsort(p->order, n, sizeof *p->order, by_material);
    for (size_t i = 0; i < n; i++) {
        uint32_t material = (uint32_t)(p->order[i] >> 32);
        memcpy(p->index + 3 * i, mesh->index + 3 * (p->order[i] & UINT32_MAX),
               3 * sizeof *p->index);
        if (i > 0 && p->runs[p->run_count - 1].material == material)
            p->runs[p->run_count - 1].count++;
        else if ((code = add_run(c, material, (uint32_t)i, err)))
            return code;
    }
    return PBS_OK;
}

static void face_normal(int16_t out[2], const float *a, const float *b, const float *c) {
    double e[3], f[3], n[3];
    float nf[3];
    for (int k = 0; k < 3; k++) e[k] = (double)b[k] - a[k], f[k] = (double)c[k] - a[k];
    for (int k = 0; k < 3; k++)
        n[k] = e[(k + 1) % 3] * f[(k + 2) % 3] - e[(k + 2) % 3] * f[(k + 1) % 3];
    double length = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    for (int k = 0; k < 3; k++) nf[k] = length > 0 ? (float)(n[k] / length) : 0;
    pbs_oct_encode(out, nf);
}

/* *mesh without normals becomes one with a vertex for each corner, which has the face's normal: so
 * the shader knows one kind of mesh. The arrays are scratch memory of the canvas. */
static pbs_code split_corners(pbs_canvas *c, pbs_mesh *mesh, const uint16_t *index, pbs_err *err) {
    mesh_painter *p = &c->mesh;
    size_t n = 3 * (size_t)mesh->triangles;
    pbs_code code =
        pbs_grow(c->run, &p->corner, &p->corner_room, n * VERTEX_SIZE, 1, "triangle corners", err);
    if (code) return code;
    float *position = (float *)p->corner, *uv = position + 3 * n;
    int16_t *normal = (int16_t *)(uv + 2 * n);
    uint8_t *colour = (uint8_t *)(normal + 2 * n);
    for (size_t i = 0; i < n; i++) {
        memcpy(position + 3 * i, mesh->position + 3 * index[i], 12);
        if (mesh->uv) memcpy(uv + 2 * i, mesh->uv + 2 * index[i], 8);
        if (mesh->colour) memcpy(colour + 4 * i, mesh->colour + 4 * index[i], 4);
        if (i % 3 < 2) continue;
        const float *corner = position + 3 * (i - 2);
        face_normal(normal + 2 * i, corner, corner + 3, corner + 6);
        memcpy(normal + 2 * i - 2, normal + 2 * i, 4);
        memcpy(normal + 2 * i - 4, normal + 2 * i, 4);
    }
    mesh->vertices = (uint32_t)n;
    mesh->position = position;
    mesh->normal = normal;
    mesh->uv = mesh->uv ? uv : NULL;
    mesh->colour = mesh->colour ? colour : NULL;
    return PBS_OK;
}

/* One attribute into the vertex buffer at *at; an absent one is the constant (1, 1, 1, 1). */
static void upload_attribute(const pbs_canvas *c, GLuint attribute, const void *data, size_t size,
                             size_t vertices, size_t *at) {
    const pbs_gl *gl = c->gl;
    if (!data) {
        gl->DisableVertexArrayAttrib(c->mesh.array, attribute);
        gl->VertexAttrib4f(attribute, 1, 1, 1, 1);
        return;
    }
    gl->NamedBufferSubData(c->mesh.vertices, (GLintptr)*at, (GLsizeiptr)(size * vertices), data);
    gl->VertexArrayVertexBuffer(c->mesh.array, attribute, c->mesh.vertices, (GLintptr)*at,
                                (GLsizei)size);
    gl->EnableVertexArrayAttrib(c->mesh.array, attribute);
    *at += size * vertices;
}

static pbs_code upload_mesh(pbs_canvas *c, const pbs_mesh *mesh, pbs_err *err) {
    const pbs_gl *gl = c->gl;
    mesh_painter *p = &c->mesh;
    const uint16_t *index = mesh->index;
    pbs_mesh m = *mesh;
    size_t at = 0;
    pbs_code code;
    p->uploaded = NULL;
    p->run_count = 0;
    if (mesh->triangle_material) {
        code = sort_triangles(c, mesh, err);
        index = p->index;
    } else {
        code = add_run(c, mesh->material, 0, err);
        if (!code) p->runs[0].count = mesh->triangles;
    }
    if (!code && !mesh->normal) code = split_corners(c, &m, index, err);
    if (code) return code;
    gl->NamedBufferData(p->vertices, (GLsizeiptr)VERTEX_SIZE * m.vertices, NULL, GL_STREAM_DRAW);
    upload_attribute(c, 0, m.position, 12, m.vertices, &at);
    upload_attribute(c, 1, m.normal, 4, m.vertices, &at);
    upload_attribute(c, 2, m.uv, 8, m.vertices, &at);
    upload_attribute(c, 3, m.colour, 4, m.vertices, &at);
    if (mesh->normal)
        gl->NamedBufferData(p->indices, (GLsizeiptr)6 * m.triangles, index, GL_STREAM_DRAW);
    p->uploaded = mesh;
    return pbs_gl_check(gl, "mesh", err);
}

static pbs_code draw_mesh(pbs_canvas *c, textures *t, const pbs_draw *draw, pbs_err *err) {
    const pbs_gl *gl = c->gl;
    mesh_painter *p = &c->mesh;
    double view[12];
    if (draw->mesh->triangles == 0 || draw->mesh->vertices == 0) return PBS_OK;
    if (draw->mesh != p->uploaded) {
        pbs_code code = upload_mesh(c, draw->mesh, err);
        if (code) return code;
    }
    pbs_camera_place(view, &c->camera, draw->m);
    pbs_canvas_matrix(gl, gl->GetUniformLocation(p->program, "to_view"), 4, view, 1);
    pbs_canvas_normal_matrix(gl, gl->GetUniformLocation(p->program, "to_view_normal"), view);
    for (size_t i = 0; i < p->run_count; i++) {
        const material_run *r = &p->runs[i];
        GLint first = (GLint)(3 * r->first), count = (GLint)(3 * r->count);
        pbs_code code = set_material(c, t, r->material, err);
        if (code) return code;
        if (draw->mesh->normal)
            gl->DrawElements(GL_TRIANGLES, count, GL_UNSIGNED_SHORT, (const char *)0 + 2 * first);
        else
            gl->DrawArrays(GL_TRIANGLES, first, count);
    }
    return PBS_OK;
}

pbs_code pbs_canvas_meshes(pbs_canvas *c, const pbs_meshes *scene, pbs_err *err) {
    const pbs_gl *gl = c->gl;
    textures t = {scene, NULL};
    size_t n = 2 * scene->texture_count;
    pbs_code code = pbs_alloc(c->run, &t.made, n, sizeof *t.made, "textures", err);
    if (code) return code;
    memset(t.made, 0, n * sizeof *t.made);
    pbs_canvas_view_uniforms(c, c->mesh.program);
    gl->BindVertexArray(c->mesh.array);
    c->mesh.uploaded = NULL;
    for (size_t i = 0; i < scene->draw_count && !code; i++) {
        code = pbs_run_check(c->run, err);
        if (!code) code = draw_mesh(c, &t, &scene->draws[i], err);
    }
    for (size_t i = 0; i < n; i++) gl->DeleteTextures(1, &t.made[i]);
    /* They would make the textures of others, without mipmaps, incomplete. */
    for (GLuint unit = 0; unit < 3; unit++) gl->BindSampler(unit, 0);
    pbs_free(c->run, t.made);
    return code ? code : pbs_gl_check(gl, "meshes", err);
}
