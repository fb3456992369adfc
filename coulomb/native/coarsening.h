/* From a grid to a coarser one; included by shapes.h for every shape. */

/* Block k of a row, BR x BR. */
static inline __attribute__((always_inline)) void NAME(block)(long k, const int *at, const float *val, const float *low,
                                                              double *block)
{
    const long place = at ? at[k] : k;
    const float *high = val + BR * BR * (place < 0 ? ~place : place), *rest = low + (high - val);
    if (place < 0)
        for (int r = 0; r < BR; r++)
            for (int c = 0; c < BR; c++)
                block[BR * r + c] = (double)high[BR * c + r] + rest[BR * c + r];
    else
        for (int e = 0; e < BR * BR; e++)
            block[e] = (double)high[e] + rest[e];
}

#if BC == 6

/* What K says about its nodes, from a part of its rows: norm[i] <- the square of the block on the diagonal (where
`norm` is not 0), and loose[r] <- 1 where row r has an entry beside the diagonal; both are 0 before. */
void NAME(examine)(int n, int threads, const int *ptr, const int *col, const int *at, const float *val,
                   const float *low, double *norm, unsigned char *loose)
{
#pragma omp parallel for schedule(static) num_threads(threads) if (threads > 1)
    for (int i = 0; i < n; i++)
        for (int k = ptr[i]; k < ptr[i + 1]; k++) {
            const int own = norm && col[k] == i;
            double block[BR * BR];
            NAME(block)(k, at, val, low, block);
            for (int r = 0; r < BR; r++)
                for (int c = 0; c < BR; c++) {
                    if (own)
                        norm[i] += block[BR * r + c] * block[BR * r + c];
                    if (block[BR * r + c] != 0.0 && !(own && r == c))
                        loose[BR * i + r] = 1;
                }
        }
}

/* strong[k] <- whether block k is not small beside the diagonals, by Frobenius norms: more than `part` of the geometric
mean of those. */
void NAME(strength)(int n, int threads, const int *ptr, const int *col, const int *at, const float *val,
                    const float *low, const double *norm, double part, unsigned char *strong)
{
    const double square = part * part;
#pragma omp parallel for schedule(static) num_threads(threads) if (threads > 1)
    for (int i = 0; i < n; i++)
        for (int k = ptr[i]; k < ptr[i + 1]; k++) {
            double sum = 0.0, block[BR * BR];
            NAME(block)(k, at, val, low, block);
            for (int e = 0; e < BR * BR; e++)
                sum += block[e] * block[e];
            strong[k] = col[k] != i && sum > 0.0 && sum > square * sqrt(norm[i] * norm[col[k]]);
        }
}

/* modes, (BR n, 6) by rows, <- orthonormal columns on each aggregate, and R, 6 x 6 per aggregate, with modes = new modes R;
R is 0 before.  Rows that are not loose become 0, and so do columns that depend on earlier ones. */
void NAME(orthonormal)(int aggregates, int threads, const int *begin, const int *members, const unsigned char *loose,
                       double *modes, double *R)
{
#pragma omp parallel num_threads(threads) if (threads > 1)
    {
        long most = 0;
        for (int a = 0; a < aggregates; a++)
            most = begin[a + 1] - begin[a] > most ? begin[a + 1] - begin[a] : most;
        double *Q = malloc(sizeof(double) * (6 * BR * most + 1));
#pragma omp for schedule(dynamic, 64)
        for (int a = 0; a < aggregates; a++) {
            const long m = BR * (long)(begin[a + 1] - begin[a]);
            double *own = R + 36 * (long)a;
            for (long s = 0; s < m; s++) {
                const long row = BR * (long)members[begin[a] + s / BR] + s % BR;
                for (int c = 0; c < 6; c++)
                    Q[m * c + s] = loose[row] ? modes[6 * row + c] : 0.0;
            }
            for (int c = 0; c < 6; c++) {
                double *q = Q + m * c, size = 0.0, left = 0.0;
                for (long s = 0; s < m; s++)
                    size += q[s] * q[s];
                for (int twice = 0; twice < 2; twice++)
                    for (int e = 0; e < c; e++) {
                        const double *p = Q + m * e;
                        double dot = 0.0;
                        for (long s = 0; s < m; s++)
                            dot += p[s] * q[s];
                        for (long s = 0; s < m; s++)
                            q[s] -= dot * p[s];
                        own[6 * e + c] += dot;
                    }
                for (long s = 0; s < m; s++)
                    left += q[s] * q[s];
                const double norm = sqrt(left), inverse = left > 1e-16 * size ? 1.0 / norm : 0.0;
                own[6 * c + c] = inverse > 0.0 ? norm : 0.0;
                for (long s = 0; s < m; s++)
                    q[s] *= inverse;
            }
            for (long s = 0; s < m; s++) {
                const long row = BR * (long)members[begin[a] + s / BR] + s % BR;
                for (int c = 0; c < 6; c++)
                    modes[6 * row + c] = Q[m * c + s];
            }
        }
        free(Q);
    }
}

