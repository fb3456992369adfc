/* Anderson's mixing of forces after blocks of sweeps (D. G. Anderson, J. ACM 12, 1965; H. F. Walker, P. Ni, SIAM J.
   Numer. Anal. 49, 2011): the combination of the last blocks whose change is smallest.  A block after which the
   residual is clearly larger than the smallest so far is taken back. */

#include <math.h>
#include <string.h>

#define BLOCK_OF_SWEEPS 16
#define MEMORY 8
#define DROPPED 1e-10 /* part of a difference that is new, squared, over all of it, below which it is left out */
#define WORSE 1.5

typedef double v4 __attribute__((vector_size(32))); /* of which three are used */

struct mixing {
    long m;
    int blocks, kept, failed; /* kept: differences, -1 before the first; failed: the last block was taken back */
    double smallest;          /* residual */
    v4 *start, *change, *end, *safe; /* of the block; of the one before; forces at the smallest residual */
    v4 *changes[MEMORY], *ends[MEMORY];
};

#define MIXING_VECTORS (4 + 2 * MEMORY)

static struct mixing mixing_in(long m, v4 *memory)
{
    struct mixing x = {.m = m, .kept = -1, .start = memory, .change = memory + m, .end = memory + 2 * m};
    x.safe = memory + 3 * m;
    for (int j = 0; j < MEMORY; j++)
        x.changes[j] = memory + (4 + j) * m, x.ends[j] = memory + (4 + MEMORY + j) * m;
    return x;
}

static double dot(long m, const v4 *a, const v4 *b)
{
    v4 sum = {0.0, 0.0, 0.0, 0.0};
    for (long i = 0; i < m; i++)
        sum += a[i] * b[i];
    return sum[0] + sum[1] + sum[2];
}

/* Forces r after a block of sweeps, with this residual, for the beginning of the next one. */
static void mixed(struct mixing *x, v4 *r, double residual)
{
    const long m = x->m;
    if (x->blocks++ && residual > WORSE * x->smallest && !x->failed) {
        memcpy(r, x->safe, m * sizeof *r), memcpy(x->start, r, m * sizeof *r);
        x->failed = 1, x->kept = -1;
        return;
    }
    if (x->failed || x->blocks == 1 || residual < x->smallest)
        x->smallest = residual, memcpy(x->safe, r, m * sizeof *r);
    x->failed = 0;
    if (x->kept >= 0) { /* the oldest difference makes room */
        v4 *f = x->changes[MEMORY - 1], *g = x->ends[MEMORY - 1];
        for (int j = MEMORY - 1; j > 0; j--)
            x->changes[j] = x->changes[j - 1], x->ends[j] = x->ends[j - 1];
        x->changes[0] = f, x->ends[0] = g;
        for (long i = 0; i < m; i++)
            f[i] = r[i] - x->start[i] - x->change[i], g[i] = r[i] - x->end[i];
        x->kept = x->kept < MEMORY ? x->kept + 1 : MEMORY;
    } else
        x->kept = 0;
    for (long i = 0; i < m; i++)
        x->change[i] = r[i] - x->start[i];
    memcpy(x->end, r, m * sizeof *r);
    double L[MEMORY][MEMORY], y[MEMORY], scale[MEMORY]; /* Cholesky's factor of the normal equations */
    int used[MEMORY], n = 0;
    for (int j = 0; j < x->kept; j++) {
        const double size = sqrt(dot(m, x->changes[j], x->changes[j]));
        if (!(size > 0.0))
            continue;
        used[n] = j, scale[n] = 1.0 / size;
        double pivot = 1.0, right = scale[n] * dot(m, x->changes[j], x->change);
        for (int k = 0; k < n; k++) {
            double sum = scale[n] * scale[k] * dot(m, x->changes[j], x->changes[used[k]]);
            for (int l = 0; l < k; l++)
                sum -= L[n][l] * L[k][l];
            L[n][k] = sum / L[k][k];
            pivot -= L[n][k] * L[n][k], right -= L[n][k] * y[k];
        }
        if (pivot > DROPPED)
            L[n][n] = sqrt(pivot), y[n] = right / L[n][n], n++;
    }
    for (int k = n - 1; k >= 0; k--) {
        for (int l = k + 1; l < n; l++)
            y[k] -= L[l][k] * y[l];
        y[k] /= L[k][k];
        const double weight = scale[k] * y[k];
        for (long i = 0; i < m; i++)
            r[i] -= weight * x->ends[used[k]][i];
    }
    memcpy(x->start, r, m * sizeof *r);
}
