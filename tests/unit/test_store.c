/* The store without a GL: a table of functions instead of buffers, and items that are their own
 * numbers. */
#include "cmd/pbs-view/plan/rooms.h"
#include "cmd/pbs-view/stream/store.h"
#include "tests/check.h"
#include <stdatomic.h>
#include <time.h>

static uint64_t state = 88172645463325252u;
static pbs_run run = {.threads = 1};
static pbs_err err;

static uint32_t below(uint32_t n) {
    state ^= state << 13, state ^= state >> 7, state ^= state << 17;
    return (uint32_t)(state >> 33) % n;
}

TEST(rooms_never_overlap_and_are_joined_again) {
    enum { SIZE = 64 * 256, MOST = 64 };
    static uint8_t taken[SIZE];
    struct {
        uint64_t at, size;
    } have[MOST] = {{0, 0}};
    pbs_rooms r;
    memset(taken, 0, sizeof taken);
    CHECK(pbs_rooms_new(&run, SIZE, &r, &err) == PBS_OK);
    for (int i = 0; i < 20000; i++) {
        uint32_t k = below(MOST);
        if (have[k].size) {
            CHECK(pbs_rooms_give(&run, &r, have[k].at, have[k].size, &err) == PBS_OK);
            memset(taken + have[k].at, 0, have[k].size);
            have[k].size = 0;
        } else {
            uint64_t size = 1 + below(2000);
            if (!pbs_rooms_take(&r, size, &have[k].at)) continue;
            have[k].size = size;
            CHECK(have[k].at % PBS_ROOM_ALIGN == 0 && have[k].at + size <= SIZE);
            for (uint64_t b = 0; b < size; b++) CHECK(!taken[have[k].at + b]);
            memset(taken + have[k].at, 1, size);
        }
    }
    for (int k = 0; k < MOST; k++)
        if (have[k].size) pbs_rooms_give(&run, &r, have[k].at, have[k].size, &err);
    uint64_t at;
    CHECK(r.used == 0 && r.count == 1 && pbs_rooms_take(&r, SIZE, &at) && at == 0);
    CHECK(!pbs_rooms_take(&r, 1, &at));
    pbs_rooms_free(&run, &r);
}

/* ---- a GPU and an archive of sorts ---- */

enum { ITEMS = 200, BUFFERS = 64 };

static uint64_t bytes[ITEMS];
static uint8_t *buffer[BUFFERS];
static uint64_t buffer_size[BUFFERS], in_buffers, most_in_buffers, filled;
static uint64_t gpu_has;        /* make fails beyond */
static uint32_t loaded[100000]; /* in this order */
static _Atomic size_t loads;
static uint32_t bad; /* an item that is damaged */
static double slow;  /* seconds an item */
static size_t apart; /* items from here on are textures, of which nobody knew how large they are */
static uint64_t expected[ITEMS];

static bool make(void *ctx, uint64_t size, uint32_t *out) {
    (void)ctx;
    if (in_buffers + size > gpu_has) return false;
    for (uint32_t i = 1; i < BUFFERS; i++)
        if (!buffer[i]) {
            buffer[i] = malloc(size);
            buffer_size[i] = size;
            in_buffers += size;
            most_in_buffers = in_buffers > most_in_buffers ? in_buffers : most_in_buffers;
            *out = i;
            return true;
        }
    return false;
}

static void fill(void *ctx, uint32_t id, uint64_t at, const void *from, uint64_t size) {
    (void)ctx;
    CHECK(buffer[id] && at + size <= buffer_size[id]);
    memcpy(buffer[id] + at, from, size);
    filled += size;
}

static void drop(void *ctx, uint32_t id) {
    (void)ctx;
    CHECK(buffer[id] != NULL);
    in_buffers -= buffer_size[id];
    free(buffer[id]);
    buffer[id] = NULL;
}

static bool make_apart(void *ctx, uint32_t item, uint64_t size, uint32_t *out) {
    CHECK(item >= apart && size >= bytes[item] && size < bytes[item] + 256);
    return make(ctx, size, out);
}

static void fill_apart(void *ctx, uint32_t item, uint32_t id, uint64_t at, const void *from,
                       uint64_t size) {
    CHECK(item >= apart && at % 4 == 0 && size % 4 == 0 && at + size <= bytes[item]);
    fill(ctx, id, at, from, size);
}

static void drop_apart(void *ctx, uint32_t id, uint64_t size) {
    CHECK(buffer_size[id] == size);
    drop(ctx, id);
}

