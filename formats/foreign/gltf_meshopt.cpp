/* gltf_meshopt.cpp: EXT_meshopt_compression: the bytes of a bufferView, decoded when they are
 * needed. Packers put the vertices of many meshes into one view, so some decoded views are kept. */
#include "formats/foreign/gltf.hpp"
#include <meshoptimizer.h>

namespace pbs::gltf {

typedef unsigned long long ull;

/* What may be kept besides what the primitive at hand needs. */
static const uint64_t keep_bytes = 64 << 20;
static const size_t keep_views = 256;

/* The codecs take at least so many bytes; without this, 20 bytes of JSON could ask for any amount
 * of memory. Also what the library only asserts. */
static void check_claims(const meshopt_entry &e, pbs_err *err) {
    bool indices = e.mode != ATTRIBUTES;
    if (indices ? e.stride != 2 && e.stride != 4 : !e.stride || e.stride % 4 || e.stride > 256)
        fail(err, PBS_DATA, "byteStride %llu", (ull)e.stride);
    bool fits = e.mode == TRIANGLES ? e.count % 3 == 0 && e.count / 3 <= e.length
                : indices           ? e.count <= e.length
                                    : e.count <= e.length * 64 / e.stride;
    if (!fits || e.length > 1ull << 40)
        fail(err, PBS_DATA, "%llu elements cannot be in %llu bytes", (ull)e.count, (ull)e.length);
    if ((e.filter != NO_FILTER && indices) ||
        (e.filter == OCTAHEDRAL && e.stride != 4 && e.stride != 8) ||
        (e.filter == QUATERNION && e.stride != 8))
        fail(err, PBS_DATA, "a filter that does not fit");
}

static void decode(const meshopt_entry &e, const bytes &in, uint8_t *out, pbs_err *err) {
    size_t n = (size_t)e.count, stride = (size_t)e.stride;
    if (!n) return;
    int failed = e.mode == ATTRIBUTES ? meshopt_decodeVertexBuffer(out, n, stride, in.data, in.size)
                 : e.mode == TRIANGLES
                     ? meshopt_decodeIndexBuffer(out, n, stride, in.data, in.size)
                     : meshopt_decodeIndexSequence(out, n, stride, in.data, in.size);
    if (failed) fail(err, PBS_DATA, "the compressed bytes are damaged (%d)", failed);
    if (e.filter == OCTAHEDRAL) meshopt_decodeFilterOct(out, n, stride);
    if (e.filter == QUATERNION) meshopt_decodeFilterQuat(out, n, stride);
    if (e.filter == EXPONENTIAL) meshopt_decodeFilterExp(out, n, stride);
}

/* False: all that are left are in use. */
bool reader::drop_oldest_view() {
    size_t oldest = decoded_.size();
    for (size_t i = 0; i < decoded_.size(); i++)
        if (decoded_[i].era < era_ &&
            (oldest == decoded_.size() || decoded_[i].era < decoded_[oldest].era))
            oldest = i;
    if (oldest == decoded_.size()) return false;
    decoded_bytes_ -= decoded_[oldest].data.size();
    decoded_.erase(decoded_.begin() + (ptrdiff_t)oldest);
    return true;
}

bytes reader::decoded_view(int view) {
    const view_entry &v = doc_.views[(size_t)view];
    for (view_bytes &d : decoded_)
        if (d.meshopt == v.meshopt) {
            d.era = era_;
            return {d.data.data(), d.data.size()};
        }
    const meshopt_entry &e = doc_.meshopt[(size_t)v.meshopt];
    in_place(err_, "bufferView", (size_t)view, "EXT_meshopt_compression", [&] {
        check_claims(e, err_);
        uint64_t size = e.count * e.stride;
        if (size != v.length)
            fail(err_, PBS_DATA, "%llu bytes, but the view has %llu", (ull)size, (ull)v.length);
        bytes in = range(e.buffer, e.offset, e.length, view);
        while ((decoded_bytes_ + size > keep_bytes || decoded_.size() >= keep_views ||
                pbs_mem_left(run_) < size + (1 << 20)) &&
               drop_oldest_view())
            ;
        view_bytes d = {array<uint8_t>(run_, size, "a decoded view", err_), v.meshopt, era_};
        decode(e, in, d.data.data(), err_);
        touch(in.size);
        decoded_bytes_ += size;
        decoded_.push_back(std::move(d));
    });
    return {decoded_.back().data.data(), decoded_.back().data.size()};
}

} // namespace pbs::gltf
