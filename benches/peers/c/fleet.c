/* SPDX-License-Identifier: MIT OR Apache-2.0
 *
 * A fleet of differential-drive robots in plain C, for the compiler to vectorize.
 *
 *   gcc -Ofast -march=native -mprefer-vector-width=512 -fopenmp-simd fleet.c -lm
 *   … -DREAL=float for single precision
 *
 * Robots lie in structures of arrays, a tile of them at a time. A tile takes all
 * its steps before the next tile begins, so that it stays in the cache.
 */
#include "fleet_common.h"
#include <string.h>

#ifndef REAL
#define REAL double
#endif

/* Robots in a tile. Some 16 arrays of this length have to fit the L1 cache. A power
 * of two would put the arrays on the same cache sets. */
#ifndef TILE
#define TILE (sizeof(REAL) == 8 ? 240 : 496)
#endif

/* In C an enum is the constant expression an array's length needs. */
enum { TILE_LENGTH = TILE };

typedef struct {
    REAL x[TILE_LENGTH], y[TILE_LENGTH], v[TILE_LENGTH], w[TILE_LENGTH];
    REAL i_l[TILE_LENGTH], i_r[TILE_LENGTH];
    /* The heading: an angle in the first kernel, cosine and sine in the second. */
    REAL theta[TILE_LENGTH], c[TILE_LENGTH], s[TILE_LENGTH];
    REAL pull[TILE_LENGTH], swing[TILE_LENGTH], turn[TILE_LENGTH], drag[TILE_LENGTH];
    REAL decay[TILE_LENGTH], back_v[TILE_LENGTH], back_w[TILE_LENGTH];
    REAL u_l[TILE_LENGTH], u_r[TILE_LENGTH];
} __attribute__((aligned(64))) Tile;

/* The states that feed back on others, without the heading. */
typedef struct {
    REAL v, w, i_l, i_r;
} Motion;

static inline __attribute__((always_inline)) Motion rate(const Tile *t, int k, Motion m)
{
    const REAL back = t->back_v[k] * m.v, spin = t->back_w[k] * m.w;
    return (Motion){
        .v = t->pull[k] * (m.i_l + m.i_r) + t->swing[k] * m.w * m.w,
        .w = t->turn[k] * (m.i_r - m.i_l) - t->drag[k] * m.v * m.w,
        .i_l = t->u_l[k] - t->decay[k] * m.i_l - (back - spin),
        .i_r = t->u_r[k] - t->decay[k] * m.i_r - (back + spin),
    };
}

static inline __attribute__((always_inline)) Motion ahead(Motion m, REAL h, Motion d)
{
    return (Motion){ m.v + h * d.v, m.w + h * d.w, m.i_l + h * d.i_l, m.i_r + h * d.i_r };
}

static inline __attribute__((always_inline)) REAL mean(REAL k1, REAL k2, REAL k3, REAL k4)
{
    return (REAL)(1.0 / 6) * (k1 + k4) + (REAL)(1.0 / 3) * (k2 + k3);
}

/* Sine and cosine of the C library under names of our own, with the vector variants
 * of libmvec declared. Under their usual names gcc would merge the two into one call
 * of sincos, which has no vector variant, and leave the whole loop scalar. */
#define VECTOR_MATH __attribute__((simd("notinbranch"), const, nothrow))
extern VECTOR_MATH double sine_f64(double) __asm__("sin");
extern VECTOR_MATH double cosine_f64(double) __asm__("cos");
extern VECTOR_MATH float sine_f32(float) __asm__("sinf");
extern VECTOR_MATH float cosine_f32(float) __asm__("cosf");
#define SINE(a) _Generic((a), double: sine_f64, float: sine_f32)(a)
#define COSINE(a) _Generic((a), double: cosine_f64, float: cosine_f32)(a)

#define STAGES                                                                  \
    const Motion m1 = { t->v[k], t->w[k], t->i_l[k], t->i_r[k] };               \
    const Motion d1 = rate(t, k, m1);                                           \
    const Motion m2 = ahead(m1, h / 2, d1), d2 = rate(t, k, m2);                \
    const Motion m3 = ahead(m1, h / 2, d2), d3 = rate(t, k, m3);                \
    const Motion m4 = ahead(m1, h, d3), d4 = rate(t, k, m4);

#define FINISH                                                                  \
    t->v[k] = m1.v + h * mean(d1.v, d2.v, d3.v, d4.v);                          \
    t->w[k] = m1.w + h * mean(d1.w, d2.w, d3.w, d4.w);                          \
    t->i_l[k] = m1.i_l + h * mean(d1.i_l, d2.i_l, d3.i_l, d4.i_l);              \
    t->i_r[k] = m1.i_r + h * mean(d1.i_r, d2.i_r, d3.i_r, d4.i_r);

