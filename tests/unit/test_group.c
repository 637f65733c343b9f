/* Flat lists become groups: everything is in one of them or at the top, once and in order; groups
 * are neither small nor light. */
#include "formats/scene/group.h"
#include "tests/unit/support.h"
#include "tests/check.h"

static pbs_run run = {.threads = 1};
static pbs_err err;

static double noise(uint64_t *seed) {
    return (double)random_bits(seed) / 0x1p32;
}

typedef struct group_test {
    pbs_group_item item[4000];
    uint32_t count, groups;
    uint64_t triangles[4000]; /* of groups */
    uint32_t items[4000], most;
    bool seen[8000], wrong;
} group_test;

static pbs_code note_group(void *ctx, const uint32_t *ref, size_t n, pbs_err *e) {
    group_test *t = ctx;
    (void)e;
    t->wrong |= n < 2;
    t->most = n > t->most ? (uint32_t)n : t->most;
    t->triangles[t->groups] = t->items[t->groups] = 0;
    for (size_t i = 0; i < n; i++) {
        bool item = ref[i] < t->count;
        t->wrong |= t->seen[ref[i]] || (i && ref[i] <= ref[i - 1]);
        t->wrong |= ref[i] >= t->count + t->groups;
        t->seen[ref[i]] = true;
        t->wrong |= item && (t->item[ref[i]].apart || pbs_box_is_empty(&t->item[ref[i]].box));
        t->triangles[t->groups] +=
            item ? t->item[ref[i]].triangles : t->triangles[ref[i] - t->count];
        t->items[t->groups] += item ? 1 : t->items[ref[i] - t->count];
    }
    t->wrong |= t->triangles[t->groups] < 1000 || t->items[t->groups] <= 8;
    t->groups++;
    return PBS_OK;
}

static size_t group_them(group_test *t, uint64_t limit) {
    pbs_grouping g = {t->item, t->count, limit, t, note_group};
    uint32_t *top;
    size_t n;
    t->groups = t->most = 0, t->wrong = false;
    memset(t->seen, 0, sizeof t->seen);
    must(pbs_group(&run, &g, &top, &n, &err), &err);
    for (size_t i = 0; i < n; i++) {
        t->wrong |= t->seen[top[i]] || (i && top[i] <= top[i - 1]);
        t->seen[top[i]] = true;
    }
    for (uint32_t i = 0; i < t->count + t->groups; i++) t->wrong |= !t->seen[i];
    for (uint32_t i = 0, k = 0; i < t->count; i++) {
        bool stays = t->item[i].apart || pbs_box_is_empty(&t->item[i].box);
        while (k < n && top[k] < i) k++;
        t->wrong |= stays && (k == n || top[k] != i);
    }
    CHECK(!t->wrong);
    pbs_free(&run, top);
    CHECK(pbs_mem_used(&run) == 0);
    return n;
}

static void put_item(group_test *t, const double at[3], double size, uint64_t triangles) {
    pbs_group_item *item = &t->item[t->count++];
    memset(item, 0, sizeof *item);
    for (int k = 0; k < 3; k++)
        item->box.min[k] = at[k] - size / 2, item->box.max[k] = at[k] + size / 2;
    item->triangles = triangles;
}

static group_test gt;

/* Eight clusters in the corners of a cube; what they hold decides whether each is a group. */
TEST(clusters_become_groups) {
    uint64_t seed = 5;
    gt.count = 0;
    put_item(&gt, (double[3]){50, 50, 50}, 60, 100000); /* larger than half the cell */
    for (int c = 0; c < 8; c++) {
        int items = c == 1 ? 8 : 30;
        for (int i = 0; i < items; i++) {
            double at[3];
            for (int k = 0; k < 3; k++) at[k] = (c >> k & 1) * 90 + 10 * noise(&seed);
            put_item(&gt, at, 1, c == 1 ? 1000 : c == 2 ? 33 : 100);
        }
    }
    gt.item[100].apart = true;
    gt.item[150].box = PBS_BOX_EMPTY;
    CHECK(group_them(&gt, 32) == 1 + 8 + 30 + 6 + 2 && gt.groups == 6);
    CHECK(group_them(&gt, 1000) == gt.count && gt.groups == 0);
}

TEST(groups_of_many) {
    uint64_t seed = 9;
    for (int kind = 0; kind < 4; kind++) {
        gt.count = 0;
        while (gt.count < 4000) {
            double at[3];
            for (int k = 0; k < 3; k++) {
                at[k] = noise(&seed);
                if (kind == 1) at[k] = exp(40 * at[k]);           /* clustered */
                if (kind == 2) at[k] = k ? 1e300 : 1e300 * at[k]; /* flat, and large */
                if (kind == 3) at[k] = 7;
            }
            put_item(&gt, at, kind == 2 ? 1e297 : 0.01, random_bits(&seed) % 500);
            gt.item[gt.count - 1].apart = random_bits(&seed) % 100 == 0;
        }
        gt.item[7].box.max[1] = INFINITY, gt.item[8].box.min[0] = NAN;
        size_t top = group_them(&gt, 32);
        CHECK_NUM(kind == 3 || (gt.groups > 20 && top < 300 && gt.most < 300), top);
        CHECK_NUM(kind != 0 || gt.most <= 72, gt.most);
        CHECK_NUM(kind != 3 || gt.groups == 0, gt.groups);
    }
}

TEST_MAIN
