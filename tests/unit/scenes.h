/* scenes.h: small scenes of parts and assemblies, made through the scene sink and opened again. */
#ifndef PBS_SCENES_H
#define PBS_SCENES_H
#include "tests/unit/support.h"

static pbs_run run = {.threads = 2};
static pbs_err err;

typedef struct maker {
    pbs_writer *w;
    pbs_scene_writer *sw;
    const pbs_sink *s;
} maker;

static inline maker new_scene(void) {
    static const pbs_scene_options as_it_is = {0};
    maker m = {.w = spool_writer(&run, PBS_SCENE, NULL, 0)};
    must(pbs_scene_writer_new(&run, m.w, &as_it_is, &m.sw, &err), &err);
    m.s = pbs_scene_sink(m.sw);
    return m;
}

static inline pbs_child child_at(uint32_t node, double x, double scale, bool moves) {
    pbs_child c = {.node = node, .flags = moves ? PBS_CHILD_MOVES : 0};
    for (int i = 0; i < 12; i++) c.m[i] = scale * PBS_IDENTITY[i];
    c.m[3] = x;
    return c;
}

static inline uint32_t add_assembly(const maker *m, const pbs_child *c, size_t n) {
    uint32_t node;
    must(m->s->assembly(m->s->ctx, "some", c, n, &node, &err), &err);
    return node;
}

static inline uint32_t add_pair(const maker *m, pbs_child a, pbs_child b) {
    return add_assembly(m, (pbs_child[]){a, b}, 2);
}

static inline pbs_scene reopen(maker *m, uint32_t root) {
    pbs_scene s;
    char path[40];
    int fd = memfd_create("scene", MFD_CLOEXEC);
    must(m->s->root(m->s->ctx, root, &err), &err);
    must(pbs_scene_writer_end(m->sw, &err), &err);
    pbs_scene_writer_free(m->sw);
    blob b = take_bytes(m->w);
    snprintf(path, sizeof path, "/proc/self/fd/%d", fd);
    if (write(fd, b.bytes, b.size) != (ssize_t)b.size) abort();
    must(pbs_scene_open(&run, path, NULL, &s, &err), &err);
    close(fd);
    free(b.bytes);
    return s;
}
#endif
