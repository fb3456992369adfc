/* Vectors of numbers that the kernels work with, and threads.

Vectors have four numbers.  GCC 12 keeps wider ones than the processor's registers in memory: blocks of six columns with
rows of one vector of eight took three to six times as long without AVX-512, and with it as long as two of four (Zen 4). */

#ifndef LANES_H
#define LANES_H

typedef float f4 __attribute__((vector_size(16), aligned(4), may_alias));
typedef double d4 __attribute__((vector_size(32), aligned(8), may_alias));

#define MOST_THREADS 64
#ifdef _OPENMP
#include <omp.h>
#define THREAD omp_get_thread_num()
#define TEAM omp_get_num_threads()
#else /* one after the other */
#define THREAD 0
#define TEAM 1
#endif

#ifdef __AVX__ /* compilers convert a vector in two halves if they are not told otherwise */
#include <immintrin.h>
static inline d4 up4(const float *v) { return (d4)_mm256_cvtps_pd(_mm_loadu_ps(v)); }
#else
static inline d4 up4(const float *v) { return __builtin_convertvector(*(const f4 *)v, d4); }
#endif

#endif
