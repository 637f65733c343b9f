/* Voxels in files: what is right passes, as a stream and as an archive, from a pipe and a map, and
 * each promise that is broken is found behind right checksums. */
#include "tests/unit/support.h"
#include "tests/check.h"

static pbs_run run = {.threads = 1};
static pbs_err err;

enum { SOME = PBS_POSITION | PBS_NORMAL | PBS_WEIGHT };

TEST(a_sphere_is_right) {
    vox_model m;
    vox_sphere(&m, 512);
    CHECK(m.nodes == 9);
    for (int archive = 0; archive < 2; archive++) {
        blob b = vox_file(&run, &m, SOME | PBS_FACE | PBS_COLOUR, archive);
        pbs_input in;
        pbs_checked found;
        pbs_run fresh = {.threads = 1};
        open_blob(&fresh, b, false, &in);
        if (pbs_check_file(&fresh, &in, &found, &err)) printf("# %s\n", err.text), pbs_bad++;
        CHECK(found.records == m.count[0] + m.count[1] && found.nodes == 10);
        CHECK_NUM(pbs_mem_peak(&fresh) < 64 << 10,
                  fresh.mem_peak); /* a table of nodes, no voxels */
        CHECK(pbs_mem_used(&fresh) == 0);
        free(b.bytes);
    }
    vox_free(&m);
}

/* ---- one thing wrong at a time ---- */

static vox_cell *of_level(vox_model *m, uint32_t level, uint32_t i) {
    return &m->cell[level][i];
}

static void drop(vox_model *m, uint32_t level, uint32_t i) {
    memmove(of_level(m, level, i), of_level(m, level, i + 1),
            (--m->count[level] - i) * sizeof(vox_cell));
    for (uint32_t n = 0; n < m->nodes; n++) {
        vox_node *node = &m->node[n];
        if (node->level != level) continue;
        node->count -= node->first <= i && i < node->first + node->count;
        node->first -= node->first > i;
    }
}

static void swap(vox_model *m) {
    vox_cell c = *of_level(m, 1, 1);
    *of_level(m, 1, 1) = *of_level(m, 1, 2);
    *of_level(m, 1, 2) = c;
}
static void twice(vox_model *m) {
    of_level(m, 1, 1)->code = of_level(m, 1, 0)->code;
}
static void parent_missing(vox_model *m) {
    drop(m, 1, 1);
}
static void last_parent_missing(vox_model *m) {
    drop(m, 1, m->count[1] - 1);
}
static void child_missing(vox_model *m) {
    drop(m, 0, 1);
}
static void parent_elsewhere(vox_model *m) {
    of_level(m, 1, m->count[1] - 1)->code++;
}
static void face_missing(vox_model *m) {
    of_level(m, 1, 0)->faces &= ~(uint32_t)PBS_FACE_X0;
}
static void bit_too_many(vox_model *m) {
    of_level(m, 0, 0)->faces |= 128;
}
static void beyond(vox_model *m) {
    m->grid.size = 400;
    of_level(m, 0, m->count[0] - 1)->code |= 0x249249; /* x 255 of the second chunk */
}
static void weightless(vox_model *m) {
    of_level(m, 0, 2)->weight = NAN;
}
static void negative(vox_model *m) {
    of_level(m, 0, 2)->weight = -1;
}
static void no_side(vox_model *m) {
    m->grid.voxel = 0;
}
static void moved(vox_model *m) {
    m->node[m->nodes - 1].child[1].m[3] = 0.5;
}
static void adds(vox_model *m) {
    m->node[m->nodes - 1].flags = PBS_NODE_ADDS;
}
static void child_twice(vox_model *m) {
    m->node[m->nodes - 1].child[1].node = m->node[m->nodes - 1].child[0].node;
}
static void wrong_level(vox_model *m) {
    m->node[m->nodes - 1].level = 2;
    m->cell[2] = m->cell[1], m->cell[1] = NULL;
}
static void other_eighth(vox_model *m) {
    m->node[0].chunk = 2;
}
static void wrong_chunk(vox_model *m) {
    m->grid.size = 1024, m->levels = 2;
    m->node[0].chunk = 8;
}

