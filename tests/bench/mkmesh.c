/* mkmesh FORMAT TRIANGLES [shuffled] > FILE: one large mesh, a bumpy torus, for measuring imports.
 * FORMAT is ply (binary), ascii (PLY), stl (binary) or obj. shuffled: neighbours in the file are
 * far apart on the torus, the worst that a reader can get. Not part of the build:
 *
 *     cc -O2 -o mkmesh tests/bench/mkmesh.c -lm
 */
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static uint64_t rows, columns, triangles;

static void vertex(uint64_t i, float v[3]) {
    double a = 6.283185307179586 * (double)(i / columns) / (double)rows;
    double b = 6.283185307179586 * (double)(i % columns) / (double)columns;
    double r = 30 + sin(20 * a) * cos(14 * b);
    v[0] = (float)((100 + r * cos(b)) * cos(a));
    v[1] = (float)((100 + r * cos(b)) * sin(a));
    v[2] = (float)(r * sin(b));
}

static void triangle(uint64_t t, uint64_t v[3]) {
    uint64_t row = t / 2 / columns, column = t / 2 % columns;
    uint64_t down = (row + 1) % rows * columns, right = (column + 1) % columns;
    row *= columns;
    v[0] = row + (t & 1 ? right : column);
    v[1] = down + column;
    v[2] = t & 1 ? down + right : row + right;
}

static void put(const void *bytes, size_t n) {
    if (fwrite(bytes, 1, n, stdout) != n) exit(74);
}

static void header(const char *format) {
    if (!strcmp(format, "stl")) {
        char head[84] = "generated";
        uint32_t n = (uint32_t)triangles;
        memcpy(head + 80, &n, 4);
        put(head, sizeof head);
    } else if (strcmp(format, "obj")) {
        printf("ply\nformat %s 1.0\nelement vertex %llu\nproperty float x\nproperty float y\n"
               "property float z\nelement face %llu\nproperty list uchar int vertex_indices\n"
               "end_header\n",
               *format == 'p' ? "binary_little_endian" : "ascii",
               (unsigned long long)(rows * columns), (unsigned long long)triangles);
    }
}

static void put_vertex(const char *format, uint64_t i) {
    float v[3];
    vertex(i, v);
    if (*format == 'p')
        put(v, 12);
    else
        printf("%s%.7g %.7g %.7g\n", *format == 'o' ? "v " : "", v[0], v[1], v[2]);
}

static void put_triangle(const char *format, uint64_t t) {
    uint64_t v[3];
    triangle(t, v);
    if (*format == 's') {
        float record[13] = {0};
        for (int k = 0; k < 3; k++) vertex(v[k], record + 3 + 3 * k);
        put(record, 50);
    } else if (*format == 'p') {
        char record[13] = {3};
        for (int k = 0; k < 3; k++) memcpy(record + 1 + 4 * k, &(uint32_t){(uint32_t)v[k]}, 4);
        put(record, 13);
    } else {
        int one = *format == 'o';
        printf("%s %u %u %u\n", one ? "f" : "3", (unsigned)v[0] + one, (unsigned)v[1] + one,
               (unsigned)v[2] + one);
    }
}

int main(int argc, char **argv) {
    triangles = argc > 2 ? strtoull(argv[2], NULL, 10) : 0;
    if (triangles < 100 || argc > 4) {
        fprintf(stderr, "mkmesh: ply|ascii|stl|obj TRIANGLES [shuffled]\n");
        return 64;
    }
    columns = (uint64_t)sqrt((double)triangles / 6) + 2;
    rows = triangles / 2 / columns;
    triangles = 2 * rows * columns;
    header(argv[1]);
    for (uint64_t i = 0; i < rows * columns && *argv[1] != 's'; i++) put_vertex(argv[1], i);
    uint64_t step = argc > 3 ? 982451653 : 1; /* a prime: every triangle comes once */
    for (uint64_t i = 0; i < triangles; i++)
        put_triangle(argv[1], (uint64_t)((unsigned __int128)i * step % triangles));
    return fflush(stdout) ? 74 : 0;
}
