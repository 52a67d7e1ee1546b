/* SPDX-License-Identifier: MIT OR Apache-2.0
 *
 * The same fleet with the kernel written in AVX2 and AVX-512 intrinsics; which of
 * them the processor can run is found out at run time.
 *
 *   gcc -O3 fleet_intrinsics.c -lm
 */
#include "fleet_common.h"
#include <immintrin.h>
#include <string.h>

/* Vectors of robots in a tile; one of 512 bits takes 1 KiB. */
#ifndef TILE_BLOCKS
#define TILE_BLOCKS 16
#endif

#define REAL double
#define VECTOR __m256d
#define LANES 4
#define TARGET __attribute__((target("avx2,fma")))
#define NAME(a) a##_avx2_f64
#define SPLAT(a) _mm256_set1_pd(a)
#define LOAD(p) _mm256_load_pd(p)
#define STORE(p, a) _mm256_store_pd(p, a)
#define ADD(a, b) _mm256_add_pd(a, b)
#define SUB(a, b) _mm256_sub_pd(a, b)
#define MUL(a, b) _mm256_mul_pd(a, b)
#define FMA(a, b, c) _mm256_fmadd_pd(a, b, c)
#define FNMA(a, b, c) _mm256_fnmadd_pd(a, b, c)
#include "fleet_kernel.inc"

#define REAL float
#define VECTOR __m256
#define LANES 8
#define TARGET __attribute__((target("avx2,fma")))
#define NAME(a) a##_avx2_f32
#define SPLAT(a) _mm256_set1_ps(a)
#define LOAD(p) _mm256_load_ps(p)
#define STORE(p, a) _mm256_store_ps(p, a)
#define ADD(a, b) _mm256_add_ps(a, b)
#define SUB(a, b) _mm256_sub_ps(a, b)
#define MUL(a, b) _mm256_mul_ps(a, b)
#define FMA(a, b, c) _mm256_fmadd_ps(a, b, c)
#define FNMA(a, b, c) _mm256_fnmadd_ps(a, b, c)
#include "fleet_kernel.inc"

#define REAL double
#define VECTOR __m512d
#define LANES 8
#define TARGET __attribute__((target("avx512f")))
#define NAME(a) a##_avx512_f64
#define SPLAT(a) _mm512_set1_pd(a)
#define LOAD(p) _mm512_load_pd(p)
#define STORE(p, a) _mm512_store_pd(p, a)
#define ADD(a, b) _mm512_add_pd(a, b)
#define SUB(a, b) _mm512_sub_pd(a, b)
#define MUL(a, b) _mm512_mul_pd(a, b)
#define FMA(a, b, c) _mm512_fmadd_pd(a, b, c)
#define FNMA(a, b, c) _mm512_fnmadd_pd(a, b, c)
#include "fleet_kernel.inc"

#define REAL float
#define VECTOR __m512
#define LANES 16
#define TARGET __attribute__((target("avx512f")))
#define NAME(a) a##_avx512_f32
#define SPLAT(a) _mm512_set1_ps(a)
#define LOAD(p) _mm512_load_ps(p)
#define STORE(p, a) _mm512_store_ps(p, a)
#define ADD(a, b) _mm512_add_ps(a, b)
#define SUB(a, b) _mm512_sub_ps(a, b)
#define MUL(a, b) _mm512_mul_ps(a, b)
#define FMA(a, b, c) _mm512_fmadd_ps(a, b, c)
#define FNMA(a, b, c) _mm512_fnmadd_ps(a, b, c)
#include "fleet_kernel.inc"

int main(int argc, char **argv)
{
    const Work work = work_of(argc, argv);
    __builtin_cpu_init();
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) {
        measure_avx2_f64("c-avx2-f64", work);
        measure_avx2_f32("c-avx2-f32", work);
    } else {
        fprintf(stderr, "c-avx2: this processor has no AVX2 with FMA\n");
    }
    if (__builtin_cpu_supports("avx512f")) {
        measure_avx512_f64("c-avx512-f64", work);
        measure_avx512_f32("c-avx512-f32", work);
    } else {
        fprintf(stderr, "c-avx512: this processor has no AVX-512\n");
    }
    return 0;
}
