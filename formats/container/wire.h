/* wire.h: numbers as bytes. The only place that knows the byte order on disk (little endian). */
#ifndef PBS_WIRE_H
#define PBS_WIRE_H

#include <stddef.h>
#include <stdint.h>
#include <string.h>

#if __BYTE_ORDER__ != __ORDER_LITTLE_ENDIAN__
#error "arrays are written and mapped as they lie in memory: a big-endian port swaps them here"
#endif

#define PBS_WIRE(type, name)                                                                       \
    static inline uint8_t *pbs_put_##name(uint8_t *p, type v) {                                    \
        memcpy(p, &v, sizeof v);                                                                   \
        return p + sizeof v;                                                                       \
    }                                                                                              \
    static inline type pbs_get_##name(const uint8_t *p) {                                          \
        type v;                                                                                    \
        memcpy(&v, p, sizeof v);                                                                   \
        return v;                                                                                  \
    }
PBS_WIRE(uint16_t, u16)
PBS_WIRE(uint32_t, u32)
PBS_WIRE(uint64_t, u64)
PBS_WIRE(float, f32)
PBS_WIRE(double, f64)
#undef PBS_WIRE

/* CRC-32C (Castagnoli, reflected, start and end inverted), as in iSCSI: "123456789" gives
 * 0xe3069283. crc is 0 or the result so far. */
uint32_t pbs_crc32c(uint32_t crc, const void *bytes, size_t n);

/* What is missing to the next multiple of `to`, a power of two. */
static inline uint64_t pbs_padding(uint64_t n, uint64_t to) {
    return (0 - n) & (to - 1);
}
#endif
