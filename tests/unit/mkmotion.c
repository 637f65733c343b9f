/* mkmotion: writes a small GLB whose parts move, for the cases in tests/cli: mkmotion FILE [TIME].
 * With a time, what is its pose then by the formulas here is the rest of the file; the animations
 * are the same. The hierarchy is floor; slide (moves, turns) / mount (stands) / wheel (turns along
 * a spline, in quaternions of 16 bits); drum (jumps, in a second animation, "drum"). */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { SIDE = 12, CORNERS = 6 * SIDE * SIDE * 6, FLOATS = 3 * CORNERS };

typedef struct bytes {
    unsigned char data[1 << 20];
    size_t size;
} bytes;

static bytes bin;
static char views[8192], accessors[8192];
static int count;

static void add(const void *p, size_t n, const char *type, int component, size_t elements,
                const char *more) {
    size_t v = strlen(views), a = strlen(accessors);
    while (bin.size % 4) bin.data[bin.size++] = 0;
    snprintf(views + v, sizeof views - v, "%s{\"buffer\":0,\"byteOffset\":%zu,\"byteLength\":%zu}",
             count ? "," : "", bin.size, n);
    snprintf(accessors + a, sizeof accessors - a,
             "%s{\"bufferView\":%d,\"componentType\":%d,\"count\":%zu,\"type\":\"%s\"%s}",
             count ? "," : "", count, component, elements, type, more);
    memcpy(bin.data + bin.size, p, n);
    bin.size += n;
    count++;
}

/* A box around the origin, each side in SIDE * SIDE squares, so that it has surfels of its own. */
static void add_box(double x, double y, double z) {
    static float p[FLOATS];
    const double half[3] = {x, y, z};
    size_t n = 0;
    for (int face = 0; face < 6; face++)
        for (int i = 0; i < SIDE * SIDE; i++) {
            static const int corner[6][2] = {{0, 0}, {1, 0}, {1, 1}, {0, 0}, {1, 1}, {0, 1}};
            int axis = face / 2, up = face % 2;
            for (int c = 0; c < 6; c++) {
                double v[3];
                v[axis] = up ? 1 : -1;
                v[(axis + 1) % 3] = 2.0 * (i % SIDE + corner[c][up ? 0 : 1]) / SIDE - 1;
                v[(axis + 2) % 3] = 2.0 * (i / SIDE + corner[c][up ? 1 : 0]) / SIDE - 1;
                for (int k = 0; k < 3; k++) p[n++] = (float)(half[k] * v[k]);
            }
        }
    add(p, sizeof p, "VEC3", 5126, CORNERS, "");
}

static double clamp(double t, double end) {
    return t < 0 ? 0 : t > end ? end : t;
}

/* The wheel turns about z by the angle a: keys at 0 and 2 s, quaternions without tangents but
 * those below. */
static const double leave = 0.6, arrive = -0.2; /* tangents of z, a second */

static void wheel_at(double t, double q[4]) {
    double u = clamp(t, 2) / 2, z0 = 0, w0 = 1, z1 = 1, w1 = 0;
    double h00 = 2 * u * u * u - 3 * u * u + 1, h10 = u * u * u - 2 * u * u + u;
    double h01 = 1 - h00, h11 = u * u * u - u * u;
    double z = h00 * z0 + 2 * h10 * leave + h01 * z1 + 2 * h11 * arrive;
    double w = h00 * w0 + h01 * w1, l = sqrt(z * z + w * w);
    q[0] = q[1] = 0, q[2] = z / l, q[3] = w / l;
}

/* The slide turns about y, by 120 degrees in 2 s. */
static void slide_at(double t, double place[3], double q[4]) {
    double u = clamp(t, 2) / 2, half = 3.14159265358979323846 / 3 * u;
    place[0] = -1.5 + 2 * u, place[1] = 0.6, place[2] = 0.5 * u;
    q[0] = q[2] = 0, q[1] = sin(half), q[3] = cos(half);
}

/* It begins again after a second. */
static double drum_at(double t) {
    t = t > 1 ? fmod(t, 1) : t;
    return t < 0.5 ? 0 : t < 1 ? 0.7 : -0.4;
}

static void add_keys(void) {
    const float times[2] = {0, 2}, jumps[3] = {0, 0.5f, 1};
    float places[6], turns[8], drum[9] = {1.6f, 0.4f, -1, 1.6f, 0.4f, -1, 1.6f, 0.4f, -1};
    short wheel[24] = {0};
    double place[3], q[4];
    for (int i = 0; i < 2; i++) {
        slide_at(2 * i, place, q);
        for (int k = 0; k < 3; k++) places[3 * i + k] = (float)place[k];
        for (int k = 0; k < 4; k++) turns[4 * i + k] = (float)q[k];
    }
    wheel[7] = 32767; /* the first key's value */
    wheel[10] = (short)lrint(leave * 32767);
    wheel[14] = (short)lrint(arrive * 32767);
    wheel[18] = 32767;
    for (int i = 0; i < 3; i++) drum[3 * i + 1] += (float)drum_at(jumps[i]);
    add(times, sizeof times, "SCALAR", 5126, 2, "");
    add(places, sizeof places, "VEC3", 5126, 2, "");
    add(turns, sizeof turns, "VEC4", 5126, 2, "");
    add(wheel, sizeof wheel, "VEC4", 5122, 6, ",\"normalized\":true");
    add(jumps, sizeof jumps, "SCALAR", 5126, 3, "");
    add(drum, sizeof drum, "VEC3", 5126, 3, "");
}

