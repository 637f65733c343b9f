/* Voxels from a stream to an archive: chunks joined, weights dropped, what is absent filled,
 * numbers of materials moved. */
#include "formats/archive/voxelpack.h"
#include "tests/unit/support.h"
#include "tests/check.h"

enum { COUNT = 1000, FACES = 2 * COUNT };

static pbs_run run = {.threads = 1};
static pbs_err err;
static const pbs_voxel_place where = {1, 1, 512, {0, 0, 0}};

/* A node of COUNT voxels in chunks of 64, each with its list of faces; two faces a voxel. */
static blob stream(uint32_t channels, bool colour) {
    char text[256];
    pbs_voxels v;
    uint32_t faces[FACES];
    pbs_voxels_text(channels, text);
    pbs_writer *w = spool_writer(&run, PBS_VOXELS, text, 0);
    must(pbs_voxels_alloc(&run, channels, COUNT, &v, &err), &err);
    for (uint32_t i = 0; i < COUNT; i++) {
        v.place[i] = pbs_unmorton8(3 * i) | 3u << 24;
        v.weight[i] = 1;
        if (v.colour) v.colour[i] = i * 77;
        v.face[i] = 2 * i;
        faces[2 * i] = i, faces[2 * i + 1] = PBS_NONE;
    }
    for (uint32_t i = 0; i < COUNT; i += 64) {
        uint32_t n = COUNT - i < 64 ? COUNT - i : 64;
        pbs_voxels some = {.count = n,
                           .place = v.place + i,
                           .weight = v.weight + i,
                           .colour = v.colour ? v.colour + i : NULL,
                           .face = v.face + i};
        must(pbs_voxels_write(w, 0, &where, &some, i, &err), &err);
        must(pbs_faces_write(w, 0, colour, faces + 2 * i, 2 * n, 2 * i, &err), &err);
    }
    pbs_voxels_free(&run, &v);
    return take_bytes(w);
}

/* The stream's node packed as node 7 of another file with those channels. */
static blob pack(blob from, uint32_t have, uint32_t want, uint32_t materials) {
    pbs_input in;
    uint32_t map[COUNT];
    for (uint32_t i = 0; i < COUNT; i++) map[i] = i + materials;
    pbs_voxel_source s = {.channels = have, .material = map, .materials = COUNT};
    pbs_voxel_survey survey;
    char text[512];
    pbs_archive_text(&(pbs_record){0}, want, text);
    open_blob(&run, from, false, &in);
    must(pbs_reader_open(&run, &in, PBS_KIND(PBS_VOXELS), &s.reader, &err), &err);
    must(pbs_reader_directory(s.reader, &s.entries, &s.end, &err), &err);
    must(pbs_voxels_survey(&s, &survey, &err), &err);
    CHECK(survey.voxels == COUNT && survey.faces == FACES && survey.place.size == 512);
    pbs_writer *w = spool_writer(&run, PBS_ARCHIVE, text,
                                 pbs_voxels_pack_chunks(&survey)); /* exactly so many */
    must(pbs_voxels_pack(&run, &s, &survey, w, 7, want, &err), &err);
    pbs_reader_close(s.reader);
    return take_bytes(w);
}

static void check_packed(blob b, uint32_t have, uint32_t want, bool colour, uint32_t materials) {
    pbs_input in;
    pbs_reader *r;
    pbs_chunk c = {0};
    pbs_voxel_place place;
    pbs_voxels v;
    bool end;
    open_blob(&run, b, false, &in);
    must(pbs_reader_open(&run, &in, PBS_KIND(PBS_ARCHIVE), &r, &err), &err);
    must(pbs_reader_next(r, &c, &end, &err), &err);
    CHECK(c.tag == PBS_TAG_VOXELS && c.node == 7 && c.count == COUNT && c.first == 0);
    must(pbs_voxels_view("f", want, &c, 0, &place, &v, &err), &err);
    CHECK(!memcmp(&place, &where, sizeof place));
    for (uint32_t i = 0; i < COUNT; i++) {
        CHECK(v.place[i] == (pbs_unmorton8(3 * i) | 3u << 24) && v.face[i] == 2 * i);
        CHECK(v.colour[i] == (have & PBS_COLOUR ? i * 77 : UINT32_MAX));
        CHECK(v.normal[i] == 0 && v.material[i] == 255 << 8 && v.emissive[i] == 0 && !v.weight);
    }
    must(pbs_reader_next(r, &c, &end, &err), &err);
    const uint32_t *id = c.payload;
    CHECK(c.tag == PBS_TAG_FACES && c.count == FACES && !!(c.flags & PBS_VFAC_COLOUR) == colour);
    for (uint32_t i = 0; i < COUNT; i++)
        CHECK(id[2 * i] == (colour ? i : i + materials) && id[2 * i + 1] == PBS_NONE);
    CHECK(pbs_reader_next(r, &c, &end, &err) == PBS_OK && end);
    pbs_reader_close(r);
}

TEST(everything_arrives) {
    const uint32_t want =
        PBS_POSITION | PBS_NORMAL | PBS_COLOUR | PBS_MATERIAL | PBS_EMISSIVE | PBS_FACE;
    for (int k = 0; k < 4; k++) {
        uint32_t have = PBS_POSITION | PBS_WEIGHT | PBS_FACE | (k & 1 ? PBS_COLOUR : 0);
        blob from = stream(have, k & 2), to = pack(from, have, want, 50);
        check_packed(to, have, want, k & 2, 50);
        free(from.bytes), free(to.bytes);
    }
    CHECK(pbs_mem_used(&run) == 0);
}

TEST(materials_are_there) {
    blob from = stream(PBS_POSITION | PBS_WEIGHT | PBS_FACE, false);
    pbs_input in;
    uint32_t map[COUNT] = {0};
    pbs_voxel_source s = {
        .channels = PBS_POSITION | PBS_WEIGHT | PBS_FACE, .material = map, .materials = COUNT - 1};
    pbs_voxel_survey survey;
    open_blob(&run, from, false, &in);
    must(pbs_reader_open(&run, &in, PBS_KIND(PBS_VOXELS), &s.reader, &err), &err);
    must(pbs_reader_directory(s.reader, &s.entries, &s.end, &err), &err);
    must(pbs_voxels_survey(&s, &survey, &err), &err);
    pbs_writer *w = spool_writer(&run, PBS_ARCHIVE, "place:u8x4 face:u32", 2);
    CHECK(pbs_voxels_pack(&run, &s, &survey, w, 7, PBS_POSITION | PBS_FACE, &err) == PBS_DATA);
    pbs_writer_close(w);
    pbs_reader_close(s.reader);
    free(from.bytes);
    CHECK(pbs_mem_used(&run) == 0);
}

TEST_MAIN
