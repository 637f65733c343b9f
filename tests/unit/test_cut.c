/* What the player draws of a hierarchy: profiles of spacings, prefixes, voxels, what is hidden, and
 * what is asked for. */
#include "cmd/pbs-view/plan/cut.h"
#include "cmd/pbs-view/plan/hidden.h"
#include "libcore/data/quant.h"
#include "tests/check.h"

static uint64_t state = 88172645463325252u;
static pbs_run run = {.threads = 1};
static pbs_err err;

static double uniform(double low, double high) {
    state ^= state << 13, state ^= state >> 7, state ^= state << 17;
    return low + (high - low) * (double)(state >> 11) / 9007199254740992.0;
}

/* ---- profiles ---- */

enum { MOST = 500 };
static uint8_t records[MOST][12];

static double spacing_of(const pbs_spacings *s, uint32_t i) {
    const uint8_t *p = s->first + i * s->stride;
    return s->unit * (double)pbs_half_get((uint16_t)(p[0] | p[1] << 8));
}

/* Records of 12 bytes whose spacings fall from half to half. */
static pbs_spacings random_spacings(uint32_t count) {
    uint16_t h = 0x7000;
    for (uint32_t i = 0; i < count; i++) {
        h = (uint16_t)(h - (uint16_t)uniform(0, 40));
        records[i][6] = (uint8_t)h, records[i][7] = (uint8_t)(h >> 8);
    }
    return (pbs_spacings){records[0] + 6, 12, count, 0.25, 0, 0};
}

/* Covering radius of a prefix, from all spacings. */
static double exact(const pbs_spacings *s, uint32_t p) {
    return s->slack + (p < s->count      ? spacing_of(s, p)
                       : s->covering > 0 ? s->covering
                                         : spacing_of(s, s->count - 1));
}

TEST(profiles_are_never_coarser_than_asked) {
    for (int i = 0; i < 400; i++) {
        pbs_spacings s = random_spacings(1 + (uint32_t)uniform(0, MOST - 1));
        pbs_profile p;
        s.slack = i % 2 ? 0.7 : 0;
        pbs_profile_make(&s, &p);
        double step = pow(p.first / p.last, 1.0 / (PBS_PROFILE_STEPS - 1)) * (1 + 1e-9);
        for (int k = 0; k < 20; k++) {
            double wanted = exact(&s, 1) * pow(10, uniform(-3, 0.5));
            uint32_t got = pbs_profile_prefix(&p, wanted), want = 1, finer = 1;
            while (want < s.count && !(exact(&s, want) <= wanted)) want++;
            while (finer < s.count && !(exact(&s, finer) - s.slack <= (wanted - s.slack) / step))
                finer++;
            CHECK_NUM(got >= want, got);
            CHECK_NUM(got <= finer, got);
            CHECK(got == s.count || pbs_profile_radius(&p, got) <= wanted * (1 + 1e-9));
        }
        for (uint32_t q = 1; q < s.count; q++) {
            double r = pbs_profile_radius(&p, q), e = exact(&s, q);
            CHECK_NUM(r >= e * (1 - 1e-9), r / e);
            CHECK_NUM(r - s.slack <= (e - s.slack) * step, r / e);
            CHECK(r >= pbs_profile_radius(&p, q + 1) * (1 - 1e-12));
        }
        CHECK(pbs_profile_radius(&p, 0) == pbs_profile_radius(&p, 1));
        CHECK(pbs_profile_radius(&p, s.count) == exact(&s, s.count));
        CHECK(pbs_profile_radius(&p, s.count + 5) == exact(&s, s.count));
    }
}

