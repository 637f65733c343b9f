#include "formats/scene/motions.h"
#include "formats/container/wire.h"
#include <string.h>

/* ANIM: u32 name bytes, u32 zero, name. MOTN: rest pose, u32 channels, u32 zero; then the channels;
 * then of each channel its times and its values. */
enum {
    NAME_AT = 8,
    REST = 10,
    CHANNELS_AT = 8 * REST,
    MOTION_FIXED = CHANNELS_AT + 8,
    /* u32 animation, u8 path, u8 way, u16 zero, u32 keys, u32 zero */
    CHANNEL_FIXED = 16
};

_Static_assert(sizeof(pbs_trs) == REST * sizeof(double), "the rest is REST numbers");

/* ---- writing ---- */

pbs_code pbs_animation_write(pbs_writer *w, uint32_t number, const char *name, pbs_err *err) {
    uint8_t head[NAME_AT] = {0};
    size_t n = name ? strlen(name) : 0;
    pbs_put_u32(head, (uint32_t)n);
    pbs_chunk c = {.tag = PBS_TAG_ANIMATION, .node = number, .count = 1};
    pbs_piece piece[2] = {{head, sizeof head}, {name, n}};
    return pbs_writer_chunk(w, &c, piece, 2, err);
}

static uint64_t numbers_of(const pbs_motion_channel *c) {
    return (uint64_t)c->keys * (1 + pbs_motion_numbers(c->path, c->way));
}

static uint8_t *put_doubles(uint8_t *p, const double *v, uint64_t n) {
    for (uint64_t i = 0; i < n; i++) p = pbs_put_f64(p, v[i]);
    return p;
}

pbs_code pbs_motion_pack(pbs_run *run, const pbs_motion *m, uint8_t **out, size_t *size,
                         pbs_err *err) {
    double rest[REST];
    uint64_t numbers = 0;
    memcpy(rest, &m->rest, sizeof rest);
    for (uint32_t i = 0; i < m->count; i++) numbers += numbers_of(&m->channels[i]);
    *size = MOTION_FIXED + CHANNEL_FIXED * (size_t)m->count + 8 * (size_t)numbers;
    *out = NULL;
    if (numbers > PBS_MOTION_MOST || *size > PBS_PAYLOAD_MAX)
        return pbs_fail(err, PBS_LIMIT, "a motion of more keys than the format takes");
    pbs_code rc = pbs_alloc(run, out, *size, 1, "a motion", err);
    if (rc) return rc;
    memset(*out, 0, *size);
    uint8_t *p = put_doubles(*out, rest, REST);
    pbs_put_u32(p, m->count);
    p = *out + MOTION_FIXED;
    for (uint32_t i = 0; i < m->count; i++, p += CHANNEL_FIXED) {
        const pbs_motion_channel *c = &m->channels[i];
        pbs_put_u32(p, c->animation);
        p[4] = c->path, p[5] = c->way;
        pbs_put_u32(p + 8, c->keys);
    }
    for (uint32_t i = 0; i < m->count; i++) {
        const pbs_motion_channel *c = &m->channels[i];
        p = put_doubles(p, c->time, c->keys);
        p = put_doubles(p, c->value, (uint64_t)c->keys * pbs_motion_numbers(c->path, c->way));
    }
    return PBS_OK;
}

pbs_code pbs_motion_write(pbs_run *run, pbs_writer *w, uint32_t number, const pbs_motion *m,
                          pbs_err *err) {
    pbs_chunk c = {.tag = PBS_TAG_MOTION, .node = number, .count = 1};
    uint8_t *bytes;
    pbs_piece piece;
    pbs_code rc = pbs_motion_pack(run, m, &bytes, &piece.size, err);
    piece.bytes = bytes;
    if (!rc) rc = pbs_writer_chunk(w, &c, &piece, 1, err);
    pbs_free(run, bytes);
    return rc;
}

pbs_code pbs_motions_write(pbs_run *run, pbs_writer *w, const pbs_motions *m, pbs_err *err) {
    pbs_code rc = PBS_OK;
    for (size_t i = 0; i < m->animation_count && !rc; i++)
        rc = pbs_animation_write(w, (uint32_t)i, m->animations[i].name, err);
    for (size_t i = 0; i < m->count && !rc; i++)
        rc = pbs_motion_write(run, w, (uint32_t)i, &m->motions[i], err);
    return rc;
}

/* ---- reading ---- */

static pbs_code damaged(const char *place, const char *what, uint32_t number, pbs_err *err) {
    return pbs_fail(err, PBS_DATA, "%s: %s %u is damaged", place, what, number);
}

