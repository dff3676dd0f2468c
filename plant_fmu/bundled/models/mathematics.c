/* x = n pi/2 + r + rest, |r| <= pi/4, and sin x is sin or cos of r + rest, up to a sign.
 *
 * |x| < 2^15: Cody and Waite. pi/2 is P1 + P2 + P3, the first two of 38 bits, so that n times
 * each is exact; what x - n P1 - n P2 - n P3 rounds away is kept in rest.
 * Beyond: Payne and Hanek. Of 2/pi only those 192 bits decide x 2/pi modulo 4 that x, an
 * integer times 2^e, does not shift beyond 4; what is left out is less than 2^-137.
 *
 * sin and cos of r are polynomials in r^2, of Chebyshev's interpolation at 60 digits, whose
 * errors are 2^-56 and 2^-59 of 1; their first terms are added last, with what these round. */

#include "mathematics.h"

#include <math.h>
#include <stdint.h>
#include <string.h>

typedef struct {
    double r, rest;
    int quadrant; /* n modulo 4 */
} Reduced;

enum { LIMBS = 6 };

static const double MODERATE = 32768.0, ROUND = 0x1.8p52, TWO_OVER_PI = 0x1.45f306dc9c883p-1;
static const double P1 = 0x1.921fb5444p+0, P2 = 0x1.68c234c4cp-39, P3 = 0x1.98a2e03707345p-77;

/* 2/pi in units of 2^-32, 2^-64, ... */
static const uint32_t DIGITS[] = {
    0xa2f9836e, 0x4e441529, 0xfc2757d1, 0xf534ddc0, 0xdb629599, 0x3c439041, 0xfe5163ab,
    0xdebbc561, 0xb7246e3a, 0x424dd2e0, 0x06492eea, 0x09d1921c, 0xfe1deb1c, 0xb129a73e,
    0xe88235f5, 0x2ebb4484, 0xe99c7026, 0xb45f7e41, 0x3991d639, 0x835339f4, 0x9c845f8b,
    0xbdf9283b, 0x1ff897ff, 0xde05980f, 0xef2f118b, 0x5a0a6d1f, 0x6d367ecf, 0x27cb09b7,
    0x4f463f66, 0x9e5fea2d, 0x7527bac7, 0xebe5f17b, 0x3d0739f7, 0x8a5292ea, 0x6bfb5fb1,
    0x1f8d5d08, 0x56033046, 0xfc7b6bab, 0xf0cfbc20};

/* Digit `index` of 2/pi, the integer part being digit 0. */
static uint64_t digit(int index)
{
    return index < 1 ? 0 : DIGITS[index - 1];
}

/* s + rest = a + b, where |a| >= |b| or a = 0. */
static double add(double a, double b, double *rest)
{
    const double s = a + b;
    *rest = b - (s - a);
    return s;
}

/* p + rest = a b, by halves of 26 bits (Dekker), which do not overflow here. */
static double multiply(double a, double b, double *rest)
{
    const double SPLIT = 134217729.0, p = a * b;
    const double a_split = SPLIT * a, b_split = SPLIT * b;
    const double a_high = a_split - (a_split - a), b_high = b_split - (b_split - b);
    const double a_low = a - a_high, b_low = b - b_high;
    *rest = a_low * b_low - (p - a_high * b_high - a_low * b_high - a_high * b_low);
    return p;
}

static Reduced reduce_large(double x)
{
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    const int exponent = (int)(bits >> 52 & 0x7ff) - 1075; /* |x| = integer 2^exponent */
    const uint64_t integer = (bits & 0xfffffffffffff) | 0x10000000000000;
    const uint32_t factor[] = {(uint32_t)integer, (uint32_t)(integer >> 32)};

    /* window / 2^(exponent + 190) is 2/pi, modulo 4 / 2^exponent; its first limb is the last. */
    uint32_t window[LIMBS], product[LIMBS] = {0};
    for (int i = 0; i < LIMBS; ++i) {
        const int end = exponent + 190 - 32 * i; /* of the limb, in bits of the fraction */
        const int whole = end >= 0 ? end / 32 : -((31 - end) / 32), part = end - 32 * whole;
        const uint64_t two = digit(whole) << 32 | digit(whole + 1);
        window[i] = (uint32_t)(two >> (32 - part));
    }
    for (int j = 0; j < 2; ++j) {
        uint64_t carry = 0;
        for (int i = 0; i + j < LIMBS; ++i) {
            carry += (uint64_t)factor[j] * window[i] + product[i + j];
            product[i + j] = (uint32_t)carry;
            carry >>= 32;
        }
    }

    /* The two highest bits are n modulo 4, and the rest is the fraction: nearest to n. */
    int quadrant = (int)(product[LIMBS - 1] >> 30);
    const int negative = product[LIMBS - 1] >> 29 & 1;
    product[LIMBS - 1] &= 0x3fffffff;
    if (negative) {
        uint64_t carry = 1;
        for (int i = 0; i < LIMBS; ++i) {
            carry += (uint32_t)~product[i];
            product[i] = (uint32_t)carry;
            carry >>= 32;
        }
        product[LIMBS - 1] &= 0x3fffffff;
        ++quadrant;
    }
    double fraction = 0.0, rest = 0.0, unit = 0x1p-30, lost, low;
    for (int i = LIMBS - 1; i >= 0; --i, unit *= 0x1p-32) {
        fraction = add(fraction, product[i] * unit, &lost);
        rest += lost;
    }
    const double high = multiply(fraction, 0x1.921fb54442d18p+0, &low);
    low += fraction * 0x1.1a62633145c07p-54 + rest * 0x1.921fb54442d18p+0;
    const double r = add(high, low, &rest);
    if ((x < 0.0) == negative)
        return (Reduced){r, rest, x < 0.0 ? -quadrant & 3 : quadrant & 3};
    return (Reduced){-r, -rest, x < 0.0 ? -quadrant & 3 : quadrant & 3};
}

