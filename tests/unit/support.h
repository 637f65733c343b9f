/* support.h: small valid files of every kind, made with the writers' own functions; the same bytes
 * given to a reader as a map and as a pipe; and a repair of all checksums, so that damage gets past
 * them to the code behind. Used by the unit tests of formats and by tests/fuzz. */
#ifndef PBS_SUPPORT_H
#define PBS_SUPPORT_H

#include "formats/archive/check.h"
#include "formats/container/layout.h"
#include "formats/readers/module.h"
#include "formats/scene/node.h"
#include "formats/surfels/points.h"
#include "formats/scene/scene.h"
#include "formats/container/wire.h"
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

typedef struct blob {
    uint8_t *bytes; /* malloc'ed */
    size_t size;
} blob;

/* For steps that a test only prepares with. */
static inline void must(pbs_code rc, const pbs_err *err) {
    if (!rc) return;
    printf("# %s\nnot ok preparation\n", err->text);
    exit(1);
}

static inline uint32_t random_bits(uint64_t *state) {
    *state = *state * 6364136223846793005u + 1442695040888963407u;
    return (uint32_t)(*state >> 32);
}

/* Not inline: gcc 12 sees sizes that cannot be and warns. */
static __attribute__((noinline, unused)) blob copy_blob(blob b) {
    blob c = {malloc(b.size + 1), b.size};
    memcpy(c.bytes, b.bytes, b.size);
    return c;
}

#include "tests/unit/voxels.h"

/* ---- writing ---- */

static inline pbs_writer *coded_writer(pbs_run *run, pbs_kind kind, const char *channels,
                                       uint64_t front, pbs_codec codec) {
    pbs_output spool;
    pbs_err err = {0};
    pbs_writer *w;
    pbs_writer_desc d = {.output = &spool,
                         .kind = kind,
                         .channels = channels,
                         .history = "stage a test\n",
                         .stage = "test",
                         .front = front,
                         .codec = codec};
    must(pbs_output_spool(run, &spool, &err), &err);
    must(pbs_writer_open(run, &d, &w, &err), &err);
    return w;
}

static inline pbs_writer *spool_writer(pbs_run *run, pbs_kind kind, const char *channels,
                                       uint64_t front) {
    return coded_writer(run, kind, channels, front, PBS_CODEC_NONE);
}

/* Finishes the file and gives its bytes; the writer is closed. */
static inline blob take_bytes(pbs_writer *w) {
    pbs_input in;
    pbs_err err = {0};
    must(pbs_writer_reopen(w, &in, &err), &err);
    blob b = {malloc((size_t)in.size + 1), (size_t)in.size};
    memcpy(b.bytes, in.bytes, b.size);
    pbs_input_close(&in);
    pbs_writer_close(w);
    return b;
}

static inline void fill_points(pbs_run *run, uint32_t channels, size_t n, uint64_t seed,
                               pbs_points *p) {
    pbs_err err = {0};
    must(pbs_points_alloc(run, channels, n, p, &err), &err);
    for (size_t i = 0; i < n; i++) {
        for (int k = 0; k < 3; k++)
            p->position[3 * i + k] = (float)((int)(random_bits(&seed) >> 8) - (1 << 23)) / 1e6f;
        if (p->spacing) p->spacing[i] = (float)(random_bits(&seed) >> 8) / 1e6f;
        uint32_t v[4];
        for (int k = 0; k < 4; k++) v[k] = random_bits(&seed);
        if (p->normal) memcpy(p->normal + 2 * i, &v[0], 4);
        if (p->colour) memcpy(p->colour + 4 * i, &v[1], 4);
        if (p->material) memcpy(p->material + 4 * i, &v[2], 4);
        if (p->emissive) memcpy(p->emissive + 4 * i, &v[3], 4);
    }
}

static inline pbs_node small_node(uint32_t id, uint64_t records, pbs_child *child) {
    pbs_node n = {.id = id,
                  .name = id ? "assembly" : "part",
                  .origin = {1, 2, 3},
                  .box = {{-8, -8, -8}, {9, 9, 9}},
                  .triangles = 5000,
                  .records = records,
                  .pixel = 0.25,
                  .covering = 0.5,
                  .median = 1,
                  .median_count = 10};
    if (child) {
        *child = (pbs_child){.node = id - 1, .name = "placed", .flags = PBS_CHILD_MOVES};
        memcpy(child->m, PBS_IDENTITY, sizeof child->m);
        n.children = child;
        n.child_count = 1;
    }
    return n;
}

