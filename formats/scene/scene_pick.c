/* scene_pick.c: which reader a foreign scene file needs. */
#include "formats/scene/scene.h"
#include <ctype.h>
#include <string.h>
#include <strings.h>

static bool begins(const uint8_t *b, size_t n, const char *with) {
    return n >= strlen(with) && !memcmp(b, with, strlen(with));
}

static bool ends(const char *path, const char *with) {
    size_t n = path ? strlen(path) : 0, w = strlen(with);
    return n > w && !strcasecmp(path + n - w, with);
}

static bool is_json(const uint8_t *b, size_t n) {
    size_t i = begins(b, n, "\xef\xbb\xbf") ? 3 : 0;
    while (i < n && isspace(b[i])) i++;
    return i < n && b[i] == '{';
}

/* Formats that people will try, and what to do instead. */
static const struct {
    const char *magic, *ending, *what;
} refused[] = {
    {"LASF", ".las", "a point cloud (LAS) has no triangles"},
    {"ASTM-E57", ".e57", "a point cloud (E57) has no triangles"},
    {"ISO-10303-21", ".step", "STEP is not read: export glTF from the CAD program (or FreeCAD)"},
    {"ISO-10303-21", ".stp", "STEP is not read: export glTF from the CAD program (or FreeCAD)"},
    {"Kaydara FBX", ".fbx", "FBX is not read: export glTF (Blender does)"},
    {"DRACO", ".drc", "bare Draco is not read: put it into glTF with KHR_draco_mesh_compression"},
    {NULL, ".laz", "a point cloud (LAZ) has no triangles"},
    {NULL, ".igs", "IGES is not read: export glTF from the CAD program (or FreeCAD)"},
    {NULL, ".dae", "COLLADA is not read: export glTF (Blender does)"},
};

static bool looks_like_stl(const uint8_t *b, size_t size, const char *path) {
    if (ends(path, ".stl") || begins(b, size, "solid")) return true;
    uint32_t count;
    if (size < 84) return false;
    memcpy(&count, b + 80, 4);
    return size == 84 + 50 * (uint64_t)count;
}

pbs_code pbs_import_pick(const char *path, const uint8_t *b, size_t size, pbs_import_fn *fn,
                         pbs_err *err) {
    if (!size) return pbs_fail(err, PBS_DATA, "the file is empty");
    if (begins(b, size, "glTF") || ends(path, ".glb") || ends(path, ".gltf") || is_json(b, size))
        *fn = pbs_import_gltf;
    else if (begins(b, size, "ply\n") || begins(b, size, "ply\r") || ends(path, ".ply"))
        *fn = pbs_import_ply;
    else if (ends(path, ".obj"))
        *fn = pbs_import_obj;
    else {
        for (size_t i = 0; i < sizeof refused / sizeof refused[0]; i++)
            if ((refused[i].magic && begins(b, size, refused[i].magic)) ||
                ends(path, refused[i].ending))
                return pbs_fail(err, PBS_DATA, "%s", refused[i].what);
        if (looks_like_stl(b, size, path))
            *fn = pbs_import_stl;
        else if (path && strcmp(path, "-"))
            return pbs_fail(err, PBS_DATA,
                            "not a scene file that is read (glTF, GLB, OBJ, PLY, STL)");
        else
            *fn = pbs_import_obj; /* text on a pipe: OBJ has no magic */
    }
    return PBS_OK;
}

pbs_code pbs_import_input(pbs_input *in, const char *path, const pbs_sink *sink, pbs_err *err) {
    pbs_import_fn fn = NULL;
    pbs_code rc = pbs_input_map(in, err);
    if (rc) return rc;
    rc = pbs_import_pick(path, in->bytes, (size_t)in->size, &fn, err);
    pbs_sink mapped = *sink;
    mapped.mapped = true;
    if (!rc) rc = fn(path ? path : "-", in->bytes, (size_t)in->size, &mapped, err);
    return rc ? pbs_fail_in(err, "%s", in->name) : PBS_OK;
}