TEST(profiles_of_odd_spacings) {
    pbs_spacings none = {.stride = 2, .unit = 1};
    pbs_profile p;
    pbs_profile_make(&none, &p);
    CHECK(pbs_profile_prefix(&p, 1) == 0 && pbs_profile_radius(&p, 3) == 0);
    CHECK(pbs_profile_adding(&p, 1) == 0);
    const uint16_t odd[][4] = {{0, 0, 0, 0},
                               {0xffff, 0x7bff, 0xfbff, 0},
                               {0x7bff, 0, 0, 0},
                               {0, 1, 2, 3},
                               {0xfbff, 0xfbff, 0xfbff, 0xfbff}};
    for (size_t i = 0; i < sizeof odd / sizeof *odd; i++) {
        pbs_spacings s = {(const uint8_t *)odd[i], 2, 4, 1, 0, 0};
        pbs_profile_make(&s, &p);
        for (double r = 1e-9; r < 1e9; r *= 7) {
            CHECK(pbs_profile_prefix(&p, r) >= 1 && pbs_profile_prefix(&p, r) <= 4);
            CHECK(pbs_profile_adding(&p, r) <= 4);
            CHECK(pbs_profile_radius(&p, 2) >= 0);
        }
        CHECK(pbs_profile_prefix(&p, -1) == 4 && pbs_profile_prefix(&p, NAN) == 4);
    }
}

/* Equal spacings are one level: all of it or none. */
TEST(levels_that_add_are_whole) {
    const uint16_t half[] = {0x4000, 0x4000, 0x3c00, 0x3c00, 0x3c00, 0x3800}; /* 2 1 1/2 */
    const double radius[] = {5, 4, 3, 2, 1.5, 1, 1e-9, 0};
    const uint32_t prefix[] = {0, 2, 2, 5, 5, 6, 6, 6};
    pbs_spacings s = {(const uint8_t *)half, 2, 6, 2, 0, 0}, level = s;
    pbs_profile p;
    pbs_profile_make(&s, &p);
    for (size_t i = 0; i < sizeof radius / sizeof *radius; i++)
        CHECK_NUM(pbs_profile_adding(&p, radius[i]) == prefix[i], radius[i]);
    level.count = 2;
    pbs_profile_make(&level, &p);
    CHECK(pbs_profile_adding(&p, 4) == 2 && pbs_profile_adding(&p, 4.001) == 0);
}

TEST(the_papers_formula) {
    pbs_node n = {.records = 5000, .median = 0.25, .median_count = 1000}, unknown = {.records = 9};
    CHECK(pbs_formula_prefix(&n, 0.25) == 1000 && pbs_formula_prefix(&n, 0.125) == 4000);
    CHECK(pbs_formula_prefix(&n, 0.01) == 5000 && pbs_formula_prefix(&n, 1e9) == 1);
    CHECK(pbs_formula_prefix(&n, 0) == 5000 && pbs_formula_prefix(&unknown, 1) == 0);
    for (uint32_t p = 1; p < 5000; p += 7) {
        uint32_t back = pbs_formula_prefix(&n, pbs_formula_radius(&n, p) * (1 + 1e-9));
        CHECK_NUM(back == p, back);
    }
}

TEST(hidden_is_a_set) {
    pbs_hidden h = {0};
    bool in[2000] = {0};
    size_t count = 0;
    for (int i = 0; i < 20000; i++) {
        uint64_t k = (uint64_t)uniform(1, 1999);
        if (uniform(0, 1) < 0.5)
            count += !in[k], in[k] = true, pbs_hidden_add(&run, &h, k * 0x10000000000u, &err);
        else
            count -= in[k], in[k] = false, pbs_hidden_remove(&h, k * 0x10000000000u);
        CHECK(h.count == count);
        uint64_t j = (uint64_t)uniform(1, 1999);
        CHECK(pbs_hidden_has(&h, j * 0x10000000000u) == in[j]);
    }
    pbs_hidden_clear(&h);
    CHECK(!pbs_hidden_has(&h, 0x10000000000u) && h.count == 0);
    pbs_hidden_free(&run, &h);
}

/* ---- a hierarchy ---- */

enum { NODES = 1 + 8 + 64, LEVELS = 3, SPACINGS = 4096 };

/* An octree of the unit cube, three levels; node ids from the leaves to the root. */
typedef struct tree {
    pbs_node nodes[NODES];
    pbs_child children[NODES];
    uint8_t has[NODES], resident[2 * NODES];
    uint64_t placings[NODES], moving[NODES];
    pbs_profile profiles[NODES], *profile[NODES];
    pbs_cut_scene scene;
    pbs_cut *cut;
    int level[NODES];
    uint32_t parent[NODES];
} tree;