/* A turn along a spline in an animation, steps in another. */
static inline const pbs_motion *small_motion(void) {
    static const double time[3] = {0, 1, 2.5};
    static const double value[24] = {0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1};
    static const pbs_motion_channel channels[2] = {
        {0, PBS_MOTION_ROTATION, PBS_MOTION_CUBIC, 2, time, value},
        {1, PBS_MOTION_SCALE, PBS_MOTION_STEP, 3, time, value + 8}};
    static const pbs_motion motion = {{{0, 0, 0}, {0, 0, 0, 1}, {1, 1, 1}}, 2, channels};
    return &motion;
}

/* Two nodes with points each, as a stream; several chunks a node. */
static inline blob small_stream(pbs_run *run, pbs_kind kind, uint32_t channels) {
    pbs_record r = pbs_record_make(channels, false);
    char text[256];
    pbs_err err = {0};
    pbs_record_text(&r, text);
    pbs_writer *w = spool_writer(run, kind, text, 0);
    for (uint32_t id = 0; id < 2; id++) {
        pbs_points p;
        pbs_child child;
        fill_points(run, channels, 7 + id, id + 1, &p);
        pbs_node n = small_node(id, p.count, id ? &child : NULL);
        must(pbs_points_write(run, w, &r, id, &p, 0, 5, NULL, &err), &err);
        must(pbs_node_write(run, w, &n, &err), &err);
        pbs_points_free(run, &p);
    }
    return take_bytes(w);
}

static inline blob small_archive(pbs_run *run, uint32_t channels) {
    pbs_record r = pbs_record_make(channels | PBS_POSITION | PBS_SPACING, true);
    char text[256];
    pbs_err err = {0};
    pbs_points p[2];
    pbs_lattice l[2];
    pbs_record_text(&r, text);
    pbs_writer *w = spool_writer(run, PBS_ARCHIVE, text, 2 + 3 + 1 + 2);
    for (uint32_t id = 0; id < 2; id++) {
        pbs_child child;
        fill_points(run, r.channels, 4 + 2 * id, id + 9, &p[id]);
        pbs_node n = small_node(id, p[id].count, id ? &child : NULL);
        l[id] = pbs_lattice_of(p[id].position, p[id].count);
        memcpy(n.lattice_min, l[id].min, sizeof n.lattice_min);
        n.lattice = l[id].step;
        child.motion = 1;
        must(pbs_node_write(run, w, &n, &err), &err);
    }
    must(pbs_animation_write(w, 0, "turn", &err), &err);
    must(pbs_animation_write(w, 1, NULL, &err), &err);
    must(pbs_motion_write(run, w, 0, small_motion(), &err), &err);
    for (uint32_t id = 0; id < 2; id++) {
        must(pbs_points_write(run, w, &r, id, &p[id], 0, id ? 4 : 100, &l[id], &err), &err);
        pbs_points_free(run, &p[id]);
    }
    return take_bytes(w);
}

static inline void put_quad(const pbs_sink *s, double size, uint32_t m0, uint32_t m1) {
    pbs_err err = {0};
    pbs_corner c[4];
    memset(c, 0, sizeof c);
    for (int i = 0; i < 4; i++) {
        c[i].position[0] = (i & 1) * size, c[i].position[1] = (i >> 1) * size;
        c[i].normal[2] = 1;
        c[i].uv[0] = (float)(i & 1), c[i].uv[1] = (float)(i >> 1);
        memset(c[i].colour, 50 * i, 4);
    }
    must(s->triangle(s->ctx, (pbs_corner[3]){c[0], c[1], c[2]}, m0, &err), &err);
    must(s->triangle(s->ctx, (pbs_corner[3]){c[1], c[3], c[2]}, m1, &err), &err);
}

/* Two parts with all attributes, a material with a texture, and an assembly of three placings, one
 * of which moves. */
