/* The OCTV chunk: written and read back, in streams and archives, and hostile ones refused. */
#include "formats/archive/archive.h"
#include "tests/unit/support.h"
#include "tests/check.h"

static pbs_run run = {.threads = 1};
static pbs_err err;

enum { SURFELS = 300, ENTRIES = 75 + 19, CHANNELS = PBS_POSITION | PBS_SPACING | PBS_COLOUR };

typedef struct wish {
    size_t entries;          /* written, of ENTRIES */
    uint32_t chunk, node;    /* entries a chunk; of the chunks */
    bool archive, late;      /* late: behind everything */
    uint32_t channels, size; /* of the file; bytes of an entry that are written */
} wish;

static void write_entries(pbs_writer *w, const wish *a) {
    static uint8_t bytes[ENTRIES * 8];
    for (size_t i = 0; i < sizeof bytes; i++) bytes[i] = (uint8_t)(i * 7);
    for (uint32_t at = 0; at < a->entries; at += a->chunk) {
        uint32_t n = (uint32_t)a->entries - at < a->chunk ? (uint32_t)a->entries - at : a->chunk;
        pbs_chunk c = {.tag = PBS_TAG_OCTAVES, .node = a->node, .count = n, .first = at};
        pbs_piece piece = {bytes + (size_t)at * a->size, (size_t)n * a->size};
        must(pbs_writer_chunk(w, &c, &piece, 1, &err), &err);
    }
}

static blob make(const wish *a) {
    pbs_points p;
    char text[256];
    pbs_record r = pbs_record_make(a->channels, a->archive);
    pbs_lattice l = {{0, 0, 0}, 1};
    pbs_node node = {.name = "n", .records = SURFELS, .box = {{0, 0, 0}, {9, 9, 9}}};
    node.lattice = a->archive;
    pbs_record_text(&r, text);
    must(pbs_points_alloc(&run, a->channels, SURFELS, &p, &err), &err);
    memset(p.position, 0, SURFELS * 12), memset(p.spacing, 0, SURFELS * 4);
    if (p.colour) memset(p.colour, 9, SURFELS * 4);
    uint64_t front = a->archive ? 2 + pbs_points_chunks(a->entries, a->chunk) : 0;
    pbs_writer *w = spool_writer(&run, a->archive ? PBS_ARCHIVE : PBS_SURFELS, text, front);
    if (a->archive) must(pbs_node_write(&run, w, &node, &err), &err);
    if (a->archive && !a->late) write_entries(w, a);
    must(pbs_points_write(&run, w, &r, 0, &p, 0, PBS_ARCHIVE_CHUNK, &l, &err), &err);
    if (!a->archive && !a->late) write_entries(w, a);
    if (!a->archive) must(pbs_node_write(&run, w, &node, &err), &err);
    if (a->late) write_entries(w, a);
    pbs_points_free(&run, &p);
    return take_bytes(w);
}

static pbs_code check(const wish *a) {
    pbs_checked got;
    pbs_input in;
    blob b = make(a);
    open_blob(&run, b, false, &in);
    pbs_code rc = pbs_check_file(&run, &in, &got, &err);
    free(b.bytes);
    return rc;
}

static pbs_code open_archive(const wish *a, pbs_archive *out) {
    const char *tmp = getenv("TMPDIR");
    char path[600];
    snprintf(path, sizeof path, "%.500s/pbs-octaves-%d", tmp ? tmp : ".", (int)getpid());
    blob b = make(a);
    FILE *f = fopen(path, "wb");
    if (!f || fwrite(b.bytes, 1, b.size, f) != b.size || fclose(f)) exit(1);
    free(b.bytes);
    pbs_code rc = pbs_archive_open(&run, path, out, &err);
    unlink(path);
    return rc;
}

static const wish good = {.entries = ENTRIES, .chunk = 1000, .channels = CHANNELS, .size = 4};

TEST(streams_and_archives_with_and_without) {
    for (int archive = 0; archive < 2; archive++)
        for (uint32_t chunk = 1; chunk < 2000; chunk *= 10) {
            wish a = good;
            a.archive = archive, a.chunk = chunk;
            CHECK(!check(&a));
            a.entries = 0;
            CHECK(!check(&a));
        }
}

TEST(an_archive_gives_them_back) {
    for (uint32_t chunk = 7; chunk < 2000; chunk *= 20) {
        pbs_archive a;
        wish w = good;
        w.archive = true, w.chunk = chunk;
        CHECK(!open_archive(&w, &a));
        pbs_node_data d;
        CHECK(!pbs_archive_load_node(&a, 0, &d, &err) && a.octave.stride == 4 && d.octaves);
        int wrong = 0;
        for (size_t i = 0; i < 4 * ENTRIES; i++) wrong += d.octaves[i] != (uint8_t)(i * 7);
        CHECK_NUM(wrong == 0, wrong);
        pbs_node_data_free(&a, &d);
        pbs_archive_close(&a);
        w.entries = 0;
        CHECK(!open_archive(&w, &a) && !pbs_archive_has(&a, 0, PBS_SORT_OCTAVES));
        pbs_archive_close(&a);
    }
    CHECK(pbs_mem_used(&run) == 0);
}

TEST(what_does_not_fit_is_refused) {
    for (int archive = 0; archive < 2; archive++) {
        pbs_archive a;
        wish w[5];
        for (int i = 0; i < 5; i++) w[i] = good, w[i].archive = archive;
        w[0].entries = ENTRIES - 1;
        w[1].size = 8;
        w[2].node = 1;
        w[3].channels = PBS_POSITION | PBS_SPACING;
        w[4].entries = 20, w[4].chunk = 3;
        for (int i = 0; i < 5; i++) {
            CHECK_NUM(check(&w[i]) == PBS_DATA, i);
            if (archive) CHECK_NUM(open_archive(&w[i], &a) == PBS_DATA, i);
        }
    }
    wish late = good;
    late.late = true;
    CHECK(check(&late) == PBS_DATA);
    CHECK(pbs_mem_used(&run) == 0);
}

TEST_MAIN