static tree T;

static uint32_t add_node(uint32_t *next, uint32_t *child, const double low[3], int level) {
    uint32_t ids[8], count = 0;
    double side = ldexp(1, -level);
    if (level + 1 < LEVELS)
        for (int i = 0; i < 8; i++) {
            double at[3];
            for (int k = 0; k < 3; k++) at[k] = low[k] + (i >> k & 1) * side / 2;
            ids[count++] = add_node(next, child, at, level + 1);
        }
    uint32_t id = (*next)++;
    pbs_node *n = &T.nodes[id];
    *n = (pbs_node){.id = id, .records = SPACINGS, .triangles = 100, .lattice = side / 256};
    for (int k = 0; k < 3; k++) n->box.min[k] = low[k], n->box.max[k] = low[k] + side;
    n->child_count = count;
    n->children = &T.children[*child];
    for (uint32_t i = 0; i < count; i++) {
        T.children[*child] = (pbs_child){.node = ids[i]};
        memcpy(T.children[(*child)++].m, PBS_IDENTITY, sizeof PBS_IDENTITY);
        T.parent[ids[i]] = id;
    }
    T.level[id] = level;
    return id;
}

static void new_cut(void) {
    pbs_cut_free(T.cut);
    T.scene = (pbs_cut_scene){T.nodes, NODES, T.has, T.placings, T.moving, T.resident, T.profile};
    CHECK(pbs_cut_new(&run, &T.scene, &T.cut, &err) == PBS_OK);
}

/* Every node has `has`; spacings of 4096 surfels: half a side at first, a hundredth at last. */
static void grow_tree(uint8_t has, bool resident) {
    static uint16_t half[SPACINGS];
    uint32_t next = 0, child = 0;
    for (int i = 0; i < SPACINGS; i++)
        half[i] = pbs_half_put((float)fmin(0.5, 0.64 / sqrt(i + 1.0)));
    add_node(&next, &child, (double[3]){0, 0, 0}, 0);
    for (uint32_t i = 0; i < NODES; i++) {
        T.has[i] = has;
        T.moving[i] = 0;
        T.placings[i] = 1;
        for (uint32_t k = 0; k < T.nodes[i].child_count; k++)
            T.placings[i] += T.placings[T.nodes[i].children[k].node];
        pbs_spacings s = {(const uint8_t *)half, 2, SPACINGS, 256 * T.nodes[i].lattice, 0, 0};
        pbs_profile_make(&s, &T.profiles[i]);
        T.profile[i] = &T.profiles[i];
    }
    memset(T.resident, resident, sizeof T.resident);
    new_cut();
}

static pbs_cut_view look(double distance, double size) {
    pbs_cut_view v = {.width = 1024, .height = 768, .size = size};
    char text[100];
    snprintf(text, sizeof text, "%g,%g,%g,0.5,0.5,0.5", 0.5 + distance, 0.5 + 0.7 * distance,
             0.5 + 0.9 * distance);
    CHECK(pbs_camera_parse(&v.camera, text, &err) == PBS_OK);
    return v;
}

static pbs_cut_frame next_frame(const pbs_cut_view *v) {
    pbs_cut_frame f = {0};
    CHECK(pbs_cut_next(T.cut, v, &f, &err) == PBS_OK);
    return f;
}

/* How often a leaf is drawn: by itself or one above it. */
static int drawn(const pbs_cut_frame *f, uint32_t leaf, bool probes) {
    int n = 0;
    for (uint32_t id = leaf;; id = T.parent[id]) {
        for (size_t i = 0; i < f->draw_count; i++)
            n += f->draws[i].node == id && (f->draws[i].kind == PBS_CUT_PROBE) == probes;
        if (id == NODES - 1) return n;
    }
}

static bool in_sight(const pbs_cut_view *v, uint32_t id) {
    return pbs_cut_visible(&v->camera, 1024.0 / 768, &T.nodes[id].box, 0, PBS_IDENTITY);
}

