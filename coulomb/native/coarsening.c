/* The first steps from a grid to a coarser one: aggregates of nodes, and the kernels of coarsening.h for blocks of
3 x 3 (from second order to first), 3 x 6 and 6 x 6. */

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "lanes.h"

/* Here the rows of a symmetric matrix are those of its upper triangle in blocks, `val` + `low` as in blocks.h, by all
blocks of a row: those of row i are ptr[i] to ptr[i + 1], in columns `col`, ascending; block k is that at at[k], or the
transposed of that at ~at[k].  Of columns of other ranks `at` is NULL: block k is that at k. */

/* All rows of the upper triangle (upper, column), in every row of which the block on the diagonal is first. */
void whole_rows(int n, const int *upper, const int *column, int *ptr, int *col, int *at)
{
    memset(ptr, 0, sizeof(int) * (n + 1));
    for (int i = 0; i < n; i++)
        for (int k = upper[i]; k < upper[i + 1]; k++) {
            ptr[i + 1]++;
            if (column[k] != i)
                ptr[column[k] + 1]++;
        }
    for (int i = 0; i < n; i++)
        ptr[i + 1] += ptr[i];
    for (int i = 0; i < n; i++) /* the blocks before the diagonal are there when row i comes */
        for (int k = upper[i]; k < upper[i + 1]; k++) {
            col[ptr[i]] = column[k];
            at[ptr[i]++] = k;
            if (column[k] != i) {
                col[ptr[column[k]]] = i;
                at[ptr[column[k]]++] = ~k;
            }
        }
    memmove(ptr + 1, ptr, sizeof(int) * n);
    ptr[0] = 0;
}

/* Aggregates of the n nodes of a graph, in which edges count where `strong` is not 0: out[i] is that of node i, -1 where
it has no strong edge; their number.  First a node with all its neighbours, if they are free; then nodes join an
aggregate beside them, the one with most of their neighbours. */
int aggregate(int n, const int *ptr, const int *col, const unsigned char *strong, int *out)
{
    int count = 0;
    for (int i = 0; i < n; i++)
        out[i] = -1;
    for (int i = 0; i < n; i++) {
        int neighbours = 0, is_free = out[i] < 0;
        for (int k = ptr[i]; is_free && k < ptr[i + 1]; k++)
            if (strong[k]) {
                neighbours++;
                is_free = out[col[k]] < 0;
            }
        if (!is_free || neighbours == 0)
            continue;
        out[i] = count;
        for (int k = ptr[i]; k < ptr[i + 1]; k++)
            if (strong[k])
                out[col[k]] = count;
        count++;
    }
    int *joined = malloc(sizeof(int) * (n > 0 ? n : 1)), *votes = calloc(count > 0 ? count : 1, sizeof(int));
    for (int i = 0; i < n; i++) {
        joined[i] = out[i];
        if (out[i] >= 0)
            continue;
        int most = 0;
        for (int k = ptr[i]; k < ptr[i + 1]; k++)
            if (strong[k] && out[col[k]] >= 0 && ++votes[out[col[k]]] > most) {
                most = votes[out[col[k]]];
                joined[i] = out[col[k]];
            }
        for (int k = ptr[i]; k < ptr[i + 1]; k++)
            if (strong[k] && out[col[k]] >= 0)
                votes[out[col[k]]] = 0;
    }
    memcpy(out, joined, sizeof(int) * n);
    free(joined);
    free(votes);
    for (int i = 0; i < n; i++) { /* what is left has no aggregate beside it: its edges go one way */
        if (out[i] >= 0)
            continue;
        int made = 0;
        for (int k = ptr[i]; k < ptr[i + 1]; k++)
            if (strong[k] && out[col[k]] < 0) {
                out[col[k]] = count;
                made = 1;
            }
        if (made)
            out[i] = count++;
    }
    return count;
}

/* The places of a matrix by columns: those of column j are at begin[j] to begin[j + 1] in `rows` and `places`. */
void by_columns(int n, int columns, const int *ptr, const int *col, int *begin, int *rows, int *places)
{
    memset(begin, 0, sizeof(int) * (columns + 1));
    for (int k = 0; k < ptr[n]; k++)
        begin[col[k] + 1]++;
    for (int j = 0; j < columns; j++)
        begin[j + 1] += begin[j];
    for (int i = 0; i < n; i++)
        for (int k = ptr[i]; k < ptr[i + 1]; k++) {
            rows[begin[col[k]]] = i;
            places[begin[col[k]]++] = k;
        }
    memmove(begin + 1, begin, sizeof(int) * columns);
    begin[0] = 0;
}

