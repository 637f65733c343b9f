/* store.c: the loader's thread, the queue before it, and the GPU's memory behind it: paper 2,
 * section 4.
 *
 * Only the thread that draws changes what items are; the loader takes numbers from the queue and
 * puts what it has loaded on a list. Both are behind one lock, which is held for a few copies.
 */
#include "cmd/pbs-view/stream/store.h"
#include "cmd/pbs-view/plan/rooms.h"
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

enum { QUEUE = 256, NONE = UINT32_MAX, LEAST_BLOCK = 1 << 20 };

typedef enum state { ABSENT, READY, RESIDENT, FAILED } state;

typedef struct place {
    uint32_t block; /* NONE: it has none */
    uint64_t at, size;
} place;

typedef struct item {
    uint8_t state;
    bool refused;   /* there was no room, when so many items had been let go: */
    uint32_t parts; /* their places are found in their order: without the first none has one */
    uint64_t refused_at;
    place one, *many;
    uint64_t done; /* bytes of it that are uploaded */
    uint64_t used; /* frame that needed it last */
    pbs_blob blob;
} item;

typedef struct block {
    uint32_t buffer;
    bool apart;      /* it is one item's own, and no buffer */
    pbs_rooms rooms; /* size 0: not there */
} block;

/* An item that may go. */
typedef struct victim {
    uint64_t used;
    uint32_t item;
} victim;

typedef struct arrival {
    uint32_t item;
    pbs_blob blob;
    pbs_err err; /* code PBS_OK: it is there */
} arrival;

struct pbs_store {
    pbs_run *run;
    pbs_store_desc desc;
    pbs_store_source source;
    pbs_store_gpu gpu;
    uint64_t *bytes; /* of each item */
    uint64_t block_size, frame, let_go;
    item *items;
    uint8_t *resident;
    victim *victims; /* scratch */
    block *blocks;
    size_t block_count, block_cap, newest;
    pbs_store_stats stats;
    pbs_err trouble;
    /* shared with the loader */
    pthread_mutex_t lock;
    pthread_cond_t asked, arrived;
    pthread_t thread;
    bool running, stop;
    uint32_t queue[QUEUE], queued, taken; /* queue[taken .. queued - 1] is left */
    uint32_t loading;                     /* item, or NONE */
    arrival done[QUEUE];
    uint32_t done_count;
    uint64_t host, host_peak; /* bytes of blobs */
};

/* ---- the loader ---- */

/* With the lock: whether the next one may be loaded. */
static bool may_load(const pbs_store *s) {
    if (s->taken == s->queued || s->done_count == QUEUE) return false;
    return !s->host || s->host + s->bytes[s->queue[s->taken]] <= s->desc.host;
}

/* With the lock, which is given up while it loads. */
static void load_one(pbs_store *s) {
    arrival a = {.item = s->queue[s->taken++]};
    s->loading = a.item;
    uint64_t room = s->bytes[a.item];
    s->host += room;
    pthread_mutex_unlock(&s->lock);
    a.err.code = s->source.load(s->source.ctx, a.item, &a.blob, &a.err);
    pthread_mutex_lock(&s->lock);
    s->host += a.blob.size - room;
    s->host_peak = s->host > s->host_peak ? s->host : s->host_peak;
    s->loading = NONE;
    s->done[s->done_count++] = a;
    pthread_cond_broadcast(&s->arrived);
}

static void *loader(void *ctx) {
    pbs_store *s = ctx;
    pthread_mutex_lock(&s->lock);
    while (!s->stop) {
        if (may_load(s))
            load_one(s);
        else
            pthread_cond_wait(&s->asked, &s->lock);
    }
    pthread_mutex_unlock(&s->lock);
    return NULL;
}

/* ---- the GPU's memory ---- */

static bool is_apart(const pbs_store *s, uint32_t id) {
    return s->desc.apart && id >= s->desc.apart;
}

