/* scene.h: scenes: the scene stream, written and read, and any scene file opened as one.
 *
 * Chunks of a scene stream, in an order in which everything comes before what refers to it:
 *
 *     TEXR  an image file's bytes            MATL  a material
 *     ANIM  an animation                     MOTN  how placings move (motions.h)
 *     MESH  a piece of a part                NODE  a part (after its meshes) or an assembly
 *     CNTS  what could not become triangles, once, before the end
 *
 * The last NODE is the root. Parts that are equal, and assemblies of equal children, are one node;
 * where they have different names, the placings carry them.
 */
#ifndef PBS_SCENE_H
#define PBS_SCENE_H

#include "formats/container/container.h"
#include "formats/scene/motions.h"
#include "formats/scene/node.h"
#include "formats/readers/sink.h"

/* ---- writing: the sink behind which the readers of foreign files stand ---- */

typedef struct pbs_scene_writer pbs_scene_writer;

typedef struct pbs_scene_options {
    bool ignore_missing; /* textures that are not there are counted, not an error */
    uint64_t split;      /* parts with more triangles become assemblies of parts; 0: never */
    uint64_t group;      /* assemblies with more children get inner ones; 0: never */
    /* Told of each part, material or texture that cannot be read and is left out (sink.h); the text
     * is without the file's name. NULL: the first one is an error. */
    void (*failed)(void *ctx, const pbs_err *err);
    void *failed_ctx;
} pbs_scene_options;
#define PBS_SCENE_DEFAULTS ((pbs_scene_options){.split = 400000, .group = 32})

/* The writer stays the caller's. options NULL: PBS_SCENE_DEFAULTS. Meshes are cut, vertices welded
 * by equality of their bits. */
pbs_code pbs_scene_writer_new(pbs_run *run, pbs_writer *w, const pbs_scene_options *options,
                              pbs_scene_writer **out, pbs_err *err);
const pbs_sink *pbs_scene_sink(pbs_scene_writer *s);
/* Instead of the sink's triangle, for one that was stored before with the same origin: nothing is
 * rounded or left out (meshbuild.h). */
struct pbs_vertex;
pbs_code pbs_scene_stored(pbs_scene_writer *s, const struct pbs_vertex *corner, uint32_t material,
                          pbs_err *err);
/* After the reader is done: PBS_DATA "no triangles" if there are none. */
pbs_code pbs_scene_writer_end(pbs_scene_writer *s, pbs_err *err);
typedef struct pbs_scene_totals {
    uint64_t nodes, triangles, stored;          /* with all instances; each part once */
    uint64_t parts_unified, assemblies_unified; /* that equal an earlier one */
    uint64_t parts_split, groups;               /* made by the options split and group */
    uint64_t animations, motions;
    uint64_t skipped[PBS_SKIP_KINDS];
} pbs_scene_totals;
pbs_scene_totals pbs_scene_writer_totals(const pbs_scene_writer *s); /* after the end */
void pbs_scene_writer_free(pbs_scene_writer *s);

/* What a reader is chosen by: the file's first bytes, and its name where those say nothing.
 * Errors: PBS_DATA, which names formats that are known but not read (LAZ, STEP, E57, ...). */
pbs_code pbs_import_pick(const char *path, const uint8_t *bytes, size_t size, pbs_import_fn *fn,
                         pbs_err *err);

/* Maps the input, picks the reader and runs it. path: as pbs_input_open got it. Errors have the
 * file's name in front. */
pbs_code pbs_import_input(pbs_input *in, const char *path, const pbs_sink *sink, pbs_err *err);

/* ---- reading ---- */

typedef struct pbs_texture {
    const char *name;
    const void *bytes;
    size_t size;
} pbs_texture;

typedef struct pbs_scene {
    pbs_run *run;
    pbs_reader *reader; /* mapped; meshes and textures point into it */
    pbs_node *nodes;
    size_t node_count;
    size_t *first_mesh; /* node_count + 1: the meshes of node i begin at first_mesh[i] */
    pbs_mesh *meshes;
    size_t mesh_count;
    pbs_material *materials;
    size_t material_count;
    pbs_texture *textures;
    size_t texture_count;
    pbs_motions motions;
    uint64_t skipped[PBS_SKIP_KINDS];
    uint32_t channels; /* that candidates of the scene can have: NORMAL, and what there is of
                          COLOUR, MATERIAL, EMISSIVE */
    pbs_scene_options options; /* that it was opened with */
} pbs_scene;

/* Any scene file, or a scene stream, from a path or (NULL) standard input. Foreign files are
 * imported to a spool on the way. Everything is checked. */
pbs_code pbs_scene_open(pbs_run *run, const char *path, const pbs_scene_options *options,
                        pbs_scene *out, pbs_err *err);
/* The same for an input that is open already; takes it over, also on error. path: as pbs_input_open
 * got it. */
pbs_code pbs_scene_open_input(pbs_run *run, pbs_input *in, const char *path,
                              const pbs_scene_options *options, pbs_scene *out, pbs_err *err);
/* The provenance of the scene for the next header: whole lines. */
const char *pbs_scene_history(const pbs_scene *s);
/* The root's name, or that of the file that the scene was imported from; "" if that was a pipe. */
void pbs_scene_title(const pbs_scene *s, char *out, size_t size);
/* The MATL chunks as they are, for files whose records name materials by number. The textures that
 * they refer to do not come with them. Errors: PBS_IO. */
pbs_code pbs_scene_copy_materials(const pbs_scene *s, pbs_writer *w, pbs_err *err);
void pbs_scene_close(pbs_scene *s);

/* All placed meshes below the root, in the frame whose origin is *origin (chosen here: the middle
 * of *box, which is the exact bounding box of all placed vertices in the scene's coordinates).
 * *draws is freed with pbs_free. Instances of one mesh share it. singular: placings whose
 * transform is not invertible. Errors: PBS_LIMIT; PBS_DATA if there is no triangle, or more than
 * 2^32 - 2. */
typedef struct pbs_flat {
    pbs_draw *draws;
    size_t count;
    uint64_t triangles, singular;
    double origin[3];
    pbs_box box;
} pbs_flat;
pbs_code pbs_scene_flatten(const pbs_scene *s, pbs_flat *out, pbs_err *err);
/* The draws of a flattened scene once more, in the same frame, with motions in their poses (node.h;
 * NULL: at rest). The box stays that of the rest. Errors: PBS_LIMIT, PBS_CANCEL. */
pbs_code pbs_scene_pose(const pbs_scene *s, const double (*pose)[12], pbs_flat *flat, pbs_err *err);

/* Decodes all textures that materials use. Array of texture_count; free with pbs_images_free. One
 * that cannot be decoded is an error, or told and has no size, which counts as white (see failed
 * above). */
pbs_code pbs_scene_images(const pbs_scene *s, pbs_image **out, pbs_err *err);
void pbs_images_free(pbs_run *run, pbs_image *images, size_t count);

/* What a MATL or TEXR chunk says; false if it is damaged. textures, materials: how many there are.
 * The name is not filled in. */
bool pbs_material_parse(const pbs_chunk *c, size_t textures, pbs_material *out);
bool pbs_texture_parse(const pbs_chunk *c);
bool pbs_mesh_materials_fit(const pbs_mesh *m, size_t materials);

/* The words for pbs_skip: "triangles with NaN or infinite corners". */
extern const char *const pbs_skip_text[PBS_SKIP_KINDS];
#endif