static int ascending(const void *a, const void *b) { return *(const int *)a - *(const int *)b; }

/* The aggregates of the nodes to which row i couples, itself included, in `own` where that is not 0: their number. */
static int aggregates_of_row(int i, int n, const int *ptr, const int *col, const int *ghost_ptr, const int *ghost_col,
                             const int *aggregates, int *seen, int *own)
{
    int found = 0;
    for (int part = 0; part < (ghost_ptr ? 2 : 1); part++) {
        const int *p = part ? ghost_ptr : ptr, *c = part ? ghost_col : col;
        for (int k = p[i]; k < p[i + 1]; k++) {
            const int a = aggregates[c[k] + (part ? n : 0)];
            if (a >= 0 && seen[a] != i) {
                seen[a] = i;
                if (own)
                    own[found] = a;
                found++;
            }
        }
    }
    return found;
}

/* The number of these of every row. */
void coupled_aggregates(int n, int threads, const int *ptr, const int *col, const int *ghost_ptr, const int *ghost_col,
                        const int *aggregates, int count, int *out)
{
#pragma omp parallel num_threads(threads) if (threads > 1)
    {
        int *seen = malloc(sizeof(int) * (count + 1));
        memset(seen, -1, sizeof(int) * (count + 1));
#pragma omp for schedule(static)
        for (int i = 0; i < n; i++)
            out[i] = aggregates_of_row(i, n, ptr, col, ghost_ptr, ghost_col, aggregates, seen, 0);
        free(seen);
    }
}

/* The columns of a row of P^T K P, ascending where `columns` is not 0: their number; of the first `own` rows those from
the diagonal on, which is always there.  `touched` are the nodes to which P^T K couples it, `most` their largest number
so far. */
static int row_pattern(int row, int own, int n, const int *begin, const int *rows, const int *ptr, const int *col,
                       const int *ghost_ptr, const int *ghost_col, const int *p_ptr, const int *p_col, int *node_seen,
                       int *coarse_seen, int *touched, int *columns, int *most)
{
    int nodes = 0, found = 0;
    if (row < own) {
        coarse_seen[row] = row;
        if (columns)
            columns[found] = row;
        found++;
    }
    for (int t = begin[row]; t < begin[row + 1]; t++)
        for (int part = 0; part < (ghost_ptr ? 2 : 1); part++) {
            const int i = rows[t], *p = part ? ghost_ptr : ptr, *c = part ? ghost_col : col;
            for (int k = p[i]; k < p[i + 1]; k++) {
                const int j = c[k] + (part ? n : 0);
                if (node_seen[j] != row) {
                    node_seen[j] = row;
                    touched[nodes++] = j;
                }
            }
        }
    for (int s = 0; s < nodes; s++)
        for (int k = p_ptr[touched[s]]; k < p_ptr[touched[s] + 1]; k++)
            if (coarse_seen[p_col[k]] != row && (row >= own || p_col[k] > row)) {
                coarse_seen[p_col[k]] = row;
                if (columns)
                    columns[found] = p_col[k];
                found++;
            }
    if (columns)
        qsort(columns, found, sizeof(int), ascending);
    if (nodes > *most)
        *most = nodes;
    return found;
}

/* The pattern of the first `coarse` rows of P^T K P, of `width` columns: how many blocks the rows have, in `pointers`, or
where these are known their columns, ascending, of the first `own` rows those of the upper triangle.  `nodes` are the
rows of P, of which the first n are this rank's.  The largest number of nodes to which P^T K couples a row. */
int product_pattern(int n, int nodes, int own, int coarse, int width, int threads, const int *begin, const int *rows,
                    const int *ptr, const int *col, const int *ghost_ptr, const int *ghost_col, const int *p_ptr,
                    const int *p_col, int *pointers, int *columns)
{
    int most = 0;
#pragma omp parallel num_threads(threads) if (threads > 1) reduction(max : most)
    {
        int *memory = malloc(sizeof(int) * (2 * (long)nodes + width + 1)), here = 0;
        memset(memory, -1, sizeof(int) * (2 * (long)nodes + width + 1));
#pragma omp for schedule(dynamic, 64)
        for (int row = 0; row < coarse; row++) {
            const int found = row_pattern(row, own, n, begin, rows, ptr, col, ghost_ptr, ghost_col, p_ptr, p_col,
                                          memory, memory + nodes, memory + nodes + width,
                                          columns ? columns + pointers[row] : 0, &here);
            if (!columns)
                pointers[row] = found;
        }
        most = here > most ? here : most;
        free(memory);
    }
    return most;
}

#define KERNELS "coarsening.h"
#include "shapes.h"
