/* Products with matrices in small dense blocks, stored in single precision, vectors in double precision.

Included by shapes.h for every shape.  A block is stored by rows without padding; vectors of lanes read beyond the end
of a row, and what they read there goes to lanes that nobody reads.  Hence arrays of values and vectors need 8 numbers
more at their end, and sums are collected in an array `w` with LC numbers per block of columns, which is zero before and
after every call.  That array also keeps a store from overlapping the next load, which would stall it.

Of a symmetric matrix the upper triangle is given, in every row the block on the diagonal first. */

/* The sum of the numbers of a row's vectors. */
static inline __attribute__((always_inline)) double NAME(total)(const d4 *sum)
{
    double total = 0.0;
    for (int c = 0; c < BC; c++)
        total += sum[c / 4][c % 4];
    return total;
}

/* y <- y + factor A g, A = val + low if `accurate`, else val, with the blocks g that are being fetched; with an inverse
diagonal y <- y + factor D^-1 A g, and the same for x.  Like the next functions it returns 0, or MPI's error. */
static int NAME(add_others)(const struct others *A, int accurate, double factor, const double *inverse, double *y,
                            double *x)
{
    if (!A)
        return 0;
    const int error = end_fetching(A->ghosts);
    const double *g = A->ghosts->values;
    const float *low = accurate ? A->low : 0;
    for (int i = 0; i < A->n; i++) {
        d4 sum[BR][PARTS] = {{{0}}};
        for (long k = A->ptr[i]; k < A->ptr[i + 1]; k++) {
            const float *block = A->val + BR * BC * k;
            const d4 *gj = (const d4 *)(g + (long)BC * A->col[k]);
            __builtin_prefetch(block + 768);
            for (int r = 0; r < BR; r++)
                for (int h = 0; h < PARTS; h++) {
                    d4 row = up4(block + BC * r + 4 * h);
                    if (low)
                        row += up4(low + BR * BC * k + BC * r + 4 * h);
                    sum[r][h] += row * gj[h];
                }
        }
        for (int r = 0; r < BR; r++) {
            const long at = (long)BR * A->rows[i] + r;
            double total = factor * NAME(total)(sum[r]);
            if (inverse) {
                total *= inverse[at];
                x[at] += total;
            }
            y[at] += total;
        }
    }
    return error;
}

#if BR == BC

/* What is done with (K x)_i as soon as it is known.  Row i needs x only at columns >= i, and has added its part to the
rows below: x_i may be changed then. */
enum NAME(mode) { NAME(PRODUCT), NAME(RESIDUAL), NAME(STEP) };

/* What becomes of row `at` of K x. */
static inline __attribute__((always_inline)) void NAME(finish)(
    const enum NAME(mode) mode, long at, double total, const double *restrict inverse, const double *b, double *x,
    double *y, double first, double second)
{
    if (mode == NAME(PRODUCT))
        y[at] = total;
    else if (mode == NAME(RESIDUAL))
        y[at] = b[at] - total;
    else {
        y[at] = first * y[at] + second * inverse[at] * (b[at] - total);
        x[at] += y[at];
    }
}

/* Rows begin to end.  Their parts of rows from `end` on go to `beyond`, if it is `shared` work.  Rows before `held` are
not finished: what is known of them is left in w. */
static inline __attribute__((always_inline)) void NAME(symmetric)(
    const enum NAME(mode) mode, const int split, const int shared, int begin, int held, int end,
    const int *restrict ptr, const int *restrict col, const float *restrict val, const float *restrict low,
    const double *restrict inverse, const double *b, double *x, double *y, double first, double second,
    double *restrict w, double *restrict beyond)
{
    for (int i = begin; i < end; i++) {
        d4 X[BR], sum[BR][PARTS];
        const double *xi = x + BR * i;
        const d4 *own = (const d4 *)xi;
        long k = ptr[i];
        const long last = ptr[i + 1];
        for (int r = 0; r < BR; r++) {
            X[r] = xi[r] - (d4){0};
            for (int h = 0; h < PARTS; h++) {
                d4 row = up4(val + BR * BC * k + BC * r + 4 * h);
                if (split)
                    row += up4(low + BR * BC * k + BC * r + 4 * h);
                sum[r][h] = row * own[h];
            }
        }
        for (k++; k < last; k++) {
            const float *block = val + BR * BC * k;
            const long j = col[k];
            const d4 *xj = (const d4 *)(x + BC * j);
            d4 *wj = (d4 *)((shared && j >= end ? beyond : w) + LC * j);
            __builtin_prefetch(block + 768);
            if (split)
                __builtin_prefetch(low + BR * BC * k + 768);
            for (int h = 0; h < PARTS; h++) {
                d4 below = wj[h];
                for (int r = 0; r < BR; r++) {
                    d4 row = up4(block + BC * r + 4 * h);
                    if (split)
                        row += up4(low + BR * BC * k + BC * r + 4 * h);
                    sum[r][h] += row * xj[h];
                    below += row * X[r];
                }
                wj[h] = below;
            }
        }
        for (int r = 0; r < BR; r++) {
            const double total = w[LC * i + r] + NAME(total)(sum[r]);
            if (shared && i < held)
                w[LC * i + r] = total;
            else
                NAME(finish)(mode, (long)BR * i + r, total, inverse, b, x, y, first, second);
        }
        for (int h = 0; h < PARTS && !(shared && i < held); h++)
            ((d4 *)(w + LC * i))[h] = (d4){0};
    }
}