TEST(voxels_are_as_fine_as_wanted_everywhere_once) {
    grow_tree(PBS_HAS_VOXELS, true);
    size_t most = 0, least = NODES;
    for (int i = 0; i < 200; i++) {
        pbs_cut_view v = look(pow(10, uniform(-1, 1)), pow(10, uniform(-0.5, 1)));
        pbs_cut_frame f = next_frame(&v);
        CHECK(f.missing == 0 && f.first[PBS_CUT_VOXELS] == 0);
        CHECK(f.first[PBS_CUT_KINDS] == f.draw_count && f.hidden == 0);
        for (uint32_t id = 0; id < NODES; id++)
            if (!T.nodes[id].child_count) {
                int n = drawn(&f, id, false);
                CHECK(n <= 1 && (n == 1 || !in_sight(&v, id)));
            }
        for (size_t k = 0; k < f.draw_count; k++) {
            const pbs_cut_draw *d = &f.draws[k];
            const pbs_node *n = &T.nodes[d->node];
            bool fine = pbs_cut_fine(&v.camera, v.height, d->depth, v.size, n->lattice, d->m);
            CHECK(fine || !n->child_count);
            CHECK(k == 0 || f.draws[k - 1].depth <= d->depth);
        }
        most = f.draw_count > most ? f.draw_count : most;
        least = f.draw_count < least ? f.draw_count : least;
    }
    CHECK(least == 1 && most > 30);
}

/* Whatever is there, a closed cut shows every place once, as long as the root is there; a partial
 * one at most once. What is missing is asked for, coarse first, near first, below what is there. */
TEST(streaming_policies) {
    grow_tree(PBS_HAS_VOXELS, true);
    int holes = 0, coarse = 0;
    for (int i = 0; i < 300; i++) {
        for (int id = 0; id < NODES - 1; id++)
            T.resident[2 * id] = uniform(0, 1) < 0.85 + 0.05 * (i % 3);
        pbs_cut_view v = look(pow(10, uniform(-0.3, 0.5)), 0.05);
        v.partial = i % 2;
        pbs_cut_frame f = next_frame(&v);
        for (uint32_t id = 0; id < NODES; id++)
            if (!T.nodes[id].child_count && in_sight(&v, id)) {
                int n = drawn(&f, id, false);
                CHECK(n == 1 || (v.partial && n == 0));
                holes += n == 0;
            }
        uint64_t missing = 0;
        for (size_t k = 0; k < f.need_count; k++) {
            const pbs_cut_need *n = &f.needs[k];
            uint32_t id = n->item / 2;
            missing += !T.resident[n->item];
            CHECK(n->level == (uint32_t)T.level[id] && n->item % 2 == 0);
            CHECK(id == NODES - 1 || T.resident[2 * T.parent[id]]);
            if (k == 0) continue;
            CHECK(n[-1].level < n->level || (n[-1].level == n->level && n[-1].depth <= n->depth));
        }
        CHECK(missing == f.missing);
        for (size_t k = 0; k < f.draw_count; k++) {
            CHECK(T.resident[2 * f.draws[k].node]);
            coarse += T.level[f.draws[k].node] == 1;
        }
    }
    CHECK_NUM(holes > 100, holes);
    CHECK_NUM(coarse > 100, coarse);
    T.resident[2 * (NODES - 1)] = 0;
    pbs_cut_view v = look(1, 1);
    pbs_cut_frame f = next_frame(&v);
    CHECK(f.draw_count == 0 && f.missing == 1 && f.needs[0].item == PBS_ITEM_OWN(NODES - 1));
}

/* A few leaves are seen. What is drawn is seen if one of them is below it. */
static pbs_cut_frame feed(const pbs_cut_view *v, const bool *leaf) {
    static uint32_t seen[NODES];
    pbs_cut_frame f = next_frame(v);
    for (size_t i = 0; i < f.draw_count; i++) {
        seen[i] = 0;
        for (uint32_t id = 0; id < NODES; id++) {
            uint32_t up = id;
            while (leaf[id] && up != f.draws[i].node && up != NODES - 1) up = T.parent[up];
            seen[i] |= leaf[id] && up == f.draws[i].node;
        }
    }
    CHECK(pbs_cut_feedback(T.cut, f.number, seen, f.draw_count, &err) == PBS_OK);
    return f;
}

