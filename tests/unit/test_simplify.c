/* Voxel streams with all their levels: the same bytes however the finest come, and damage. With
 * operands it writes such a stream instead of testing, for the command line's cases:
 *
 *     test_simplify ball|solid|scatter SIZE [colour] [faces] [chunks] [voxels] [tiles=N] [other]
 *
 * chunks, voxels: they come in no order. tiles=N: N^3 of them beside each other. */
#include "formats/voxels/simplify.h"
#include "tests/check.h"
#include "tests/unit/support.h"
#include "tests/unit/voxelset.h"

typedef struct stream_options {
    uint32_t channels;
    bool chunks, voxels, other, face_colour;
    uint32_t tiles;
} stream_options;

/* ---- a stream of the finest level ---- */

typedef struct stream {
    pbs_run *run;
    pbs_writer *w;
    pbs_grid grid;
    const stream_options *o;
    uint64_t seed;
    uint32_t nodes;
    pbs_child *children;
} stream;

static void write_chunk(stream *s, const cell *c, size_t n, const uint32_t shift[3]) {
    pbs_err err = {0};
    pbs_voxel_place place = {0, pbs_voxel_levels(s->grid.size), s->grid.size, {0, 0, 0}};
    uint8_t low[3] = {255, 255, 255}, high[3] = {0, 0, 0};
    cell_arrays a = arrays_of(c, n, s->o->channels);
    if (s->o->voxels) {
        /* Their lists of faces stay where they are. */
        for (size_t i = n; i > 1; i--) {
            size_t k = noise(&s->seed) % i;
            uint32_t *all[] = {a.v.place,  a.v.normal,   (uint32_t *)a.v.weight,
                               a.v.colour, a.v.material, a.v.emissive,
                               a.v.face};
            for (int j = 0; j < 7; j++) {
                if (!all[j]) continue;
                uint32_t swap = all[j][i - 1];
                all[j][i - 1] = all[j][k], all[j][k] = swap;
            }
        }
    }
    chunk_of(c, place.chunk);
    for (int k = 0; k < 3; k++) place.chunk[k] += shift[k];
    for (size_t i = 0; i < n; i++)
        for (int k = 0; k < 3; k++) {
            uint8_t v = (uint8_t)c[i].at[k];
            low[k] = v < low[k] ? v : low[k];
            high[k] = v > high[k] ? v : high[k];
        }
    must(pbs_voxels_write(s->w, s->nodes, &place, &a.v, 0, &err), &err);
    if (a.faces)
        must(pbs_faces_write(s->w, s->nodes, s->o->face_colour, a.faces, a.face_count, 0, &err),
             &err);
    pbs_node node = pbs_voxel_node(&s->grid, &place, s->nodes, n, low, high);
    must(pbs_node_write(s->run, s->w, &node, &err), &err);
    s->children = realloc(s->children, (s->nodes + 1) * sizeof *s->children);
    s->children[s->nodes] = (pbs_child){.node = s->nodes};
    memcpy(s->children[s->nodes++].m, PBS_IDENTITY, sizeof PBS_IDENTITY);
    free_arrays(&a);
}

static void write_other(stream *s, uint32_t tag, uint32_t node) {
    pbs_err err = {0};
    pbs_chunk c = {.tag = tag, .node = node, .count = 1};
    pbs_piece piece = {"what it says", 12};
    must(pbs_writer_chunk(s->w, &c, &piece, 1, &err), &err);
}

/* Chunks of one tile, in Morton order or not. */
static void write_tile(stream *s, const cells *c, const uint32_t shift[3]) {
    size_t first[4096], n = 0, end;
    for (size_t i = 0; i < c->count; i = end) first[n++] = i, end = chunk_end(c, i);
    first[n] = c->count;
    for (size_t i = 0; i < n; i++) {
        size_t k = s->o->chunks ? n - 1 - i : i;
        write_chunk(s, c->cell + first[k], first[k + 1] - first[k], shift);
    }
}

