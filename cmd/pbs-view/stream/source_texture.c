/* source_texture.c: textures of an archive as they lie in the GPU's memory: decoded, with all
 * levels, no larger than the device takes. */
#include "cmd/pbs-view/stream/source.h"
#include "formats/readers/image.h"
#include "formats/scene/scene_wire.h"
#include "formats/container/wire.h"
#include <stdio.h>

/* Images are packed to about a tenth; all levels together are a third more than the first. */
uint64_t pbs_source_guess(const pbs_source *s, uint32_t texture) {
    const pbs_archive *a = s->archive;
    uint64_t bytes = pbs_archive_bytes(a, a->textures[texture]);
    return bytes < UINT32_MAX ? 12 * bytes + 4 : UINT32_MAX;
}

static pbs_code decode(pbs_source *s, uint32_t texture, pbs_image *out, pbs_err *err) {
    const pbs_archive *a = s->archive;
    char name[64];
    pbs_fetched f;
    pbs_code rc = pbs_archive_fetch(a, a->textures[texture], &f, err);
    if (rc) return rc;
    const uint8_t *p = f.chunk.payload;
    size_t skip = TEXTURE_FIXED + (size_t)pbs_get_u32(p);
    snprintf(name, sizeof name, "texture %u", texture);
    rc = pbs_image_decode(s->run, name, p + skip, (size_t)f.chunk.bytes - skip, out, err);
    pbs_archive_release(a, &f);
    return rc;
}

pbs_code pbs_source_load_texture(pbs_source *s, uint32_t item, pbs_blob *out, pbs_err *err) {
    uint32_t number = item - (uint32_t)(2 * s->archive->node_count);
    pbs_mips *m = pbs_source_mips(s, item);
    pbs_image image;
    *out = (pbs_blob){0};
    pbs_code rc = decode(s, number / 2, &image, err);
    if (rc) return rc;
    rc = pbs_mips_make(s->run, &image, number % 2, s->largest_side, s->largest_texture, m,
                       &out->bytes, err);
    pbs_free(s->run, image.rgba);
    if (!rc) out->size = (size_t)pbs_mips_bytes(m);
    return rc;
}
