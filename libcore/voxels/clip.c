/* clip.c: triangles cut along cells (paper 2, section 3). The work is in clip_batch_inner.h. */
#include "libcore/voxels/clip_batch_inner.h"

void pbs_clip(const pbs_triangles *t, bool centroids, bool simd, pbs_fragments *out) {
#if defined(__x86_64__)
    if (simd) {
        pbs_clip_avx2(t, centroids, out);
        return;
    }
#endif
    (void)simd;
    clip_batch(t, centroids, out);
}