static void write_stream(pbs_run *run, pbs_writer *w, const cells *c, const stream_options *o) {
    pbs_err err = {0};
    uint32_t tiles = o->tiles ? o->tiles : 1, chunks = (c->size + 255) / 256, side = 1;
    while (side < chunks) side *= 2;
    stream s = {.run = run, .w = w, .o = o, .seed = 5};
    s.grid = (pbs_grid){{-3, 5, 0.25}, 0.125, tiles > 1 ? tiles * side * 256 : c->size};
    if (o->other) {
        write_other(&s, PBS_TAG_MATERIAL, 0);
        write_other(&s, PBS_TAG('W', 'h', 'o', '?'), PBS_NONE);
    }
    for (uint32_t t = 0; t < tiles * tiles * tiles; t++) {
        uint32_t p = pbs_unmorton8(t);
        uint32_t shift[3] = {(p & 255) * side, (p >> 8 & 255) * side, (p >> 16 & 255) * side};
        write_tile(&s, c, shift);
    }
    pbs_node root = {.id = s.nodes,
                     .name = "whole",
                     .box = {{-3, 5, 0.25}, {1000, 1000, 1000}},
                     .triangles = 12345,
                     .child_count = s.nodes,
                     .children = s.children};
    must(pbs_node_write(run, w, &root, &err), &err);
    free(s.children);
}

static pbs_writer *voxel_writer(pbs_run *run, uint32_t channels) {
    char text[256];
    pbs_voxels_text(channels, text);
    return spool_writer(run, PBS_VOXELS, text, 0);
}

static blob stream_of(const cells *c, const stream_options *o) {
    pbs_run run = {.threads = 1};
    pbs_writer *w = voxel_writer(&run, o->channels);
    write_stream(&run, w, c, o);
    return take_bytes(w);
}

/* ---- all levels of it ---- */

static pbs_code simplified(blob b, bool piped, const pbs_levels_params *params, blob *out,
                           pbs_simplified *stats, pbs_err *err) {
    pbs_run run = {.threads = 1};
    pbs_input in;
    pbs_reader *r;
    pbs_writer *w = NULL;
    memset(out, 0, sizeof *out);
    open_blob(&run, b, piped, &in);
    pbs_code rc = pbs_reader_open(&run, &in, PBS_KIND(PBS_VOXELS), &r, err);
    uint32_t channels;
    if (!rc && !pbs_voxels_parse("f", pbs_reader_channels(r), &channels, err)) {
        w = voxel_writer(&run, channels);
        rc = pbs_simplify(&run, r, w, params, stats, err);
        if (!rc)
            *out = take_bytes(w);
        else
            pbs_writer_close(w);
    } else
        rc = PBS_DATA;
    pbs_reader_close(r);
    CHECK_NUM(run.mem_used == 0, run.mem_used);
    return rc;
}

static blob simplify(blob b, bool piped, uint64_t least, uint32_t levels) {
    pbs_err err = {0};
    pbs_simplified s;
    pbs_levels_params p = {least, levels};
    blob out;
    if (simplified(b, piped, &p, &out, &s, &err)) printf("# %s\n", err.text);
    CHECK(!err.code);
    return out;
}

static bool same_bytes(blob a, blob b) {
    return a.size == b.size && a.size && !memcmp(a.bytes, b.bytes, a.size);
}

enum { COLOURED = PBS_POSITION | PBS_NORMAL | PBS_WEIGHT | PBS_COLOUR };

TEST(however_the_finest_come_the_bytes_are_the_same) {
    cells c = shell(300, 140, 1);
    for (int faces = 0; faces < 2; faces++) {
        stream_options plain = {.channels = COLOURED | (faces ? PBS_FACE : 0), .other = true};
        blob in = stream_of(&c, &plain), want = simplify(in, false, 1000, 31);
        for (int how = 1; how < 8; how++) {
            stream_options o = plain;
            o.chunks = how & 1, o.voxels = how & 2;
            bool again = how & 4;
            blob other = stream_of(&c, &o), got = simplify(other, false, 1000, 31);
            CHECK(same_bytes(in, other) == !(how & 3));
            CHECK(same_bytes(want, got));
            if (again) {
                blob twice = simplify(got, false, 1000, 31);
                CHECK(same_bytes(want, twice));
                free(twice.bytes);
            }
            free(other.bytes), free(got.bytes);
        }
        free(in.bytes), free(want.bytes);
    }
    free(c.cell);
}

TEST(a_pipe_is_read_once_and_in_order) {
    cells c = scatter(600, 10000, 1);
    stream_options plain = {.channels = COLOURED}, mixed = {.channels = COLOURED, .chunks = true};
    blob in = stream_of(&c, &plain), want = simplify(in, false, 1000, 31),
         got = simplify(in, true, 1000, 31), other = stream_of(&c, &mixed), none;
    CHECK(same_bytes(want, got));
    pbs_err err = {0};
    pbs_simplified s;
    pbs_levels_params p = {1000, 31};
    CHECK(simplified(other, true, &p, &none, &s, &err) == PBS_DATA);
    CHECK(strstr(err.text, "as an operand"));
    free(in.bytes), free(want.bytes), free(got.bytes), free(other.bytes);
    free(c.cell);
}

