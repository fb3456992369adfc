/* Products with matrices in small dense blocks, stored in single precision, vectors in double precision.

Included with BR, BC (rows and columns of a block), LC (the next power of two of BC), DC (a vector of LC doubles), UP (LC
floats converted to doubles) and NAME.  A block is stored by rows without padding; vectors of lanes read beyond the end
of a row, and what they read there goes to lanes that nobody reads.  Hence arrays of values and vectors need 8 numbers
more at their end, and sums are collected in an array `w` with LC numbers per block of columns, which is zero before and
after every call.  That array also keeps a store from overlapping the next load, which would stall it.

Of a symmetric matrix the upper triangle is given, in every row the block on the diagonal first. */

#if BR == BC

/* What is done with (K x)_i as soon as it is known.  Row i needs x only at columns >= i, and has added its part to the
rows below: x_i may be changed then. */
enum NAME(mode) { NAME(PRODUCT), NAME(RESIDUAL), NAME(STEP) };

static inline __attribute__((always_inline)) void NAME(symmetric)(
    const enum NAME(mode) mode, const int split, int n, const int *restrict ptr, const int *restrict col,
    const float *restrict val, const float *restrict low, const double *restrict inverse, const double *b, double *x,
    double *y, double first, double second, double *restrict w)
{
    for (int i = 0; i < n; i++) {
        DC X[BR], sum[BR];
        const double *xi = x + BR * i;
        for (int r = 0; r < BR; r++) {
            X[r] = xi[r] - (DC){0};
            sum[r] = (DC){0};
        }
        long k = ptr[i];
        const long end = ptr[i + 1];
        const DC own = *(const DC *)xi;
        for (int r = 0; r < BR; r++) {
            DC row = UP(val + BR * BC * k + BC * r);
            if (split)
                row += UP(low + BR * BC * k + BC * r);
            sum[r] = row * own;
        }
        for (k++; k < end; k++) {
            const float *block = val + BR * BC * k;
            const long j = col[k];
            const DC xj = *(const DC *)(x + BC * j);
            DC *wj = (DC *)(w + LC * j), below = *wj;
            __builtin_prefetch(block + 768);
            if (split)
                __builtin_prefetch(low + BR * BC * k + 768);
            for (int r = 0; r < BR; r++) {
                DC row = UP(block + BC * r);
                if (split)
                    row += UP(low + BR * BC * k + BC * r);
                sum[r] += row * xj;
                below += row * X[r];
            }
            *wj = below;
        }
        for (int r = 0; r < BR; r++) {
            double total = w[LC * i + r];
            for (int c = 0; c < BC; c++)
                total += sum[r][c];
            const long at = (long)BR * i + r;
            if (mode == NAME(PRODUCT))
                y[at] = total;
            else if (mode == NAME(RESIDUAL))
                y[at] = b[at] - total;
            else {
                y[at] = first * y[at] + second * inverse[at] * (b[at] - total);
                x[at] += y[at];
            }
        }
        *(DC *)(w + LC * i) = (DC){0};
    }
}

/* y <- K x, K = val + low, or val where low is 0. */
void NAME(product)(int n, const int *ptr, const int *col, const float *val, const float *low, double *x, double *y,
                   double *w)
{
    if (low)
        NAME(symmetric)(NAME(PRODUCT), 1, n, ptr, col, val, low, 0, 0, x, y, 0.0, 0.0, w);
    else
        NAME(symmetric)(NAME(PRODUCT), 0, n, ptr, col, val, 0, 0, 0, x, y, 0.0, 0.0, w);
}

/* y <- b - K x. */
void NAME(residual)(int n, const int *ptr, const int *col, const float *val, const double *b, double *x, double *y,
                    double *w)
{
    NAME(symmetric)(NAME(RESIDUAL), 0, n, ptr, col, val, 0, 0, b, x, y, 0.0, 0.0, w);
}

/* A step of Chebyshev's iteration: d <- first d + second D^-1 (b - K x), x <- x + d. */
void NAME(step)(int n, const int *ptr, const int *col, const float *val, const double *inverse, const double *b,
                double *x, double *d, double first, double second, double *w)
{
    NAME(symmetric)(NAME(STEP), 0, n, ptr, col, val, 0, inverse, b, x, d, first, second, w);
}

#endif

/* x <- x + P e. */
void NAME(prolong)(int n, const int *ptr, const int *col, const float *val, const double *e, double *x)
{
    for (int i = 0; i < n; i++) {
        DC sum[BR];
        for (int r = 0; r < BR; r++)
            sum[r] = (DC){0};
        for (long k = ptr[i]; k < ptr[i + 1]; k++) {
            const float *block = val + BR * BC * k;
            const DC ej = *(const DC *)(e + (long)BC * col[k]);
            __builtin_prefetch(block + 768);
            for (int r = 0; r < BR; r++)
                sum[r] += UP(block + BC * r) * ej;
        }
        for (int r = 0; r < BR; r++) {
            double total = 0.0;
            for (int c = 0; c < BC; c++)
                total += sum[r][c];
            x[(long)BR * i + r] += total;
        }
    }
}

/* b <- P^T r, of `columns` blocks; P has the rows `rows`, where that is not 0. */
void NAME(restrict_to)(int n, int columns, const int *rows, const int *ptr, const int *col, const float *val,
                       const double *r, double *b, double *w)
{
    for (int i = 0; i < n; i++) {
        const long at = rows ? rows[i] : i;
        DC R[BR];
        for (int k = 0; k < BR; k++)
            R[k] = r[BR * at + k] - (DC){0};
        for (long k = ptr[i]; k < ptr[i + 1]; k++) {
            const float *block = val + BR * BC * k;
            DC *wj = (DC *)(w + (long)LC * col[k]), sum = *wj;
            __builtin_prefetch(block + 768);
            for (int row = 0; row < BR; row++)
                sum += UP(block + BC * row) * R[row];
            *wj = sum;
        }
    }
    for (long j = 0; j < columns; j++) {
        for (int c = 0; c < BC; c++)
            b[BC * j + c] = w[LC * j + c];
        *(DC *)(w + LC * j) = (DC){0};
    }
}

/* y <- y + factor A g, of which A has the rows `rows`, A = val + low, or val where low is 0; with an inverse diagonal
y <- y + factor D^-1 A g, and the same for x. */
void NAME(others)(int n, const int *rows, const int *ptr, const int *col, const float *val, const float *low,
                  const double *g, double factor, const double *inverse, double *y, double *x)
{
    for (int i = 0; i < n; i++) {
        DC sum[BR];
        for (int r = 0; r < BR; r++)
            sum[r] = (DC){0};
        for (long k = ptr[i]; k < ptr[i + 1]; k++) {
            const DC gj = *(const DC *)(g + (long)BC * col[k]);
            for (int r = 0; r < BR; r++) {
                DC row = UP(val + BR * BC * k + BC * r);
                if (low)
                    row += UP(low + BR * BC * k + BC * r);
                sum[r] += row * gj;
            }
        }
        for (int r = 0; r < BR; r++) {
            const long at = (long)BR * rows[i] + r;
            double total = 0.0;
            for (int c = 0; c < BC; c++)
                total += sum[r][c];
            if (inverse) {
                total *= inverse[at];
                x[at] += factor * total;
            }
            y[at] += factor * total;
        }
    }
}

#undef BR
#undef BC
#undef LC
#undef UP
#undef DC
#undef NAME
