/* The kernels of blocks.h for blocks of 3 x 3, 3 x 6 and 6 x 6: nodes, and aggregates of nodes with six rigid motions. */

#include "exchange.h"
#include "lanes.h"

void from_zero(long n, int threads, double factor, const double *restrict inverse, const double *restrict b,
               double *restrict d, double *restrict x);

#define KERNELS "blocks.h"
#include "shapes.h"

/* The entries of some rows in blocks of br x bc, rows of blocks ascending: their number, and where `out` is not 0 their
columns and values, what single precision rounds off in `low` where that is not 0.  Of an upper triangle, those before
the block on the diagonal are left out, and that is always there.  -1 if the columns of a row do not ascend. */
long to_blocks(long n, int br, int bc, int upper, const int *ptr, const int *col, const double *val, int *pointers,
               int *out, float *high, float *low)
{
    long count = 0;
    for (long i = 0; i < n; i++) {
        int at[8], end[8];
        pointers[i] = (int)count;
        for (int r = 0; r < br; r++) {
            at[r] = ptr[br * i + r];
            end[r] = ptr[br * i + r + 1];
            for (int k = at[r] + 1; k < end[r]; k++)
                if (col[k] <= col[k - 1])
                    return -1;
            while (upper && at[r] < end[r] && col[at[r]] < bc * i)
                at[r]++;
        }
        for (int first = 1;; first = 0) {
            int j = 0x7fffffff;
            for (int r = 0; r < br; r++)
                if (at[r] < end[r] && col[at[r]] / bc < j)
                    j = col[at[r]] / bc;
            if (upper && first)
                j = (int)i;
            if (j == 0x7fffffff)
                break;
            if (out)
                out[count] = j;
            for (int r = 0; r < br; r++)
                for (; at[r] < end[r] && col[at[r]] < bc * (j + 1); at[r]++)
                    if (out) {
                        const long place = (count * br + r) * bc + col[at[r]] - bc * j;
                        high[place] = (float)val[at[r]];
                        if (low)
                            low[place] = (float)(val[at[r]] - high[place]);
                    }
            count++;
        }
    }
    pointers[n] = (int)count;
    return count;
}

static double advanced(long n, double step, const double *restrict p, const double *restrict image,
                       double *restrict x, double *restrict r)
{
    d4 squares = {0};
    long i = 0;
    for (; i + 4 <= n; i += 4) {
        *(d4 *)(x + i) += step * *(const d4 *)(p + i);
        const d4 left = *(d4 *)(r + i) - step * *(const d4 *)(image + i);
        *(d4 *)(r + i) = left;
        squares += left * left;
    }
    double total = 0.0;
    for (int k = 0; k < 4; k++)
        total += squares[k];
    for (; i < n; i++) {
        x[i] += step * p[i];
        r[i] -= step * image[i];
        total += r[i] * r[i];
    }
    return total;
}

/* x <- x + step p, r <- r - step image; |r|^2, added up by threads in their order. */
double advance(long n, int threads, double step, const double *p, const double *image, double *x, double *r)
{
    double squares[MOST_THREADS], total = 0.0;
#pragma omp parallel for schedule(static) num_threads(threads) if (threads > 1)
    for (int t = 0; t < threads; t++) {
        const long from = 8 * (n / 8 * t / threads), to = t + 1 < threads ? 8 * (n / 8 * (t + 1) / threads) : n;
        squares[t] = advanced(to - from, step, p + from, image + from, x + from, r + from);
    }
    for (int t = 0; t < threads; t++)
        total += squares[t];
    return total;
}

/* p <- z + factor p. */
void next_direction(long n, int threads, double factor, const double *restrict z, double *restrict p)
{
#pragma omp parallel for schedule(static) num_threads(threads) if (threads > 1)
    for (long i = 0; i < n; i++)
        p[i] = z[i] + factor * p[i];
}
