/* bench.h: a series of pictures along a camera path, measured: for each the time of the device and
 * of the processor, how much was drawn and uploaded, and with a scene as the truth how far the
 * picture is from its full geometry. The table is pbs-view(1)'s, subsection Measuring. */
#ifndef PBS_BENCH_H
#define PBS_BENCH_H

#include "cmd/pbs-view/draw/count.h"
#include "cmd/pbs-view/play.h"
#include "cmd/pbs-view/draw/timer.h"
#include "formats/container/file.h"

/* Of a frame; NaN: not measured. */
enum { PBS_BENCH_REALS = 8 };
typedef struct pbs_bench_row {
    double time; /* on the path, seconds */
    union {
        struct {
            double gpu, cpu, wall; /* milliseconds */
            double size;           /* of surfels, pixels */
            double ssim, psnr, hole, spill;
        };
        double real[PBS_BENCH_REALS];
    };
    uint64_t draws, nodes, surfels, voxels, triangles, bytes;
} pbs_bench_row;

typedef struct pbs_bench {
    pbs_run *run;
    pbs_show *show;
    pbs_play *play;
    const pbs_gl *gl;
    pbs_show truth; /* its run is NULL: there is none */
    pbs_show_options truth_options;
    pbs_canvas *truth_canvas;
    uint32_t truth_width, truth_height;
    pbs_timer timer;
    pbs_output out;
    pbs_bench_row *rows;
    uint64_t count, done;
} pbs_bench;

/* Opens the table's file, and the truth if one is asked for. Everything is borrowed until close.
 * gl: with the counter of count.h in it. Errors: PBS_IO; those of a scene; PBS_LIMIT. */
pbs_code pbs_bench_open(pbs_show *show, pbs_play *play, const pbs_gl *gl, pbs_bench *out,
                        pbs_err *err);
/* Draws and measures the next of the pictures onto a canvas of this size. Waits until the device
 * has finished it. Errors: those of drawing and comparing. */
pbs_code pbs_bench_frame(pbs_bench *bench, pbs_canvas *canvas, uint32_t width, uint32_t height,
                         pbs_err *err);
static inline bool pbs_bench_is_done(const pbs_bench *bench) {
    return bench->done == bench->count;
}
/* Writes the table of the frames that are done, and gives the file its name. Errors: PBS_IO. */
pbs_code pbs_bench_write(pbs_bench *bench, pbs_err *err);
/* Of a value, by its offset in the row: the median over all frames; NaN ones are left out. */
double pbs_bench_median(const pbs_bench *bench, size_t offset);
void pbs_bench_close(pbs_bench *bench);
#endif
