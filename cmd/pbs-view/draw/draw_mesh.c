/* draw_mesh.c: source geometry: meshes, materials, textures. */
#include "cmd/pbs-view/draw/draw_internal.h"
#include <stdlib.h>

enum { VERTEX_SIZE = 28 }; /* bytes of a vertex with all attributes */

/* sRGB and linear versions of a texture are two for the GPU. */
typedef struct textures {
    const pbs_meshes *scene;
    GLuint *made; /* 2 a texture: linear, sRGB; 0: not yet */
} textures;

void pbs_mesh_painter_init(pbs_canvas *c) {
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
}

void pbs_mesh_painter_free(pbs_canvas *c) {
    const pbs_gl *gl = c->gl;
    mesh_painter *p = &c->mesh;
    gl->DeleteProgram(p->program);
    gl->DeleteBuffers(1, &p->vertices);
    gl->DeleteBuffers(1, &p->indices);
    gl->DeleteVertexArrays(1, &p->array);
    pbs_free(c->run, p->runs);
    pbs_free(c->run, p->order);
    pbs_free(c->run, p->index);
    pbs_free(c->run, p->corner);
}

static pbs_code make_texture(const pbs_canvas *c, const pbs_image *image, bool srgb, GLuint *out,
                             pbs_err *err) {
    const pbs_gl *gl = c->gl;
    pbs_mips mips;
    uint8_t *chain;
    pbs_code rc = pbs_mips_make(c->run, image, srgb, (uint32_t)gl->max_texture, UINT64_MAX, &mips,
                                &chain, err);
    if (rc || !chain) return rc;
    *out = pbs_gl_texture_new(gl, &mips);
    pbs_gl_texture_fill(gl, *out, &mips, 0, chain, pbs_mips_bytes(&mips));
    pbs_free(c->run, chain);
    return pbs_gl_check(gl, "texture", err);
}

/* The texture of a use, 0: white. */
static pbs_code texture_of(const pbs_canvas *c, textures *t, const pbs_texture_use *use, bool srgb,
                           GLuint *out, pbs_err *err) {
    *out = 0;
    if (use->texture >= t->scene->texture_count) return PBS_OK;
    GLuint *made = &t->made[2 * (size_t)use->texture + srgb];
    pbs_code rc = PBS_OK;
    if (!*made) rc = make_texture(c, &t->scene->textures[use->texture], srgb, made, err);
    *out = *made;
    return rc;
}

/* textured: the mesh has coordinates for them. */
static pbs_code set_material(pbs_canvas *c, textures *t, uint32_t id, bool textured, pbs_err *err) {
    pbs_material m = PBS_MATERIAL_DEFAULT;
    GLuint texture[3] = {0};
    pbs_code rc = PBS_OK;
    if (id < t->scene->material_count) m = t->scene->materials[id];
    if (textured) {
        rc = texture_of(c, t, &m.base_texture, true, &texture[0], err);
        if (!rc) rc = texture_of(c, t, &m.material_texture, false, &texture[1], err);
        if (!rc) rc = texture_of(c, t, &m.emissive_texture, true, &texture[2], err);
    }
    if (rc) return rc;
    pbs_canvas_wear(c, &m, texture);
    c->gl->Uniform1ui(c->gl->GetUniformLocation(c->mesh.program, "number"), id);
    return PBS_OK;
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
        pbs_code code = set_material(c, t, r->material, draw->mesh->uv != NULL, err);
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
    const pbs_palette palette = {scene->materials, scene->material_count};
    c->palette_of = NULL; /* another scene may have had its materials in the same place */
    pbs_code code = pbs_canvas_palette(c, &palette, err);
    if (code) return code;
    code = pbs_alloc(c->run, &t.made, n, sizeof *t.made, "textures", err);
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
    pbs_canvas_undress(c);
    pbs_free(c->run, t.made);
    return code ? code : pbs_gl_check(gl, "meshes", err);
}
