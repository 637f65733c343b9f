/* Whole numbers of 256 bits against long-hand arithmetic, digit by digit in base 2^16. */
#include "libcore/voxels/exact.h"
#include "libcore/data/rng.h"
#include "tests/check.h"

enum { DIGITS = 16 };
typedef struct slow {
    uint16_t d[DIGITS]; /* two's complement, lowest first */
} slow;

static slow slow_of(unsigned __int128 low, unsigned __int128 high) {
    slow s;
    for (int i = 0; i < 8; i++)
        s.d[i] = (uint16_t)(low >> 16 * i), s.d[8 + i] = (uint16_t)(high >> 16 * i);
    return s;
}
static slow slow_of128(__int128 a) {
    return slow_of((unsigned __int128)a, a < 0 ? ~(unsigned __int128)0 : 0);
}
static slow slow_wide(pbs_wide w) {
    return slow_of(w.low, (unsigned __int128)w.high);
}
static slow slow_add(slow a, slow b) {
    uint32_t carry = 0;
    for (int i = 0; i < DIGITS; i++) {
        carry += (uint32_t)a.d[i] + b.d[i];
        a.d[i] = (uint16_t)carry, carry >>= 16;
    }
    return a;
}
static slow slow_negate(slow a) {
    slow one = {{1}};
    for (int i = 0; i < DIGITS; i++) a.d[i] = (uint16_t)~a.d[i];
    return slow_add(a, one);
}
static slow slow_mul(slow a, slow b) {
    slow r = {{0}};
    for (int i = 0; i < DIGITS; i++) {
        uint32_t carry = 0;
        for (int j = 0; i + j < DIGITS; j++) {
            carry += (uint32_t)a.d[i] * b.d[j] + r.d[i + j];
            r.d[i + j] = (uint16_t)carry, carry >>= 16;
        }
    }
    return r;
}
static int slow_sign(slow a) {
    if (a.d[DIGITS - 1] >> 15) return -1;
    for (int i = 0; i < DIGITS; i++)
        if (a.d[i]) return 1;
    return 0;
}
static int same(slow a, slow b) {
    return !memcmp(&a, &b, sizeof a);
}

/* Numbers of all lengths, with many next to powers of two, where carries go wrong. */
static __int128 number(uint64_t i, uint64_t which) {
    uint64_t r = pbs_random(7, which, 3 * i);
    unsigned __int128 v = (unsigned __int128)pbs_random(7, which, 3 * i + 1) << 64;
    v |= pbs_random(7, which, 3 * i + 2);
    if (r & 1) v = (r & 2) ? 0 : ~(unsigned __int128)0;
    v >>= r >> 8 & 127;
    if (r & 4) v = ((unsigned __int128)1 << (r >> 16 & 127)) + (r >> 24 & 3) - 1;
    return (__int128)(r & 8 ? v : -v);
}

TEST(products) {
    for (uint64_t i = 0; i < 20000; i++) {
        __int128 a = number(i, 0), b = number(i, 1);
        slow want = slow_mul(slow_of128(a), slow_of128(b));
        CHECK(same(slow_wide(pbs_wide_mul(a, b)), want));
        want = slow_mul(slow_of128(a), slow_of128((int64_t)b));
        CHECK(same(slow_wide(pbs_wide_mul64(a, (int64_t)b)), want));
    }
}

TEST(sums_and_signs) {
    for (uint64_t i = 0; i < 20000; i++) {
        pbs_wide a = pbs_wide_mul(number(i, 2), number(i, 3) >> 2);
        pbs_wide b = i % 4 ? pbs_wide_mul(number(i, 4), number(i, 5) >> 2) : a;
        if (i % 8 == 4) b = pbs_wide_add(a, pbs_wide_of(number(i, 6) >> 120));
        slow sa = slow_wide(a), sb = slow_wide(b), difference = slow_add(sa, slow_negate(sb));
        CHECK(same(slow_wide(pbs_wide_add(a, b)), slow_add(sa, sb)));
        CHECK(same(slow_wide(pbs_wide_sub(a, b)), difference));
        CHECK(same(slow_wide(pbs_wide_negate(a)), slow_negate(sa)));
        CHECK(pbs_wide_sign(a) == slow_sign(sa));
        CHECK(pbs_wide_compare(a, b) == slow_sign(difference));
        CHECK(pbs_wide_compare(a, b) == -pbs_wide_compare(b, a));
    }
    CHECK(pbs_wide_sign(pbs_wide_of(0)) == 0);
    CHECK(pbs_wide_sign((pbs_wide){0, 1}) == 1);
    CHECK(pbs_wide_sign((pbs_wide){~(unsigned __int128)0, 0}) == 1);
    CHECK(pbs_wide_sign((pbs_wide){~(unsigned __int128)0, -1}) == -1);
}

TEST(coordinates) {
    const double most = 1 << 20, step = 1 / 4294967296.0;
    CHECK(pbs_fixed(most) == (int64_t)1 << 52);
    CHECK(pbs_fixed(-most + step) == -((int64_t)1 << 52) + 1);
    CHECK(pbs_fixed(-step) == -1 && pbs_fixed(0.5) == PBS_FIXED_ONE / 2);
    int64_t far = pbs_fixed(most) * 2;
    CHECK(pbs_cross(far, -far, far, far) == (__int128)1 << 107);
    CHECK(pbs_sign128(pbs_cross(far, far - 1, far + 1, far)) == 1);
    CHECK(pbs_sign128(pbs_cross(far, far, far, far)) == 0);
    CHECK(pbs_sign128(pbs_cross(far, far, far, far - 1)) == -1);
}

TEST_MAIN
