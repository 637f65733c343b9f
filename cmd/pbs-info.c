/* pbs-info: what is in a pbs file, a line a chunk. */
#include "cmd/tool.h"
#include "formats/archive/archive.h"
#include "formats/archive/check.h"
#include "formats/scene/meshbits.h"
#include <inttypes.h>
#include <stdio.h>
#include <string.h>

typedef struct options {
    bool check, json, nodes, tree;
} options;

static const pbs_option table[] = {
    {'c', "check", PBS_FLAG, offsetof(options, check), NULL,
     "read everything and verify it; print one line", 0, 0, NULL, false},
    {0, "json", PBS_FLAG, offsetof(options, json), NULL, "print JSON", 0, 0, NULL, false},
    {0, "nodes", PBS_FLAG, offsetof(options, nodes), NULL, "print the nodes instead of the chunks",
     0, 0, NULL, false},
    {0, "tree", PBS_FLAG, offsetof(options, tree), NULL,
     "print the nodes as they are placed, each below its parent", 0, 0, NULL, false},
};

static const pbs_tool tool = {"pbs-info",
                              "Prints or verifies what is in a pbs file",
                              "[FILE...]",
                              0,
                              -1,
                              table,
                              sizeof table / sizeof table[0],
                              true};

typedef struct printer {
    pbs_run *run;
    const options *o;
    pbs_reader *r;
    uint32_t voxels; /* channels */
    uint64_t chunks, nodes, printed;
    pbs_node *node; /* all of them, for the tree */
    size_t room;
} printer;

/* ---- JSON and text ---- */

/* What a file says, or is called, must not steer the terminal. Lines stay lines where it says. */
static void print_clean(const char *s, bool lines) {
    for (; *s; s++)
        putchar(((unsigned char)*s < 0x20 && !(lines && *s == '\n')) || *s == 0x7f ? '?' : *s);
}

static void print_header(const printer *p) {
    const char *channels = pbs_reader_channels(p->r), *history = pbs_reader_history(p->r);
    const char *kind = pbs_kind_name[pbs_reader_kind(p->r)];
    if (!p->o->json) {
        print_clean(pbs_reader_name(p->r), false);
        printf(": %s\n", kind);
        if (*channels) {
            printf("channels ");
            print_clean(channels, false);
            printf("\n");
        }
        print_clean(history, true);
        return;
    }
    printf("{\"file\": ");
    pbs_print_json_text(pbs_reader_name(p->r), strlen(pbs_reader_name(p->r)));
    printf(", \"kind\": \"%s\", \"channels\": ", kind);
    pbs_print_json_text(channels, strlen(channels));
    printf(",\n \"history\": [");
    for (const char *line = history, *end; *line; line = end + 1) {
        end = strchr(line, '\n');
        if (line != history) printf(", ");
        pbs_print_json_text(line, (size_t)(end - line));
    }
    printf("],\n \"%s\": [", p->o->tree ? "tree" : p->o->nodes ? "nodes" : "chunks");
}

/* Which chunk of cells, for a chunk of voxels. */
static bool place_of(const printer *p, const pbs_chunk *c, pbs_voxel_place *place) {
    pbs_voxels v;
    pbs_chunk one = *c;
    if (c->tag != PBS_TAG_VOXELS || !p->voxels) return false;
    if (!one.payload) one.payload = pbs_reader_peek(p->r, c); /* NULL where it is packed */
    return one.payload && !pbs_voxels_view("", p->voxels, &one, one.first, place, &v, NULL);
}

/* The name of an animation, or its beginning; false: the chunk is none, or damaged. */
static bool name_of(const printer *p, const pbs_chunk *c, char out[200]) {
    const uint8_t *at = c->payload ? c->payload : pbs_reader_peek(p->r, c);
    if (c->tag != PBS_TAG_ANIMATION || c->stored < 8 || !at) return false;
    snprintf(out, 200, "%.*s", (int)(c->stored < 200 ? c->stored - 8 : 192), (const char *)at + 8);
    return true;
}