/* All rows, by threads where there are `shares`: their number, where the rows of each begin and the last end, and the
number after the last column of each.  A thread adds to rows of later ones in an array of its own, behind those of w;
the rows to which earlier threads add, which still need x there, are finished when all have come so far. */
static inline __attribute__((always_inline)) void NAME(shared)(
    const enum NAME(mode) mode, const int split, int n, const int *shares, const int *restrict ptr,
    const int *restrict col, const float *restrict val, const float *restrict low, const double *restrict inverse,
    const double *b, double *x, double *y, double first, double second, double *w)
{
    if (!shares) {
        NAME(symmetric)(mode, split, 0, 0, 0, n, ptr, col, val, low, inverse, b, x, y, first, second, w, w);
        return;
    }
    const int count = shares[0], *begin = shares + 1, *reach = shares + 2 + count;
    double *beyond[MOST_THREADS];
    int held[MOST_THREADS];
    long place = n;
    for (int t = 0, most = 0; t < count; t++) {
        held[t] = most < begin[t + 1] ? most : begin[t + 1];
        beyond[t] = w + LC * (place - begin[t + 1]);
        place += reach[t] - begin[t + 1];
        most = reach[t] > most ? reach[t] : most;
    }
#pragma omp parallel num_threads(count)
    {
        for (int t = THREAD; t < count; t += TEAM)
            NAME(symmetric)(mode, split, 1, begin[t], held[t], begin[t + 1], ptr, col, val, low, inverse, b, x, y,
                            first, second, w, beyond[t]);
#pragma omp barrier
        for (int t = THREAD; t < count; t += TEAM)
            for (long i = begin[t]; i < held[t]; i++) {
                double total[LC];
                for (int c = 0; c < LC; c++) {
                    total[c] = w[LC * i + c];
                    w[LC * i + c] = 0.0;
                }
                for (int s = 0; s < t; s++)
                    for (int c = 0; c < LC && i < reach[s]; c++) {
                        total[c] += beyond[s][LC * i + c];
                        beyond[s][LC * i + c] = 0.0;
                    }
                for (int r = 0; r < BR; r++)
                    NAME(finish)(mode, BR * i + r, total[r], inverse, b, x, y, first, second);
            }
    }
}

/* y <- K x, K = val + low if `accurate`, else val. */
int NAME(product)(const struct blocks *K, int accurate, double *x, double *y)
{
    const int error = begin_fetching(K->others, x);
    if (accurate && K->low)
        NAME(shared)(NAME(PRODUCT), 1, K->n, K->shares, K->ptr, K->col, K->val, K->low, 0, 0, x, y, 0.0, 0.0, K->sums);
    else
        NAME(shared)(NAME(PRODUCT), 0, K->n, K->shares, K->ptr, K->col, K->val, 0, 0, 0, x, y, 0.0, 0.0, K->sums);
    return error | NAME(add_others)(K->others, accurate, 1.0, 0, y, 0);
}

/* r <- b - K x. */
int NAME(residual)(const struct blocks *K, const double *b, double *x, double *r)
{
    const int error = begin_fetching(K->others, x);
    NAME(shared)(NAME(RESIDUAL), 0, K->n, K->shares, K->ptr, K->col, K->val, 0, 0, b, x, r, 0.0, 0.0, K->sums);
    return error | NAME(add_others)(K->others, 0, -1.0, 0, r, 0);
}

