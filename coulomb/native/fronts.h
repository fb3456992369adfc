/* The fronts of a multifrontal factorisation, with numbers of type REAL; included once per type, with NAME.

A front has e rows and columns of its own and a border of b rows, all three per node.  Its columns are stored one after
another: the head (e x e, a lower triangle), then what is below (b x e).  The update matrix (b x b, a lower triangle) is
what it adds to its parent. */

/* The entries of K on and below the diagonal in the columns of all fronts, in the order of elimination; zeros elsewhere.

own, border: nodes of each front; nodes: those of all fronts in the order of elimination; edges: those of all borders;
position: place of every node in that order; ptr, col: coupled nodes of every node; first, stride: where the block of
each pair begins in `values`, and the distance of its rows; place: as long as `position`, of any content. */
void NAME(assemble)(long fronts, const long *own, const long *border, const long *nodes, const long *edges,
                    const long *position, const long *ptr, const long *col, const long *first, const long *stride,
                    const double *values, long *place, REAL *memory)
{
    long begin = 0;
    for (long f = 0; f < fronts; f++) {
        const long e = 3 * own[f], b = 3 * border[f];
        REAL *head = memory, *below = memory + e * e;
        memset(memory, 0, sizeof(REAL) * e * (e + b));
        for (long k = 0; k < own[f]; k++)
            place[nodes[k]] = 3 * k;
        for (long k = 0; k < border[f]; k++)
            place[edges[k]] = 3 * k;
        for (long k = 0; k < own[f]; k++)
            for (long at = ptr[nodes[k]]; at < ptr[nodes[k] + 1]; at++) {
                const long row = col[at], later = position[row];
                if (later < begin + k)
                    continue;
                const long height = later < begin + own[f] ? e : b;
                REAL *to = (later < begin + own[f] ? head : below) + 3 * k * height + place[row];
                for (int i = 0; i < 3; i++) /* K is symmetric: its rows are columns here */
                    for (int j = 0; j < 3; j++)
                        to[i * height + j] = (REAL)values[first[at] + i * stride[at] + j];
            }
        memory += e * (e + b);
        nodes += own[f];
        edges += border[f];
        begin += own[f];
    }
}

static inline void NAME(add)(long n, const REAL *restrict from, REAL *restrict to)
{
    for (long i = 0; i < n; i++)
        to[i] += from[i];
}

/* Add the update matrix of a child (width x width) to its parent's own columns, or, with `rest`, what remains of it to
the parent's update matrix `head`.  Every run is a first node in the border of the child, a first place among the nodes
of the parent, and a number of nodes. */
void NAME(extend)(int rest, const REAL *child, long width, long count, const long *runs, long e, long b, REAL *head,
                  REAL *below)
{
    for (long q = 0; q < count; q++) {
        const long column = 3 * runs[3 * q], to = 3 * runs[3 * q + 1], n = 3 * runs[3 * q + 2];
        if ((to >= e) != rest)
            continue;
        for (long j = 0; j < n; j++) {
            const REAL *from = child + (column + j) * width;
            REAL *upper = rest ? head + (to + j - e) * b - e : head + (to + j) * e;
            REAL *lower = rest ? upper : below + (to + j) * b - e;
            NAME(add)(n - j, from + column + j, upper + to + j);
            for (long r = q + 1; r < count; r++) {
                const long row = 3 * runs[3 * r], at = 3 * runs[3 * r + 1];
                NAME(add)(3 * runs[3 * r + 2], from + row, (at < e ? upper : lower) + at);
            }
        }
    }
}

#define COLUMNS 8

/* v <- v - A c, of a few columns. */
static inline void NAME(subtract)(long n, int columns, const REAL *restrict a, long height, const REAL *restrict c,
                                  REAL *restrict v)
{
    if (columns == COLUMNS) {
        const REAL *restrict a1 = a + height, *restrict a2 = a1 + height, *restrict a3 = a2 + height;
        const REAL *restrict a4 = a3 + height, *restrict a5 = a4 + height, *restrict a6 = a5 + height;
        const REAL *restrict a7 = a6 + height;
        for (long i = 0; i < n; i++)
            v[i] -= ((a[i] * c[0] + a1[i] * c[1]) + (a2[i] * c[2] + a3[i] * c[3])) +
                    ((a4[i] * c[4] + a5[i] * c[5]) + (a6[i] * c[6] + a7[i] * c[7]));
        return;
    }
    for (int k = 0; k < columns; k++)
        for (long i = 0; i < n; i++)
            v[i] -= a[k * height + i] * c[k];
}

