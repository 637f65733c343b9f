/* cloudfile.h: writes small LAS files, for the tests of point clouds. */
#ifndef PBS_TEST_CLOUDFILE_H
#define PBS_TEST_CLOUDFILE_H
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct las_desc {
    int minor, format, extra; /* bytes behind each point */
    double scale[3], offset[3];
    uint64_t count, said; /* points; what the header says, if not 0 */
    int behind;           /* bytes behind the points */
} las_desc;

static const int las_size[] = {20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67};
static const int las_red[] = {0, 0, 20, 28, 0, 28, 0, 30, 30, 0, 30};

/* q: 3 integers a point; colour: 3 numbers of 16 bits a point, or NULL. Writes PATH. */
static inline void las_write(const char *path, const las_desc *d, const int32_t *q,
                             const uint16_t *colour) {
    int header = d->minor >= 4 ? 375 : d->minor == 3 ? 235 : 227;
    size_t stride = (size_t)(las_size[d->format] + d->extra);
    uint32_t at = (uint32_t)header + 54; /* one variable record without content */
    uint8_t *h = calloc(1, at), *p = malloc(stride);
    uint16_t size = (uint16_t)header, length = (uint16_t)stride;
    uint32_t count = d->minor >= 4 && d->format > 5 ? 0 : (uint32_t)(d->said ? d->said : d->count);
    uint64_t count64 = d->said ? d->said : d->count;
    memcpy(h, "LASF", 4);
    h[24] = 1, h[25] = (uint8_t)d->minor, h[104] = (uint8_t)d->format;
    memcpy(h + 94, &size, 2), memcpy(h + 96, &at, 4), memcpy(h + 105, &length, 2);
    memcpy(h + 107, &count, 4), memcpy(h + 131, d->scale, 24), memcpy(h + 155, d->offset, 24);
    if (d->minor >= 4) memcpy(h + 247, &count64, 8);
    FILE *f = fopen(path, "wb");
    fwrite(h, 1, at, f);
    for (uint64_t i = 0; i < d->count; i++) {
        memset(p, 0xee, stride);
        memcpy(p, q + 3 * i, 12);
        if (colour && las_red[d->format]) memcpy(p + las_red[d->format], colour + 3 * i, 6);
        fwrite(p, 1, stride, f);
    }
    for (int i = 0; i < d->behind; i++) fputc('x', f);
    fclose(f);
    free(h);
    free(p);
}

/* Says in the header of PATH that the numbers are in a box. */
static inline void las_say_box(const char *path, const las_desc *d, const int32_t low[3],
                               const int32_t high[3]) {
    FILE *f = fopen(path, "r+b");
    fseek(f, 179, SEEK_SET);
    for (int k = 0; k < 3; k++) {
        double box[2] = {d->offset[k] + d->scale[k] * high[k], d->offset[k] + d->scale[k] * low[k]};
        fwrite(box, 8, 2, f);
    }
    fclose(f);
}
#endif