static const struct {
    const char *name;
    void (*change)(vox_model *m);
    bool piped; /* found in a pipe, too */
    const char *text;
} wrong[] = {
    {"order", swap, true, "Morton order"},
    {"a cell twice", twice, true, "Morton order"},
    {"a parent is missing", parent_missing, false, "that their children make"},
    {"the last parent is missing", last_parent_missing, false, "that their children make"},
    {"a child is missing", child_missing, false, "that their children make"},
    {"a parent elsewhere", parent_elsewhere, false, "that their children make"},
    {"a face is missing", face_missing, false, "a face of their children"},
    {"a bit too many", bit_too_many, true, "faces that there are none of"},
    {"beyond the grid", beyond, true, "outside of the grid"},
    {"no weight", weightless, true, "no area"},
    {"a weight below zero", negative, true, "no area"},
    {"no side", no_side, true, "no side of cells"},
    {"a child is moved", moved, true, "a child is moved"},
    {"added to its children", adds, true, "points of a cloud"},
    {"a child twice", child_twice, true, "an eighth of it"},
    {"another level", wrong_level, true, "a cell outside of the grid"},
    {"another eighth", other_eighth, false, "that their children make"},
    {"another chunk", wrong_chunk, true, "an eighth of it"},
};

static void check_wrong(size_t k, bool archive) {
    vox_model m;
    vox_small(&m);
    wrong[k].change(&m);
    blob b = vox_file(&run, &m, SOME, archive);
    for (int piped = 0; piped < 2; piped++) {
        pbs_code rc = check_blob(&run, b, piped, &err);
        if (piped && !wrong[k].piped) continue;
        if (rc == PBS_DATA && strstr(err.text, wrong[k].text)) continue;
        printf("# %s, %s: %s\n", wrong[k].name, archive ? "archive" : "stream",
               rc ? err.text : "taken");
        pbs_bad++;
    }
    free(b.bytes);
    vox_free(&m);
}

TEST(each_promise_is_kept) {
    for (size_t k = 0; k < sizeof wrong / sizeof wrong[0]; k++)
        for (int archive = 0; archive < 2; archive++) check_wrong(k, archive);
    CHECK(pbs_mem_used(&run) == 0);
}

/* ---- lists of faces ---- */

/* One voxel with three faces, whose list begins at `at` and has two chunks; material ids. */
static pbs_code check_list(uint32_t at, uint32_t first, uint32_t second, uint32_t second_at,
                           uint32_t flags, uint32_t id, uint32_t channels) {
    char text[256];
    pbs_voxels_text(channels, text);
    pbs_writer *w = spool_writer(&run, PBS_VOXELS, text, 0);
    uint32_t place[1] = {PBS_PLACE(1, 2, 3, 7)}, faces[8] = {id, id, id, id, id, id, id, id};
    pbs_voxel_place where = {0, 0, 16, {0, 0, 0}};
    pbs_voxels v = {.count = 1, .place = place, .face = channels & PBS_FACE ? &at : NULL};
    pbs_node n = {.lattice = 1, .records = 1, .box = {{0, 0, 0}, {16, 16, 16}}};
    must(pbs_voxels_write(w, 0, &where, &v, 0, &err), &err);
    must(pbs_faces_write(w, 0, false, faces, first, 0, &err), &err);
    must(pbs_faces_write(w, 0, flags, faces, second, second_at, &err), &err);
    must(pbs_node_write(&run, w, &n, &err), &err);
    blob b = take_bytes(w);
    pbs_code rc = check_blob(&run, b, false, &err);
    CHECK(check_blob(&run, b, true, &err) == rc);
    free(b.bytes);
    return rc;
}