/* ---- what is in it ---- */

typedef struct seen {
    pbs_node node[2000];
    pbs_voxel_place place[2000];
    size_t nodes;
    uint64_t voxels[20];
    bool good;
} seen;

static void look(blob b, seen *s) {
    pbs_run run = {.threads = 1};
    pbs_input in;
    pbs_reader *r;
    pbs_err err = {0};
    uint32_t channels = 0;
    memset(s, 0, sizeof *s);
    s->good = true;
    open_blob(&run, b, false, &in);
    must(pbs_reader_open(&run, &in, PBS_KIND(PBS_VOXELS), &r, &err), &err);
    must(pbs_voxels_parse("f", pbs_reader_channels(r), &channels, &err), &err);
    uint64_t have = 0;
    int64_t last = -1;
    for (bool end = false;;) {
        pbs_chunk c;
        pbs_voxels v;
        must(pbs_reader_next(r, &c, &end, &err), &err);
        if (end) break;
        if (c.tag == PBS_TAG_VOXELS) {
            must(pbs_voxels_view("f", channels, &c, have, &s->place[s->nodes], &v, &err), &err);
            const char *fault = pbs_voxels_fault(&s->place[s->nodes], &v, &last);
            if (fault) printf("# %s\n", fault);
            s->good = s->good && !fault && c.node == s->nodes;
            have += c.count;
            s->voxels[s->place[s->nodes].level] += c.count;
        } else if (c.tag == PBS_TAG_NODE) {
            pbs_node *n = &s->node[s->nodes];
            must(pbs_node_read(&run, "f", &c, (uint32_t)s->nodes, n, &err), &err);
            s->good = s->good && n->records == have;
            have = 0, last = -1, s->nodes++;
        }
    }
    pbs_reader_close(r);
}

static void forget(seen *s) {
    pbs_run run = {.threads = 1};
    for (size_t i = 0; i < s->nodes; i++) pbs_node_free(&run, &s->node[i]);
}

TEST(children_come_first_and_lie_inside) {
    cells c = shell(1100, 150, 1);
    stream_options o = {.channels = PBS_POSITION | PBS_NORMAL};
    blob in = stream_of(&c, &o), out = simplify(in, false, 1500, 31);
    static seen s;
    uint8_t used[2000] = {0};
    look(out, &s);
    CHECK(s.good);
    const pbs_node *root = &s.node[s.nodes - 1];
    CHECK(!strcmp(root->name, "whole") && root->triangles == 12345);
    CHECK_NUM(root->records && root->records <= 1500, root->records);
    for (size_t i = 0; i < s.nodes; i++) {
        const pbs_node *n = &s.node[i];
        CHECK_NUM(n->child_count <= 8, n->child_count);
        for (uint32_t k = 0; k < n->child_count; k++) {
            uint32_t id = n->children[k].node;
            const pbs_node *below = &s.node[id];
            used[id]++;
            CHECK(s.place[i].level == s.place[id].level + 1);
            CHECK(n->lattice == 2 * below->lattice);
            for (int a = 0; a < 3; a++) {
                CHECK(s.place[i].chunk[a] == s.place[id].chunk[a] / 2);
                CHECK(n->box.min[a] <= below->box.min[a] && n->box.max[a] >= below->box.max[a]);
                double at = (n->origin[a] + 3) / (256 * n->lattice);
                if (a == 0) CHECK_NUM(fabs(at - s.place[i].chunk[a]) < 1e-9, at);
            }
        }
    }
    for (size_t i = 0; i + 1 < s.nodes; i++) CHECK_NUM(used[i] == 1, i);
    CHECK(s.voxels[0] == c.count);
    forget(&s);
    free(in.bytes), free(out.bytes), free(c.cell);
}

