/* draw_mesh.c: source geometry: meshes, materials, textures. */
#include "cmd/pbs-view/draw_internal.h"
#include <stdlib.h>

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
    gl->CreateBuffers(1, &p->faces);
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
    gl->DeleteBuffers(1, &p->faces);
    gl->DeleteVertexArrays(1, &p->array);
    gl->DeleteTextures(1, &p->white);
    gl->DeleteSamplers(9, p->sampler);
    pbs_free(c->run, p->runs);
    pbs_free(c->run, p->order);
    pbs_free(c->run, p->index);
    pbs_free(c->run, p->face);
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

/* Face normals of the triangles in the order of `index`, 4 floats each. */
static pbs_code face_normals(pbs_canvas *c, const pbs_mesh *mesh, const uint16_t *index,
                             pbs_err *err) {
    mesh_painter *p = &c->mesh;
    pbs_code code = pbs_grow(c->run, &p->face, &p->face_room, 4 * (size_t)mesh->triangles,
                             sizeof *p->face, "face normals", err);
    for (size_t i = 0; i < mesh->triangles && !code; i++) {
        const float *a = mesh->position + 3 * index[3 * i], *q[2];
        double e[2][3], n[3], length = 0;
        for (int j = 0; j < 2; j++) {
            q[j] = mesh->position + 3 * index[3 * i + 1 + (size_t)j];
            for (int k = 0; k < 3; k++) e[j][k] = (double)q[j][k] - a[k];
        }
        for (int k = 0; k < 3; k++) {
            n[k] = e[0][(k + 1) % 3] * e[1][(k + 2) % 3] - e[0][(k + 2) % 3] * e[1][(k + 1) % 3];
            length += n[k] * n[k];
        }
        length = sqrt(length);
        for (int k = 0; k < 3; k++)
            p->face[4 * i + (size_t)k] = length > 0 ? (float)(n[k] / length) : 0;
        p->face[4 * i + 3] = 0;
    }
    return code;
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
    size_t n = mesh->triangles, v = mesh->vertices, at = 0;
    pbs_code code;
    p->run_count = 0;
    if (mesh->triangle_material) {
        code = sort_triangles(c, mesh, err);
        index = p->index;
    } else {
        code = add_run(c, mesh->material, 0, err);
        if (!code) p->runs[0].count = mesh->triangles;
    }
    if (!code && !mesh->normal) code = face_normals(c, mesh, index, err);
    if (code) return code;
    gl->NamedBufferData(p->vertices, (GLsizeiptr)(28 * v), NULL, GL_STREAM_DRAW);
    upload_attribute(c, 0, mesh->position, 12, v, &at);
    upload_attribute(c, 1, mesh->normal, 4, v, &at);
    upload_attribute(c, 2, mesh->uv, 8, v, &at);
    upload_attribute(c, 3, mesh->colour, 4, v, &at);
    gl->NamedBufferData(p->indices, (GLsizeiptr)(6 * n), index, GL_STREAM_DRAW);
    gl->NamedBufferData(p->faces, mesh->normal ? 16 : (GLsizeiptr)(16 * n),
                        mesh->normal ? NULL : p->face, GL_STREAM_DRAW);
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
    GLint first_face = gl->GetUniformLocation(p->program, "first_face");
    for (size_t i = 0; i < p->run_count; i++) {
        const material_run *r = &p->runs[i];
        pbs_code code = set_material(c, t, r->material, err);
        if (code) return code;
        gl->Uniform1i(first_face, draw->mesh->normal ? -1 : (GLint)r->first);
        gl->DrawElements(GL_TRIANGLES, (GLsizei)(3 * r->count), GL_UNSIGNED_SHORT,
                         (const char *)0 + 6 * (size_t)r->first);
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
    gl->BindBufferBase(GL_SHADER_STORAGE_BUFFER, 0, c->mesh.faces);
    c->mesh.uploaded = NULL;
    for (size_t i = 0; i < scene->draw_count && !code; i++) {
        code = pbs_run_check(c->run, err);
        if (!code) code = draw_mesh(c, &t, &scene->draws[i], err);
    }
    for (size_t i = 0; i < n; i++) gl->DeleteTextures(1, &t.made[i]);
    pbs_free(c->run, t.made);
    return code ? code : pbs_gl_check(gl, "meshes", err);
}