TEST(hidden_branches_are_drawn_coarse_and_nothing_seen_is_lost) {
    for (int i = 0; i < 60; i++) {
        grow_tree(PBS_HAS_VOXELS, true);
        pbs_cut_view v = look(2.5, 0.03); /* all leaves are wanted */
        v.occlusion = true;
        size_t all = next_frame(&v).draw_count;
        for (int change = 0; change < 3; change++) {
            bool leaf[NODES] = {0};
            pbs_cut_frame f;
            uint32_t one = (uint32_t)uniform(0, 8) * 9;
            leaf[one] = true;
            /* As many frames as it takes to go down all levels, or to come up again. */
            for (int k = 0; k < 6 * LEVELS; k++) f = feed(&v, leaf);
            for (int k = 0; k < 6; k++) {
                f = feed(&v, leaf);
                CHECK(drawn(&f, one, false) == 1 && drawn(&f, one, true) == 0);
                for (uint32_t id = 0; id < NODES; id++)
                    if (!T.nodes[id].child_count)
                        CHECK(drawn(&f, id, false) + drawn(&f, id, true) == 1 || !in_sight(&v, id));
                CHECK(f.first[PBS_CUT_PROBE] + f.hidden == f.draw_count);
            }
            CHECK_NUM(all == 64 && f.draw_count == 15 && f.hidden == 7, f.draw_count);
        }
        v.occlusion = false;
        CHECK(next_frame(&v).draw_count == all);
    }
}

TEST(feedback_of_other_frames_is_ignored) {
    grow_tree(PBS_HAS_VOXELS, true);
    uint32_t none[NODES] = {0};
    pbs_cut_view v = look(2.5, 0.03);
    v.occlusion = true;
    pbs_cut_frame f = next_frame(&v);
    uint64_t old = f.number;
    CHECK(pbs_cut_feedback(T.cut, 0, none, NODES, &err) == PBS_OK);
    CHECK(pbs_cut_feedback(T.cut, old + 7, none, NODES, &err) == PBS_OK);
    CHECK(pbs_cut_feedback(T.cut, old, none, 3, &err) == PBS_OK); /* too few */
    for (int i = 0; i < 3; i++) f = next_frame(&v);
    CHECK(pbs_cut_feedback(T.cut, old, none, NODES, &err) == PBS_OK);
    f = next_frame(&v);
    CHECK(f.draw_count == 64 && f.hidden == 0);
    CHECK(pbs_cut_feedback(T.cut, f.number, none, NODES, &err) == PBS_OK);
    CHECK(next_frame(&v).hidden == 8);
}

TEST(geometry_takes_over_from_the_finest_voxels) {
    grow_tree(PBS_HAS_VOXELS, true);
    for (uint32_t id = 0; id < NODES; id++)
        if (!T.nodes[id].child_count) T.has[id] |= PBS_HAS_MESH;
    for (int i = 0; i < 50; i++) {
        pbs_cut_view v = look(uniform(0.5, 3), pow(10, uniform(-1, 0.5)));
        uint32_t leaf = (uint32_t)uniform(0, 8) * 9;
        T.resident[PBS_ITEM_MESH(leaf)] = i % 2;
        pbs_cut_frame f = next_frame(&v);
        for (size_t k = 0; k < f.draw_count; k++) {
            const pbs_cut_draw *d = &f.draws[k];
            const pbs_node *n = &T.nodes[d->node];
            bool fine = pbs_cut_fine(&v.camera, v.height, d->depth, v.size, n->lattice, d->m);
            bool mesh = !fine && !n->child_count && T.resident[PBS_ITEM_MESH(d->node)];
            CHECK((d->kind == PBS_CUT_MESH) == mesh);
            CHECK((k < f.first[PBS_CUT_VOXELS]) == mesh);
        }
        for (uint32_t id = 0; id < NODES; id++)
            if (!T.nodes[id].child_count && in_sight(&v, id)) CHECK(drawn(&f, id, false) == 1);
    }
}