static void drop_block(pbs_store *s, block *b) {
    s->stats.buffers -= b->rooms.size;
    if (b->apart)
        s->gpu.drop_apart(s->gpu.ctx, b->buffer, b->rooms.size);
    else
        s->gpu.drop(s->gpu.ctx, b->buffer);
    pbs_rooms_free(s->run, &b->rooms);
}

static place *places_of(item *i) {
    return i->many ? i->many : &i->one;
}

static pbs_code release_part(pbs_store *s, place *p, pbs_err *err) {
    block *b = &s->blocks[p->block];
    pbs_code rc = pbs_rooms_give(s->run, &b->rooms, p->at, p->size, err);
    if (rc) return rc;
    if (b->apart) drop_block(s, b);
    p->block = NONE;
    s->stats.resident -= p->size;
    return PBS_OK;
}

static pbs_code release(pbs_store *s, uint32_t id, pbs_err *err) {
    item *i = &s->items[id];
    place *p = places_of(i);
    if (p->block == NONE) return PBS_OK;
    for (uint32_t k = i->parts; k-- > 0;) {
        pbs_code rc = p[k].block == NONE ? PBS_OK : release_part(s, &p[k], err);
        if (rc) return rc;
    }
    i->done = 0;
    s->let_go++;
    return PBS_OK;
}

static void free_blob(pbs_store *s, item *i) {
    if (!i->blob.bytes) return;
    pthread_mutex_lock(&s->lock);
    s->host -= i->blob.size;
    pthread_mutex_unlock(&s->lock);
    pbs_free(s->run, i->blob.bytes);
    i->blob = (pbs_blob){0};
}

static void drop_empty_blocks(pbs_store *s) {
    for (size_t i = 0; i < s->block_count; i++) {
        block *b = &s->blocks[i];
        if (b->rooms.size && !b->rooms.used) drop_block(s, b);
    }
}

/* Room in a buffer. */
static bool find_room(pbs_store *s, uint64_t size, place *p) {
    for (size_t k = 0; k < s->block_count; k++)
        if (!s->blocks[k].apart && pbs_rooms_take(&s->blocks[k].rooms, size, &p->at)) {
            p->block = (uint32_t)k;
            return true;
        }
    return false;
}

/* A place for another buffer, or a texture. */
static pbs_code new_block(pbs_store *s, block **out, pbs_err *err) {
    size_t k = 0;
    while (k < s->block_count && s->blocks[k].rooms.size) k++;
    pbs_code rc =
        pbs_grow(s->run, &s->blocks, &s->block_cap, k + 1, sizeof *s->blocks, "the GPU's map", err);
    if (rc) return rc;
    *out = &s->blocks[k];
    if (k == s->block_count) s->block_count++;
    **out = (block){0};
    return PBS_OK;
}

/* Another buffer that holds at least `size`, or a texture of that size for the item; *made false:
 * the limit, or the device, says no. */
static pbs_code add_block(pbs_store *s, uint32_t id, uint64_t size, bool *made, pbs_err *err) {
    bool apart = is_apart(s, id);
    uint64_t want = apart || size > s->block_size ? size : s->block_size,
             left = s->desc.gpu - s->stats.buffers;
    block *b;
    *made = false;
    if (want > left && size <= left) want = left;
    want &= ~(uint64_t)(PBS_ROOM_ALIGN - 1);
    if (want > left || want < size) return PBS_OK;
    pbs_code rc = new_block(s, &b, err);
    if (rc) return rc;
    b->apart = apart;
    if (!(apart ? s->gpu.make_apart(s->gpu.ctx, id, want, &b->buffer)
                : s->gpu.make(s->gpu.ctx, want, &b->buffer)))
        return PBS_OK;
    s->stats.buffers += want;
    rc = pbs_rooms_new(s->run, want, &b->rooms, err);
    if (rc) {
        b->rooms.size = want;
        drop_block(s, b);
        return rc;
    }
    s->newest = (size_t)(b - s->blocks);
    *made = true;
    return PBS_OK;
}

