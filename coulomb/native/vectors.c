/* Operations on long vectors, each of which reads and writes its data once. */

#include <string.h>

#include "lanes.h"

#define MOST_ROWS 64
#define PIECE 1024 /* numbers that stay in the fastest cache */

static long begin_of(long n, int t, int threads) { return 8 * (n / 8 * t / threads); }
static long end_of(long n, int t, int threads) { return t + 1 < threads ? begin_of(n, t + 1, threads) : n; }

/* d <- factor inverse b, and x <- d. */
void from_zero(long n, int threads, double factor, const double *restrict inverse, const double *restrict b,
               double *restrict d, double *restrict x)
{
#pragma omp parallel for schedule(static) num_threads(threads) if (threads > 1)
    for (long i = 0; i < n; i++)
        x[i] = d[i] = factor * (inverse[i] * b[i]);
}

/* u <- u + sum of c_k rows_k, and r <- r - sum of c_k images_k, of `count` <= 4 rows. */
static inline __attribute__((always_inline)) void add_rows(const int count, long n, long length, const double *c,
                                                           const double *rows, const float *images, double *u, double *r)
{
    long i = 0;
    for (; i + 4 <= length; i += 4) {
        d4 sum = *(d4 *)(u + i), left = *(d4 *)(r + i);
        for (int k = 0; k < count; k++) {
            sum += c[k] * *(const d4 *)(rows + n * k + i);
            left -= c[k] * up4(images + n * k + i);
        }
        *(d4 *)(u + i) = sum;
        *(d4 *)(r + i) = left;
    }
    for (; i < length; i++)
        for (int k = 0; k < count; k++) {
            u[i] += c[k] * rows[n * k + i];
            r[i] -= c[k] * images[n * k + i];
        }
}

/* u <- sum of c_k rows_k, and r <- r - sum of c_k images_k; rows of n numbers, the images in single precision. */
void combine(long n, int threads, int count, const double *c, const double *rows, const float *images, double *u,
             double *r)
{
#pragma omp parallel for schedule(static) num_threads(threads) if (threads > 1)
    for (long piece = 0; piece < (n + PIECE - 1) / PIECE; piece++) {
        const long i = PIECE * piece, length = i + PIECE < n ? PIECE : n - i;
        int k = 0;
        memset(u + i, 0, sizeof(double) * length);
        for (; k + 4 <= count; k += 4)
            add_rows(4, n, length, c + k, rows + n * k + i, images + n * k + i, u + i, r + i);
        for (; k < count; k++)
            add_rows(1, n, length, c + k, rows + n * k + i, images + n * k + i, u + i, r + i);
    }
}

/* The inner products of `count` <= 4 images with r. */
static inline __attribute__((always_inline)) void inner(const int count, long n, long length, const float *images,
                                                        const double *r, double *products)
{
    d4 sums[4] = {{0}, {0}, {0}, {0}};
    long i = 0;
    for (; i + 4 <= length; i += 4) {
        const d4 here = *(const d4 *)(r + i);
        for (int k = 0; k < count; k++)
            sums[k] += up4(images + n * k + i) * here;
    }
    for (int k = 0; k < count; k++) {
        for (int j = 0; j < 4; j++)
            products[k] += sums[k][j];
        for (long j = i; j < length; j++)
            products[k] += images[n * k + j] * r[j];
    }
}

/* The inner products of r with the images, at most MOST_ROWS, added up by threads in their order. */
void project(long n, int threads, int count, const float *images, const double *r, double *products)
{
    double parts[MOST_THREADS][MOST_ROWS] = {{0.0}};
#pragma omp parallel for schedule(static) num_threads(threads) if (threads > 1)
    for (int t = 0; t < threads; t++) {
        const long begin = begin_of(n, t, threads), end = end_of(n, t, threads);
        for (long first = begin; first < end; first += PIECE) {
            const long length = first + PIECE < end ? PIECE : end - first;
            int k = 0;
            for (; k + 4 <= count; k += 4)
                inner(4, n, length, images + n * k + first, r + first, parts[t] + k);
            for (; k < count; k++)
                inner(1, n, length, images + n * k + first, r + first, parts[t] + k);
        }
    }
    for (int k = 0; k < count; k++) {
        products[k] = 0.0;
        for (int t = 0; t < threads; t++)
            products[k] += parts[t][k];
    }
}

/* row <- factor u, image <- factor change. */
void keep(long n, int threads, double factor, const double *restrict u, const double *restrict change,
          double *restrict row, float *restrict image)
{
#pragma omp parallel for schedule(static) num_threads(threads) if (threads > 1)
    for (long i = 0; i < n; i++) {
        row[i] = factor * u[i];
        image[i] = (float)(factor * change[i]);
    }
}