/* ---- surfels ---- */

static const pbs_cut_draw *draw_of(const pbs_cut_frame *f, uint32_t node) {
    for (size_t i = 0; i < f->draw_count; i++)
        if (f->draws[i].node == node) return &f->draws[i];
    return NULL;
}

/* Of a node and what is below it, one closes the surface at any distance: it is drawn with all that
 * the camera wants. */
static bool closed(const pbs_cut_frame *f, const pbs_cut_view *v, uint32_t id) {
    const pbs_node *n = &T.nodes[id];
    const pbs_cut_draw *d = draw_of(f, id);
    if (!in_sight(v, id)) return true;
    double depth = pbs_cut_depth(&v->camera, 1024.0 / 768, &n->box, PBS_IDENTITY);
    double wanted = pbs_cut_wanted(&v->camera, v->height, depth, v->size, PBS_IDENTITY);
    if (d && d->prefix == pbs_profile_prefix(&T.profiles[id], wanted)) return true;
    bool all = n->child_count != 0;
    for (uint32_t k = 0; k < n->child_count; k++) all = all && closed(f, v, n->children[k].node);
    return all;
}

TEST(surfels_are_blended_without_a_hole) {
    grow_tree(PBS_HAS_SURFELS, true);
    int both = 0;
    uint64_t before = 0;
    for (int i = 0; i < 400; i++) {
        pbs_cut_view v = look(2, 16 * pow(0.98, i));
        pbs_cut_frame f = next_frame(&v);
        CHECK(closed(&f, &v, NODES - 1));
        both += draw_of(&f, NODES - 1) && f.draw_count > 1;
        /* Nothing jumps: a step of 2 % finer discs is at most so many more surfels. */
        CHECK_NUM(i == 0 || f.surfels < before * 1.6 + 64, (double)f.surfels / (double)before);
        before = f.surfels;
        for (size_t k = 0; k < f.draw_count; k++) CHECK(f.draws[k].kind == PBS_CUT_SURFELS);
    }
    CHECK_NUM(both > 15, both);
    pbs_cut_view v = look(2, 0.02);
    pbs_cut_frame f = next_frame(&v);
    CHECK(!draw_of(&f, NODES - 1) && f.surfels == 64 * SPACINGS);
    v.prefix = 77;
    f = next_frame(&v);
    CHECK(f.draw_count == 1 && f.surfels == 77);
}

TEST(surfels_stay_until_what_is_below_is_there) {
    grow_tree(PBS_HAS_SURFELS, true);
    uint32_t child = T.nodes[NODES - 1].children[3].node;
    T.resident[2 * child] = 0;
    pbs_cut_view v = look(2, 0.02);
    pbs_cut_frame f = next_frame(&v);
    CHECK(f.draw_count == 1 && f.surfels == SPACINGS && f.missing == 1 && f.need_count == 9);
    v.partial = true;
    f = next_frame(&v);
    CHECK(draw_of(&f, NODES - 1) && draw_of(&f, NODES - 1)->prefix == SPACINGS);
    CHECK_NUM(f.draw_count == 1 + 56, f.draw_count);
    /* A leaf that has nothing: what is above it stays, too. */
    grow_tree(PBS_HAS_SURFELS, true);
    T.has[0] = 0;
    new_cut();
    v.partial = false;
    f = next_frame(&v);
    CHECK_NUM(draw_of(&f, T.parent[0]) && f.draw_count == 1 + 56, f.draw_count);
    /* Its triangles will do. */
    T.has[0] = PBS_HAS_MESH;
    new_cut();
    f = next_frame(&v);
    CHECK(!draw_of(&f, T.parent[0]) && f.draw_count == 64 && f.first[PBS_CUT_VOXELS] == 1);
}