TEST(lists_of_faces) {
    const uint32_t with = PBS_POSITION | PBS_FACE;
    CHECK(check_list(0, 2, 1, 2, 0, PBS_NONE, with) == PBS_OK);
    CHECK(check_list(1, 2, 2, 2, 0, PBS_NONE, with) == PBS_OK);
    CHECK(check_list(PBS_NONE, 0, 0, 0, 0, PBS_NONE, with) == PBS_OK);
    CHECK(check_list(1, 2, 1, 2, 0, PBS_NONE, with) == PBS_DATA);
    CHECK(check_list(0xfffffffe, 2, 2, 2, 0, PBS_NONE, with) == PBS_DATA);
    CHECK(check_list(0, 2, 1, 3, 0, PBS_NONE, with) == PBS_DATA); /* a hole */
    CHECK(check_list(0, 2, 2, 1, 0, PBS_NONE, with) == PBS_DATA); /* overlap */
    CHECK(check_list(0, 2, 1, 2, 1, PBS_NONE, with) == PBS_DATA); /* of two kinds */
    CHECK(check_list(0, 2, 1, 2, 0, 0, with) == PBS_DATA);        /* no such material */
    CHECK(check_list(0, 2, 1, 2, 0, PBS_NONE, PBS_POSITION) == PBS_DATA);
}

/* ---- places that chunks must not be in ---- */

static pbs_code check_tags(pbs_kind kind, const char *channels, bool points) {
    pbs_writer *w = spool_writer(&run, kind, channels, 0);
    uint32_t place[1] = {0};
    pbs_voxel_place where = {0, 0, 16, {0, 0, 0}};
    pbs_voxels v = {.count = 1, .place = place};
    pbs_node n = {.lattice = 1, .records = points ? 2 : 1, .box = {{0, 0, 0}, {16, 16, 16}}};
    pbs_chunk c = {.tag = PBS_TAG_POINTS, .count = 1};
    pbs_piece piece = {place, 8};
    uint8_t zeros[8] = {0};
    piece.bytes = zeros;
    if (kind == PBS_ARCHIVE) must(pbs_node_write(&run, w, &n, &err), &err);
    if (points) must(pbs_writer_chunk(w, &c, &piece, 1, &err), &err);
    must(pbs_voxels_write(w, 0, &where, &v, points, &err), &err);
    if (kind != PBS_ARCHIVE) must(pbs_node_write(&run, w, &n, &err), &err);
    blob b = take_bytes(w);
    pbs_code rc = check_blob(&run, b, false, &err);
    free(b.bytes);
    return rc;
}

TEST(voxels_where_they_do_not_belong) {
    CHECK(check_tags(PBS_VOXELS, "place:u8x4", false) == PBS_OK);
    CHECK(check_tags(PBS_ARCHIVE, "place:u8x4", false) == PBS_OK);
    CHECK(check_tags(PBS_ARCHIVE, "position:u16x3 spacing:f16 place:u8x4", false) == PBS_OK);
    CHECK(check_tags(PBS_ARCHIVE, "position:u16x3 spacing:f16 place:u8x4", true) == PBS_DATA);
    CHECK(check_tags(PBS_ARCHIVE, "position:u16x3 spacing:f16", false) == PBS_DATA);
    CHECK(check_tags(PBS_ARCHIVE, "position:u16x3 spacing:f16place:u8x4", false) == PBS_DATA);
    CHECK(check_tags(PBS_ARCHIVE, "", false) == PBS_DATA);
    CHECK(check_tags(PBS_VOXELS, "position:u16x3 spacing:f16 place:u8x4", false) == PBS_DATA);
    CHECK(check_tags(PBS_VOXELS, "place:u8x4 shade:u8x4", false) == PBS_DATA);
    CHECK(check_tags(PBS_SCENE, "", false) == PBS_DATA);
}

/* ---- channels of archives ---- */

TEST(channels_of_archives_come_back) {
    for (uint32_t bits = 0; bits < 1 << 10; bits++) {
        uint32_t have = bits & 15 ? PBS_POSITION | PBS_SPACING : 0, voxels = bits >> 4 & 63;
        if (have) have |= (bits & 14) << 1;
        voxels = voxels ? PBS_POSITION | (voxels << 2 & ~(uint32_t)PBS_WEIGHT) : 0;
        if (!have && !voxels) continue;
        char text[512];
        pbs_record r = pbs_record_make(have, true), back;
        uint32_t voxels_back;
        pbs_archive_text(&r, voxels, text);
        CHECK(pbs_archive_parse("f", text, &back, &voxels_back, &err) == PBS_OK);
        CHECK(back.channels == have && voxels_back == voxels && back.stride == r.stride);
    }
}

TEST_MAIN