TEST(levels_end_where_they_are_told_to) {
    cells c = shell(700, 340, 1), small = shell(100, 40, 1), none = {.size = 10};
    stream_options o = {.channels = PBS_POSITION | PBS_NORMAL};
    static seen s;
    const struct {
        const cells *c;
        uint64_t least;
        uint32_t levels, want, tops; /* levels with voxels, children of a root without */
    } row[] = {{&c, 1, 31, 11, 0},         {&c, 1u << 31, 31, 3, 0}, {&c, 1u << 31, 1, 2, 8},
               {&c, 1, 0, 1, 26},          {&c, 1, 2, 3, 0},         {&small, 1u << 31, 31, 1, 1},
               {&small, 1, 31, 8, 0},      {&small, 1, 3, 4, 0},     {&none, 1, 31, 0, 0},
               {&small, 1u << 31, 0, 1, 1}};
    for (size_t i = 0; i < sizeof row / sizeof *row; i++) {
        blob in = stream_of(row[i].c, &o), out = simplify(in, false, row[i].least, row[i].levels);
        look(out, &s);
        uint32_t levels = 0;
        for (int l = 0; l < 20; l++) levels += s.voxels[l] > 0;
        CHECK_NUM(levels == row[i].want, levels);
        const pbs_node *root = &s.node[s.nodes - 1];
        CHECK(s.good && !strcmp(root->name, "whole"));
        if (root->records)
            CHECK_NUM(!row[i].tops, i);
        else
            CHECK_NUM(root->child_count == row[i].tops, root->child_count);
        forget(&s);
        free(in.bytes), free(out.bytes);
    }
    free(c.cell), free(small.cell);
}

/* ---- damage ---- */

TEST(no_damage_that_passes_the_checksums_crashes) {
    cells c = scatter(300, 60, 1);
    for (int faces = 0; faces < 2; faces++) {
        stream_options o = {.channels = COLOURED | (faces ? PBS_FACE : 0), .other = true};
        blob in = stream_of(&c, &o);
        uint64_t seed = 9;
        int refused = 0;
        for (int round = 0; round < 1000; round++) {
            blob b = copy_blob(in), out;
            pbs_err err = {0};
            pbs_simplified s;
            pbs_levels_params p = {1 + noise(&seed) % 100, noise(&seed) % 32};
            size_t at = noise(&seed) % b.size;
            b.bytes[at] ^= (uint8_t)(1u << noise(&seed) % 8);
            if (round % 4 == 0) b.bytes[noise(&seed) % b.size] = (uint8_t)noise(&seed);
            reseal(b);
            pbs_code rc = simplified(b, false, &p, &out, &s, &err);
            CHECK_NUM(!rc || rc == PBS_DATA, rc);
            refused += rc == PBS_DATA;
            free(b.bytes), free(out.bytes);
        }
        CHECK_NUM(refused > 150, refused);
        free(in.bytes);
    }
    free(c.cell);
}

static void one_wrong(const char *what, uint32_t size, const cell *two) {
    cells c = {(cell *)two, 2, 2, size};
    stream_options o = {.channels = COLOURED};
    blob in = stream_of(&c, &o), out;
    pbs_err err = {0};
    pbs_simplified s;
    pbs_levels_params p = {1, 31};
    CHECK(simplified(in, false, &p, &out, &s, &err) == PBS_DATA);
    if (!strstr(err.text, what)) printf("# %s\n", err.text);
    CHECK(strstr(err.text, what));
    free(in.bytes);
}

TEST(voxels_that_cannot_be_are_refused) {
    cells c = {.size = 20};
    add_cell(&c, 1, 1, 1), add_cell(&c, 2, 1, 1);
    cell *v = &c.cell[1];
    v->weight = -1, one_wrong("a weight that is no area", 20, c.cell);
    v->weight = NAN, one_wrong("a weight that is no area", 20, c.cell);
    v->weight = INFINITY, one_wrong("a weight that is no area", 20, c.cell);
    v->weight = 1, v->mask = 128, one_wrong("faces that there are none of", 20, c.cell);
    v->mask = 0, v->at[0] = 20, one_wrong("a cell outside the grid", 20, c.cell);
    v->at[0] = 1, one_wrong("a cell comes twice", 20, c.cell);
    free(c.cell);
}

