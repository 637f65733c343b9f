/* mips.c: the levels of a texture in one piece of memory. */
#include "cmd/pbs-view/draw/mips.h"
#include "libcore/data/texture.h"

static uint32_t half(uint32_t n) {
    return n > 1 ? n / 2 : 1;
}

int pbs_mips_levels(const pbs_mips *m) {
    int n = 0;
    for (uint32_t side = m->width > m->height ? m->width : m->height; side; side /= 2) n++;
    return n;
}

pbs_mips pbs_mips_level(const pbs_mips *m, int level, uint64_t *at) {
    pbs_mips l = *m;
    *at = 0;
    for (; level > 0; level--) {
        *at += (uint64_t)4 * l.width * l.height;
        l.width = half(l.width), l.height = half(l.height);
    }
    return l;
}

uint64_t pbs_mips_bytes(const pbs_mips *m) {
    uint64_t bytes;
    pbs_mips_level(m, pbs_mips_levels(m), &bytes);
    return bytes;
}

/* The first level that is kept. */
static int choose(const pbs_texture *t, bool srgb, uint32_t side, uint64_t most, pbs_mips *out) {
    for (int l = 0; l < t->levels; l++) {
        *out = (pbs_mips){t->width[l], t->height[l], srgb};
        if (out->width <= side && out->height <= side && pbs_mips_bytes(out) <= most) return l;
    }
    return t->levels - 1;
}

pbs_code pbs_mips_make(pbs_run *run, const pbs_image *image, bool srgb, uint32_t side,
                       uint64_t most, pbs_mips *out, uint8_t **chain, pbs_err *err) {
    pbs_texture t;
    size_t at = 0;
    *out = (pbs_mips){0, 0, srgb};
    *chain = NULL;
    pbs_code rc = pbs_texture_build(run, image, srgb, &t, err);
    if (rc || !t.levels) return rc;
    int first = choose(&t, srgb, side, most, out);
    rc = pbs_alloc(run, chain, (size_t)pbs_mips_bytes(out), 1, "a texture", err);
    for (int l = first; l < t.levels && !rc; l++) {
        size_t n = (size_t)4 * t.width[l] * t.height[l];
        memcpy(*chain + at, t.level[l], n);
        at += n;
    }
    pbs_texture_free(run, &t);
    return rc;
}