static inline blob small_scene(pbs_run *run) {
    pbs_writer *w = spool_writer(run, PBS_SCENE, NULL, 0);
    pbs_scene_writer *sw;
    pbs_err err = {0};
    must(pbs_scene_writer_new(run, w, NULL, &sw, &err), &err);
    const pbs_sink *s = pbs_scene_sink(sw);
    uint32_t texture, material, animation, node[3];
    pbs_material m = PBS_MATERIAL_DEFAULT;
    must(s->texture(s->ctx, "t.png", "not a picture", 13, &texture, &err), &err);
    m.name = "red", m.base[1] = m.base[2] = 0;
    m.base_texture.texture = texture, m.base_texture.wrap_u = 2;
    must(s->material(s->ctx, &m, &material, &err), &err);
    for (int i = 0; i < 2; i++) {
        const double origin[3] = {i, 0, 0};
        must(s->part_begin(s->ctx, i ? "b" : "a", origin, i ? 0 : 7, &err), &err);
        put_quad(s, i + 1, material, i ? PBS_NONE : material);
        must(s->part_end(s->ctx, &node[i], &err), &err);
    }
    pbs_child child[3] = {{.node = node[0], .name = "left"}, {.node = node[1]}, {.node = node[0]}};
    must(s->animation(s->ctx, "turn", &animation, &err), &err);
    must(s->animation(s->ctx, "", &animation, &err), &err);
    must(s->motion(s->ctx, small_motion(), &child[1].motion, &err), &err);
    child[1].flags = PBS_CHILD_MOVES;
    for (int i = 0; i < 3; i++)
        memcpy(child[i].m, PBS_IDENTITY, sizeof child[i].m), child[i].m[7] = i;
    must(s->assembly(s->ctx, "all", child, 3, &node[2], &err), &err);
    must(s->root(s->ctx, node[2], &err), &err);
    s->skip(s->ctx, PBS_SKIP_LINES, 3);
    must(pbs_scene_writer_end(sw, &err), &err);
    pbs_scene_writer_free(sw);
    return take_bytes(w);
}

/* Chunk number i of a file of chunks that no program knows. */
static inline pbs_chunk chunk_number(uint64_t i, uint8_t payload[200], size_t *n) {
    uint64_t seed = i;
    *n = random_bits(&seed) % 5 ? random_bits(&seed) % 200 : 64 * (i % 2);
    for (size_t k = 0; k < *n; k++) payload[k] = (uint8_t)random_bits(&seed);
    return (pbs_chunk){.tag = PBS_TAG('T', 'e', 's', '0' + i % 10),
                       .flags = (uint32_t)(i * 256),
                       .node = (uint32_t)(i * 3),
                       .count = random_bits(&seed),
                       .first = random_bits(&seed)};
}

static inline void write_chunks(pbs_writer *w, uint64_t from, uint64_t n) {
    uint8_t payload[200];
    pbs_err err = {0};
    for (uint64_t i = from; i < n; i++) {
        size_t size;
        pbs_chunk c = chunk_number(i, payload, &size);
        pbs_piece piece[3] = {
            {payload, size / 3}, {NULL, 0}, {payload + size / 3, size - size / 3}};
        must(pbs_writer_chunk(w, &c, piece, 3, &err), &err);
    }
}

static inline blob chunks_file(pbs_run *run, uint64_t n, bool front) {
    pbs_writer *w = spool_writer(run, PBS_SCENE, "some:u8", front ? n : 0);
    write_chunks(w, 0, n);
    return take_bytes(w);
}

/* Writes the model whole. */
static inline blob vox_file(pbs_run *run, const vox_model *m, uint32_t channels, bool archive) {
    char text[512];
    uint64_t chunks = m->nodes + 1;
    pbs_archive_text(&(pbs_record){0}, channels, text);
    for (uint32_t i = 0; i < m->nodes; i++) chunks += vox_data_chunks(m, i, channels);
    pbs_writer *w = spool_writer(run, archive ? PBS_ARCHIVE : PBS_VOXELS, text, archive * chunks);
    vox_write(run, m, channels, archive, w);
    return take_bytes(w);
}

static inline blob small_voxels(pbs_run *run, uint32_t channels, bool archive) {
    vox_model m;
    vox_small(&m);
    blob b = vox_file(run, &m, channels, archive);
    vox_free(&m);
    return b;
}

#include "tests/unit/mixed.h"