static pbs_code load(void *ctx, uint32_t item, pbs_blob *out, pbs_err *e) {
    (void)ctx;
    if (slow > 0) nanosleep(&(struct timespec){0, (long)(slow * 1e9)}, NULL);
    loaded[atomic_fetch_add(&loads, 1)] = item;
    if (item == bad) return pbs_fail(e, PBS_DATA, "item %u is damaged", item);
    out->size = (size_t)bytes[item];
    pbs_code rc = pbs_alloc(&run, &out->bytes, out->size, 1, "an item", e);
    if (!rc) memset(out->bytes, (int)(item & 255), out->size);
    return rc;
}

/* Items that are larger than a buffer have parts of 10 MB and what is left, where they may. */
static bool dividing;
static uint64_t part(void *ctx, uint32_t item, uint32_t k) {
    const uint64_t each = 10000000, from = k * each;
    (void)ctx;
    if (!dividing || from >= bytes[item]) return 0;
    return bytes[item] - from < each ? bytes[item] - from : each;
}

static pbs_store *new_store(uint64_t gpu, uint64_t upload, uint64_t host, bool threaded) {
    pbs_store_desc d = {ITEMS, apart ? expected : bytes, gpu, 1 << 24, upload, host, threaded,
                        apart};
    pbs_store_source source = {NULL, load, part};
    pbs_store_gpu table = {NULL, make, fill, drop, make_apart, fill_apart, drop_apart};
    pbs_store *s;
    gpu_has = UINT64_MAX, bad = UINT32_MAX, slow = 0;
    most_in_buffers = filled = 0;
    atomic_store(&loads, 0);
    CHECK(pbs_store_new(&run, &d, &source, &table, &s, &err) == PBS_OK);
    return s;
}

static void end(pbs_store *s) {
    pbs_store_free(s, true);
    CHECK(in_buffers == 0);
    CHECK_NUM(pbs_mem_used(&run) == 0, pbs_mem_used(&run));
}

static void sizes(uint64_t least, uint32_t more) {
    for (int i = 0; i < ITEMS; i++) bytes[i] = least + (more ? below(more) : 0);
}

static size_t needs_from(pbs_cut_need *n, uint32_t first, uint32_t count) {
    for (uint32_t i = 0; i < count; i++) n[i] = (pbs_cut_need){first + i, i, i};
    return count;
}

/* What is resident has its own bytes, whatever was let go and moved around it. */
static uint64_t check_bytes(const pbs_store *s) {
    uint64_t sum = 0;
    for (uint32_t i = 0; i < ITEMS; i++) {
        if (!pbs_store_resident(s)[i]) continue;
        pbs_region r = pbs_store_where(s, i, 0);
        CHECK(r.size == bytes[i] && r.at % 256 == 0);
        const uint8_t *p = buffer[r.buffer] + r.at;
        CHECK(p[0] == (i & 255) && p[r.size / 2] == (i & 255) && p[r.size - 1] == (i & 255));
        sum += r.size;
    }
    CHECK(sum <= pbs_store_measure(s).resident);
    return sum;
}

TEST(items_come_in_the_order_of_the_needs) {
    pbs_cut_need n[3] = {{7, 0, 1}, {3, 1, 1}, {5, 1, 2}};
    bool busy;
    sizes(1000, 0);
    pbs_store *s = new_store(1 << 20, 0, 1 << 20, false);
    CHECK(pbs_store_frame(s, n, 3, &busy, &err) == PBS_OK && busy);
    CHECK(loads == 3 && loaded[0] == 7 && loaded[1] == 3 && loaded[2] == 5);
    CHECK(pbs_store_frame(s, n, 3, &busy, &err) == PBS_OK && !busy);
    CHECK(pbs_store_resident(s)[7] && pbs_store_resident(s)[3] && pbs_store_resident(s)[5]);
    CHECK(check_bytes(s) == 3000 && loads == 3);
    CHECK(pbs_store_frame(s, NULL, 0, &busy, &err) == PBS_OK && !busy && check_bytes(s) == 3000);
    end(s);
}

TEST(uploads_are_limited) {
    pbs_cut_need n[4];
    size_t count = needs_from(n, 0, 4);
    bool busy = true;
    sizes(1000, 0);
    pbs_store *s = new_store(1 << 20, 300, 1 << 20, false);
    for (int frame = 0; busy && frame < 100; frame++) {
        CHECK(pbs_store_frame(s, n, count, &busy, &err) == PBS_OK);
        CHECK(pbs_store_measure(s).uploaded_last <= 300);
        for (int i = 1; i < 4; i++) CHECK(pbs_store_resident(s)[i - 1] >= pbs_store_resident(s)[i]);
    }
    CHECK(check_bytes(s) == 4000 && pbs_store_measure(s).uploaded == 4000 && filled == 4000);
    end(s);
}

