/* gltf_data.cpp: from a claim in the JSON to bytes that are there: files, buffers, accessors. */
#include "formats/foreign/gltf.hpp"
#include <algorithm>
#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

namespace pbs::gltf {

typedef unsigned long long ull;

mapping::~mapping() {
    if (view_.data) munmap((void *)view_.data, view_.size);
}

bool mapping::open(const std::string &path) {
    /* Not blocking: the name may be a pipe's. */
    int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    if (fd < 0) return false;
    struct stat st;
    void *p = MAP_FAILED;
    if (fstat(fd, &st) == 0 && S_ISREG(st.st_mode) && st.st_size > 0)
        p = mmap(nullptr, (size_t)st.st_size, PROT_READ, MAP_PRIVATE, fd, 0);
    else
        errno = EINVAL;
    int keep = errno;
    close(fd);
    errno = keep;
    if (p == MAP_FAILED) return false;
    view_ = {(const uint8_t *)p, (uint64_t)st.st_size};
    return true;
}

void let_go(const bytes &map) {
    if (map.data) madvise((void *)map.data, map.size, MADV_DONTNEED);
}

static int hex_digit(char c) {
    return c >= '0' && c <= '9'                 ? c - '0'
           : (c | 32) >= 'a' && (c | 32) <= 'f' ? (c | 32) - 'a' + 10
                                                : -1;
}

static std::string percent_decode(const std::string &s) {
    std::string out;
    for (size_t i = 0; i < s.size(); i++) {
        int hi = s[i] == '%' && i + 2 < s.size() ? hex_digit(s[i + 1]) : -1;
        int lo = hi >= 0 ? hex_digit(s[i + 2]) : -1;
        if (lo >= 0) i += 2;
        out += lo >= 0 ? (char)(hi << 4 | lo) : s[i];
    }
    return out;
}

static bool has_scheme(const std::string &uri) {
    size_t n =
        uri.find_first_not_of("ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+-.");
    return n != uri.npos && n > 0 && uri[n] == ':';
}

/* A file beside the scene. As the standard has it; then as exporters write it, with a name that
 * was never encoded, or with the slashes of another system. */
bool reader::find_file(const std::string &uri, mapping &file) {
    if (uri.empty() || has_scheme(uri) || uri[0] == '/') return errno = EINVAL, false;
    std::string plain = percent_decode(uri), slashes = plain;
    for (char &c : slashes)
        if (c == '\\') c = '/';
    int first = 0;
    for (const std::string &name : {plain, uri, slashes}) {
        if (first && name[0] == '/') continue;
        if (file.open(folder_ + name)) {
            pbs_run_opened(run_, (folder_ + name).c_str());
            return true;
        }
        if (!first) first = errno;
    }
    errno = first;
    return false;
}

void reader::touch(uint64_t size) {
    touched_ += size;
    if (touched_ > hold_bytes) let_go_of_files();
}

void reader::let_go_of_files() {
    touched_ = 0;
    let_go(doc_.map);
    for (const loaded_buffer &b : buffers_) let_go(b.file.view());
}

const bytes &reader::buffer(int i) {
    if (i < 0 || (size_t)i >= doc_.buffers.size())
        fail(err_, PBS_DATA, "buffer %d, but there are %zu", i, doc_.buffers.size());
    loaded_buffer &b = buffers_[(size_t)i];
    const buffer_entry &e = doc_.buffers[(size_t)i];
    if (b.loaded) return b.view;
    if (e.has_uri && is_data_uri(e.uri)) {
        b.decoded = decode_data_uri(run_, e.uri, &b.view.size, err_);
        b.view.data = b.decoded.data();
    } else if (e.has_uri) {
        std::string uri = unescape(e.uri);
        if (!find_file(uri, b.file))
            fail(err_, PBS_DATA, "buffer %d: %.200s: %s", i, uri.c_str(),
                 errno == EINVAL ? "not a file beside the scene" : strerror(errno));
        b.view = b.file.view();
    } else if (i == 0 && doc_.bin.data) {
        b.view = doc_.bin;
    } else {
        fail(err_, PBS_DATA, "buffer %d has no data%s", i,
             e.fallback ? ": it stands for EXT_meshopt_compression, which this view lacks" : "");
    }
    if (b.view.size < e.length)
        fail(err_, PBS_DATA, "buffer %d has %llu bytes of %llu: it is cut off", i, (ull)b.view.size,
             (ull)e.length);
    b.view.size = e.length;
    b.loaded = true;
    return b.view;
}

/* A part of a buffer, for a view. */
bytes reader::range(int i, uint64_t offset, uint64_t length, int view) {
    const bytes &b = buffer(i);
    if (offset > b.size || length > b.size - offset)
        fail(err_, PBS_DATA, "bufferView %d: %llu bytes at %llu, but buffer %d has %llu", view,
             (ull)length, (ull)offset, i, (ull)b.size);
    return {b.data + offset, length};
}

bytes reader::whole_view(int view) {
    if (view < 0 || (size_t)view >= doc_.views.size())
        fail(err_, PBS_DATA, "bufferView %d, but there are %zu", view, doc_.views.size());
    const view_entry &v = doc_.views[(size_t)view];
    if (v.meshopt != absent) return decoded_view(view);
    return range(v.buffer, v.offset, v.length, view);
}

bytes reader::slice(int view, uint64_t offset, uint64_t length) {
    bytes b = whole_view(view);
    if (offset > b.size || length > b.size - offset)
        fail(err_, PBS_DATA, "%llu bytes at %llu are needed, but bufferView %d has %llu",
             (ull)length, (ull)offset, view, (ull)b.size);
    return {b.data + offset, length};
}

uint32_t component_size(int type) {
    switch (type) {
    case TINYGLTF_COMPONENT_TYPE_BYTE:
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE:
        return 1;
    case TINYGLTF_COMPONENT_TYPE_SHORT:
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT:
        return 2;
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT:
    case TINYGLTF_COMPONENT_TYPE_FLOAT:
        return 4;
    default:
        return 0;
    }
}

/* Zeros that need no data may be as many as somebody likes to write: 20 bytes of JSON must not
 * keep us busy for an hour. */
static const uint64_t max_without_data = 1 << 26;

void reader::open_sparse(stream &s, const sparse_entry &sp) {
    int type = sp.where_type;
    uint32_t width = component_size(type);
    if (type != TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE &&
        type != TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT &&
        type != TINYGLTF_COMPONENT_TYPE_UNSIGNED_INT)
        fail(err_, PBS_DATA, "sparse indices of type %d", type);
    uint64_t n = sp.count;
    if (n > s.count) fail(err_, PBS_DATA, "%llu sparse values of %llu", (ull)n, (ull)s.count);
    s.where = slice(sp.where_view, sp.where_offset, n * width).data;
    s.values = slice(sp.values_view, sp.values_offset, n * s.element).data;
    s.where_type = type;
    s.sparse_count = n;
    int64_t last = -1;
    for (uint64_t j = 0; j < n; j++) {
        int64_t i = load_index(s.where + j * width, type);
        if (i <= last || (uint64_t)i >= s.count)
            fail(err_, PBS_DATA, "sparse index %lld at place %llu: out of order or range",
                 (long long)i, (ull)j);
        last = i;
    }
}

/* The stride of an accessor's view. A stride that would tear numbers apart or let elements
 * overlap is no reading of the file that anybody meant. */
static uint64_t stride_of(const document &doc, int view, const stream &s, pbs_err *err) {
    const view_entry &v = doc.views[(size_t)view];
    if (!v.stride && v.meshopt != absent)
        return std::max<uint64_t>(doc.meshopt[(size_t)v.meshopt].stride, s.element);
    if (!v.stride) return s.element;
    uint32_t width = component_size(s.type);
    if (v.stride < 0 || (uint64_t)v.stride % width || (uint64_t)v.stride < s.element)
        fail(err, PBS_DATA, "bufferView %d: byteStride %lld for elements of %u bytes", view,
             (long long)v.stride, s.element);
    return (uint64_t)v.stride;
}

void reader::place_stream(stream &s, const accessor_entry &a) {
    static const uint8_t zeros[64] = {0};
    if (a.view == absent) {
        if (s.count > max_without_data)
            fail(err_, PBS_DATA, "%llu elements without data", (ull)s.count);
        s.data = zeros;
        return;
    }
    if (a.view < 0 || (size_t)a.view >= doc_.views.size())
        fail(err_, PBS_DATA, "bufferView %d, but there are %zu", a.view, doc_.views.size());
    s.stride = stride_of(doc_, a.view, s, err_);
    uint64_t length = 0;
    if (s.count && (__builtin_mul_overflow(s.count - 1, s.stride, &length) ||
                    __builtin_add_overflow(length, s.element, &length)))
        fail(err_, PBS_DATA, "%llu elements", (ull)s.count);
    s.data = slice(a.view, a.offset, length).data;
}

stream reader::open_stream(int accessor) {
    if (accessor < 0 || (size_t)accessor >= doc_.accessors.size())
        fail(err_, PBS_DATA, "accessor %d, but there are %zu", accessor, doc_.accessors.size());
    const accessor_entry &a = doc_.accessors[(size_t)accessor];
    stream s;
    in_place(err_, "accessor", (size_t)accessor, nullptr, [&] {
        uint32_t width = component_size(a.type);
        if (!width) fail(err_, PBS_DATA, "component type %d", a.type);
        s.type = a.type;
        s.components = a.components;
        s.element = width * a.components;
        s.normalized = a.normalized;
        s.count = a.count;
        place_stream(s, a);
        if (a.sparse != absent) open_sparse(s, doc_.sparse[(size_t)a.sparse]);
    });
    return s;
}

const uint8_t *stream::at(uint64_t i) const {
    if (!sparse_count) return data + i * stride;
    uint64_t lo = 0, hi = sparse_count;
    uint32_t width = component_size(where_type);
    while (lo < hi) {
        uint64_t mid = (lo + hi) / 2;
        if (load_index(where + mid * width, where_type) < i)
            lo = mid + 1;
        else
            hi = mid;
    }
    if (lo < sparse_count && load_index(where + lo * width, where_type) == i)
        return values + lo * element;
    return data + i * stride;
}

template <class T>
static void convert(const uint8_t *p, int n, bool normalized, double scale, double *out) {
    for (int k = 0; k < n; k++) {
        T v;
        memcpy(&v, p + (size_t)k * sizeof v, sizeof v);
        double d = (double)v / (normalized ? scale : 1);
        out[k] = normalized && d < -1 ? -1 : d;
    }
}

void stream::get(uint64_t i, double *out) const {
    const uint8_t *p = at(i);
    switch (type) {
    case TINYGLTF_COMPONENT_TYPE_FLOAT:
        return convert<float>(p, components, false, 1, out);
    case TINYGLTF_COMPONENT_TYPE_BYTE:
        return convert<int8_t>(p, components, normalized, 127, out);
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_BYTE:
        return convert<uint8_t>(p, components, normalized, 255, out);
    case TINYGLTF_COMPONENT_TYPE_SHORT:
        return convert<int16_t>(p, components, normalized, 32767, out);
    case TINYGLTF_COMPONENT_TYPE_UNSIGNED_SHORT:
        return convert<uint16_t>(p, components, normalized, 65535, out);
    default:
        return convert<uint32_t>(p, components, normalized, 4294967295.0, out);
    }
}

} // namespace pbs::gltf
