/* player.h: an archive that is drawn while it is loaded: the cut says what is wanted, the store
 * what is there, the canvas draws it. */
#ifndef PBS_PLAYER_H
#define PBS_PLAYER_H

#include "cmd/pbs-view/draw/draw.h"
#include "cmd/pbs-view/draw/draw_texture.h"
#include "cmd/pbs-view/draw/passes.h"
#include "cmd/pbs-view/stream/source.h"

/* How surfels are drawn (splat.h), and points of clouds (reduce.h). */
enum { PBS_SPLAT_OFF, PBS_SPLAT_ON, PBS_SPLAT_AFRESH, PBS_SPLAT_WHOLE };
enum { PBS_POINTS_CUT, PBS_POINTS_REDUCE, PBS_POINTS_PERIPHERY, PBS_POINTS_CAST };

typedef struct pbs_player_desc {
    uint64_t gpu;    /* bytes of the GPU's memory; 0: 1 GiB. Of a software renderer, whose memory is
                        the host's, at most half of what -m leaves */
    uint64_t upload; /* bytes a frame; 0: 16 MiB */
    uint64_t buffer; /* bytes of a buffer at most; 0: 128 MiB, or what the device has */
    int splat;       /* PBS_SPLAT_OFF, ... */
    int points;      /* PBS_POINTS_CUT, ... */
    bool still; /* of one picture: points are those of its camera, and what is seen is counted */
    bool per_point; /* every surfel decides with its own distance whether it is wanted */
} pbs_player_desc;

typedef struct pbs_player {
    pbs_run *run;
    const pbs_archive *archive;
    pbs_player_desc desc;
    pbs_source source;
    pbs_store *store;
    pbs_cut *cut;
    const pbs_gl *gl; /* of the canvas of the first frame */
    uint64_t counted; /* bytes taken with pbs_mem_take */
    pbs_surfels *surfels;
    pbs_resident *residents; /* of the surfels, or of the clouds, for those passes */
    pbs_cubes *cubes;
    pbs_placed_mesh *near;
    size_t resident_cap, surfel_cap, cube_cap, near_cap;
    pbs_cut_frame frame; /* the last one */
    /* player_near.c; NULL where the archive has no textures */
    uint8_t *ready;      /* of each item of a node: it can be drawn, with its textures */
    uint8_t *covered;    /* of each node: something stands for its mesh */
    pbs_cut_need *needs; /* of the last frame, with textures */
    size_t need_count, need_cap;
    uint64_t *wanted_at; /* of each texture's item: the list of needs that it is in */
    uint64_t want_number;
    /* of the last frame */
    bool busy; /* another frame would show more: something is still to be loaded or uploaded */
    uint64_t voxels, triangles, calls;
    uint64_t replaced;        /* points that the cut took and a pass decides on */
    uint64_t points, visible; /* that a pass has kept; with `still` */
} pbs_player;

/* archive is borrowed until the free. */
pbs_code pbs_player_new(pbs_run *run, const pbs_archive *archive, const pbs_player_desc *desc,
                        pbs_player *out, pbs_err *err);
/* The GL's buffers go with its context, which may be gone already. */
void pbs_player_free(pbs_player *p);

/* Which items a frame needs, and a step of the store towards them; nothing is drawn. The first call
 * waits for what is coarsest, at most 64 MiB of it, so that the first frame shows the whole; the
 * others never wait. */
pbs_code pbs_player_look(pbs_player *p, pbs_canvas *canvas, const pbs_cut_view *view, pbs_err *err);
/* The same until everything is there that the view needs and the limits allow. */
pbs_code pbs_player_settle(pbs_player *p, pbs_canvas *canvas, const pbs_cut_view *view,
                           pbs_err *err);
/* Draws what the last look found, onto a canvas that has begun; any number of times, for instance
 * for two eyes. */
pbs_code pbs_player_draw(pbs_player *p, pbs_canvas *canvas, const pbs_cut_view *view, pbs_err *err);

/* A part of it: discs, splats, and points of clouds. */
pbs_code pbs_player_surfels(pbs_player *p, pbs_canvas *canvas, const pbs_cut_view *view,
                            pbs_err *err);

/* ---- player_near.c ---- */

pbs_code pbs_player_open_near(pbs_player *p, pbs_err *err);
/* What the store is to know of textures. */
void pbs_player_textures(pbs_player *p, pbs_store_desc *desc, pbs_store_gpu *gpu);
/* pbs_store_frame, with what the last cut needs and its textures. */
pbs_code pbs_player_load(pbs_player *p, bool *busy, pbs_err *err);
/* Draws source geometry. */
pbs_code pbs_player_near(pbs_player *p, pbs_canvas *canvas, pbs_err *err);

/* Of the GPU's memory and the loader; zeros before the first frame. */
pbs_store_stats pbs_player_measure(const pbs_player *p);
#endif