static int by_use(const void *a, const void *b) {
    const victim *x = a, *y = b;
    return x->used != y->used ? (x->used > y->used) - (x->used < y->used)
                              : (x->item > y->item) - (x->item < y->item);
}

/* Lets go what no need of this frame names, what was unused for longest first, until `size` bytes
 * are free in one place. *found: they are, and p is it. A texture is none of a buffer's places:
 * where one goes, or is to come, it is enough that the limit has room. */
static pbs_code evict(pbs_store *s, uint32_t wanted, uint64_t size, place *p, bool *found,
                      pbs_err *err) {
    bool apart = is_apart(s, wanted), room = false;
    size_t n = 0;
    for (uint32_t k = 0; k < s->desc.items; k++)
        if (places_of(&s->items[k])->block != NONE && s->items[k].used < s->frame)
            s->victims[n++] = (victim){s->items[k].used, k};
    if (n) qsort(s->victims, n, sizeof *s->victims, by_use);
    for (size_t k = 0; k < n && !*found && !room; k++) {
        uint32_t id = s->victims[k].item;
        item *old = &s->items[id];
        pbs_code rc = release(s, id, err);
        if (rc) return rc;
        s->stats.evicted += old->state == RESIDENT;
        if (old->state == RESIDENT) old->state = ABSENT;
        s->resident[id] = 0;
        if (apart) drop_empty_blocks(s);
        *found = !apart && find_room(s, size, p);
        room = (apart || is_apart(s, id)) && s->desc.gpu - s->stats.buffers >= size;
    }
    return PBS_OK;
}

/* Room in the block that was made last. */
static bool take_new(pbs_store *s, uint64_t size, place *p) {
    if (!pbs_rooms_take(&s->blocks[s->newest].rooms, size, &p->at)) return false;
    p->block = (uint32_t)s->newest;
    return true;
}

/* A place for a part of the item: where one is free; in a new buffer; in the place of others. */
static pbs_code settle(pbs_store *s, uint32_t id, place *p, bool *found, pbs_err *err) {
    item *i = &s->items[id];
    uint64_t size = (p->size + PBS_ROOM_ALIGN - 1) & ~(uint64_t)(PBS_ROOM_ALIGN - 1);
    pbs_code rc = PBS_OK;
    *found = !is_apart(s, id) && find_room(s, size, p);
    for (int again = 0; again < 2 && !*found && !rc; again++) {
        bool made;
        rc = add_block(s, id, size, &made, err);
        if (!rc && made) *found = take_new(s, size, p);
        if (!rc && !*found && !again) rc = evict(s, id, size, p, found, err);
        if (!*found && !again) drop_empty_blocks(s);
    }
    if (*found) s->stats.resident += p->size;
    i->refused = !*found;
    i->refused_at = s->let_go;
    return rc;
}

/* ---- a frame ---- */

static void arrive(pbs_store *s, const arrival *a) {
    item *i = &s->items[a->item];
    bool fits = a->blob.size && (is_apart(s, a->item) || a->blob.size == s->bytes[a->item]);
    i->blob = a->blob;
    if (a->err.code == PBS_OK && fits) {
        i->state = READY;
        if (is_apart(s, a->item)) s->bytes[a->item] = i->one.size = a->blob.size;
        s->stats.loaded++;
        return;
    }
    i->state = FAILED;
    if (!s->stats.failed++) {
        s->trouble = a->err;
        if (a->err.code == PBS_OK)
            (void)pbs_fail(&s->trouble, PBS_INTERNAL, "item %u has another size", a->item);
    }
}

static void take_arrivals(pbs_store *s) {
    static const arrival none;
    for (;;) {
        arrival a = none;
        pthread_mutex_lock(&s->lock);
        bool some = s->done_count != 0;
        if (some) a = s->done[--s->done_count];
        if (some) arrive(s, &a); /* what it says of sizes the loader reads */
        s->stats.host_peak = s->host_peak;
        pthread_mutex_unlock(&s->lock);
        if (!some) return;
        if (s->items[a.item].state == FAILED) free_blob(s, &s->items[a.item]);
    }
}