/* A window of needs moves over all items. */
TEST(limits_hold_and_what_was_unused_for_longest_goes) {
    pbs_cut_need n[ITEMS];
    bool busy;
    sizes(20000, 60000);
    pbs_store *s = new_store(2000000, 0, 200000, false);
    for (uint32_t first = 0; first + 12 < ITEMS; first++) {
        size_t count = needs_from(n, first, 12);
        for (int k = 0; k < 8; k++) {
            CHECK(pbs_store_frame(s, n, count, &busy, &err) == PBS_OK);
            check_bytes(s);
            CHECK(in_buffers <= 2000000);
        }
        for (uint32_t i = first; i < first + 12; i++) CHECK_NUM(pbs_store_resident(s)[i], i);
        CHECK(!busy);
        /* Of those that went no one was used later than one that stayed. */
        bool gone = false;
        for (uint32_t i = first; i-- > 0;) {
            if (gone && first > 30) CHECK(i + 8 < first || pbs_store_resident(s)[i]);
            gone = gone || !pbs_store_resident(s)[i];
        }
    }
    pbs_store_stats t = pbs_store_measure(s);
    CHECK(t.evicted > 100 && most_in_buffers > 1500000 && t.host_peak <= 200000);
    end(s);
}

/* More is needed than there is room for: the first 95 % come, nothing thrashes, and it ends. */
TEST(more_than_fits_comes_to_rest) {
    pbs_cut_need n[ITEMS];
    size_t count = needs_from(n, 0, ITEMS);
    bool busy = true;
    sizes(20000, 60000);
    pbs_store *s = new_store(2000000, 100000, 200000, false);
    int frames = 0;
    for (; busy && frames < 2000; frames++)
        CHECK(pbs_store_frame(s, n, count, &busy, &err) == PBS_OK);
    CHECK(!busy && in_buffers <= 2000000);
    size_t before = loads;
    for (int i = 0; i < 20; i++) CHECK(pbs_store_frame(s, n, count, &busy, &err) == PBS_OK);
    CHECK(loads == before && !busy);
    CHECK_NUM(check_bytes(s) > 1500000, check_bytes(s));
    CHECK(pbs_store_resident(s)[0] && !pbs_store_resident(s)[ITEMS - 1]);
    end(s);
}

/* Buffers and textures under one limit, and each makes way for the other. */
TEST(textures_are_objects_of_their_own) {
    pbs_cut_need n[16];
    bool busy;
    sizes(20000, 60000);
    apart = ITEMS / 2;
    for (uint32_t i = 0; i < ITEMS; i++) {
        bytes[i] &= ~(uint64_t)3;
        expected[i] = i < apart ? bytes[i] : below(2) ? 1 : 100000;
    }
    pbs_store *s = new_store(1500000, 50002, 200000, false);
    for (int turn = 0; turn < 200; turn++) {
        /* Now all of one sort, now of both. */
        for (uint32_t i = 0; i < 12; i++) {
            uint32_t first = turn / 20 % 3 ? 0 : (uint32_t)apart, more = turn / 20 % 3 > 1 ? 2 : 1;
            n[i] = (pbs_cut_need){(first + more * (uint32_t)turn + i * ITEMS / 24) % ITEMS, i, i};
        }
        int frames = 0;
        for (busy = true; busy && frames < 1000; frames++) {
            CHECK(pbs_store_frame(s, n, 12, &busy, &err) == PBS_OK);
            CHECK(in_buffers <= 1500000 && pbs_store_measure(s).uploaded_last <= 50000);
        }
        check_bytes(s);
        CHECK(!busy);
        uint64_t there = 0;
        for (uint32_t i = 0; i < 12; i++) {
            there += pbs_store_resident(s)[n[i].item];
            CHECK(!pbs_store_awaits(s, n[i].item) && !pbs_store_failed(s, n[i].item));
        }
        CHECK_NUM(there == 12, there);
        for (uint32_t i = (uint32_t)apart; i < ITEMS; i++)
            CHECK(!pbs_store_resident(s)[i] || pbs_store_where(s, i, 0).at == 0);
    }
    CHECK(pbs_store_measure(s).buffers == in_buffers && pbs_store_measure(s).evicted > 100);
    apart = 0;
    end(s);
}

