/* mixed.h: a small archive that has everything that an archive can have: surfels with octaves and
 * with meshes beside them, points of a cloud, voxels with meshes beside them, materials, textures.
 * Included by support.h. */
#ifndef PBS_TEST_MIXED_H
#define PBS_TEST_MIXED_H

enum {
    MIXED_SURFELS, /* 70, in two chunks; 18 octaves; a mesh */
    MIXED_CLOUD,   /* 9 points that stay when finer ones are drawn */
    MIXED_VOXELS,  /* 3, with attributes of faces, and two meshes */
    MIXED_ROOT,    /* the three of them */
    MIXED_NODES,
    MIXED_RECORDS = 70,
    MIXED_FIRST = 40,  /* surfels in the first chunk */
    MIXED_CHUNKS = 17, /* in the file */
    MIXED_TRIANGLES = 2,
    MIXED_CHANNELS = PBS_POSITION | PBS_SPACING | PBS_COLOUR,
    MIXED_VOXEL_CHANNELS = PBS_POSITION | PBS_NORMAL | PBS_FACE
};

static inline void mixed_put(pbs_writer *w, pbs_chunk c, const void *bytes, size_t n) {
    pbs_err err = {0};
    pbs_piece piece = {bytes, n};
    must(pbs_writer_chunk(w, &c, &piece, 1, &err), &err);
}

static inline void mixed_mesh(pbs_writer *w, uint32_t node, uint32_t first, float x) {
    const uint32_t head[4] = {4, MIXED_TRIANGLES, 0, 0};
    const float v[12] = {x, 0, 0, x, 1, 0, x, 0, 1, x, 1, 1};
    const uint16_t index[6] = {0, 1, 2, 1, 3, 2};
    uint8_t all[16 + 48 + 12];
    memcpy(all, head, 16), memcpy(all + 16, v, 48), memcpy(all + 64, index, 12);
    mixed_put(w, (pbs_chunk){.tag = PBS_TAG_MESH, .node = node, .count = 2, .first = first}, all,
              sizeof all);
}

static inline void mixed_nodes(pbs_run *run, pbs_writer *w) {
    const uint32_t records[MIXED_NODES] = {MIXED_RECORDS, 9, 3, 0};
    pbs_child child[MIXED_ROOT] = {{.node = 0}, {.node = 1}, {.node = 2}};
    pbs_err err = {0};
    for (int i = 0; i < MIXED_ROOT; i++) memcpy(child[i].m, PBS_IDENTITY, sizeof child->m);
    for (uint32_t i = 0; i < MIXED_NODES; i++) {
        pbs_node n = {.id = i, .name = "n", .records = records[i], .box = {{0, 0, 0}, {9, 9, 9}}};
        n.lattice = i == MIXED_ROOT ? 0 : 1;
        n.flags = i == MIXED_CLOUD ? PBS_NODE_ADDS : 0;
        if (i == MIXED_ROOT) n.children = child, n.child_count = MIXED_ROOT;
        must(pbs_node_write(run, w, &n, &err), &err);
    }
}

static inline void mixed_materials(pbs_writer *w) {
    uint8_t m[144] = {0}, t[16] = "\1\0\0\0\0\0\0\0tPNG";
    for (int i = 0; i < 3; i++) pbs_put_u32(m + 44 + 32 * i, i ? PBS_NONE : 1);
    mixed_put(w, (pbs_chunk){.tag = PBS_TAG_MATERIAL, .count = 1}, m, sizeof m);
    for (uint32_t i = 0; i < 2; i++)
        mixed_put(w, (pbs_chunk){.tag = PBS_TAG_TEXTURE, .node = i, .count = 1}, t, 12);
}

static inline void mixed_points(pbs_run *run, pbs_writer *w) {
    pbs_record r = pbs_record_make(MIXED_CHANNELS, true);
    uint8_t octaves[4 * 18];
    pbs_lattice l = {{0, 0, 0}, 1};
    pbs_err err = {0};
    pbs_points p;
    for (size_t i = 0; i < sizeof octaves; i++) octaves[i] = (uint8_t)(7 * i);
    mixed_put(w, (pbs_chunk){.tag = PBS_TAG_OCTAVES, .node = MIXED_SURFELS, .count = 18}, octaves,
              sizeof octaves);
    for (uint32_t node = 0; node < 2; node++) {
        fill_points(run, MIXED_CHANNELS, node ? 9 : MIXED_RECORDS, node + 5, &p);
        must(pbs_points_write(run, w, &r, node, &p, 0, node ? 100 : MIXED_FIRST, &l, &err), &err);
        pbs_points_free(run, &p);
    }
}

static inline void mixed_voxels(pbs_writer *w) {
    uint32_t place[3] = {PBS_PLACE(0, 0, 0, 1), PBS_PLACE(1, 0, 0, 2), PBS_PLACE(0, 1, 0, 63)};
    uint32_t normal[3] = {1, 2, 3}, face[3] = {PBS_NONE, PBS_NONE, 1};
    uint32_t faces[7] = {0, 0, PBS_NONE, 0, PBS_NONE, 0, 0};
    pbs_err err = {0};
    pbs_voxels v = {.count = 3, .place = place, .normal = normal, .face = face};
    pbs_voxel_place at = {.size = 4};
    must(pbs_voxels_write(w, MIXED_VOXELS, &at, &v, 0, &err), &err);
    must(pbs_faces_write(w, MIXED_VOXELS, false, faces, 7, 0, &err), &err);
}

static inline blob small_mixed(pbs_run *run) {
    pbs_record r = pbs_record_make(MIXED_CHANNELS, true);
    char text[512];
    pbs_archive_text(&r, MIXED_VOXEL_CHANNELS, text);
    pbs_writer *w = spool_writer(run, PBS_ARCHIVE, text, MIXED_CHUNKS);
    mixed_nodes(run, w);
    mixed_materials(w);
    mixed_points(run, w);
    mixed_voxels(w);
    mixed_mesh(w, MIXED_SURFELS, 0, 0);
    mixed_mesh(w, MIXED_VOXELS, 0, 1);
    mixed_mesh(w, MIXED_VOXELS, MIXED_TRIANGLES, 2);
    mixed_put(w, (pbs_chunk){.tag = PBS_TAG('T', 'e', 's', 't'), .node = 77}, "?", 1);
    return take_bytes(w);
}
#endif