static Reduced reduce(double x)
{
    if (!(fabs(x) < MODERATE))
        return isfinite(x) ? reduce_large(x) : (Reduced){x - x, 0.0, 0};
    const double n = x * TWO_OVER_PI + ROUND - ROUND;
    const double first = x - n * P1, second = n * P2, sum = first - second;
    const double changed = sum - first; /* what sum rounds away, whichever is greater (Knuth) */
    const double lost = (first - (sum - changed)) - (second + changed);
    const double low = n * P3 - lost, r = sum - low;
    return (Reduced){r, (sum - r) - low, (int)n & 3};
}

static double polynomial_of_sine(double r, double rest)
{
    const double z = r * r, cube = z * r, w = z * z;
    const double tail = 0x1.1111111110bb1p-7 + z * -0x1.a01a019e8357dp-13 +
                        w * (0x1.71de37961e4c6p-19 + z * -0x1.ae600a926c89ap-26 +
                             w * 0x1.5e0af186af739p-33);
    return r - ((z * (0.5 * rest - cube * tail) - rest) + cube * 0x1.5555555555555p-3);
}

static double polynomial_of_cosine(double r, double rest)
{
    const double z = r * r, half = 0.5 * z, most = 1.0 - half, w = z * z;
    const double tail = 0x1.5555555555555p-5 + z * -0x1.6c16c16c16966p-10 +
                        w * (0x1.a01a019f4e867p-16 + z * -0x1.27e4fa17a41b4p-22 +
                             w * (0x1.1eeb68b109173p-29 + z * -0x1.907d7aebd5e3dp-37));
    return most + (((1.0 - most) - half) + (w * tail - r * rest));
}

static double turned(Reduced x, int quadrant)
{
    const double y = quadrant & 1 ? polynomial_of_cosine(x.r, x.rest)
                                  : polynomial_of_sine(x.r, x.rest);
    return quadrant & 2 ? -y : y;
}

double sine(double x)
{
    const Reduced reduced = reduce(x);
    return turned(reduced, reduced.quadrant);
}

double cosine(double x)
{
    const Reduced reduced = reduce(x);
    return turned(reduced, reduced.quadrant + 1);
}

void sine_and_cosine(double x, double *s, double *c)
{
    const Reduced reduced = reduce(x);
    const double a = polynomial_of_sine(reduced.r, reduced.rest);
    const double b = polynomial_of_cosine(reduced.r, reduced.rest);
    const double sine = reduced.quadrant & 1 ? b : a, cosine = reduced.quadrant & 1 ? a : b;
    *s = reduced.quadrant & 2 ? -sine : sine;
    *c = (reduced.quadrant + 1) & 2 ? -cosine : cosine;
}

double inverse_fifth_root(double x)
{
    /* 2^(1/10 - j/5): within 2^(1/10) of the root, so that five of Newton's steps are enough. */
    static const double NEAR[] = {0x1.125fbee250664p+0, 0x1.ddb680117ab12p-1, 0x1.9fdf8bcce533dp-1,
                                  0x1.6a09e667f3bcdp-1, 0x1.3b2c47bff8329p-1};
    int exponent;
    const double mantissa = frexp(x, &exponent);
    const int j = (exponent % 5 + 5) % 5;
    const double scaled = ldexp(mantissa, j);
    double y = NEAR[j];
    for (int i = 0; i < 5; ++i) {
        const double square = y * y;
        y += y * (1.0 - scaled * (square * square * y)) / 5.0;
    }
    return ldexp(y, -(exponent - j) / 5);
}

double inverse_eighth_root(double x)
{
    return 1.0 / sqrt(sqrt(sqrt(x)));
}

double inverse_tenth_root(double x)
{
    return sqrt(inverse_fifth_root(x));
}