/* The equations as they are written: an angle, its sine and cosine at each stage. */
static __attribute__((noinline)) void angle(Tile *restrict t, long steps)
{
    const REAL h = (REAL)STEP;
    for (long n = 0; n < steps; n++) {
#pragma omp simd
        for (int k = 0; k < TILE_LENGTH; k++) {
            STAGES
            const REAL a1 = t->theta[k], a2 = a1 + h / 2 * m1.w;
            const REAL a3 = a1 + h / 2 * m2.w, a4 = a1 + h * m3.w;
            t->x[k] += h * mean(m1.v * COSINE(a1), m2.v * COSINE(a2),
                                m3.v * COSINE(a3), m4.v * COSINE(a4));
            t->y[k] += h * mean(m1.v * SINE(a1), m2.v * SINE(a2),
                                m3.v * SINE(a3), m4.v * SINE(a4));
            t->theta[k] = a1 + h * mean(m1.w, m2.w, m3.w, m4.w);
            FINISH
        }
    }
}

/* The heading as a unit vector: dc = -w s, ds = w c. No trigonometry. */
static __attribute__((noinline)) void unit(Tile *restrict t, long steps)
{
    const REAL h = (REAL)STEP;
    for (long n = 0; n < steps; n++) {
#pragma omp simd
        for (int k = 0; k < TILE_LENGTH; k++) {
            STAGES
            const REAL c1 = t->c[k], s1 = t->s[k];
            const REAL p1 = m1.w * s1, q1 = m1.w * c1;
            const REAL c2 = c1 - h / 2 * p1, s2 = s1 + h / 2 * q1;
            const REAL p2 = m2.w * s2, q2 = m2.w * c2;
            const REAL c3 = c1 - h / 2 * p2, s3 = s1 + h / 2 * q2;
            const REAL p3 = m3.w * s3, q3 = m3.w * c3;
            const REAL c4 = c1 - h * p3, s4 = s1 + h * q3;
            const REAL p4 = m4.w * s4, q4 = m4.w * c4;
            t->x[k] += h * mean(m1.v * c1, m2.v * c2, m3.v * c3, m4.v * c4);
            t->y[k] += h * mean(m1.v * s1, m2.v * s2, m3.v * s3, m4.v * s4);
            const REAL c = c1 - h * mean(p1, p2, p3, p4);
            const REAL s = s1 + h * mean(q1, q2, q3, q4);
            /* One Newton step towards length one; it is at most an ulp or so away. */
            const REAL norm = (REAL)1.5 - (REAL)0.5 * (c * c + s * s);
            t->c[k] = c * norm;
            t->s[k] = s * norm;
            FINISH
        }
    }
}

static void load(Tile *t, long tile)
{
    memset(t, 0, sizeof *t);
    for (int k = 0; k < TILE_LENGTH; k++) {
        const Coefficients of = robot(tile * TILE_LENGTH + k);
        t->c[k] = 1;
        t->pull[k] = (REAL)of.pull, t->swing[k] = (REAL)of.swing;
        t->turn[k] = (REAL)of.turn, t->drag[k] = (REAL)of.drag;
        t->decay[k] = (REAL)of.decay;
        t->back_v[k] = (REAL)of.back_v, t->back_w[k] = (REAL)of.back_w;
        t->u_l[k] = (REAL)of.u_l, t->u_r[k] = (REAL)of.u_r;
    }
}

static void measure(const char *peer, Work work, void (*kernel)(Tile *restrict, long))
{
    /* Whole tiles only: the fleet is rounded up. */
    const long tiles = (work.robots + TILE_LENGTH - 1) / TILE_LENGTH;
    work.robots = tiles * TILE_LENGTH;
    Tile *fleet = aligned_alloc(64, (size_t)tiles * sizeof *fleet);
    double *seconds = malloc((size_t)work.rounds * sizeof *seconds);
    if (!fleet || !seconds) abort();
    for (long r = 0; r < work.rounds; r++) {
        for (long i = 0; i < tiles; i++) load(&fleet[i], i);
        const double start = now();
        for (long i = 0; i < tiles; i++) kernel(&fleet[i], work.steps);
        seconds[r] = now() - start;
    }
    double sum = 0;
    for (long k = 0; k < CHECKED; k++) sum += (double)fleet[k / TILE_LENGTH].x[k % TILE_LENGTH];
    report(peer, work, seconds, (double)fleet[0].x[0], sum / CHECKED);
    free(seconds);
    free(fleet);
}

int main(int argc, char **argv)
{
    const Work work = work_of(argc, argv);
    const int wide = sizeof(REAL) == 8;
    measure(wide ? "c-ofast-f64" : "c-ofast-f32", work, angle);
    measure(wide ? "c-ofast-unit-f64" : "c-ofast-unit-f32", work, unit);
    return 0;
}