static bool can_come(const pbs_store *s, const item *i) {
    return i->state != FAILED && !(i->refused && i->refused_at == s->let_go);
}

/* How many of the needs fit: 95 % of the limit. Marks them. */
static size_t mark(pbs_store *s, const pbs_cut_need *needs, size_t count) {
    uint64_t sum = 0;
    size_t n = 0;
    for (; n < count; n++) {
        uint32_t id = needs[n].item;
        sum += s->bytes[id];
        if (sum > s->desc.gpu / 20 * 19) break;
        s->items[id].used = s->frame;
    }
    return n;
}

/* As much of a part, which begins at byte `from` of the item, as may be uploaded now. */
static void fill_part(pbs_store *s, uint32_t id, const place *p, uint64_t from, uint64_t *left) {
    item *i = &s->items[id];
    uint64_t at = i->done - from, some = p->size - at < *left ? p->size - at : *left;
    uint32_t to = s->blocks[p->block].buffer;
    if (is_apart(s, id))
        s->gpu.fill_apart(s->gpu.ctx, id, to, at, i->blob.bytes + i->done, some);
    else
        s->gpu.fill(s->gpu.ctx, to, p->at + at, i->blob.bytes + i->done, some);
    i->done += some;
    *left -= some;
    s->stats.uploaded += some;
    s->stats.uploaded_last += some;
}

/* What finds no room makes way for what is behind it. Rooms that its own first parts had are no
 * reason for others that found none to come again. */
static pbs_code give_up(pbs_store *s, uint32_t id, pbs_err *err) {
    uint64_t let_go = s->let_go;
    free_blob(s, &s->items[id]);
    s->items[id].state = ABSENT;
    pbs_code rc = release(s, id, err);
    s->let_go = let_go;
    return rc;
}

static pbs_code upload(pbs_store *s, uint32_t id, uint64_t *left, pbs_err *err) {
    item *i = &s->items[id];
    place *p = places_of(i);
    uint64_t from = 0;
    for (uint32_t k = 0; k < i->parts && *left; from += p[k++].size) {
        if (i->done >= from + p[k].size) continue;
        bool found = p[k].block != NONE;
        pbs_code rc = found ? PBS_OK : settle(s, id, &p[k], &found, err);
        if (rc || !found) return rc ? rc : give_up(s, id, err);
        fill_part(s, id, &p[k], from, left);
    }
    if (i->done < s->bytes[id]) return PBS_OK;
    i->state = RESIDENT;
    s->resident[id] = 1;
    free_blob(s, i);
    return PBS_OK;
}

/* Blobs that nobody needs any more are in the way of others. */
static pbs_code forget_unused(pbs_store *s, pbs_err *err) {
    pbs_code rc = PBS_OK;
    pthread_mutex_lock(&s->lock);
    bool full = s->host > s->desc.host / 2;
    pthread_mutex_unlock(&s->lock);
    for (uint32_t id = 0; full && id < s->desc.items && !rc; id++) {
        item *i = &s->items[id];
        if (i->state != READY || i->used == s->frame) continue;
        free_blob(s, i);
        rc = release(s, id, err);
        i->state = ABSENT;
    }
    return rc;
}

/* Returns whether something is to come. */
static bool ask(pbs_store *s, const pbs_cut_need *needs, size_t count) {
    pthread_mutex_lock(&s->lock);
    s->queued = s->taken = 0;
    for (size_t k = 0; k < count && s->queued < QUEUE; k++) {
        const item *i = &s->items[needs[k].item];
        bool here = needs[k].item == s->loading;
        for (uint32_t d = 0; d < s->done_count && !here; d++)
            here = s->done[d].item == needs[k].item;
        if (i->state == ABSENT && !here && can_come(s, i)) s->queue[s->queued++] = needs[k].item;
    }
    bool some = s->queued || s->loading != NONE || s->done_count;
    if (some) pthread_cond_signal(&s->asked);
    while (!s->desc.threaded && may_load(s)) load_one(s);
    pthread_mutex_unlock(&s->lock);
    return some;
}

