/* mkvoxels SIZE CHANNELS [X]: writes a sphere's voxels in a grid of SIZE^3 (a power of two) to
 * standard output, with all levels of detail, for the command-line cases. CHANNELS: letters of n
 * normal, w weight, c colour, m material, e emissive, f attributes of faces. X: moved so far. */
#include "tests/unit/support.h"

static uint32_t channels_of(const char *letters) {
    static const struct {
        char letter;
        uint32_t channel;
    } known[] = {{'n', PBS_NORMAL},   {'w', PBS_WEIGHT},   {'c', PBS_COLOUR},
                 {'m', PBS_MATERIAL}, {'e', PBS_EMISSIVE}, {'f', PBS_FACE}};
    uint32_t channels = PBS_POSITION;
    for (size_t i = 0; i < sizeof known / sizeof known[0]; i++)
        if (strchr(letters, known[i].letter)) channels |= known[i].channel;
    return channels;
}

int main(int argc, char **argv) {
    pbs_run run = {.threads = 1};
    vox_model m;
    if (argc < 3) return 64;
    vox_sphere(&m, (uint32_t)atoi(argv[1]));
    if (argc > 3) m.grid.min[0] += atof(argv[3]);
    blob b = vox_file(&run, &m, channels_of(argv[2]), false);
    bool ok = fwrite(b.bytes, 1, b.size, stdout) == b.size && !fflush(stdout);
    free(b.bytes);
    vox_free(&m);
    return ok ? 0 : 74;
}