static void put_u32(FILE *f, size_t v) {
    for (int i = 0; i < 4; i++) fputc((int)(v >> 8 * i & 255), f);
}

int main(int argc, char **argv) {
    static char json[32768];
    double t = argc > 2 ? atof(argv[2]) : 0, place[3], turn[4], wheel[4];
    if (argc < 2) return 64;
    add_box(3, 0.1, 3);
    add_box(0.9, 0.15, 0.15);
    add_box(0.1, 0.5, 0.25);
    add_box(0.3, 0.3, 0.3);
    add_keys();
    slide_at(t, place, turn);
    wheel_at(t, wheel);
    size_t n = (size_t)snprintf(
        json, sizeof json,
        "{\"asset\":{\"version\":\"2.0\"},\"scene\":0,\"scenes\":[{\"nodes\":[0,1,4]}],\"nodes\":["
        "{\"name\":\"floor\",\"mesh\":0},"
        "{\"name\":\"slide\",\"mesh\":1,\"children\":[2],\"translation\":[%.17g,%.17g,%.17g],"
        "\"rotation\":[%.17g,%.17g,%.17g,%.17g]},"
        "{\"name\":\"mount\",\"children\":[3],\"translation\":[0.9,0.2,0],\"scale\":[1,1,1.5]},"
        "{\"name\":\"wheel\",\"mesh\":2,\"rotation\":[%.17g,%.17g,%.17g,%.17g]},"
        "{\"name\":\"drum\",\"mesh\":3,\"translation\":[1.6,%.17g,-1]}],"
        "\"meshes\":[",
        place[0], place[1], place[2], turn[0], turn[1], turn[2], turn[3], wheel[0], wheel[1],
        wheel[2], wheel[3], 0.4 + drum_at(t));
    for (int i = 0; i < 4; i++)
        n += (size_t)snprintf(json + n, sizeof json - n,
                              "%s{\"primitives\":[{\"attributes\":{\"POSITION\":%d},"
                              "\"material\":%d}]}",
                              i ? "," : "", i, i);
    n += (size_t)snprintf(
        json + n, sizeof json - n,
        "],\"materials\":[{\"pbrMetallicRoughness\":{\"baseColorFactor\":[0.5,0.5,0.5,1]}},"
        "{\"pbrMetallicRoughness\":{\"baseColorFactor\":[0.9,0.3,0.1,1]}},"
        "{\"pbrMetallicRoughness\":{\"baseColorFactor\":[0.1,0.4,0.9,1]}},"
        "{\"pbrMetallicRoughness\":{\"baseColorFactor\":[0.2,0.8,0.2,1]}}],"
        "\"animations\":[{\"name\":\"work\",\"samplers\":[{\"input\":4,\"output\":5},"
        "{\"input\":4,\"output\":6},{\"input\":4,\"output\":7,\"interpolation\":\"CUBICSPLINE\"}],"
        "\"channels\":[{\"sampler\":0,\"target\":{\"node\":1,\"path\":\"translation\"}},"
        "{\"sampler\":1,\"target\":{\"node\":1,\"path\":\"rotation\"}},"
        "{\"sampler\":2,\"target\":{\"node\":3,\"path\":\"rotation\"}}]},"
        "{\"name\":\"drum\",\"samplers\":[{\"input\":8,\"output\":9,\"interpolation\":\"STEP\"}],"
        "\"channels\":[{\"sampler\":0,\"target\":{\"node\":4,\"path\":\"translation\"}}]}],"
        "\"bufferViews\":[%s],\"accessors\":[%s],\"buffers\":[{\"byteLength\":%zu}]}",
        views, accessors, bin.size);
    while (n % 4) json[n++] = ' ';
    while (bin.size % 4) bin.data[bin.size++] = 0;
    FILE *f = fopen(argv[1], "wb");
    if (!f) return 74;
    fwrite("glTF\2\0\0\0", 1, 8, f);
    put_u32(f, 12 + 8 + n + 8 + bin.size);
    put_u32(f, n);
    fwrite("JSON", 1, 4, f);
    fwrite(json, 1, n, f);
    put_u32(f, bin.size);
    fwrite("BIN\0", 1, 4, f);
    fwrite(bin.data, 1, bin.size, f);
    return fclose(f) ? 74 : 0;
}