enum {
    SMALL_SCENE,
    SMALL_CANDIDATES,
    SMALL_SURFELS,
    SMALL_ARCHIVE,
    SMALL_VOXELS,
    SMALL_VOXEL_ARCHIVE,
    SMALL_MIXED,
    SMALL_KINDS
};
static inline blob small_file(pbs_run *run, int which) {
    const uint32_t some = PBS_POSITION | PBS_NORMAL | PBS_COLOUR;
    switch (which) {
    case SMALL_SCENE:
        return small_scene(run);
    case SMALL_CANDIDATES:
        return small_stream(run, PBS_CANDIDATES, some | PBS_EMISSIVE);
    case SMALL_SURFELS:
        return small_stream(run, PBS_SURFELS, some | PBS_SPACING | PBS_MATERIAL);
    case SMALL_MIXED:
        return small_mixed(run, PBS_CODEC_NONE);
    case SMALL_VOXELS:
        return small_voxels(run, PBS_POSITION | PBS_NORMAL | PBS_WEIGHT | PBS_COLOUR | PBS_FACE,
                            false);
    case SMALL_VOXEL_ARCHIVE:
        return small_voxels(run, PBS_POSITION | PBS_NORMAL | PBS_MATERIAL | PBS_EMISSIVE, true);
    default:
        return small_archive(run, some);
    }
}

/* ---- reading ---- */

static inline void open_mapped(pbs_run *run, blob b, pbs_input *in) {
    pbs_err err = {0};
    char path[40];
    int fd = memfd_create("small", MFD_CLOEXEC);
    snprintf(path, sizeof path, "/proc/self/fd/%d", fd);
    if (fd < 0 || write(fd, b.bytes, b.size) != (ssize_t)b.size) abort();
    must(pbs_input_open(run, path, in, &err), &err);
    close(fd);
}

/* At most 1 MiB, which a pipe holds by itself. */
static inline void open_piped(pbs_run *run, blob b, pbs_input *in) {
    pbs_err err = {0};
    char path[40];
    int fd[2];
    if (pipe2(fd, O_CLOEXEC)) abort();
    if (b.size > 65536) fcntl(fd[1], F_SETPIPE_SZ, 1 << 20);
    if (write(fd[1], b.bytes, b.size) != (ssize_t)b.size) abort();
    close(fd[1]);
    snprintf(path, sizeof path, "/proc/self/fd/%d", fd[0]);
    must(pbs_input_open(run, path, in, &err), &err);
    close(fd[0]);
}

static inline void open_blob(pbs_run *run, blob b, bool piped, pbs_input *in) {
    if (piped)
        open_piped(run, b, in);
    else
        open_mapped(run, b, in);
}

static inline pbs_code check_blob(pbs_run *run, blob b, bool piped, pbs_err *err) {
    pbs_input in;
    pbs_checked found;
    open_blob(run, b, piped, &in);
    return pbs_check_file(run, &in, &found, err);
}

/* The same as a map, but in memory that ends where the file ends, so that a sanitizer sees a read
 * behind it, and without the system calls, of which tests with every bit make many. The reader's
 * munmap fails because the bytes do not begin at a page. */
static inline pbs_code check_guarded(pbs_run *run, blob b, pbs_err *err) {
    void *block = NULL;
    uint8_t *bytes;
    for (size_t front = 64;; front += 64) {
        if (posix_memalign(&block, 64, front + b.size)) abort();
        bytes = (uint8_t *)block + front;
        if ((uintptr_t)bytes % 4096) break;
        free(block);
    }
    pbs_input in = {
        .fd = -1, .mapped = true, .bytes = bytes, .size = b.size, .name = "f", .run = run};
    pbs_checked found;
    memcpy(bytes, b.bytes, b.size);
    if (!b.size) in.bytes = NULL;
    pbs_code rc = pbs_check_file(run, &in, &found, err);
    free(block);
    return rc;
}

/* ---- repairing ---- */

static inline void reseal_header(blob b) {
    uint32_t n = b.size < HEADER_FIXED ? 0 : pbs_get_u32(b.bytes + HEADER_BYTES_AT);
    if (n < HEADER_FIXED || n > b.size) return;
    pbs_put_u32(b.bytes + HEADER_CRC_AT, 0);
    pbs_put_u32(b.bytes + HEADER_CRC_AT, pbs_crc32c(0, b.bytes, n));
}