pbs_code pbs_store_frame(pbs_store *s, const pbs_cut_need *needs, size_t count, bool *busy,
                         pbs_err *err) {
    uint64_t left = (s->desc.upload ? s->desc.upload : UINT64_MAX) & ~(uint64_t)3;
    pbs_code rc = PBS_OK;
    bool waiting = false;
    s->frame++;
    s->stats.uploaded_last = 0;
    take_arrivals(s);
    count = mark(s, needs, count);
    for (size_t k = 0; k < count && !rc; k++) {
        const item *i = &s->items[needs[k].item];
        if (i->state != READY) continue;
        if (left) rc = upload(s, needs[k].item, &left, err);
        waiting = waiting || i->state == READY;
    }
    if (!rc) rc = forget_unused(s, err);
    if (!rc) *busy = ask(s, needs, count) || waiting;
    return rc;
}

void pbs_store_wait(pbs_store *s, double seconds) {
    struct timespec until;
    clock_gettime(CLOCK_REALTIME, &until);
    until.tv_nsec += (long)(seconds * 1e9);
    until.tv_sec += until.tv_nsec / 1000000000;
    until.tv_nsec %= 1000000000;
    pthread_mutex_lock(&s->lock);
    int late = 0;
    while (!s->done_count && !late && (s->loading != NONE || s->taken != s->queued))
        late = pthread_cond_timedwait(&s->arrived, &s->lock, &until);
    pthread_mutex_unlock(&s->lock);
}

/* ---- from beginning to end ---- */

static pbs_code make_parts(pbs_store *s, uint32_t id, uint32_t parts, pbs_err *err) {
    item *i = &s->items[id];
    pbs_code rc =
        pbs_alloc(s->run, &i->many, parts, sizeof *i->many, "the table of what is loaded", err);
    if (rc) return rc;
    i->parts = parts;
    for (uint32_t k = 0; k < parts; k++)
        i->many[k] = (place){.block = NONE, .size = s->source.part(s->source.ctx, id, k)};
    return PBS_OK;
}

/* An item that is larger than a buffer; without parts that fit it fails. */
static pbs_code divide(pbs_store *s, uint32_t id, pbs_err *err) {
    uint64_t most = s->desc.largest, sum = 0, size;
    uint32_t parts = 0;
    while (s->source.part && (size = s->source.part(s->source.ctx, id, parts)) && size <= most)
        parts++, sum += size;
    if (sum == s->bytes[id]) return make_parts(s, id, parts, err);
    s->items[id].state = FAILED;
    if (!s->stats.failed++)
        (void)pbs_fail(&s->trouble, PBS_LIMIT,
                       "a node of %llu bytes: the device draws up to %llu from one buffer, and it "
                       "cannot be divided so far",
                       (unsigned long long)s->bytes[id], (unsigned long long)most);
    return PBS_OK;
}

static pbs_code build(pbs_store *s, pbs_err *err) {
    const char *what = "the table of what is loaded";
    size_t n = s->desc.items;
    pbs_code rc = pbs_alloc(s->run, &s->bytes, n, sizeof *s->bytes, what, err);
    if (!rc) rc = pbs_alloc(s->run, &s->items, n, sizeof *s->items, what, err);
    if (!rc) rc = pbs_alloc(s->run, &s->resident, n, 1, what, err);
    if (!rc) rc = pbs_alloc(s->run, &s->victims, n, sizeof *s->victims, what, err);
    if (rc) return rc;
    memset(s->resident, 0, n);
    if (n) memcpy(s->bytes, s->desc.bytes, n * sizeof *s->bytes);
    for (size_t i = 0; i < n; i++)
        s->items[i] = (item){.parts = 1, .one = {.block = NONE, .size = s->bytes[i]}};
    for (uint32_t i = 0; i < (s->desc.apart ? s->desc.apart : n) && !rc; i++)
        if (s->bytes[i] > s->desc.largest) rc = divide(s, i, err);
    if (rc) return rc;
    if (s->desc.threaded && pthread_create(&s->thread, NULL, loader, s))
        return pbs_fail(err, PBS_LIMIT, "no thread to load with");
    s->running = s->desc.threaded;
    return PBS_OK;
}

