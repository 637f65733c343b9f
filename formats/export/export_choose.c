/* export_choose.c: how coarse, so that there are at most so many points (export.h). */
#include "formats/export/export.h"
#include "formats/container/wire.h"
#include <float.h>
#include <math.h>

/* ---- a node ---- */

/* One of many equal ones in clouds, where only a change is looked at. */
typedef struct group {
    double spacing;
    uint64_t count;
} group;

static void add_group(pbs_export_tally *t, double spacing, group g) {
    if (g.spacing >= spacing) t->least = fmin(t->least, g.count ? g.spacing : t->least);
    if (g.spacing > spacing)
        t->above += g.count;
    else if (g.spacing == spacing)
        t->equal += g.count;
    else if (g.count)
        t->next = fmax(t->next, g.spacing);
}

static void tally_chunk(const pbs_exporter *x, uint32_t node, const pbs_chunk *c, double scale,
                        pbs_export_tally *t) {
    int at = pbs_record_at(&x->record, PBS_SPACING);
    size_t size = x->record.packed ? 2 : 4;
    const uint8_t *p = (const uint8_t *)c->payload + at;
    uint32_t bits = 0, last = 0;
    group g = {0, 0};
    for (uint32_t i = 0; i < c->count; i++, p += x->record.stride) {
        memcpy(&bits, p, size);
        if (!i || bits != last) {
            add_group(t, x->spacing, g);
            g = (group){pbs_export_spacing(x, node, p) * scale, 0};
            last = bits;
        }
        g.count++;
    }
    add_group(t, x->spacing, g);
}

static pbs_code count_points(pbs_exporter *x, uint32_t node, double scale, pbs_err *err) {
    pbs_export_data *d = &x->data[node];
    pbs_code rc = PBS_OK;
    size_t at = 0;
    for (uint32_t i = 0; i < d->chunks && !rc; i++) {
        pbs_chunk c;
        rc = pbs_export_chunk(x, node, i, &at, &c, err);
        if (!rc) tally_chunk(x, node, &c, scale, &d->tally);
        if (!rc) rc = pbs_run_check(x->run, err);
    }
    return rc;
}

static pbs_export_tally tally_voxels(const pbs_node *n, double scale) {
    double side = n->lattice * scale;
    return (pbs_export_tally){n->records, 0, n->child_count ? side / 2 : 0, side};
}

pbs_code pbs_export_tally_of(pbs_exporter *x, uint32_t node, double scale, pbs_export_tally *out,
                             pbs_err *err) {
    pbs_export_data *d = &x->data[node];
    pbs_code rc = PBS_OK;
    /* Instances are mostly of one size. */
    if (d->tallied[0] != x->spacing || d->tallied[1] != scale) {
        d->tallied[0] = -1;
        d->tally = (pbs_export_tally){.least = INFINITY};
        if (d->tag == PBS_TAG_VOXELS)
            d->tally = tally_voxels(&x->node[node], scale);
        else
            rc = count_points(x, node, scale, err);
        if (rc) return rc;
        d->tallied[0] = x->spacing, d->tallied[1] = scale;
    }
    *out = d->tally;
    return PBS_OK;
}

/* ---- all ---- */

static uint64_t prefix_of(const pbs_exporter *x, uint32_t node) {
    uint64_t n = x->node[node].records, prefix = x->o->prefix;
    return x->data[node].tag == PBS_TAG_VOXELS || n < prefix ? n : prefix;
}

typedef struct sum {
    pbs_exporter *x;
    pbs_export_tally t;
    uint64_t most; /* 0: any number */
} sum;

