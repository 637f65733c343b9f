#include "formats/scene/pages.h"

enum { TRIM_EVERY = 1 << 17 }; /* triangles: a few megabytes */

void pbs_pages_open(const pbs_scene *s, const pbs_scratch *beside, pbs_pages *p) {
    p->seen = 0;
    pbs_trim_open(s->run, &p->trim);
    if (beside && beside->is_file) pbs_trim_add(&p->trim, beside->bytes, beside->size);
    if (!s->mesh_count || !s->reader || !pbs_reader_mapped(s->reader)) return;
    const uint8_t *first = (const uint8_t *)s->meshes[0].position;
    const uint8_t *last = (const uint8_t *)s->meshes[s->mesh_count - 1].position;
    if (last > first) pbs_trim_add(&p->trim, first, (size_t)(last - first));
}

void pbs_pages_saw(pbs_pages *p, uint64_t triangles) {
    uint64_t before = __atomic_fetch_add(&p->seen, triangles, __ATOMIC_RELAXED);
    if (before / TRIM_EVERY != (before + triangles) / TRIM_EVERY) pbs_trim_now(&p->trim);
}

void pbs_pages_close(pbs_pages *p) {
    pbs_trim_close(&p->trim);
}
