/* The stiffness matrix in compressed rows, from the kernel that FFCx has compiled for one cell. */

#include <math.h>
#include <stdint.h>
#include <string.h>

typedef void (*tabulate)(double *matrix, const double *coefficients, const double *constants, const double *coordinates,
                         const int *entity, const uint8_t *permutation);

/* The cells of every node: those of node k are of[begin[k]] to of[begin[k + 1]].  The nodes of a cell are a row of
`nodes`, which has `width` columns; begin, of length count + 1, is zero before. */
void cells_of_nodes(long count, long cells, long width, const int *nodes, int *begin, int *of)
{
    for (long k = 0; k < cells * width; k++)
        begin[nodes[k] + 1]++;
    for (long k = 0; k < count; k++)
        begin[k + 1] += begin[k];
    for (long k = 0; k < cells * width; k++)
        of[begin[nodes[k]]++] = (int)(k / width);
    memmove(begin + 1, begin, sizeof(int) * count); /* the ends of all nodes are the begins of the next */
    begin[0] = 0;
}

/* The nodes that have a cell in common with each, itself included, ascending: those of node k are col[ptr[k]] to
col[ptr[k + 1]].  Without `col` only ptr is set.  The entries of `mark`, of length count, are -1 before and after. */
void neighbours(long count, long width, const int *nodes, const int *begin, const int *of, int *mark, int *ptr, int *col)
{
    ptr[0] = 0;
    for (long k = 0; k < count; k++) {
        int found = 0, *row = col ? col + ptr[k] : 0;
        for (int at = begin[k]; at < begin[k + 1]; at++)
            for (long a = 0; a < width; a++) {
                const int node = nodes[of[at] * width + a];
                if (mark[node] == k)
                    continue;
                mark[node] = (int)k;
                if (col) {
                    int place = found;
                    for (; place > 0 && row[place - 1] > node; place--)
                        row[place] = row[place - 1];
                    row[place] = node;
                }
                found++;
            }
        ptr[k + 1] = ptr[k] + found;
    }
    for (long k = 0; k < count; k++)
        mark[k] = -1;
}

/* The same for displacements, three per node: begins of the rows, and columns. */
void displacements(long count, const int *ptr, const int *col, int *rows, int *columns)
{
    rows[0] = 0;
    for (long k = 0; k < count; k++) {
        const int length = ptr[k + 1] - ptr[k];
        for (int i = 0; i < 3; i++) {
            for (int at = ptr[k]; at < ptr[k + 1]; at++)
                for (int j = 0; j < 3; j++)
                    *columns++ = 3 * col[at] + j;
            rows[3 * k + i + 1] = rows[3 * k + i] + 3 * length;
        }
    }
}

/* Whether two cells have the same edges to rounding, and the same coefficients. */
static int alike(long corners, const double *x, const double *y, long width, const double *c, const double *d)
{
    if (memcmp(c, d, sizeof(double) * width))
        return 0;
    double size = 0.0;
    for (long k = 3; k < 3 * corners; k++)
        size = fmax(size, fabs(x[k] - x[k % 3]));
    for (long k = 3; k < 3 * corners; k++)
        if (!(fabs((x[k] - x[k % 3]) - (y[k] - y[k % 3])) <= 1e-14 * size))
            return 0;
    return 1;
}

#define KEPT 6 /* cells whose matrices are kept: a cube of tetrahedra has six */

/* The matrix of all cells, added to `values`: three rows per node, in each three entries per coupled node (ptr, col).

A cell has `width` nodes, a row of `nodes`, and `corners` points, a row of `points` with coordinates in x; and
`coefficients` per cell.  Work: KEPT + 1 arrays of 9 width^2 numbers, and of 3 corners. */
void assemble_cells(long cells, long width, const int *nodes, long corners, const int *points, const double *x,
                    const double *constants, long coefficients, const double *coefficient, tabulate kernel,
                    const int *ptr, const int *col, double *values, double *matrices, double *places)
{
    const long n = 3 * width;
    long kept[KEPT], count = 0, next = 0;
    int order[64];
    for (long cell = 0; cell < cells; cell++) {
        const int *node = nodes + cell * width, *point = points + cell * corners;
        const double *c = coefficient + cell * coefficients;
        double *place = places + KEPT * 3 * corners, *matrix = 0;
        for (long k = 0; k < corners; k++)
            memcpy(place + 3 * k, x + 3 * (long)point[k], 3 * sizeof(double));
        for (long k = 0; k < count && !matrix; k++)
            if (alike(corners, place, places + k * 3 * corners, coefficients, c,
                      coefficient + kept[k] * coefficients))
                matrix = matrices + k * n * n;
        if (!matrix) {
            matrix = matrices + next * n * n;
            memcpy(places + next * 3 * corners, place, sizeof(double) * 3 * corners);
            memset(matrix, 0, sizeof(double) * n * n);
            kernel(matrix, c, constants, place, 0, 0);
            kept[next] = cell;
            next = (next + 1) % KEPT;
            count = count < KEPT ? count + 1 : KEPT;
        }
        for (long a = 0; a < width; a++) { /* nodes of the cell, ascending */
            long place_of = a;
            for (; place_of > 0 && node[order[place_of - 1]] > node[a]; place_of--)
                order[place_of] = order[place_of - 1];
            order[place_of] = (int)a;
        }
        for (long a = 0; a < width; a++) {
            const long first = ptr[node[a]], length = 3 * (ptr[node[a] + 1] - first);
            const double *row = matrix + 3 * a * n;
            double *to = values + 9 * first;
            long at = first;
            for (long k = 0; k < width; k++) {
                const long b = order[k];
                while (col[at] < node[b])
                    at++;
                double *block = to + 3 * (at - first);
                for (int i = 0; i < 3; i++)
                    for (int j = 0; j < 3; j++)
                        block[i * length + j] += row[i * n + 3 * b + j];
            }
        }
    }
}
