/* module.c: finds and opens the modules; see module.h. */
#include "formats/readers/module.h"
#include <dlfcn.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static struct module {
    const char *name, *libraries;
    const void *table; /* once it is open; modules are never closed */
} modules[] = {
    {"gltf", "simdjson, tinygltf, Draco and meshoptimizer", NULL},
    {"image", "OpenImageIO", NULL},
    {"exr", "OpenEXR", NULL},
    {"mend", "CGAL", NULL},
    {"zstd", "libzstd", NULL},
    {"meshopt", "meshoptimizer", NULL},
    {"draco", "Draco", NULL},
};
static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;

/* $PBS_MODULES, else ../lib/pbs as seen from the program's folder. */
static pbs_code module_folder(char *out, size_t size, pbs_err *err) {
    const char *env = getenv("PBS_MODULES");
    int n;
    if (env && *env) {
        n = snprintf(out, size, "%s", env);
    } else {
        char exe[4096];
        ssize_t got = readlink("/proc/self/exe", exe, sizeof exe - 1);
        if (got < 0) return pbs_fail_errno(err, "/proc/self/exe");
        exe[got] = 0;
        for (int up = 0; up < 2; up++) {
            char *slash = strrchr(exe, '/');
            if (slash) *slash = 0;
        }
        n = snprintf(out, size, "%s/lib/pbs", exe);
    }
    if (n < 0 || (size_t)n >= size) return pbs_fail(err, PBS_IO, "the modules' folder: too long");
    return PBS_OK;
}

static pbs_code open_file(struct module *m, pbs_err *err) {
    char folder[4096], path[4200];
    pbs_code rc = module_folder(folder, sizeof folder, err);
    if (rc) return rc;
    snprintf(path, sizeof path, "%s/%s.so", folder, m->name);
    if (access(path, F_OK))
        return pbs_fail(err, PBS_IO,
                        "module %s: not installed (looked in %s): install %s and build again",
                        m->name, folder, m->libraries);
    void *handle = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    if (!handle) return pbs_fail(err, PBS_IO, "module %s: %s", m->name, dlerror());
    const int *table = dlsym(handle, "pbs_module");
    if (!table) return pbs_fail(err, PBS_IO, "module %s: %s is not a module", m->name, path);
    if (*table != PBS_MODULE_ABI)
        return pbs_fail(err, PBS_IO, "module %s: %s has version %d, not %d: build it again",
                        m->name, path, *table, PBS_MODULE_ABI);
    m->table = table;
    return PBS_OK;
}

static pbs_code open_counted(pbs_run *run, struct module *m, size_t counted, pbs_err *err) {
    char what[64];
    snprintf(what, sizeof what, "module %s", m->name);
    pbs_code rc = pbs_mem_take(run, counted, what, err);
    if (rc) return rc;
    rc = open_file(m, err);
    if (rc) pbs_mem_give(run, counted);
    return rc;
}

pbs_code pbs_module_open(pbs_run *run, const char *name, size_t counted, const void **table,
                         pbs_err *err) {
    *table = NULL;
    for (size_t i = 0; i < sizeof modules / sizeof *modules; i++) {
        struct module *m = &modules[i];
        if (strcmp(m->name, name) != 0) continue;
        pthread_mutex_lock(&lock);
        pbs_code rc = m->table ? PBS_OK : open_counted(run, m, counted, err);
        *table = m->table;
        pthread_mutex_unlock(&lock);
        return rc;
    }
    return pbs_fail(err, PBS_INTERNAL, "module %s: there is no such module", name);
}