static void print_chunk(const printer *p, const pbs_chunk *c) {
    char tag[5], node[16] = "-";
    pbs_voxel_place at;
    char name[200];
    bool has_place = place_of(p, c, &at), has_name = name_of(p, c, name);
    double step = c->tag == PBS_TAG_MESH ? pbs_mesh_flags_step(c->flags) : 0;
    pbs_tag_text(c->tag, tag);
    if (c->node != UINT32_MAX) snprintf(node, sizeof node, "%u", c->node);
    if (!p->o->json) {
        if (!p->chunks)
            printf("%12s  tag   %8s %10s %10s %12s  crc\n", "offset", "node", "first", "count",
                   "bytes");
        printf("%12" PRIu64 "  %s  %8s %10u %10u %12" PRIu64 "  %08x", c->offset, tag, node,
               c->first, c->count, c->stored, c->crc);
        if (c->codec && c->codec < PBS_CODECS) printf("  %s", pbs_codec_name[c->codec]);
        if (has_place)
            printf("  level %u, %u %u %u", at.level, at.chunk[0], at.chunk[1], at.chunk[2]);
        if (has_name) printf("  "), print_clean(name, false);
        if (step > 0) printf("  lattice %.9g, error up to %.9g", step, step / 2);
        printf("\n");
        return;
    }
    printf("%s\n  {\"offset\": %" PRIu64 ", \"tag\": ", p->chunks ? "," : "", c->offset);
    pbs_print_json_text(tag, 4);
    printf(", \"node\": %s, \"first\": %u, \"count\": %u, \"bytes\": %" PRIu64 ", \"crc\": %u",
           c->node == UINT32_MAX ? "null" : node, c->first, c->count, c->stored, c->crc);
    if (c->codec && c->codec < PBS_CODECS) printf(", \"codec\": \"%s\"", pbs_codec_name[c->codec]);
    if (has_place)
        printf(", \"level\": %u, \"cells\": [%u, %u, %u]", at.level, at.chunk[0], at.chunk[1],
               at.chunk[2]);
    if (has_name) printf(", \"name\": "), pbs_print_json_text(name, strlen(name));
    if (step > 0) printf(", \"lattice\": %.9g, \"axis_error\": %.9g", step, step / 2);
    printf("}");
}

static void print_box(const pbs_box *b) {
    if (pbs_box_is_empty(b))
        printf("null");
    else
        printf("[%.9g, %.9g, %.9g, %.9g, %.9g, %.9g]", b->min[0], b->min[1], b->min[2], b->max[0],
               b->max[1], b->max[2]);
}

static void print_node(const printer *p, const pbs_node *n) {
    if (p->o->json) {
        printf("%s\n  {\"id\": %u, \"name\": ", p->nodes ? "," : "", n->id);
        pbs_print_json_text(n->name, strlen(n->name));
        printf(", \"children\": %u, \"triangles\": %" PRIu64 ", \"records\": %" PRIu64
               ", \"covering\": %.9g, \"box\": ",
               n->child_count, n->triangles, n->records, n->covering);
        print_box(&n->box);
        printf("}");
        return;
    }
    if (!p->nodes)
        printf("%8s %8s %12s %10s %12s  box, name\n", "node", "children", "triangles", "records",
               "covering");
    printf("%8u %8u %12" PRIu64 " %10" PRIu64 " %12.6g  ", n->id, n->child_count, n->triangles,
           n->records, n->covering);
    print_box(&n->box);
    printf("  ");
    print_clean(n->name, false);
    printf("\n");
}

/* ---- the tree of placings ---- */

typedef struct step {
    uint32_t node, next; /* child to print next */
} step;

static void print_placing(printer *p, const pbs_node *n, const pbs_child *c, size_t depth) {
    const char *name = c && c->name && *c->name ? c->name : n->name;
    bool moves = c && c->flags & PBS_CHILD_MOVES;
    if (p->o->json) {
        printf("%s\n  {\"depth\": %zu, \"node\": %u, \"name\": ", p->printed++ ? "," : "", depth,
               n->id);
        pbs_print_json_text(name, strlen(name));
        printf(", \"moves\": %s, \"triangles\": %" PRIu64 ", \"records\": %" PRIu64 "}",
               moves ? "true" : "false", n->triangles, n->records);
        return;
    }
    if (!p->printed++) printf("%8s %12s %10s  name\n", "node", "triangles", "records");
    printf("%8u %12" PRIu64 " %10" PRIu64 "  %*s", n->id, n->triangles, n->records,
           (int)(2 * (depth < 500 ? depth : 500)), "");
    print_clean(*name ? name : "-", false);
    printf("%s\n", moves ? " (moves)" : "");
}

/* Every placing, below its parent. */
static pbs_code print_tree(printer *p, pbs_err *err) {
    step *s = NULL;
    size_t depth = 0, cap = 0;
    pbs_code rc = p->nodes ? pbs_grow(p->run, &s, &cap, 1, sizeof *s, "the tree", err) : PBS_OK;
    if (rc || !p->nodes) return rc;
    s[depth++] = (step){(uint32_t)p->nodes - 1, 0};
    print_placing(p, &p->node[p->nodes - 1], NULL, 0);
    while (depth && !rc) {
        const pbs_node *n = &p->node[s[depth - 1].node];
        uint32_t k = s[depth - 1].next++;
        if (k == n->child_count) {
            depth--;
            continue;
        }
        print_placing(p, &p->node[n->children[k].node], &n->children[k], depth);
        rc = pbs_grow(p->run, &s, &cap, depth + 1, sizeof *s, "the tree", err);
        if (!rc) s[depth++] = (step){n->children[k].node, 0};
        if (!rc && p->printed % 1024 == 0) rc = pbs_run_check(p->run, err);
    }
    pbs_free(p->run, s);
    return rc;
}

/* ---- walking ---- */