/* c <- c - A^T v, of a few columns. */
static inline void NAME(subtract_products)(long n, int columns, const REAL *restrict a, long height,
                                           const REAL *restrict v, REAL *restrict c)
{
    if (columns == COLUMNS) {
        const REAL *restrict a1 = a + height, *restrict a2 = a1 + height, *restrict a3 = a2 + height;
        const REAL *restrict a4 = a3 + height, *restrict a5 = a4 + height, *restrict a6 = a5 + height;
        const REAL *restrict a7 = a6 + height;
        REAL s0 = 0, s1 = 0, s2 = 0, s3 = 0, s4 = 0, s5 = 0, s6 = 0, s7 = 0;
#pragma omp simd reduction(+ : s0, s1, s2, s3, s4, s5, s6, s7)
        for (long i = 0; i < n; i++) {
            s0 += a[i] * v[i];
            s1 += a1[i] * v[i];
            s2 += a2[i] * v[i];
            s3 += a3[i] * v[i];
            s4 += a4[i] * v[i];
            s5 += a5[i] * v[i];
            s6 += a6[i] * v[i];
            s7 += a7[i] * v[i];
        }
        const REAL s[COLUMNS] = {s0, s1, s2, s3, s4, s5, s6, s7};
        for (int k = 0; k < COLUMNS; k++)
            c[k] -= s[k];
        return;
    }
    for (int k = 0; k < columns; k++) {
        REAL s = 0;
#pragma omp simd reduction(+ : s)
        for (long i = 0; i < n; i++)
            s += a[k * height + i] * v[i];
        c[k] -= s;
    }
}

/* x <- L^-1 x in the order of elimination; on the last border, what remains of x.  x is `count` vectors of `size` numbers
one after the other; every few columns of L are read once for all.  `edges` are the places of the nodes of all borders in
that order; t is as long as `count` times the longest border. */
void NAME(forward)(long fronts, const long *own, const long *border, const long *edges, const REAL *memory, long count,
                   long size, REAL *x, REAL *t)
{
    long begin = 0;
    for (long f = 0; f < fronts; f++) {
        const long e = 3 * own[f], b = 3 * border[f];
        const REAL *head = memory, *below = memory + e * e;
        int any = 0;
        for (long v = 0; v < count; v++)
            for (long i = begin; i < begin + e; i++)
                any |= x[v * size + i] != 0;
        if (any) { /* contact forces act on the last fronts alone */
            memset(t, 0, sizeof(REAL) * count * b);
            for (long j = 0; j < e; j += COLUMNS) {
                const int columns = e - j < COLUMNS ? (int)(e - j) : COLUMNS;
                const REAL *L = head + j * e + j;
                for (long v = 0; v < count; v++) {
                    REAL *y = x + v * size + begin;
                    for (int k = 0; k < columns; k++) {
                        y[j + k] /= L[k * e + k];
                        for (int i = k + 1; i < columns; i++)
                            y[j + i] -= L[k * e + i] * y[j + k];
                    }
                    REAL c[COLUMNS];
                    memcpy(c, y + j, sizeof(REAL) * columns);
                    NAME(subtract)(e - j - columns, columns, L + columns, e, c, y + j + columns);
                    NAME(subtract)(b, columns, below + j * b, b, c, t + v * b);
                }
            }
            for (long v = 0; v < count; v++)
                for (long i = 0; i < border[f]; i++)
                    for (int k = 0; k < 3; k++)
                        x[v * size + 3 * edges[i] + k] += t[v * b + 3 * i + k];
        }
        memory += e * (e + b);
        edges += border[f];
        begin += e;
    }
}

/* x <- L^-T x in the order of elimination, with given x on the last border; arguments as above. */
void NAME(backward)(long fronts, const long *own, const long *border, const long *edges, const REAL *memory, long count,
                    long size, REAL *x, REAL *t)
{
    long nodes = 0, begin = 0;
    for (long f = 0; f < fronts; f++) {
        nodes += border[f];
        memory += 9 * own[f] * (own[f] + border[f]);
        begin += 3 * own[f];
    }
    edges += nodes;
    for (long f = fronts - 1; f >= 0; f--) {
        const long e = 3 * own[f], b = 3 * border[f];
        memory -= e * (e + b);
        edges -= border[f];
        begin -= e;
        const REAL *head = memory, *below = memory + e * e;
        for (long v = 0; v < count; v++)
            for (long i = 0; i < border[f]; i++)
                for (int k = 0; k < 3; k++)
                    t[v * b + 3 * i + k] = x[v * size + 3 * edges[i] + k];
        for (long end = e; end > 0;) {
            const int columns = end % COLUMNS ? (int)(end % COLUMNS) : COLUMNS;
            const long j = end - columns;
            const REAL *L = head + j * e + j;
            for (long v = 0; v < count; v++) {
                REAL *y = x + v * size + begin, c[COLUMNS];
                memcpy(c, y + j, sizeof(REAL) * columns);
                NAME(subtract_products)(b, columns, below + j * b, b, t + v * b, c);
                NAME(subtract_products)(e - end, columns, L + columns, e, y + end, c);
                for (int k = columns - 1; k >= 0; k--) {
                    for (int i = k + 1; i < columns; i++)
                        c[k] -= L[k * e + i] * y[j + i];
                    y[j + k] = c[k] /= L[k * e + k];
                }
            }
            end = j;
        }
    }
}

#undef COLUMNS
#undef REAL
#undef NAME