/* Steps of Chebyshev's iteration, with two factors each: d <- first d + second D^-1 (b - K x), x <- x + d; from x = 0 if
`zero`. */
int NAME(smooth)(const struct blocks *K, const double *inverse, const double *b, double *x, double *d, int steps,
                 const double *factors, int zero)
{
    int error = 0;
    if (zero)
        from_zero((long)BR * K->n, K->threads, factors[1], inverse, b, d, x);
    for (int k = zero ? 1 : 0; k < steps; k++) {
        const double first = factors[2 * k], second = factors[2 * k + 1];
        error |= begin_fetching(K->others, x);
        NAME(shared)(NAME(STEP), 0, K->n, K->shares, K->ptr, K->col, K->val, 0, inverse, b, x, d, first, second, K->sums);
        error |= NAME(add_others)(K->others, 0, -second, inverse, d, x);
    }
    return error;
}

#endif

/* x <- x + P e. */
int NAME(prolong)(const struct blocks *P, const double *e, double *x)
{
    const int error = begin_fetching(P->others, e);
#pragma omp parallel for schedule(static) num_threads(P->threads) if (P->threads > 1)
    for (int i = 0; i < P->n; i++) {
        d4 sum[BR][PARTS] = {{{0}}};
        for (long k = P->ptr[i]; k < P->ptr[i + 1]; k++) {
            const float *block = P->val + BR * BC * k;
            const d4 *ej = (const d4 *)(e + (long)BC * P->col[k]);
            __builtin_prefetch(block + 768);
            for (int r = 0; r < BR; r++)
                for (int h = 0; h < PARTS; h++)
                    sum[r][h] += up4(block + BC * r + 4 * h) * ej[h];
        }
        for (int r = 0; r < BR; r++)
            x[(long)BR * i + r] += NAME(total)(sum[r]);
    }
    return error | NAME(add_others)(P->others, 0, 1.0, 0, x, 0);
}

/* b <- P^T r, of `columns` blocks; P has the rows `rows`, where that is not 0.  Every thread has sums of its own. */
static void NAME(transposed)(int n, int columns, int threads, const int *rows, const int *ptr, const int *col,
                             const float *val, const double *r, double *b, double *w)
{
#pragma omp parallel num_threads(threads) if (threads > 1)
    {
#pragma omp for schedule(static)
        for (int i = 0; i < n; i++) {
            double *own = w + (long)LC * columns * THREAD;
            const long at = rows ? rows[i] : i;
            d4 R[BR];
            for (int k = 0; k < BR; k++)
                R[k] = r[BR * at + k] - (d4){0};
            for (long k = ptr[i]; k < ptr[i + 1]; k++) {
                const float *block = val + BR * BC * k;
                d4 *wj = (d4 *)(own + (long)LC * col[k]);
                __builtin_prefetch(block + 768);
                for (int h = 0; h < PARTS; h++) {
                    d4 sum = wj[h];
                    for (int row = 0; row < BR; row++)
                        sum += up4(block + BC * row + 4 * h) * R[row];
                    wj[h] = sum;
                }
            }
        }
#pragma omp for schedule(static)
        for (long j = 0; j < columns; j++) {
            double sum[LC] = {0};
            for (int t = 0; t < threads; t++) {
                double *of_thread = w + (long)LC * (columns * (long)t + j);
                for (int c = 0; c < LC; c++) {
                    sum[c] += of_thread[c];
                    of_thread[c] = 0.0;
                }
            }
            for (int c = 0; c < BC; c++)
                b[BC * j + c] = sum[c];
        }
    }
}

/* b <- P^T r. */
int NAME(restrict_to)(const struct blocks *P, const double *r, double *b)
{
    const struct others *A = P->others;
    int error = 0;
    if (A) {
        NAME(transposed)(A->n, A->columns, 1, A->rows, A->ptr, A->col, A->val, r, A->ghosts->values, A->sums);
        error = begin_giving(A->ghosts);
    }
    NAME(transposed)(P->n, P->columns, P->threads, 0, P->ptr, P->col, P->val, r, b, P->sums);
    return A ? error | end_giving(A->ghosts, b) : error;
}
