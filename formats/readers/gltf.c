/* gltf.c: the reader for glTF and GLB, which lives in a module. */
#include "formats/readers/module.h"

/* Code and data of libdraco, libstdc++ and the module. */
#define GLTF_COST ((size_t)6 << 20)

pbs_code pbs_import_gltf(const char *path, const void *bytes, size_t size, const pbs_sink *sink,
                         pbs_err *err) {
    const void *table;
    pbs_code rc = pbs_module_open(sink->run, "gltf", GLTF_COST, &table, err);
    if (rc) return rc;
    const pbs_module_gltf *gltf = table;
    return gltf->import(path, bytes, size, sink, err);
}
