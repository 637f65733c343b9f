/* overlay.c: the lines of the overlay. */
#include "cmd/pbs-view/overlay.h"
#include "cmd/pbs-view/keys.h"
#include <stdarg.h>
#include <stdio.h>

typedef unsigned long long ull;

__attribute__((format(printf, 2, 3))) static void add(char out[PBS_OVERLAY_TEXT], const char *fmt,
                                                      ...) {
    size_t n = strlen(out);
    va_list args;
    va_start(args, fmt);
    vsnprintf(out + n, PBS_OVERLAY_TEXT - n, fmt, args);
    va_end(args);
}

/* 12345678 as "12.3 M": what changes from frame to frame should not jump about. */
static const char *short_count(uint64_t n, char out[24]) {
    if (n < 10000000)
        snprintf(out, 24, "%llu", (ull)n);
    else if (n < 1000000000)
        snprintf(out, 24, "%.1f M", (double)n * 1e-6);
    else
        snprintf(out, 24, "%.2f G", (double)n * 1e-9);
    return out;
}

static void add_times(const pbs_overlay *o, char out[PBS_OVERLAY_TEXT]) {
    if (o->gpu > 0) add(out, "device\t%.2f ms\n", 1e3 * o->gpu);
    if (o->cpu > 0) add(out, "processor\t%.2f ms\n", 1e3 * o->cpu);
    if (o->target > 0) add(out, "held at\t%.2f ms\n", 1e3 * o->target);
}

void pbs_overlay_statistics(const pbs_overlay *o, const pbs_show *s, const pbs_show_view *v,
                            char out[PBS_OVERLAY_TEXT]) {
    char n[24];
    out[0] = 0;
    if (o->statistics) {
        add(out, "%s\n%u x %u pixels%s%s\n", o->device, v->width, v->height,
            v->separation > 0 ? ", two eyes" : "", v->zones ? ", zones" : "");
        add_times(o, out);
        add(out, "nodes\t%s\n", short_count(s->drawn_nodes, n));
        if (s->drawn_surfels) add(out, "surfels\t%s\n", short_count(s->drawn_surfels, n));
        if (s->drawn_voxels) add(out, "voxels\t%s\n", short_count(s->drawn_voxels, n));
        if (s->drawn_triangles) add(out, "triangles\t%s\n", short_count(s->drawn_triangles, n));
        add(out, "draws\t%s\n", short_count(o->counts.draws, n));
        if (o->counts.dispatches) add(out, "computes\t%s\n", short_count(o->counts.dispatches, n));
        add(out, "uploaded\t%.2f MB\n", 1e-6 * (double)o->counts.bytes);
        add(out, "size\t%.2f px\n", o->surfel_size);
        if (s->unfinished) add(out, "loading\n");
        if (o->flying) add(out, "flying\n");
        if (o->playing) add(out, "playing the path\n");
        if (pbs_poses_any(&s->poses) && !isnan(v->time))
            add(out, "animation\t%.2f s%s\n", v->time, o->moving ? "" : ", stopped");
    }
    if (o->name[0]) add(out, "%s\n", o->name);
}

void pbs_overlay_keys(char out[PBS_OVERLAY_TEXT]) {
    out[0] = 0;
    for (size_t i = 0; i < pbs_key_count; i++)
        add(out, "%s\t%s\n", pbs_keys[i].name, pbs_keys[i].what);
}