TEST(what_moves_is_placed_on_its_own) {
    grow_tree(PBS_HAS_SURFELS, true);
    pbs_node *root = &T.nodes[NODES - 1];
    uint32_t child = root->children[0].node;
    root->children[0].flags = PBS_CHILD_MOVES;
    T.moving[NODES - 1] = 1;
    pbs_cut_view v = look(2, 16);
    pbs_cut_frame f = next_frame(&v);
    CHECK(f.draw_count == 2 && draw_of(&f, NODES - 1) && draw_of(&f, child));
    v.size = 0.02;
    f = next_frame(&v);
    CHECK(f.draw_count == 64);
}

/* A pose takes the place of the placing's transform, also where it leads out of all boxes above. */
TEST(poses_are_where_things_are) {
    grow_tree(PBS_HAS_SURFELS, true);
    pbs_node *root = &T.nodes[NODES - 1];
    pbs_child *c = &root->children[0];
    double pose[2][12];
    c->flags = PBS_CHILD_MOVES, c->motion = 2;
    T.moving[NODES - 1] = 1;
    pbs_cut_view v = look(2, 16);
    memcpy(pose[1], c->m, sizeof pose[1]);
    pose[1][7] += 0.125;
    v.pose = (const double(*)[12])pose;
    pbs_cut_frame f = next_frame(&v);
    const pbs_cut_draw *d = draw_of(&f, c->node);
    CHECK(f.draw_count == 2 && d && d->m[7] == c->m[7] + 0.125 && d->m[3] == c->m[3]);
    /* Far out of the picture, and the picture there. */
    pose[1][3] += 1e4;
    f = next_frame(&v);
    CHECK(f.draw_count == 1 && !draw_of(&f, c->node));
    pbs_box there = pbs_xform_box(pose[1], &T.nodes[c->node].box);
    pbs_camera_frame(&v.camera, &there, &(pbs_camera_desc){0});
    f = next_frame(&v);
    CHECK(f.draw_count == 1 && draw_of(&f, c->node));
    v.pose = NULL;
    f = next_frame(&v);
    CHECK(f.draw_count == 0);
    c->motion = 0;
}

/* A thousand placings of one leaf need it once, at the nearest. */
TEST(instances_need_their_node_once) {
    grow_tree(PBS_HAS_VOXELS, true);
    pbs_child many[1000];
    pbs_node two[2] = {T.nodes[0], {.child_count = 1000, .children = many, .triangles = 1}};
    pbs_node *n = &two[1];
    uint8_t has[2] = {PBS_HAS_VOXELS, 0}, resident[4] = {1, 1, 1, 1};
    uint64_t placings[2] = {1, 1000}, moving[2] = {0, 0};
    pbs_profile *none[2] = {NULL, NULL};
    n->box = (pbs_box){{0, 0, 0}, {101, 1, 1}};
    for (int i = 0; i < 1000; i++) {
        many[i] = (pbs_child){.node = 0};
        memcpy(many[i].m, PBS_IDENTITY, sizeof many[i].m);
        many[i].m[3] = 0.1 * i;
    }
    pbs_cut_scene s = {two, 2, has, placings, moving, resident, none};
    pbs_cut *cut;
    pbs_cut_frame f;
    CHECK(pbs_cut_new(&run, &s, &cut, &err) == PBS_OK);
    pbs_cut_view v = {.width = 1000, .height = 1000, .size = 1};
    pbs_camera_frame(&v.camera, &n->box, &(pbs_camera_desc){0});
    CHECK(pbs_cut_next(cut, &v, &f, &err) == PBS_OK);
    CHECK(f.draw_count == 1000 && f.need_count == 1 && f.needs[0].depth == f.draws[0].depth);
    pbs_cut_free(cut);
    pbs_run full = {.threads = 1, .mem_limit = 4096};
    CHECK(pbs_cut_new(&full, &s, &cut, &err) == PBS_OK);
    CHECK(pbs_cut_next(cut, &v, &f, &err) == PBS_LIMIT);
    pbs_cut_free(cut);
    CHECK(pbs_mem_used(&full) == 0);
    pbs_cut_free(T.cut);
    T.cut = NULL;
}

TEST_MAIN
