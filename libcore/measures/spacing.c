#include "libcore/measures/spacing.h"
#include <math.h>
#include <stdlib.h>

static int by_value(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* All pairs: the prefix is short, and the answer is exact. */
void pbs_spacing_of_prefix(const pbs_points *p, pbs_spacing *out) {
    uint32_t n = p->count < PBS_SPACING_COUNT ? (uint32_t)p->count : PBS_SPACING_COUNT;
    double nearest[PBS_SPACING_COUNT], at[3][PBS_SPACING_COUNT], d[PBS_SPACING_COUNT];
    *out = (pbs_spacing){.count = n};
    if (n < 2) return;
    for (uint32_t i = 0; i < n; i++) {
        nearest[i] = INFINITY;
        for (int a = 0; a < 3; a++) at[a][i] = p->position[3 * i + a];
    }
    for (uint32_t i = 0; i < n; i++) {
        for (uint32_t k = 0; k < i; k++) { /* of its own, so that it runs in lanes */
            double x = at[0][i] - at[0][k], y = at[1][i] - at[1][k], z = at[2][i] - at[2][k];
            d[k] = x * x + y * y + z * z;
        }
        for (uint32_t k = 0; k < i; k++) {
            nearest[k] = d[k] < nearest[k] ? d[k] : nearest[k];
            nearest[i] = d[k] < nearest[i] ? d[k] : nearest[i];
        }
    }
    qsort(nearest, n, sizeof *nearest, by_value);
    out->min = sqrt(nearest[0]);
    out->median = sqrt(nearest[n / 2]);
    out->max = sqrt(nearest[n - 1]);
}