static pbs_code add(void *ctx, uint32_t node, const double m[12], double scale, pbs_err *err) {
    (void)m;
    sum *s = ctx;
    pbs_export_tally t;
    /* With faces, points are not written. */
    if (s->x->o->faces && s->x->data[node].tag == PBS_TAG_POINTS) return PBS_OK;
    t = (pbs_export_tally){.above = prefix_of(s->x, node)};
    pbs_code rc = s->x->o->prefix ? PBS_OK : pbs_export_tally_of(s->x, node, scale, &t, err);
    if (rc) return rc;
    if (__builtin_add_overflow(s->t.above, t.above, &s->t.above) ||
        __builtin_add_overflow(s->t.equal, t.equal, &s->t.equal))
        return pbs_fail(err, PBS_LIMIT, "%s: more than 2^64 points", s->x->name);
    if (s->most && s->t.above + s->t.equal > s->most)
        return pbs_fail(err, PBS_LIMIT,
                        "%s: more than 4 GiB, which is the most that a GLB can have: write PLY, or "
                        "fewer points with --count or --spacing",
                        s->x->name);
    s->t.next = fmax(s->t.next, t.next);
    s->t.least = fmin(s->t.least, t.least);
    return PBS_OK;
}

static pbs_code tally_at(pbs_exporter *x, double spacing, pbs_export_tally *out, pbs_err *err) {
    sum s = {x, {.least = INFINITY}, 0};
    x->spacing = spacing;
    pbs_code rc = pbs_export_walk(x, add, &s, err);
    *out = s.t;
    return rc;
}

static bool fits(const pbs_exporter *x, const pbs_export_tally *t) {
    return t->above <= x->o->count && t->equal <= x->o->count - t->above;
}

static double between(double low, double high) {
    uint64_t a, b;
    memcpy(&a, &low, sizeof a);
    memcpy(&b, &high, sizeof b);
    a += (b - a) / 2; /* numbers above 0 are in the order of their bits */
    memcpy(&low, &a, sizeof a);
    return low;
}

/* Halves the range until no spacing lies between what leaves too many points and what does not. */
static pbs_code search(pbs_exporter *x, double *low, double *high, pbs_export_tally *t,
                       pbs_err *err) {
    for (;;) {
        pbs_export_tally now;
        double middle = between(*low, *high);
        if (middle == *low || t->next <= *low) return PBS_OK;
        pbs_code rc = tally_at(x, middle, &now, err);
        if (rc) return rc;
        if (fits(x, &now)) {
            *high = middle;
            *t = now;
        } else
            *low = now.least < *high ? fmax(now.least, middle) : middle;
    }
}

/* high fits; at low there are more points with the same spacing than that, of which some do, if
 * that chooses the same nodes. */
static pbs_code fill(pbs_exporter *x, double low, double high, const pbs_export_tally *t,
                     pbs_err *err) {
    pbs_export_tally more;
    uint64_t count = x->o->count;
    x->spacing = high;
    if (t->above + t->equal == count) return PBS_OK;
    pbs_code rc = tally_at(x, low, &more, err);
    if (!rc && more.above <= count && more.equal) {
        x->share = count - more.above;
        x->equal = more.equal;
    } else
        x->spacing = high;
    return rc;
}

pbs_code pbs_export_choose(pbs_exporter *x, pbs_err *err) {
    pbs_export_tally t;
    double low = 0, high = DBL_MAX;
    if (!x->o->count) return PBS_OK;
    /* Everything, if it is no more than that. */
    pbs_code rc = tally_at(x, 0, &t, err);
    if (rc || fits(x, &t)) return rc;
    rc = tally_at(x, high, &t, err);
    if (rc || !fits(x, &t)) return rc; /* the coarsest voxels: there is nothing less */
    rc = search(x, &low, &high, &t, err);
    return rc ? rc : fill(x, low, high, &t, err);
}

/* Instances make much of little: before all points are looked at, they are counted. */
pbs_code pbs_export_fits(pbs_exporter *x, pbs_err *err) {
    if (x->o->format != PBS_EXPORT_GLB) return PBS_OK;
    sum s = {x, {.least = INFINITY}, x->equal ? 0 : UINT32_MAX / 12};
    return pbs_export_walk(x, add, &s, err);
}
