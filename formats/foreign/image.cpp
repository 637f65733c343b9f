/* image.cpp: the module "image": OpenImageIO, from memory to 8 bits a channel and back. */
#include "formats/foreign/guard.hpp"
#include "formats/readers/module.h"
#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>
#include <cstring>
#include <mutex>
#include <string>
#include <zlib.h>

namespace pbs::image {

static const int max_side = 16384;

/* We have our own threads, and a file that claims to be huge is refused before it is believed. */
static void settle() {
    static std::once_flag once;
    std::call_once(once, [] {
        OIIO::attribute("threads", 1);
        OIIO::attribute("exr_threads", 1);
        OIIO::attribute("limits:imagesize_MB", 4096);
    });
}

/* The library finds the plugin by a name's ending. Told only "an image", it would ask all of them
 * in turn, and those that cannot read from memory would look for a file of that name. */
static const char *kind_of(const uint8_t *p, size_t n) {
    struct magic {
        const char *ending;
        size_t at, length;
        const char *bytes;
    };
    static const magic known[] = {
        {"png", 0, 8, "\x89PNG\r\n\x1a\n"},
        {"jpg", 0, 3, "\xff\xd8\xff"},
        {"webp", 8, 4, "WEBP"},
        {"exr", 0, 4, "\x76\x2f\x31\x01"},
        {"gif", 0, 4, "GIF8"},
        {"bmp", 0, 2, "BM"},
        {"tif", 0, 4, "II*\0"},
        {"tif", 0, 4, "MM\0*"},
        {"dds", 0, 4, "DDS "},
        {"psd", 0, 4, "8BPS"},
        {"hdr", 0, 2, "#?"},
        {"jp2", 0, 8, "\0\0\0\x0cjP  "},
        {"avif", 4, 8, "ftypavif"},
        {"heic", 4, 8, "ftypheic"},
        {"ppm", 0, 2, "P6"},
        {"pgm", 0, 2, "P5"},
        {"ppm", 0, 2, "P3"},
        {"pgm", 0, 2, "P2"},
        {"pbm", 0, 2, "P4"},
        {"pbm", 0, 2, "P1"},
    };
    for (const magic &m : known)
        if (n >= m.at + m.length && !memcmp(p + m.at, m.bytes, m.length)) return m.ending;
    /* Targa has no mark at its begin; types 1 2 3 and their packed forms 9 10 11. */
    if (n > 18 && p[1] <= 1 && (p[2] & ~8) >= 1 && (p[2] & ~8) <= 3) return "tga";
    return nullptr;
}

static uint32_t be32(const uint8_t *p) {
    return (uint32_t)p[0] << 24 | (uint32_t)p[1] << 16 | (uint32_t)p[2] << 8 | p[3];
}

/* On a damaged PNG libpng writes to stderr, and OpenImageIO leaks. Its chunks tell before whether
 * it is whole: each has a checksum, and the last is IEND. */
static void check_png(const uint8_t *p, size_t n, pbs_err *err) {
    for (size_t at = 8; n - at >= 12;) {
        size_t length = be32(p + at);
        if (length > n - at - 12) break;
        if (crc32(0, p + at + 4, (uInt)length + 4) != be32(p + at + 8 + length))
            fail(err, PBS_DATA, "the PNG chunk at byte %zu is damaged", at);
        if (!memcmp(p + at + 4, "IEND", 4)) return;
        at += length + 12;
    }
    fail(err, PBS_DATA, "the PNG is cut off");
}

static std::string last_error() {
    std::string text = OIIO::geterror();
    return text.substr(0, text.find('\n'));
}

static void check_size(const OIIO::ImageSpec &spec, pbs_err *err) {
    if (spec.width < 1 || spec.height < 1 || spec.depth > 1 || spec.nchannels < 1)
        fail(err, PBS_DATA, "not a flat image");
    if (spec.width > max_side || spec.height > max_side)
        fail(err, PBS_DATA, "%d x %d is more than %d a side", spec.width, spec.height, max_side);
}

/* One to four channels that lie in steps of four become rgb and alpha. */
static void fill_channels(uint8_t *p, size_t pixels, int channels) {
    if (channels == 4) return;
    for (size_t i = 0; i < pixels; i++, p += 4) {
        p[3] = channels == 2 ? p[1] : 255;
        if (channels < 3) p[1] = p[2] = p[0];
    }
}

static void decode_all(pbs_run *run, const void *data, size_t size, pbs_image *out, pbs_err *err) {
    settle();
    const char *kind = kind_of((const uint8_t *)data, size);
    if (!kind) fail(err, PBS_DATA, "not an image of a known kind");
    if (!strcmp(kind, "png")) check_png((const uint8_t *)data, size, err);
    OIIO::Filesystem::IOMemReader io((void *)data, size);
    OIIO::ImageSpec config;
    /* Colours as stored: the library would multiply them by alpha. */
    config.attribute("oiio:UnassociatedAlpha", 1);
    OIIO::Filesystem::IOProxy *proxy = &io;
    config.attribute("oiio:ioproxy", OIIO::TypeDesc::PTR, &proxy);
    auto in = OIIO::ImageInput::open(std::string("memory.") + kind, &config, proxy);
    if (!in) fail(err, PBS_DATA, "%s", last_error().c_str());
    OIIO::ImageSpec spec = in->spec();
    check_size(spec, err);
    size_t pixels = (size_t)spec.width * (size_t)spec.height;
    /* Some formats are decoded whole inside. */
    counted memory(run, pixels * (size_t)spec.pixel_bytes(true), "decoding an image", err);
    array<uint8_t> rgba(run, pixels * 4, "an image", err);
    int channels = spec.nchannels < 4 ? spec.nchannels : spec.alpha_channel == 3 ? 4 : 3;
    if (!in->read_image(0, 0, 0, channels, OIIO::TypeDesc::UINT8, rgba.data(), 4))
        fail(err, PBS_DATA, "%s", in->geterror().c_str());
    fill_channels(rgba.data(), pixels, channels);
    out->width = (uint32_t)spec.width, out->height = (uint32_t)spec.height;
    out->rgba = rgba.release();
}

static pbs_code decode(pbs_run *run, const char *name, const void *data, size_t size,
                       pbs_image *out, pbs_err *err) {
    pbs_err local;
    pbs_err *e = err ? err : &local;
    pbs_code rc = guard(e, [&] { decode_all(run, data, size, out, e); });
    if (rc == PBS_DATA) pbs_fail_in(e, "%s", name);
    return rc;
}

static void write_all(const char *path, const pbs_image *image, pbs_err *err) {
    settle();
    auto out = OIIO::ImageOutput::create(path);
    if (!out) fail(err, PBS_USAGE, "%s", last_error().c_str());
    int channels = out->supports("alpha") ? 4 : 3;
    OIIO::ImageSpec spec((int)image->width, (int)image->height, channels, OIIO::TypeDesc::UINT8);
    if (channels == 4) {
        spec.alpha_channel = 3;
        spec.attribute("oiio:UnassociatedAlpha", 1);
    }
    bool good = out->open(path, spec) && out->write_image(OIIO::TypeDesc::UINT8, image->rgba, 4);
    good = out->close() && good;
    if (!good) fail(err, PBS_IO, "%s", out->geterror().c_str());
}

static pbs_code write(const char *path, const pbs_image *image, pbs_err *err) {
    return guard(err, [&] { write_all(path, image, err); });
}

} // namespace pbs::image

extern "C" __attribute__((visibility("default")))
const pbs_module_image pbs_module = {PBS_MODULE_ABI, pbs::image::decode, pbs::image::write};