/* P <- P0 - S K P0, of which `pointers` are known: columns of a row ascending, values in single precision.  P0 has a
block of BR x 6 per node, in the column `aggregates`; S is diagonal; `count` the number of columns. */
void NAME(smoothed)(int n, int threads, const int *ptr, const int *col, const int *at, const float *val,
                    const float *low, const int *ghost_ptr, const int *ghost_col, const float *ghost_val,
                    const float *ghost_low, const int *aggregates, int count, const double *P0, const double *S,
                    const int *pointers, int *columns, float *values)
{
#pragma omp parallel num_threads(threads) if (threads > 1)
    {
        int *seen = malloc(sizeof(int) * (count + 1)), *place = malloc(sizeof(int) * (count + 1)), most = 0;
        memset(seen, -1, sizeof(int) * (count + 1));
        for (int i = 0; i < n; i++)
            most = pointers[i + 1] - pointers[i] > most ? pointers[i + 1] - pointers[i] : most;
        d4 *sum = aligned_alloc(64, 64 * (BR * (long)most + 1));
#pragma omp for schedule(static)
        for (int i = 0; i < n; i++) {
            int *own = columns + pointers[i];
            const int found = aggregates_of_row(i, n, ptr, col, ghost_ptr, ghost_col, aggregates, seen, own);
            qsort(own, found, sizeof(int), ascending);
            for (int f = 0; f < found; f++)
                place[own[f]] = f;
            for (long s = 0; s < PARTS * BR * (long)found; s++)
                sum[s] = (d4){0};
            for (int part = 0; part < (ghost_ptr ? 2 : 1); part++) {
                const int *p = part ? ghost_ptr : ptr, *c = part ? ghost_col : col;
                for (int k = p[i]; k < p[i + 1]; k++) {
                    const long j = c[k] + (part ? n : 0);
                    if (aggregates[j] < 0)
                        continue;
                    double block[BR * BR];
                    NAME(block)(k, part ? 0 : at, part ? ghost_val : val, part ? ghost_low : low, block);
                    for (int h = 0; h < PARTS; h++) {
                        d4 *to = sum + PARTS * BR * (long)place[aggregates[j]] + h, row[BR];
                        for (int c2 = 0; c2 < BR; c2++)
                            row[c2] = *(const d4 *)(P0 + 6 * (BR * j + c2) + 4 * h);
                        for (int r = 0; r < BR; r++)
                            for (int c2 = 0; c2 < BR; c2++)
                                to[PARTS * r] += block[BR * r + c2] * row[c2];
                    }
                }
            }
            for (int f = 0; f < found; f++)
                for (int r = 0; r < BR; r++)
                    for (int c = 0; c < 6; c++)
                        values[BR * 6 * ((long)pointers[i] + f) + 6 * r + c] =
                            (float)((own[f] == aggregates[i] ? P0[6 * (BR * (long)i + r) + c] : 0.0) -
                                    S[BR * (long)i + r] * ((const double *)sum)[LC * (BR * (long)f + r) + c]);
        }
        free(seen);
        free(place);
        free(sum);
    }
}

#endif

