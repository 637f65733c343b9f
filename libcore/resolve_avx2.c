#if defined(__x86_64__)
#pragma GCC target("avx2")
#include "libcore/resolve_math.h"

void pbs_resolve_aim_avx2(const pbs_placed *p, pbs_lanes *b, int from, int to) {
    aim_all(p, b, from, to);
}
void pbs_resolve_finish_avx2(const pbs_placed *p, pbs_lanes *b, int from, int to, bool normals,
                             bool odd) {
    finish_all(p, b, from, to, normals, odd);
}
#endif
