/* Throws bytes at the checker of containers, as a map and as a pipe; then the same bytes with all
 * checksums, sequence numbers and the directory put right, so that what lies behind those is
 * reached. With -fsanitize=fuzzer this is a fuzzer, without it a program:
 *
 *     fuzz_container FILE...        replays files
 *     fuzz_container --seeds DIR    writes small valid files to begin with
 */
#include "formats/archive/archive.h"
#include "tests/unit/support.h"
#include "tests/unit/latticed.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static pbs_run run = {.threads = 1, .mem_limit = 512 << 20};

static uint32_t use_voxels(const pbs_voxels *v, uint32_t sum) {
    const void *array[7] = {v->place,    v->normal,   v->weight, v->colour,
                            v->material, v->emissive, v->face};
    for (int i = 0; i < 7; i++)
        if (array[i]) sum = pbs_crc32c(sum, array[i], 4 * v->count);
    return sum;
}

static uint32_t use_mesh(const pbs_mesh *m, uint32_t sum) {
    for (size_t i = 0; i < 3 * (size_t)m->triangles; i++)
        sum = pbs_crc32c(sum, m->position + 3 * (size_t)m->index[i], 12);
    return m->uv ? pbs_crc32c(sum, m->uv, 8 * (size_t)m->vertices) : sum;
}

static uint32_t use_node(const pbs_archive *a, uint32_t i, uint32_t sum) {
    pbs_node_data d;
    pbs_err err;
    bool verified;
    uint64_t n = a->nodes[i].records;
    if (pbs_archive_load_node(a, i, &d, &err)) return sum;
    sum = use_voxels(&d.voxels, sum);
    for (size_t k = 0; k < d.face_count; k++) sum ^= d.faces[k];
    if (d.octaves)
        sum = pbs_crc32c(sum, d.octaves,
                         (size_t)pbs_octave_entries(&a->octave, n) * a->octave.stride);
    if (d.records) {
        sum = pbs_crc32c(sum, d.records, (size_t)n * a->record.stride);
        /* Over themselves: the first half again. */
        if (pbs_archive_prefix(a, i, n / 2, d.records, &verified, &err)) abort();
    }
    pbs_node_data_free(a, &d);
    return sum;
}

/* What passes must be readable, every byte that the structs promise. */
static void use_archive(blob b) {
    pbs_archive a;
    pbs_fetched f;
    pbs_err err;
    char path[40];
    uint32_t sum = 0;
    int fd = memfd_create("fuzz", MFD_CLOEXEC);
    snprintf(path, sizeof path, "/proc/self/fd/%d", fd);
    if (fd < 0 || write(fd, b.bytes, b.size) != (ssize_t)b.size) abort();
    pbs_code rc = pbs_archive_open(&run, path, &a, &err);
    close(fd);
    if (rc) return;
    for (uint32_t i = 0; i < a.node_count; i++) sum = use_node(&a, i, sum);
    for (uint32_t i = 0; i < a.chunk_count; i++) {
        if (pbs_archive_fetch(&a, i, &f, &err)) continue;
        if (f.chunk.bytes != pbs_archive_bytes(&a, i)) abort();
        if (f.chunk.tag == PBS_TAG_MESH) sum = use_mesh(&f.mesh, sum);
        pbs_archive_release(&a, &f);
    }
    pbs_archive_close(&a);
    if (sum == 1) puts("");
}

static void use_scene(blob b) {
    pbs_scene s;
    pbs_flat flat;
    pbs_err err;
    char path[40];
    int fd = memfd_create("fuzz", MFD_CLOEXEC);
    snprintf(path, sizeof path, "/proc/self/fd/%d", fd);
    if (fd < 0 || write(fd, b.bytes, b.size) != (ssize_t)b.size) abort();
    pbs_code rc = pbs_scene_open(&run, path, NULL, &s, &err);
    close(fd);
    if (rc) return;
    if (!pbs_scene_flatten(&s, &flat, &err)) pbs_free(&run, flat.draws);
    pbs_scene_close(&s);
}

/* Both ways of reading take the same files, but that a pipe cannot look into the directory. */
static void check_both(blob b) {
    pbs_err err = {0};
    pbs_code piped = b.size <= 1 << 20 ? check_blob(&run, b, true, &err) : PBS_DATA;
    pbs_code mapped = check_guarded(&run, b, &err);
    if (!mapped && piped && b.size <= 1 << 20) abort();
    if (mapped && (mapped != err.code || !*err.text)) abort();
    if (pbs_mem_used(&run)) abort();
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    if (size > 1 << 20) return 0;
    blob b = {malloc(size + 1), size};
    memcpy(b.bytes, data, size);
    check_both(b);
    reseal(b);
    check_both(b);
    /* text that is no container would be taken for an OBJ file, which is another fuzzer's */
    if (pbs_is_container(b.bytes, size)) use_archive(b), use_scene(b);
    if (pbs_mem_used(&run)) abort();
    free(b.bytes);
    return 0;
}

static bool write_seed(const char *folder, const char *name, int number, blob b) {
    char path[4096];
    snprintf(path, sizeof path, "%s/%s-%d.pbs", folder, name, number);
    FILE *f = fopen(path, "wb");
    bool ok = f && fwrite(b.bytes, 1, b.size, f) == b.size;
    if (f && fclose(f)) ok = false;
    if (!ok) perror(path);
    free(b.bytes);
    return ok;
}

static int write_seeds(const char *folder) {
    bool ok = true;
    for (int k = 0; k < SMALL_KINDS; k++)
        ok = write_seed(folder, "small", k, small_file(&run, k)) && ok;
    for (int c = 1; c < PBS_CODECS; c++)
        ok = write_seed(folder, "packed", c, small_mixed(&run, (pbs_codec)c)) &&
             write_seed(folder, "latticed", c, small_latticed(&run, (pbs_codec)c)) && ok;
    return !ok;
}

/* Weak: the fuzzer's own comes before it. */
__attribute__((weak)) int main(int argc, char **argv) {
    if (argc == 3 && !strcmp(argv[1], "--seeds")) return write_seeds(argv[2]);
    for (int i = 1; i < argc; i++) {
        const uint8_t *bytes;
        size_t size;
        pbs_err err;
        if (pbs_map_file(argv[i], &bytes, &size, &err)) return puts(err.text), 1;
        LLVMFuzzerTestOneInput(bytes, size);
        pbs_unmap_file(bytes, size);
        printf("%s: survived\n", argv[i]);
    }
    return 0;
}