/* P^T K P, of which pointers and columns are known (product_pattern, also of the arguments), block after block. */
void NAME(galerkin)(int n, int nodes, int own, int coarse, int wide, int threads, int most, const int *begin,
                    const int *rows, const int *places, const int *ptr, const int *col, const int *at, const float *val,
                    const float *low, const int *ghost_ptr, const int *ghost_col, const float *ghost_val,
                    const float *ghost_low, const int *p_ptr, const int *p_col, const float *p_val, const int *pointers,
                    const int *columns, double *values)
{
#pragma omp parallel num_threads(threads) if (threads > 1)
    {
        int *place = malloc(sizeof(int) * ((long)nodes + wide + most + 1)), *touched = place + nodes;
        int *column = touched + most, widest = 0;
        memset(place, -1, sizeof(int) * nodes);
        for (int row = 0; row < coarse; row++)
            widest = pointers[row + 1] - pointers[row] > widest ? pointers[row + 1] - pointers[row] : widest;
        d4 *W = aligned_alloc(64, 64 * (BR * (long)most + BC * (long)widest + 1)), *A = W + PARTS * BR * (long)most;
#pragma omp for schedule(dynamic, 16)
        for (int row = 0; row < coarse; row++) {
            int count = 0;
            for (int t = begin[row]; t < begin[row + 1]; t++) { /* W = P^T K of this row, columns of blocks */
                const int i = rows[t];
                d4 of_row[BR][PARTS];
                for (int r = 0; r < BR; r++)
                    for (int h = 0; h < PARTS; h++)
                        of_row[r][h] = up4(p_val + BR * BC * (long)places[t] + BC * r + 4 * h);
                for (int part = 0; part < (ghost_ptr ? 2 : 1); part++) {
                    const int *p = part ? ghost_ptr : ptr, *c = part ? ghost_col : col;
                    for (int k = p[i]; k < p[i + 1]; k++) {
                        const int j = c[k] + (part ? n : 0);
                        double v[BR * BR];
                        NAME(block)(k, part ? 0 : at, part ? ghost_val : val, part ? ghost_low : low, v);
                        if (place[j] < 0) {
                            place[j] = count;
                            touched[count] = j;
                            for (int b = 0; b < PARTS * BR; b++)
                                W[PARTS * BR * (long)count + b] = (d4){0};
                            count++;
                        }
                        d4 *w = W + PARTS * BR * (long)place[j];
                        for (int b = 0; b < BR; b++)
                            for (int h = 0; h < PARTS; h++) {
                                d4 sum = w[PARTS * b + h];
                                for (int r = 0; r < BR; r++)
                                    sum += v[BR * r + b] * of_row[r][h];
                                w[PARTS * b + h] = sum;
                            }
                    }
                }
            }
            const int first = pointers[row], width = pointers[row + 1] - first;
            for (int f = 0; f < width; f++)
                column[columns[first + f]] = f;
            for (long s = 0; s < PARTS * BC * (long)width; s++)
                A[s] = (d4){0};
            for (int s = 0; s < count; s++) {
                const int j = touched[s];
                const double *w = (const double *)(W + PARTS * BR * (long)s);
                place[j] = -1;
                for (int k = p_ptr[j]; k < p_ptr[j + 1]; k++) {
                    if (row < own && p_col[k] < row)
                        continue;
                    for (int h = 0; h < PARTS; h++) {
                        d4 *to = A + PARTS * BC * (long)column[p_col[k]] + h, row_of[BR];
                        for (int b = 0; b < BR; b++)
                            row_of[b] = up4(p_val + BR * BC * (long)k + BC * b + 4 * h);
                        for (int a = 0; a < BC; a++) {
                            d4 sum = to[PARTS * a];
                            for (int b = 0; b < BR; b++)
                                sum += w[LC * b + a] * row_of[b];
                            to[PARTS * a] = sum;
                        }
                    }
                }
            }
            for (long f = 0; f < width; f++)
                for (int a = 0; a < BC; a++)
                    for (int c = 0; c < BC; c++)
                        values[BC * BC * (first + f) + BC * a + c] = ((const double *)A)[LC * (BC * f + a) + c];
        }
        free(place);
        free(W);
    }
}
