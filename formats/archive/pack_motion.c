/* pack_motion.c: motions of all inputs (motions.h): numbered anew, equal ones once.
 *
 * Animations of several inputs that have the same name are one, so that they play together, and so
 * are those without a name that have the same number; inside of an input they stay apart. */
#include "formats/archive/pack_inner.h"
#include <string.h>

static const pbs_motions *motions_of(const pack_input *in) {
    return in->kind == PACK_SCENE ? &in->scene.motions : &in->motions;
}

/* By digest; the numbers of the archive's animations and motions are places in them. */
typedef struct shelves {
    pbs_known animations, motions;
    pbs_known names; /* of the animations of one input; triangles: how many came before of each */
} shelves;

/* How many animations of that name came before in the input. */
static pbs_code rank_of(shelves *s, const char *name, uint64_t *rank, pbs_err *err) {
    pbs_known_node node = {0};
    uint32_t at;
    bool found;
    pbs_digest_add(&node.digest, name, strlen(name));
    pbs_code rc = pbs_known_find(&s->names, &node.digest, NULL, &found, &at, err);
    *rank = !rc && found ? ++s->names.node[at].triangles : 0;
    return rc || found ? rc : pbs_known_add(&s->names, &node, err);
}

static pbs_code add_animation(pbs_pack *p, shelves *s, const char *name, uint32_t *number,
                              pbs_err *err) {
    pbs_known_node node = {0};
    uint64_t rank;
    bool found = false;
    pbs_code rc = rank_of(s, name, &rank, err);
    pbs_digest_add(&node.digest, &rank, sizeof rank);
    pbs_digest_add(&node.digest, name, strlen(name));
    if (!rc) rc = pbs_known_find(&s->animations, &node.digest, NULL, &found, number, err);
    if (rc || found) return rc;
    *number = (uint32_t)p->animation_count;
    rc = pbs_known_add(&s->animations, &node, err);
    if (!rc)
        rc = pbs_grow(p->run, &p->animations, &p->animation_cap, p->animation_count + 1,
                      sizeof *p->animations, "the animations", err);
    if (!rc) p->animations[p->animation_count++] = name;
    return rc;
}

static pbs_code add_motion(pbs_pack *p, shelves *s, const pbs_motion *m, const uint32_t *animation,
                           uint32_t *number, pbs_err *err) {
    pbs_known_node node = {0};
    pbs_motion_channel *channels;
    uint8_t *bytes = NULL;
    size_t size;
    bool found = false;
    pbs_code rc = pbs_alloc(p->run, &channels, m->count, sizeof *channels, "the motions", err);
    if (rc) return rc;
    for (uint32_t i = 0; i < m->count; i++) {
        channels[i] = m->channels[i];
        channels[i].animation = animation[channels[i].animation];
    }
    pbs_motion copy = {m->rest, m->count, channels};
    rc = pbs_motion_pack(p->run, &copy, &bytes, &size, err);
    if (!rc) pbs_digest_add(&node.digest, bytes, size);
    pbs_free(p->run, bytes);
    if (!rc) rc = pbs_known_find(&s->motions, &node.digest, NULL, &found, number, err);
    if (!rc && !found) {
        *number = (uint32_t)p->motion_count;
        rc = pbs_known_add(&s->motions, &node, err);
        if (!rc)
            rc = pbs_grow(p->run, &p->motions, &p->motion_cap, p->motion_count + 1,
                          sizeof *p->motions, "the motions", err);
        if (!rc) p->motions[p->motion_count++] = copy;
    }
    if (rc || found) pbs_free(p->run, channels);
    return rc;
}

/* The placings of an input's nodes name the archive's motions. */
static pbs_code number_input(pbs_pack *p, shelves *s, const pack_input *in, pbs_err *err) {
    const pbs_motions *m = motions_of(in);
    uint32_t *animation = NULL, *motion = NULL;
    pbs_code rc =
        pbs_alloc(p->run, &animation, m->animation_count, sizeof *animation, "the animations", err);
    if (!rc) rc = pbs_alloc(p->run, &motion, m->count, sizeof *motion, "the motions", err);
    for (size_t i = 0; i < m->animation_count && !rc; i++)
        rc = add_animation(p, s, m->animations[i].name, &animation[i], err);
    for (size_t i = 0; i < m->count && !rc; i++)
        rc = add_motion(p, s, &m->motions[i], animation, &motion[i], err);
    for (size_t i = in->first_node; i < in->first_node + in->node_count && !rc; i++) {
        pbs_node *n = &p->entries[i].node;
        for (uint32_t k = 0; k < n->child_count; k++) {
            uint32_t *of = &n->children[k].motion;
            if (*of > m->count)
                rc = pbs_fail(err, PBS_DATA, "%s: node %u names motion %u, which is not there",
                              pbs_reader_name(in->reader), p->entries[i].own, *of - 1);
            else if (*of)
                *of = motion[*of - 1] + 1;
        }
    }
    pbs_free(p->run, animation);
    pbs_free(p->run, motion);
    pbs_known_free(&s->names);
    s->names = (pbs_known){.run = p->run};
    return rc;
}

pbs_code pack_motions(pbs_pack *p, pbs_err *err) {
    shelves s = {{.run = p->run}, {.run = p->run}, {.run = p->run}};
    pbs_code rc = PBS_OK;
    for (int i = 0; i < p->input_count && !rc; i++)
        if (p->inputs[i].node_count) rc = number_input(p, &s, &p->inputs[i], err);
    pbs_known_free(&s.animations);
    pbs_known_free(&s.motions);
    return rc;
}

pbs_code pack_write_motions(pbs_pack *p, pbs_err *err) {
    pbs_code rc = PBS_OK;
    for (size_t i = 0; i < p->animation_count && !rc; i++)
        rc = pbs_animation_write(p->w, (uint32_t)i, p->animations[i], err);
    for (size_t i = 0; i < p->motion_count && !rc; i++)
        rc = pbs_motion_write(p->run, p->w, (uint32_t)i, &p->motions[i], err);
    return rc;
}

void pack_free_motions(pbs_pack *p) {
    for (size_t i = 0; i < p->motion_count; i++) pbs_free(p->run, (void *)p->motions[i].channels);
    pbs_free(p->run, p->motions);
    pbs_free(p->run, p->animations);
}