static pbs_code take_animation(pbs_run *run, const char *place, const pbs_chunk *c, pbs_motions *m,
                               pbs_err *err) {
    const uint8_t *p = c->payload;
    size_t n = (size_t)c->bytes - NAME_AT;
    if (c->node != m->animation_count || c->bytes < NAME_AT || pbs_get_u32(p) != n ||
        memchr(p + NAME_AT, 0, n))
        return damaged(place, "animation", c->node, err);
    pbs_code rc = pbs_grow(run, &m->animations, &m->animation_cap, m->animation_count + 1,
                           sizeof *m->animations, "the animations", err);
    pbs_animation a = {0};
    if (!rc) rc = pbs_alloc(run, &a.name, n + 1, 1, "the animations", err);
    if (rc) return rc;
    memcpy(a.name, p + NAME_AT, n);
    a.name[n] = 0;
    m->animations[m->animation_count++] = a;
    return PBS_OK;
}

/* Numbers of the format are read where they lie, as those of meshes are. */
static bool place_keys(pbs_motion_channel *c, const uint8_t **p, uint64_t *left) {
    uint64_t numbers = numbers_of(c);
    if (!c->keys || numbers > *left) return false;
    const void *at = *p;
    c->time = at;
    c->value = c->time + c->keys;
    *p += 8 * numbers;
    *left -= numbers;
    for (uint32_t i = 0; i < c->keys; i++)
        if (!isfinite(c->time[i]) || (i && c->time[i] < c->time[i - 1])) return false;
    for (uint64_t i = 0; i < numbers - c->keys; i++)
        if (!isfinite(c->value[i])) return false;
    return true;
}

static bool get_channels(const uint8_t *p, uint64_t bytes, const pbs_motions *m, uint32_t count,
                         pbs_motion_channel *out) {
    const uint8_t *keys = p + (size_t)CHANNEL_FIXED * count;
    uint64_t left = (bytes - (uint64_t)CHANNEL_FIXED * count) / 8;
    for (uint32_t i = 0; i < count; i++, p += CHANNEL_FIXED) {
        pbs_motion_channel *c = &out[i];
        *c = (pbs_motion_channel){
            .animation = pbs_get_u32(p), .path = p[4], .way = p[5], .keys = pbs_get_u32(p + 8)};
        if (c->animation >= m->animation_count || c->path >= PBS_MOTION_PATHS ||
            c->way >= PBS_MOTION_WAYS || !place_keys(c, &keys, &left))
            return false;
    }
    return left == 0;
}

static pbs_code take_motion(pbs_run *run, const char *place, const pbs_chunk *c, pbs_motions *m,
                            pbs_err *err) {
    const uint8_t *p = c->payload;
    pbs_motion motion = {0};
    if (c->node != m->count || c->bytes < MOTION_FIXED || c->bytes % 8)
        return damaged(place, "motion", c->node, err);
    uint64_t rest = c->bytes - MOTION_FIXED;
    motion.count = pbs_get_u32(p + CHANNELS_AT);
    bool ok = motion.count <= rest / CHANNEL_FIXED;
    memcpy(&motion.rest, p, sizeof motion.rest);
    for (int i = 0; i < REST; i++) ok = ok && isfinite(pbs_get_f64(p + 8 * i));
    if (!ok) return damaged(place, "motion", c->node, err);
    pbs_motion_channel *channels;
    pbs_code rc =
        pbs_grow(run, &m->motions, &m->cap, m->count + 1, sizeof *m->motions, "the motions", err);
    if (!rc) rc = pbs_alloc(run, &channels, motion.count, sizeof *channels, "the motions", err);
    if (rc) return rc;
    motion.channels = channels;
    if (!get_channels(p + MOTION_FIXED, rest, m, motion.count, channels)) {
        pbs_free(run, channels);
        return damaged(place, "motion", c->node, err);
    }
    for (uint32_t i = 0; i < motion.count; i++) {
        double *end = &m->animations[channels[i].animation].end;
        *end = fmax(*end, channels[i].time[channels[i].keys - 1]);
    }
    m->motions[m->count++] = motion;
    return PBS_OK;
}

pbs_code pbs_motions_take(pbs_run *run, const char *place, const pbs_chunk *c, pbs_motions *m,
                          pbs_err *err) {
    return c->tag == PBS_TAG_ANIMATION ? take_animation(run, place, c, m, err)
                                       : take_motion(run, place, c, m, err);
}

pbs_code pbs_motions_fit(const char *place, const pbs_motions *m, const pbs_node *nodes,
                         size_t count, pbs_err *err) {
    for (size_t i = 0; i < count; i++)
        for (uint32_t k = 0; k < nodes[i].child_count; k++)
            if (nodes[i].children[k].motion > m->count)
                return pbs_fail(err, PBS_DATA, "%s: node %zu names motion %u, which is not there",
                                place, i, nodes[i].children[k].motion - 1);
    return PBS_OK;
}

void pbs_motions_free(pbs_run *run, pbs_motions *m) {
    for (size_t i = 0; i < m->animation_count; i++) pbs_free(run, m->animations[i].name);
    for (size_t i = 0; i < m->count; i++) pbs_free(run, (void *)m->motions[i].channels);
    pbs_free(run, m->animations);
    pbs_free(run, m->motions);
    *m = (pbs_motions){0};
}
