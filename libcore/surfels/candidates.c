#include "libcore/surfels/candidates.h"
#include "libcore/ground/pipe.h"
#include "libcore/data/vec.h"

int pbs_parts_most(size_t things, size_t least) {
    size_t most = things / least;
    return most < 1 ? 1 : most < PBS_PARTS ? (int)most : PBS_PARTS;
}

int pbs_parts(const pbs_run *run, size_t things, size_t least) {
    int most = pbs_parts_most(things, least);
    return run->threads < most ? run->threads : most;
}

typedef struct bounds {
    float low[3], high[3];
    size_t invalid;
} bounds;

typedef struct measure {
    const pbs_points *in;
    int parts;
    bounds part[PBS_PARTS];
} measure;

static void bounds_add(bounds *b, const float p[3]) {
    if (!isfinite(p[0]) || !isfinite(p[1]) || !isfinite(p[2])) {
        b->invalid++;
        return;
    }
    for (int k = 0; k < 3; k++) {
        b->low[k] = p[k] < b->low[k] ? p[k] : b->low[k];
        b->high[k] = p[k] > b->high[k] ? p[k] : b->high[k];
    }
}

enum { BATCH = 8 };

/* Eight points are 24 floats, in which the axes repeat: plain vector code. Gives up, false, at
 * the first coordinate that is not finite: v - v is 0 for the others. */
static bool bounds_of_batches(bounds *b, const float *p, size_t batches) {
    float low[3 * BATCH], high[3 * BATCH], odd[3 * BATCH] = {0};
    for (int k = 0; k < 3 * BATCH; k++) low[k] = INFINITY, high[k] = -INFINITY;
    for (size_t i = 0; i < batches; i++, p += 3 * BATCH)
        for (int k = 0; k < 3 * BATCH; k++) {
            float v = p[k];
            low[k] = v < low[k] ? v : low[k];
            high[k] = v > high[k] ? v : high[k];
            odd[k] += v - v;
        }
    for (int k = 0; k < 3 * BATCH; k++)
        if (odd[k] != 0) return false;
    for (int k = 0; k < 3 * BATCH; k += 3)
        if (batches) bounds_add(b, low + k), bounds_add(b, high + k);
    return true;
}

static pbs_code measure_part(void *ctx, size_t i, int thread, pbs_err *err) {
    (void)thread, (void)err;
    measure *m = ctx;
    size_t at = pbs_part_begin(m->in->count, m->parts, i),
           end = pbs_part_end(m->in->count, m->parts, i);
    bounds *b = &m->part[i];
    *b = (bounds){{INFINITY, INFINITY, INFINITY}, {-INFINITY, -INFINITY, -INFINITY}, 0};
    size_t batches = (end - at) / BATCH;
    if (bounds_of_batches(b, m->in->position + 3 * at, batches)) at += batches * BATCH;
    for (; at < end; at++) bounds_add(b, m->in->position + 3 * at);
    return PBS_OK;
}

static void metric_scale(pbs_metric *m, const bounds *b) {
    double side = 0, square = 0;
    int e = 53;
    for (int k = 0; k < 3; k++) {
        double s = (double)b->high[k] - b->low[k];
        side = s > side ? s : side;
        square += s * s;
    }
    if (side > 0) frexp(side, &e);
    int up = 53 - e, first = up > 127 ? 127 : up;
    m->up = ldexpf(1, first);
    m->up2 = ldexpf(1, up - first);
    m->length = ldexp(1, up);
    m->diagonal = sqrt(square);
    for (int k = 0; k < 3; k++) {
        m->low[k] = (double)b->low[k] * m->length;
        m->high[k] = (double)b->high[k] * m->length;
    }
}

pbs_code pbs_metric_set(pbs_run *run, pbs_metric *m, const pbs_points *in, float weight,
                        size_t *invalid, pbs_err *err) {
    measure work = {in, pbs_parts(run, in->count, 1 << 16), {{{0}, {0}, 0}}};
    pbs_code rc = pbs_parallel(run, (size_t)work.parts, measure_part, &work, err);
    if (rc) return rc;
    bounds all = work.part[0];
    for (int i = 1; i < work.parts; i++) {
        bounds_add(&all, work.part[i].low);
        bounds_add(&all, work.part[i].high);
        all.invalid += work.part[i].invalid;
    }
    *m = (pbs_metric){0};
    if (all.low[0] <= all.high[0]) metric_scale(m, &all);
    float w = weight > 1 ? 1 : weight > 0 ? weight : 0;
    m->normals = in->normal && w > 0;
    m->base = 1 - w * w / 2;
    m->slope = w * w / 2 / (32767.0f * 32767.0f);
    *invalid = all.invalid;
    return PBS_OK;
}

void pbs_place_normal(int16_t out[4], const int16_t oct[2]) {
    float n[3];
    pbs_oct_decode(n, oct);
    for (int k = 0; k < 3; k++) out[k] = pbs_snorm16(n[k]);
    out[3] = 0;
}

void pbs_tree_layout(pbs_tree *t, size_t candidates, pbs_layout *layout) {
    size_t n = (candidates + PBS_FAN_POINTS - 1) / PBS_FAN_POINTS;
    if (!n) n = 1;
    t->leaf = pbs_layout_take(layout, n * PBS_FAN * sizeof *t->leaf);
    t->normal = pbs_layout_take(layout, n * PBS_FAN * sizeof *t->normal);
    t->id = pbs_layout_take(layout, n * PBS_FAN_POINTS * sizeof *t->id);
    size_t digits = (size_t)pbs_parts_most(candidates, PBS_TREE_PART) * PBS_TREE_DIGITS;
    t->digits = pbs_layout_take(layout, digits * sizeof *t->digits);
    t->levels = 0;
    for (;; n = (n + PBS_FAN - 1) / PBS_FAN) {
        t->fans[t->levels] = n;
        t->fan[t->levels++] = pbs_layout_take(layout, n * sizeof *t->fan[0]);
        if (n == 1) break;
    }
}

bool pbs_cpu_has_avx2(void) {
#if defined(__x86_64__) && defined(__GNUC__)
    return __builtin_cpu_supports("avx2");
#else
    return false;
#endif
}