TEST(a_damaged_item_is_asked_for_once) {
    pbs_cut_need n[5];
    size_t count = needs_from(n, 0, 5);
    bool busy;
    sizes(500, 0);
    bytes[3] = 1 << 25; /* more than a buffer holds */
    pbs_store *s = new_store(1 << 20, 0, 1 << 20, false);
    CHECK(pbs_store_trouble(s) && strstr(pbs_store_trouble(s), "33554432 bytes"));
    pbs_store_free(s, true);
    bytes[3] = 500;
    s = new_store(1 << 20, 0, 1 << 20, false);
    bad = 2;
    CHECK(!pbs_store_trouble(s));
    for (int i = 0; i < 5; i++) CHECK(pbs_store_frame(s, n, count, &busy, &err) == PBS_OK);
    CHECK(!busy && loads == 5 && !pbs_store_resident(s)[2] && check_bytes(s) == 2000);
    CHECK(pbs_store_trouble(s) && !strcmp(pbs_store_trouble(s), "item 2 is damaged"));
    CHECK(pbs_store_measure(s).failed == 1);
    end(s);
}

/* Parts come one after the other, within the limits of each frame; what finds no room for all of
 * them gives the others back, and it ends. */
TEST(large_items_lie_in_several_buffers) {
    pbs_cut_need n[3] = {{4, 0, 1}, {9, 1, 1}, {11, 1, 2}};
    bool busy = true;
    sizes(1000, 0);
    bytes[4] = 25000000, bytes[9] = 31000000;
    dividing = true;
    pbs_store *s = new_store(70000000, 4000000, 1 << 26, false);
    for (int frame = 0; busy && frame < 100; frame++) {
        CHECK(pbs_store_frame(s, n, 3, &busy, &err) == PBS_OK);
        CHECK(pbs_store_measure(s).uploaded_last <= 4000000);
    }
    CHECK(!busy && !pbs_store_trouble(s));
    for (int i = 0; i < 3; i++) CHECK(pbs_store_resident(s)[n[i].item]);
    for (uint32_t k = 0; k < 3; k++) {
        pbs_region r = pbs_store_where(s, 4, k);
        const uint8_t *p = buffer[r.buffer] + r.at;
        CHECK(r.size == (k < 2 ? 10000000 : 5000000) && p[0] == 4 && p[r.size - 1] == 4);
    }
    CHECK_NUM(pbs_store_measure(s).resident == 56001000, pbs_store_measure(s).resident);
    end(s);
    s = new_store(70000000, 0, 1 << 26, false);
    gpu_has = 30000000; /* the limit allows both, the device one */
    busy = true;
    for (int frame = 0; busy && frame < 100; frame++)
        CHECK(pbs_store_frame(s, n, 3, &busy, &err) == PBS_OK);
    CHECK(!busy && pbs_store_resident(s)[4] && !pbs_store_resident(s)[9]);
    CHECK_NUM(pbs_store_measure(s).resident <= 25001000, pbs_store_measure(s).resident);
    end(s);
    dividing = false;
}

TEST(a_device_without_memory_is_a_limit) {
    pbs_cut_need n[20];
    size_t count = needs_from(n, 0, 20);
    bool busy = true;
    sizes(100000, 0);
    pbs_store *s = new_store(1 << 24, 0, 1 << 24, false);
    gpu_has = 1 << 20;
    int frames = 0;
    for (; busy && frames < 200; frames++)
        CHECK(pbs_store_frame(s, n, count, &busy, &err) == PBS_OK);
    CHECK(!busy && in_buffers <= 1 << 20);
    check_bytes(s);
    end(s);
}

/* The thread: frames never wait for a slow disk, and all comes in the end. */
TEST(the_loader_works_beside_the_frames) {
    pbs_cut_need n[30];
    bool busy = true;
    sizes(4000, 4000);
    pbs_store *s = new_store(1 << 22, 10000, 20000, true);
    slow = 0.002;
    for (int turn = 0; turn < 4; turn++) {
        size_t count = needs_from(n, 40 * (uint32_t)turn, 30);
        int frames = 0;
        for (busy = true; busy && frames < 100000; frames++) {
            CHECK(pbs_store_frame(s, n, count, &busy, &err) == PBS_OK);
            if (frames % 3 == 0 && busy) pbs_store_wait(s, 0.01);
        }
        CHECK_NUM(!busy, frames);
        for (uint32_t i = 0; i < 30; i++) CHECK(pbs_store_resident(s)[40 * turn + i]);
        check_bytes(s);
    }
    CHECK(pbs_store_measure(s).host_peak <= 28000);
    CHECK(loads == 120);
    /* It ends in the middle of its work. */
    CHECK(pbs_store_frame(s, n, needs_from(n, 170, 30), &busy, &err) == PBS_OK);
    end(s);
}

TEST_MAIN