/* Two nodes of one voxel each, in the chunk at x. */
static void refuses_chunks(const char *what, bool lists_first, const uint32_t size[2],
                           const uint32_t x[2]) {
    pbs_run run = {.threads = 1};
    pbs_err err = {0};
    pbs_writer *w = voxel_writer(&run, PBS_POSITION | PBS_FACE);
    for (uint32_t i = 0; i < 2; i++) {
        uint32_t at = PBS_PLACE(10 + i, 10, 10, PBS_FACE_X0), zero = 0, list = 7;
        pbs_voxel_place place = {0, pbs_voxel_levels(size[i]), size[i], {x[i], 0, 0}};
        pbs_voxels v = {.count = 1, .place = &at, .face = &zero};
        const uint8_t corner[3] = {(uint8_t)(10 + i), 10, 10};
        pbs_grid grid = {{0, 0, 0}, 1, size[i]};
        pbs_node node = pbs_voxel_node(&grid, &place, i, 1, corner, corner);
        if (lists_first) must(pbs_faces_write(w, i, false, &list, 1, 0, &err), &err);
        must(pbs_voxels_write(w, i, &place, &v, 0, &err), &err);
        if (!lists_first) must(pbs_faces_write(w, i, false, &list, 1, 0, &err), &err);
        must(pbs_node_write(&run, w, &node, &err), &err);
    }
    blob in = take_bytes(w), out;
    pbs_simplified s;
    pbs_levels_params p = {1, 31};
    CHECK(simplified(in, true, &p, &out, &s, &err) == PBS_DATA);
    if (!strstr(err.text, what)) printf("# %s\n", err.text);
    CHECK(strstr(err.text, what));
    free(in.bytes), free(out.bytes);
}

TEST(chunks_are_checked_whether_voxels_or_lists_of_faces_come_first) {
    for (int first = 0; first < 2; first++) {
        refuses_chunks("another grid", first, (uint32_t[]){512, 1024}, (uint32_t[]){0, 3});
        refuses_chunks("comes twice", first, (uint32_t[]){512, 512}, (uint32_t[]){1, 1});
        refuses_chunks("Morton order", first, (uint32_t[]){512, 512}, (uint32_t[]){1, 0});
    }
}

/* Sums of weights overflow; what is written is still a weight. */
TEST(the_heaviest_weights_give_files_that_are_fine) {
    cells c = {.size = 512};
    for (uint32_t i = 0; i < 8; i++) {
        cell *v = add_cell(&c, i & 1, i >> 1 & 1, i >> 2);
        v->weight = 3e38f, v->mask = PBS_FACES_ALL;
    }
    stream_options o = {.channels = COLOURED};
    blob in = stream_of(&c, &o), out = simplify(in, false, 1, 1);
    pbs_run run = {.threads = 1};
    pbs_input input;
    pbs_checked checked;
    pbs_err err = {0};
    open_blob(&run, out, false, &input);
    CHECK(!pbs_check_file(&run, &input, &checked, &err));
    if (err.code) printf("# %s\n", err.text);
    free(in.bytes), free(out.bytes), free(c.cell);
}

/* ---- streams for the command line ---- */

static cells solid(uint32_t size) {
    cells c = {.size = size};
    uint64_t seed = 1;
    for (uint32_t z = 0; z < size; z++)
        for (uint32_t y = 0; y < size; y++)
            for (uint32_t x = 0; x < size; x++) {
                float n[3] = {(float)x - 100, (float)y - 90, (float)z - 80};
                fill_cell(add_cell(&c, x, y, z), n, &seed);
            }
    sort_cells(&c);
    return c;
}

static int write_to_stdout(int argc, char **argv) {
    uint32_t size = (uint32_t)atoi(argv[2]);
    stream_options o = {.channels = PBS_POSITION | PBS_NORMAL | PBS_WEIGHT};
    for (int i = 3; i < argc; i++) {
        if (!strcmp(argv[i], "colour")) o.channels |= PBS_COLOUR;
        if (!strcmp(argv[i], "faces")) o.channels |= PBS_FACE;
        if (!strcmp(argv[i], "chunks")) o.chunks = true;
        if (!strcmp(argv[i], "voxels")) o.voxels = true;
        if (!strcmp(argv[i], "other")) o.other = true;
        if (!strncmp(argv[i], "tiles=", 6)) o.tiles = (uint32_t)atoi(argv[i] + 6);
    }
    cells c = !strcmp(argv[1], "solid")     ? solid(size)
              : !strcmp(argv[1], "scatter") ? scatter(size, 10000, 1)
                                            : shell(size, size * 0.49, 1);
    pbs_run run = {.threads = 1};
    pbs_err err = {0};
    pbs_writer *w;
    char text[256];
    pbs_voxels_text(o.channels, text);
    pbs_writer_desc d = {.kind = PBS_VOXELS, .channels = text, .stage = "test_simplify"};
    must(pbs_writer_open(&run, &d, &w, &err), &err);
    write_stream(&run, w, &c, &o);
    must(pbs_writer_commit(w, &err), &err);
    pbs_writer_close(w);
    free(c.cell);
    return 0;
}

static int run_tests(void);
int main(int argc, char **argv) {
    return argc > 2 ? write_to_stdout(argc, argv) : run_tests();
}
#define main run_tests
TEST_MAIN
#undef main
