/* Inputs of the packer that contradict themselves behind right checksums: never a crash, nothing is
 * leaked, and what the checker finds whole becomes an archive that it finds whole. */
#include "formats/archive/pack.h"
#include "tests/unit/support.h"
#include "tests/check.h"

static pbs_run run = {.threads = 1};
static pbs_err err;

enum { FILES = 3, TRIES = 100 };
static const int kind[FILES] = {SMALL_SCENE, SMALL_SURFELS, SMALL_VOXELS};
static const char *const path[FILES] = {"d.scene", "d.surf", "d.vox"};

static void to_file(const char *name, blob b) {
    FILE *f = fopen(name, "wb");
    if (!f || fwrite(b.bytes, 1, b.size, f) != b.size || fclose(f)) abort();
}

static pbs_code pack(blob *out) {
    pbs_pack *p;
    pbs_pack_stats stats;
    pbs_input in;
    FILE *cloud = fopen("d.xyz", "w");
    fputs("0 0 0\n1 0 0\n", cloud);
    fclose(cloud);
    pbs_code rc = pbs_pack_new(&run, &p, &err);
    for (int i = 0; i < FILES && !rc; i++) rc = pbs_pack_add(p, path[i], &err);
    if (!rc) rc = pbs_pack_add(p, "d.xyz", &err);
    if (!rc)
        rc = pbs_pack_write(p, &(pbs_writer_desc){.path = "d.pbs", .stage = "test"}, &stats, &err);
    pbs_pack_free(p);
    *out = (blob){0};
    if (rc) return rc;
    must(pbs_input_open(&run, "d.pbs", &in, &err), &err);
    *out = copy_blob((blob){(uint8_t *)in.bytes, (size_t)in.size});
    pbs_input_close(&in);
    return PBS_OK;
}

TEST(contradictions) {
    uint64_t seed = 11;
    int whole = 0, refused = 0;
    for (int k = 0; k < FILES; k++) {
        blob b = small_file(&run, kind[k]), out;
        for (int i = 0; i < FILES; i++) {
            blob other = small_file(&run, kind[i]);
            to_file(path[i], other);
            free(other.bytes);
        }
        for (int t = 0; t < TRIES; t++) {
            blob c = copy_blob(b);
            uint32_t bit = random_bits(&seed) % (uint32_t)(8 * b.size);
            if (t) c.bytes[bit / 8] ^= (uint8_t)(1 << bit % 8);
            reseal(c);
            to_file(path[k], c);
            bool fine = !check_blob(&run, c, false, &err);
            pbs_code rc = pack(&out);
            if (rc && rc != PBS_DATA) printf("# %s, bit %u: %s\n", path[k], bit, err.text);
            CHECK(!rc || rc == PBS_DATA);
            CHECK(t || !rc);
            if (fine && !rc && check_blob(&run, out, false, &err)) {
                printf("# %s, bit %u: %s\n", path[k], bit, err.text);
                pbs_bad++;
            }
            whole += !rc;
            refused += rc != PBS_OK;
            free(c.bytes), free(out.bytes);
        }
        free(b.bytes);
    }
    CHECK(whole > TRIES / 4 && refused > TRIES / 4);
    CHECK_NUM(!run.mem_used, run.mem_used);
}

TEST_MAIN
