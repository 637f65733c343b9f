/* bench_codec ARCHIVE REPEAT: the data of an archive without a codec, packed with each: its share
 * that is left, and megabytes (unpacked) per CPU second of packing, and of unpacking, the best of
 * REPEAT for each chunk. What does not become smaller stays as it is and takes no time. */
#include "formats/archive/archive.h"
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

static double cpu(void) {
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static void must(pbs_code rc, const pbs_err *err) {
    if (!rc) return;
    fprintf(stderr, "bench_codec: %s\n", err->text);
    exit(1);
}

typedef struct sum {
    uint64_t raw, stored;
    double pack, unpack;
} sum;

static void one(pbs_archive *a, pbs_codec codec, const pbs_fetched *f, int repeat, sum *s) {
    const pbs_chunk *c = &f->chunk;
    pbs_err err;
    pbs_packed p;
    uint8_t *to;
    size_t n = (size_t)c->bytes;
    double t = cpu();
    must(pbs_codec_pack(a->run, codec, c->tag, c->count, c->payload, n, &p, &err), &err);
    s->pack += cpu() - t;
    s->raw += n;
    s->stored += p.bytes ? p.size : n;
    must(pbs_alloc(a->run, &to, p.raw, 1, "bench", &err), &err);
    double best = 1e9;
    for (int i = 0; i < repeat && p.bytes; i++) {
        t = cpu();
        must(pbs_codec_unpack(a->run, p.codec, c->tag, c->count, p.bytes, p.size, to, p.raw, &err),
             &err);
        if (cpu() - t < best) best = cpu() - t;
        if (p.codec != PBS_CODEC_DRACO && memcmp(to, c->payload, n)) exit(1);
    }
    s->unpack += p.bytes ? best : 0;
    pbs_free(a->run, p.bytes);
    pbs_free(a->run, to);
}

int main(int argc, char **argv) {
    pbs_run run = {.threads = 1};
    pbs_archive a;
    pbs_err err;
    if (argc != 3) return 64;
    must(pbs_archive_open(&run, argv[1], &a, &err), &err);
    printf("codec\tshare\tpack_MB/s\tunpack_MB/s\n");
    for (int codec = 1; codec < PBS_CODECS; codec++) {
        sum s = {0};
        for (uint32_t i = 0; i < a.chunk_count; i++) {
            pbs_fetched f;
            if (!pbs_codec_fits(a.chunks[i].tag)) continue;
            must(pbs_archive_fetch(&a, i, &f, &err), &err);
            one(&a, (pbs_codec)codec, &f, atoi(argv[2]), &s);
            pbs_archive_release(&a, &f);
        }
        printf("%s\t%.3f\t%.0f\t%.0f\n", pbs_codec_name[codec], (double)s.stored / (double)s.raw,
               1e-6 * (double)s.raw / s.pack, s.unpack > 0 ? 1e-6 * (double)s.raw / s.unpack : 0);
    }
    pbs_archive_close(&a);
    return 0;
}
