/* gltf_moving.cpp: the nodes that an animation moves, and how. Their surfels cannot be merged with
 * those of what stands still (paper 1, section 3.4). Exporters write channels for every node of a
 * scene, most of which only repeat where the node is; those do not count. */
#include "formats/foreign/gltf.hpp"
#include <algorithm>
#include <cmath>

namespace pbs::gltf {

/* Where a node stands without animation. */
pbs_trs rest_pose(const document &doc, const node_entry &n) {
    pbs_trs pose = PBS_TRS_IDENTITY;
    double *const to[3] = {pose.translation, pose.rotation, pose.scale};
    uint32_t at = n.numbers;
    for (int p = TRANSLATION; p <= SCALE; p++)
        for (uint32_t k = 0; (n.has >> p & 1) && k < path_numbers[p]; k++)
            to[p][k] = doc.numbers[at++];
    return pose;
}

static const double *part_of(const pbs_trs &pose, int path) {
    return path == TRANSLATION ? pose.translation : path == ROTATION ? pose.rotation : pose.scale;
}

/* Keyframes are floats (or less), and the text may have fewer digits. */
static bool differs(const double *key, const double *rest, int n, double sign) {
    double largest = 0;
    for (int k = 0; k < n; k++) largest = std::max(largest, std::fabs(rest[k]));
    for (int k = 0; k < n; k++)
        if (!(std::fabs(sign * key[k] - rest[k]) <= largest * 0x1p-22)) return true;
    return false;
}

/* True if the channel ever shows another pose, or cannot be read: then nothing is known. */
bool reader::moves(const channel_entry &c) {
    const node_entry &n = doc_.nodes[(size_t)c.node];
    if (n.has >> MATRIX & 1 || c.output < 0) return true;
    forget_views();
    stream s = open_stream(c.output);
    int numbers = (int)path_numbers[c.path];
    if (s.components != numbers) return true;
    const double still[4] = {0, 0, 0, 0};
    pbs_trs pose = rest_pose(doc_, n);
    const double *rest = part_of(pose, c.path);
    double key[4];
    for (uint64_t i = 0; i < s.count; i++) {
        if (i % 65536 == 0) check(pbs_run_check(run_, err_));
        s.get(i, key);
        /* Splines have a tangent before and behind each value. */
        const double *want = c.way == PBS_MOTION_CUBIC && i % 3 != 1 ? still : rest;
        bool turned = c.path == ROTATION && want == rest; /* q and -q are one rotation */
        if (differs(key, want, numbers, 1) && !(turned && !differs(key, want, numbers, -1)))
            return true;
    }
    return false;
}

/* Which channels move, and those of each node, in their order. */
void reader::mark_moving() {
    size_t nodes = doc_.nodes.size();
    moves_.assign(nodes, 0);
    motion_id_.assign(nodes, not_yet);
    first_channel_.assign(nodes + 1, 0);
    for (channel_entry &c : doc_.channels) {
        if ((size_t)c.node >= nodes) continue;
        pbs_err before = *err_;
        try {
            c.moves = moves(c);
        } catch (const failure &e) {
            /* A file that only lacks its animation's data is still a scene. */
            if (e.code != PBS_DATA) throw;
            *err_ = before;
            c.moves = true;
        }
        if (!c.moves) continue;
        moves_[(size_t)c.node] = 1;
        first_channel_[(size_t)c.node]++;
    }
    uint32_t end = 0;
    for (uint32_t &f : first_channel_) f = end += f;
    channel_.assign(end, 0);
    for (size_t i = doc_.channels.size(); i--;) {
        const channel_entry &c = doc_.channels[i];
        if (c.moves) channel_[--first_channel_[(size_t)c.node]] = (uint32_t)i;
    }
}

/* ---- the keys ---- */

/* Of one motion: of each channel its times, then its values. */
struct reader::keys {
    list<double> numbers;
    list<pbs_motion_channel> channels; /* without the pointers */
    uint64_t left_out = 0;
};

static bool all_finite(const double *v, uint32_t n) {
    return std::all_of(v, v + n, [](double x) { return std::isfinite(x); });
}

static bool is_zero(const double *v, uint32_t n) {
    return std::all_of(v, v + n, [](double x) { return x == 0; });
}

/* Of a key with its tangents: a value that no pose can be made of. */
static bool is_bad(const channel_entry &c, const double *v) {
    uint32_t n = path_numbers[c.path], all = pbs_motion_numbers(c.path, c.way);
    return !all_finite(v, all) || (c.path == ROTATION && is_zero(v + (all > n ? n : 0), n));
}

/* Keys that say nothing are left out; times that repeat are a jump. */
void reader::add_keys(const channel_entry &c, keys &k) {
    forget_views();
    stream time = open_stream(c.input), value = open_stream(c.output);
    uint32_t n = path_numbers[c.path], width = pbs_motion_numbers(c.path, c.way), parts = width / n;
    if (time.components != 1 || value.components != (int)n || value.count / parts != time.count ||
        value.count % parts)
        fail(err_, PBS_DATA, "an animation's keys do not fit");
    size_t base = k.numbers.size(), kept = 0;
    if (time.count > (PBS_MOTION_MOST - base) / (1 + width))
        fail(err_, PBS_DATA, "%llu keys of an animation are too many",
             (unsigned long long)time.count);
    size_t count = (size_t)time.count;
    k.numbers.grow(count * (1 + width));
    double *to = k.numbers.data() + base, *values = to + count, last = -INFINITY;
    for (size_t i = 0; i < count; i++) {
        if (i % 65536 == 0) check(pbs_run_check(run_, err_));
        double at, *v = values + kept * width;
        time.get(i, &at);
        for (uint32_t p = 0; p < parts; p++) value.get(i * parts + p, v + p * n);
        if (!std::isfinite(at) || at < last || is_bad(c, v)) continue;
        to[kept++] = last = at;
    }
    std::copy(values, values + kept * width, to + kept);
    k.numbers.shrink(base + kept * (1 + width));
    k.left_out += count - kept;
    if (!kept) fail(err_, PBS_DATA, "no key of an animation can be used");
    k.channels.push({c.animation, c.path, c.way, (uint32_t)kept, nullptr, nullptr});
}

/* Or counts it. */
void reader::add_channel(const channel_entry &c, keys &k) {
    pbs_err before = *err_;
    size_t numbers = k.numbers.size();
    uint64_t left_out = k.left_out;
    try {
        if (doc_.nodes[(size_t)c.node].has >> MATRIX & 1)
            fail(err_, PBS_DATA, "the standard forbids to move a matrix");
        add_keys(c, k);
    } catch (const failure &e) {
        if (e.code != PBS_DATA) throw;
        *err_ = before;
        k.numbers.shrink(numbers);
        k.left_out = left_out;
        sink_->skip(sink_->ctx, PBS_SKIP_CHANNEL, 1);
    }
}

/* All of them, before the first motion, so that they keep their numbers. */
void reader::send_animations() {
    if (!animation_id_.empty()) return;
    for (uint32_t name : doc_.animations) {
        uint32_t id;
        check(sink_->animation(sink_->ctx, doc_.name(name), &id, err_));
        animation_id_.push(id);
    }
}

/* How a node that moves does; 0: nothing of that can be read. */
uint32_t reader::motion(int n) {
    uint32_t &id = motion_id_[(size_t)n];
    if (id != not_yet) return id;
    id = 0;
    if (!sink_->motion) return id;
    keys k = {{run_, "the keys of an animation", err_}, {run_, "the keys of an animation", err_}};
    for (uint32_t i = first_channel_[(size_t)n]; i < first_channel_[(size_t)n + 1]; i++)
        add_channel(doc_.channels[channel_[i]], k);
    if (k.left_out) sink_->skip(sink_->ctx, PBS_SKIP_KEY, k.left_out);
    if (k.channels.empty()) return id;
    send_animations();
    const double *at = k.numbers.data();
    for (pbs_motion_channel &c : k.channels) {
        c.animation = animation_id_[c.animation];
        c.time = at;
        c.value = at + c.keys;
        at = c.value + (size_t)c.keys * pbs_motion_numbers(c.path, c.way);
    }
    pbs_motion m = {rest_pose(doc_, doc_.nodes[(size_t)n]), (uint32_t)k.channels.size(),
                    k.channels.data()};
    check(sink_->motion(sink_->ctx, &m, &id, err_));
    return id;
}

} // namespace pbs::gltf
