/* A matrix of blocks of 3 x 3, compressed rows of blocks, as the compressed columns of single entries. */

#include <math.h>
#include <string.h>

/* Where each entry of each block is in the columns, if row and column old[p] have the number p = new[old[p]]. */
void positions(long m, const int *first, const int *column, const int *old, const int *new, int *indptr, int *indices,
               int *at)
{
    memset(indptr, 0, (3 * m + 1) * sizeof *indptr);
    for (long i = 0; i < m; i++)
        for (long k = first[i]; k < first[i + 1]; k++)
            for (int b = 0; b < 3; b++)
                indptr[new[3 * column[k] + b] + 1] += 3;
    for (long j = 0; j < 3 * m; j++)
        indptr[j + 1] += indptr[j];
    for (long p = 0; p < 3 * m; p++) { /* rows in order: those of each column ascend */
        const long i = old[p] / 3, a = old[p] % 3;
        for (long k = first[i]; k < first[i + 1]; k++)
            for (int b = 0; b < 3; b++) {
                const int here = indptr[new[3 * column[k] + b]]++;
                indices[here] = p, at[9 * k + 3 * a + b] = here;
            }
    }
    memmove(indptr + 1, indptr, 3 * m * sizeof *indptr);
    indptr[0] = 0;
}

/* r (L W + D) c, its rows, then its columns scaled to a largest entry of 1; L NULL for 1; M is workspace. */
void entries(long m, const int *first, const int *column, const double *W, const double *D, const double *L,
             const int *at, double *M, double *r, double *c, double *data)
{
    memset(c, 0, 3 * m * sizeof *c);
    for (long i = 0; i < m; i++) {
        double largest[3] = {0.0, 0.0, 0.0};
        for (long k = first[i]; k < first[i + 1]; k++) {
            const double *B = W + 9 * k, *l = L + 9 * i;
            double *here = M + 9 * k;
            if (L == NULL)
                memcpy(here, B, 9 * sizeof *here);
            else
                for (int a = 0; a < 3; a++)
                    for (int b = 0; b < 3; b++)
                        here[3 * a + b] = l[3 * a] * B[b] + l[3 * a + 1] * B[3 + b] + l[3 * a + 2] * B[6 + b];
            if (column[k] == i)
                for (int e = 0; e < 9; e++)
                    here[e] += D[9 * i + e];
            for (int e = 0; e < 9; e++)
                if (!(fabs(here[e]) <= largest[e / 3]))
                    largest[e / 3] = fabs(here[e]);
        }
        for (int a = 0; a < 3; a++)
            r[3 * i + a] = 1.0 / largest[a];
        for (long k = first[i]; k < first[i + 1]; k++) {
            double *here = M + 9 * k, *over = c + 3 * column[k];
            for (int e = 0; e < 9; e++) {
                here[e] *= r[3 * i + e / 3];
                if (!(fabs(here[e]) <= over[e % 3]))
                    over[e % 3] = fabs(here[e]);
            }
        }
    }
    for (long j = 0; j < 3 * m; j++)
        c[j] = 1.0 / c[j];
    for (long k = 0; k < first[m]; k++)
        for (int e = 0; e < 9; e++)
            data[at[9 * k + e]] = M[9 * k + e] * c[3 * column[k] + e % 3];
}
