/* What of a scene goes on into the files made from it: its title, its list of materials. */
#include "formats/scene/scene.h"
#include <stdio.h>
#include <string.h>

/* The file that the scene was imported from: the end of the history's first line, behind the
 * options; "" if it was a pipe. The stream may come through a pipe itself, and that has no name. */
static void source_name(const pbs_scene *s, char *name, size_t size) {
    static const char stage[] = "stage pbs-import ", pipe[] = "standard input\n";
    const char *p = pbs_scene_history(s);
    *name = 0;
    if (strncmp(p, stage, sizeof stage - 1)) return;
    p += sizeof stage - 1;
    while (!strncmp(p, "--", 2)) {
        bool value = !strncmp(p, "--split ", 8) || !strncmp(p, "--group ", 8);
        for (int words = value ? 2 : 1; words; words--) {
            p += strcspn(p, " \n");
            p += *p == ' ';
        }
    }
    if (strncmp(p, pipe, sizeof pipe - 1)) snprintf(name, size, "%.*s", (int)strcspn(p, "\n"), p);
}

/* A character of UTF-8 at the end that was cut goes. */
static void drop_half(char *text) {
    size_t n = strlen(text), i = n;
    while (i && (text[i - 1] & 0xc0) == 0x80) i--;
    if (!i--) return;
    unsigned char lead = (unsigned char)text[i];
    size_t bytes = lead < 0xc0 ? 1 : lead < 0xe0 ? 2 : lead < 0xf0 ? 3 : 4;
    if (n - i < bytes) text[i] = 0;
}

void pbs_scene_title(const pbs_scene *s, char *out, size_t size) {
    const char *name = s->nodes[s->node_count - 1].name;
    if (*name)
        snprintf(out, size, "%s", name);
    else
        source_name(s, out, size);
    drop_half(out);
}

pbs_code pbs_scene_copy_materials(const pbs_scene *s, pbs_writer *w, pbs_err *err) {
    const pbs_chunk *entries;
    size_t count;
    pbs_code rc = pbs_reader_directory(s->reader, &entries, &count, err);
    for (size_t i = 0; i < count && !rc; i++) {
        pbs_chunk c;
        if (entries[i].tag != PBS_TAG_MATERIAL) continue;
        rc = pbs_reader_at(s->reader, &entries[i], &c, err);
        pbs_piece piece = {c.payload, (size_t)c.bytes};
        if (!rc) rc = pbs_writer_chunk(w, &c, &piece, 1, err);
    }
    return rc;
}