/* A few buffers, and no more than there is to put into them; where there are textures, too, a
 * buffer does not take their room. */
static uint64_t block_size(const pbs_store_desc *d) {
    uint64_t all = 0, size = d->gpu / 8, least = LEAST_BLOCK;
    if (d->apart && size < least) least = size;
    for (size_t i = 0; i < (d->apart ? d->apart : d->items) && all < size; i++)
        all += d->bytes[i] + PBS_ROOM_ALIGN;
    if (all < size) size = all;
    if (size < least) size = least;
    return size < d->largest ? size : d->largest;
}

pbs_code pbs_store_new(pbs_run *run, const pbs_store_desc *desc, const pbs_store_source *source,
                       const pbs_store_gpu *gpu, pbs_store **out, pbs_err *err) {
    pbs_store *s;
    *out = NULL;
    pbs_code rc = pbs_alloc(run, &s, 1, sizeof *s, "the table of what is loaded", err);
    if (rc) return rc;
    memset(s, 0, sizeof *s);
    s->run = run;
    s->desc = *desc;
    s->source = *source;
    s->gpu = *gpu;
    s->loading = NONE;
    s->block_size = block_size(desc);
    pthread_mutex_init(&s->lock, NULL);
    pthread_cond_init(&s->asked, NULL);
    pthread_cond_init(&s->arrived, NULL);
    rc = build(s, err);
    if (rc)
        pbs_store_free(s, false);
    else
        *out = s;
    return rc;
}

static void end_thread(pbs_store *s) {
    if (!s->running) return;
    pthread_mutex_lock(&s->lock);
    s->stop = true;
    pthread_cond_broadcast(&s->asked);
    pthread_mutex_unlock(&s->lock);
    pthread_join(s->thread, NULL);
}

void pbs_store_free(pbs_store *s, bool buffers) {
    if (!s) return;
    end_thread(s);
    for (uint32_t i = 0; i < s->done_count; i++) pbs_free(s->run, s->done[i].blob.bytes);
    for (size_t i = 0; s->items && i < s->desc.items; i++) {
        pbs_free(s->run, s->items[i].blob.bytes);
        pbs_free(s->run, s->items[i].many);
    }
    for (size_t i = 0; i < s->block_count; i++) {
        if (buffers && s->blocks[i].rooms.size) drop_block(s, &s->blocks[i]);
        pbs_rooms_free(s->run, &s->blocks[i].rooms);
    }
    pthread_mutex_destroy(&s->lock);
    pthread_cond_destroy(&s->asked);
    pthread_cond_destroy(&s->arrived);
    pbs_free(s->run, s->bytes);
    pbs_free(s->run, s->items);
    pbs_free(s->run, s->resident);
    pbs_free(s->run, s->victims);
    pbs_free(s->run, s->blocks);
    pbs_free(s->run, s);
}

bool pbs_store_awaits(const pbs_store *s, uint32_t id) {
    const item *i = &s->items[id];
    return i->state != RESIDENT && can_come(s, i) && i->used == s->frame;
}

bool pbs_store_failed(const pbs_store *s, uint32_t id) {
    return s->items[id].state == FAILED;
}

const uint8_t *pbs_store_resident(const pbs_store *s) {
    return s->resident;
}

pbs_region pbs_store_where(const pbs_store *s, uint32_t id, uint32_t k) {
    const place *p = places_of(&s->items[id]) + k;
    return (pbs_region){s->blocks[p->block].buffer, p->at, p->size};
}

pbs_store_stats pbs_store_measure(const pbs_store *s) {
    return s->stats;
}

const char *pbs_store_trouble(const pbs_store *s) {
    return s->stats.failed ? s->trouble.text : NULL;
}
