/* draw_voxel.c: voxels as cubes of at most three faces (paper 2, section 4), made on the GPU from
 * the arrays as they are in the file. */
#include "cmd/pbs-view/draw_internal.h"
#include "shaders.h"

enum {
    VERTICES = 7,
    INDICES = 18,
    BATCH = 8192 /* voxels of an instance: the indices of its vertices have 16 bits */
};

/* Near corner 0, its neighbour along axis k 1 + k, and 4 + k the far corner of the face across k,
 * which is last and so gives the triangle its light. */
static pbs_code make_indices(pbs_canvas *c, pbs_err *err) {
    uint16_t *index, *p;
    pbs_code rc = pbs_alloc(c->run, &index, BATCH * INDICES, sizeof *index, "the canvas", err);
    if (rc) return rc;
    p = index;
    for (int i = 0; i < BATCH; i++)
        for (int k = 0; k < 3; k++) {
            int base = VERTICES * i, far = base + 4 + k;
            int a = base + 1 + (k + 1) % 3, b = base + 1 + (k + 2) % 3;
            const int six[6] = {base, a, far, b, base, far};
            for (int j = 0; j < 6; j++) *p++ = (uint16_t)six[j];
        }
    c->gl->NamedBufferData(c->voxel.indices, BATCH * INDICES * sizeof *index, index,
                           GL_STATIC_DRAW);
    pbs_free(c->run, index);
    return PBS_OK;
}

/* When the first voxels are drawn: a shader's compilation is what a short run pays. */
static pbs_code init(pbs_canvas *c, pbs_err *err) {
    const pbs_gl *gl = c->gl;
    voxel_painter *p = &c->voxel;
    const pbs_gl_stage stage[2] = {
        {GL_VERTEX_SHADER, {PBS_GLSL_VERSION, shade_glsl, voxel_vert_glsl}},
        {GL_FRAGMENT_SHADER, {PBS_GLSL_VERSION, voxel_frag_glsl}},
    };
    if (p->program) return PBS_OK;
    pbs_code rc = pbs_gl_program(gl, "voxel", stage, 2, &p->program, err);
    if (rc) return rc;
    gl->CreateBuffers(1, &p->indices);
    gl->CreateVertexArrays(1, &p->array);
    gl->VertexArrayElementBuffer(p->array, p->indices);
    return make_indices(c, err);
}

void pbs_voxel_painter_free(pbs_canvas *c) {
    const pbs_gl *gl = c->gl;
    gl->DeleteProgram(c->voxel.program);
    gl->DeleteBuffers(1, &c->voxel.indices);
    gl->DeleteVertexArrays(1, &c->voxel.array);
}

/* The eye in cells, from where cells are in view coordinates. A transform that presses flat has no
 * inverse; any place sees all of such voxels. */
static void eye_in_cells(double eye[3], const double view[12]) {
    double cofactor[9], det = pbs_xform_det(view);
    pbs_xform_cofactor(cofactor, view);
    for (int k = 0; k < 3; k++) {
        double sum = 0;
        for (int r = 0; r < 3; r++) sum -= cofactor[3 * r + k] * view[4 * r + 3];
        eye[k] = sum / det;
        if (!isfinite(eye[k])) eye[k] = -1e6;
    }
}

static void place_node(const pbs_canvas *c, const pbs_cubes *node) {
    const pbs_gl *gl = c->gl;
    GLuint program = c->voxel.program;
    double s = node->side, view[12], eye[3];
    double cells[12] = {s, 0, 0, node->corner[0], 0, s, 0, node->corner[1],
                        0, 0, s, node->corner[2]};
    /* In this order the corner, far from the origin as it may be, is added in double. */
    pbs_xform_mul(cells, node->m, cells);
    pbs_camera_place(view, &c->camera, cells);
    eye_in_cells(eye, view);
    pbs_canvas_matrix(gl, gl->GetUniformLocation(program, "to_view"), 4, view, 1);
    pbs_canvas_normal_matrix(gl, gl->GetUniformLocation(program, "to_view_normal"), view);
    gl->Uniform1f(gl->GetUniformLocation(program, "hand"), pbs_xform_det(view) < 0 ? -1 : 1);
    gl->Uniform3f(gl->GetUniformLocation(program, "eye"), (float)eye[0], (float)eye[1],
                  (float)eye[2]);
}

/* Voxels first .. first + n - 1 of a chunk. */
static void draw_some(pbs_canvas *c, const pbs_voxels *v, size_t first, size_t n) {
    const pbs_gl *gl = c->gl;
    GLuint program = c->voxel.program, place;
    const uint32_t *array[4] = {v->normal, v->colour, v->material, v->emissive};
    GLint look[4];
    pbs_canvas_room(c, 20 * n);
    place = pbs_canvas_upload(c, v->place + first, 4 * n);
    for (int k = 0; k < 4; k++)
        look[k] = array[k] ? (GLint)pbs_canvas_upload(c, array[k] + first, 4 * n) : -1;
    for (size_t done = 0; done < n;) {
        GLsizei whole = (GLsizei)((n - done) / BATCH);
        size_t some = whole ? BATCH : n - done;
        GLint at[4];
        for (int k = 0; k < 4; k++) at[k] = look[k] < 0 ? -1 : look[k] + (GLint)done;
        gl->Uniform1ui(gl->GetUniformLocation(program, "place"), place + (GLuint)done);
        gl->Uniform4i(gl->GetUniformLocation(program, "look"), at[0], at[1], at[2], at[3]);
        gl->DrawElementsInstanced(GL_TRIANGLES, (GLsizei)(some * INDICES), GL_UNSIGNED_SHORT, NULL,
                                  whole ? whole : 1);
        done += whole ? (size_t)whole * BATCH : some;
    }
}

static pbs_code draw_node(pbs_canvas *c, const pbs_cubes *node, pbs_err *err) {
    const size_t most = PBS_CANVAS_STREAM / 20;
    place_node(c, node);
    for (size_t i = 0; i < node->chunk_count; i++) {
        const pbs_voxels *v = &node->chunks[i];
        for (size_t done = 0, n; done < v->count; done += n) {
            n = v->count - done < most ? v->count - done : most;
            pbs_code rc = pbs_run_check(c->run, err);
            if (rc) return rc;
            draw_some(c, v, done, n);
        }
    }
    return PBS_OK;
}

pbs_code pbs_canvas_voxels(pbs_canvas *c, const pbs_cubes *nodes, size_t count, pbs_err *err) {
    const pbs_gl *gl = c->gl;
    pbs_code rc = count ? init(c, err) : PBS_OK;
    if (rc || !count) return rc;
    pbs_canvas_view_uniforms(c, c->voxel.program);
    gl->Uniform1ui(gl->GetUniformLocation(c->voxel.program, "batch"), BATCH);
    gl->BindVertexArray(c->voxel.array);
    gl->BindBufferBase(GL_SHADER_STORAGE_BUFFER, 0, c->stream);
    for (size_t i = 0; i < count && !rc; i++) rc = draw_node(c, &nodes[i], err);
    return rc ? rc : pbs_gl_check(gl, "voxels", err);
}