static pbs_code take(printer *p, const pbs_chunk *c, pbs_err *err) {
    if (!p->o->nodes && !p->o->tree) {
        print_chunk(p, c);
        p->chunks++;
        return PBS_OK;
    }
    if (c->tag != PBS_TAG_NODE) return PBS_OK;
    pbs_node n;
    pbs_code rc = pbs_node_read(p->run, pbs_reader_name(p->r), c, (uint32_t)p->nodes, &n, err);
    if (rc) return rc;
    if (p->o->tree) {
        rc = pbs_grow(p->run, &p->node, &p->room, p->nodes + 1, sizeof n, "the nodes", err);
        if (!rc) p->node[p->nodes++] = n;
        if (rc) pbs_node_free(p->run, &n);
        return rc;
    }
    print_node(p, &n);
    p->nodes++;
    pbs_node_free(p->run, &n);
    return PBS_OK;
}

/* A file is listed from its directory, without reading the data: any size takes no time. */
static pbs_code walk_directory(printer *p, pbs_err *err) {
    const pbs_chunk *e;
    size_t n;
    pbs_code rc = pbs_reader_directory(p->r, &e, &n, err);
    for (size_t i = 0; i < n && !rc; i++) {
        pbs_chunk c = e[i];
        if ((p->o->nodes || p->o->tree) && c.tag == PBS_TAG_NODE)
            rc = pbs_reader_at(p->r, &e[i], &c, err);
        if (!rc) rc = take(p, &c, err);
    }
    return rc;
}

static pbs_code walk_stream(printer *p, pbs_err *err) {
    for (;;) {
        pbs_chunk c;
        bool end;
        pbs_code rc = pbs_reader_next(p->r, &c, &end, err);
        if (rc || end) return rc;
        if ((rc = take(p, &c, err))) return rc;
    }
}

/* 0: none, or none that are known. */
static uint32_t voxel_channels(const pbs_reader *r) {
    pbs_record points;
    uint32_t voxels = 0;
    const char *text = pbs_reader_channels(r);
    if (pbs_reader_kind(r) == PBS_VOXELS)
        return pbs_voxels_parse("", text, &voxels, NULL) ? 0 : voxels;
    if (pbs_reader_kind(r) != PBS_ARCHIVE) return 0;
    return pbs_archive_parse("", text, &points, &voxels, NULL) ? 0 : voxels;
}

static pbs_code print_file(pbs_app *app, const options *o, const char *path, pbs_err *err) {
    printer p = {.run = &app->run, .o = o};
    pbs_code rc = pbs_reader_open_path(&app->run, path, (1u << PBS_KINDS) - 1, &p.r, err);
    if (rc) return rc;
    print_header(&p);
    p.voxels = voxel_channels(p.r);
    rc = pbs_reader_mapped(p.r) ? walk_directory(&p, err) : walk_stream(&p, err);
    if (!rc && o->tree) rc = print_tree(&p, err);
    if (!rc && o->json) printf("]}\n");
    for (uint64_t i = 0; o->tree && i < p.nodes; i++) pbs_node_free(p.run, &p.node[i]);
    pbs_free(p.run, p.node);
    pbs_reader_close(p.r);
    return rc;
}

static pbs_code check_file(pbs_app *app, const options *o, const char *path, pbs_err *err) {
    pbs_input in;
    pbs_checked c;
    char name[sizeof in.name];
    pbs_code rc = pbs_input_open(&app->run, path, &in, err);
    if (rc) return rc;
    memcpy(name, in.name, sizeof name);
    if ((rc = pbs_check_file(&app->run, &in, &c, err))) return rc;
    if (o->json) {
        printf("{\"file\": ");
        pbs_print_json_text(name, strlen(name));
        printf(", \"ok\": true, \"nodes\": %" PRIu64 ", \"chunks\": %" PRIu64
               ", \"records\": %" PRIu64 ", \"bytes\": %" PRIu64 "}\n",
               c.nodes, c.chunks, c.records, c.bytes);
    } else {
        print_clean(name, false);
        printf(": ok: %" PRIu64 " nodes, %" PRIu64 " chunks, %" PRIu64 " records, %" PRIu64
               " bytes\n",
               c.nodes, c.chunks, c.records, c.bytes);
    }
    return PBS_OK;
}

static pbs_code work(pbs_app *app, void *opt, pbs_err *err) {
    const options *o = opt;
    int n = app->common.operand_count ? app->common.operand_count : 1;
    pbs_code rc = PBS_OK;
    for (int i = 0; i < n && rc != PBS_CANCEL; i++) {
        pbs_err bad = {0};
        const char *path = pbs_operand(app, i);
        if (!(o->check ? check_file : print_file)(app, o, path, &bad)) continue;
        /* One bad file does not hide the others; the last error is the program's. */
        if (rc) fprintf(stderr, "%s: %s\n", tool.name, err->text);
        *err = bad;
        rc = bad.code;
    }
    return rc;
}

int main(int argc, char **argv) {
    options o = {0};
    return pbs_tool_main(argc, argv, &tool, &o, work);
}