typedef struct resealed {
    uint64_t chunks, pages, dir_at, dir_end, at;
    uint32_t chain;
    uint8_t entry[256 * ENTRY_SIZE]; /* of the first 256 chunks */
} resealed;

static inline void reseal_chunk(uint8_t *h, uint64_t bytes, uint64_t sequence) {
    pbs_put_u32(h + CHUNK_SEQUENCE_AT, (uint32_t)sequence);
    memset(h + CHUNK_FIXED + bytes, 0, (size_t)pbs_padding(bytes, PBS_ALIGN));
    pbs_put_u32(h + CHUNK_CRC_AT, pbs_crc32c(0, h + CHUNK_FIXED, (size_t)bytes));
    pbs_put_u32(h + CHUNK_SELF_AT, pbs_crc32c(0, h, CHUNK_SELF_AT));
}

/* One pass over the chunks; the second one finds the entries of the first for its pages. */
static inline void reseal_pass(blob b, resealed *r) {
    uint64_t known = r->chunks, page_entry = 0;
    r->chunks = r->pages = r->chain = 0;
    for (r->at = pbs_get_u32(b.bytes + HEADER_BYTES_AT); r->at + CHUNK_FIXED <= b.size;) {
        uint8_t *h = b.bytes + r->at, *e = r->entry + r->chunks * ENTRY_SIZE;
        if (!memcmp(h + FOOTER_MAGIC_AT, PBS_END, 8)) break;
        uint64_t bytes = pbs_get_u64(h + CHUNK_BYTES_AT), left = b.size - r->at - CHUNK_FIXED;
        if (bytes > left || bytes + pbs_padding(bytes, PBS_ALIGN) > left) break;
        bool page = pbs_get_u32(h + CHUNK_TAG_AT) == PBS_TAG_DIR;
        if (page && bytes >= PAGE_FIXED) {
            uint64_t n = (bytes - PAGE_FIXED) / ENTRY_SIZE;
            if (!r->pages) r->dir_at = r->at;
            pbs_put_u64(h + CHUNK_FIXED + 8, known);
            for (uint64_t i = 0; i < n && page_entry < known && page_entry < 256; i++, page_entry++)
                memcpy(h + CHUNK_FIXED + PAGE_FIXED + i * ENTRY_SIZE,
                       r->entry + page_entry * ENTRY_SIZE, ENTRY_SIZE);
        }
        reseal_chunk(h, bytes, page ? r->pages++ : r->chunks);
        uint64_t offset = r->at;
        r->at += CHUNK_FIXED + bytes + pbs_padding(bytes, PBS_ALIGN);
        if (page) {
            r->dir_end = r->at;
            continue;
        }
        r->chain = pbs_crc32c(r->chain, h, CHUNK_SELF_AT);
        if (r->chunks++ >= 256) continue;
        memcpy(e, h, 16); /* tag, flags, node, count */
        pbs_put_u64(e + ENTRY_OFFSET_AT, offset);
        pbs_put_u64(e + ENTRY_BYTES_AT, bytes);
        memcpy(e + ENTRY_CRC_AT, h + CHUNK_CRC_AT, 8); /* and first */
    }
}

/* Makes checksums, sequence numbers, directory and footer right for whatever the chunks say. */
static inline void reseal(blob b) {
    static resealed r;
    memset(&r, 0, sizeof r);
    reseal_header(b);
    if (b.size < HEADER_FIXED) return;
    reseal_pass(b, &r);
    reseal_pass(b, &r);
    if (r.at + FOOTER_FIXED > b.size) return;
    uint8_t *f = b.bytes + r.at;
    pbs_put_u64(f + FOOTER_DIR_AT, r.dir_at);
    pbs_put_u64(f + FOOTER_DIR_BYTES_AT, r.dir_end - r.dir_at);
    pbs_put_u64(f + FOOTER_FILE_AT, r.at + FOOTER_FIXED);
    pbs_put_u64(f + FOOTER_CHUNKS_AT, r.chunks);
    pbs_put_u32(f + FOOTER_CHAIN_AT, r.chain);
    pbs_put_u32(f + FOOTER_CRC_AT, pbs_crc32c(0, f, FOOTER_CRC_AT));
}
#endif
