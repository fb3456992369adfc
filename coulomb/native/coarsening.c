/* The first steps from a grid to a coarser one: aggregates of nodes, and the kernels of coarsening.h for blocks of
3 x 3 (from second order to first), 3 x 6 and 6 x 6. */

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "lanes.h"

/* Here rows of a matrix are in blocks of which every entry is stored, as compressed rows of single entries: the blocks of row i
are ptr[i] to ptr[i + 1], in columns `col`; a row of a block begins after those of the blocks before it. */

/* The pattern of n rows of blocks of b x b from that of their entries: 1, or 0 if not every entry of a block is stored
or columns do not ascend. */
int block_pattern(int n, int b, const int *ptr, const int *col, int *pointers, int *columns)
{
    pointers[0] = 0;
    for (int i = 0; i < n; i++) {
        const int first = ptr[b * i], length = ptr[b * i + 1] - first, count = length / b;
        if (length % b || ptr[b * i + b] - first != b * length)
            return 0;
        for (int r = 0; r < b; r++) {
            const int *row = col + ptr[b * i + r];
            if (ptr[b * i + r] != first + r * length)
                return 0;
            for (int k = 0; k < length; k++)
                if (row[k] != (row[k - k % b] / b) * b + k % b || (k && row[k] <= row[k - 1]))
                    return 0;
            if (r && memcmp(row, col + first, sizeof(int) * length))
                return 0;
        }
        for (int k = 0; k < count; k++)
            columns[pointers[i] + k] = col[first + b * k] / b;
        pointers[i + 1] = pointers[i] + count;
    }
    return 1;
}

/* Blocks of b x b, one after the other, by rows of entries: pattern and values. */
void entries_of_blocks(int n, int b, int threads, const int *pointers, const int *columns, const double *blocks,
                       int *ptr, int *col, double *val)
{
    ptr[0] = 0;
#pragma omp parallel for schedule(static) num_threads(threads) if (threads > 1)
    for (int i = 0; i < n; i++) {
        const long first = b * b * (long)pointers[i], count = pointers[i + 1] - pointers[i];
        for (int r = 0; r < b; r++) {
            const long row = first + r * b * count;
            ptr[b * i + r + 1] = (int)(row + b * count);
            for (long k = 0; k < count; k++)
                for (int c = 0; c < b; c++) {
                    col[row + b * k + c] = b * columns[pointers[i] + k] + c;
                    val[row + b * k + c] = blocks[first + b * b * k + b * r + c];
                }
        }
    }
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

/* The columns of a row of P^T K P, ascending where `columns` is not 0: their number; `touched` are the nodes to which
P^T K couples it, `most` their largest number so far. */
static int row_pattern(int row, int n, const int *begin, const int *rows, const int *ptr, const int *col,
                       const int *ghost_ptr, const int *ghost_col, const int *p_ptr, const int *p_col, int *node_seen,
                       int *coarse_seen, int *touched, int *columns, int *most)
{
    int nodes = 0, found = 0;
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
            if (coarse_seen[p_col[k]] != row) {
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

/* The pattern of the first `coarse` rows of P^T K P, of `width` columns: how many blocks the rows have, in `pointers`, or where these are known
their columns, ascending.  `nodes` are the rows of P, of which the first n are this rank's.  The largest number of
nodes to which P^T K couples a row. */
int product_pattern(int n, int nodes, int coarse, int width, int threads, const int *begin, const int *rows, const int *ptr,
                    const int *col, const int *ghost_ptr, const int *ghost_col, const int *p_ptr, const int *p_col,
                    int *pointers, int *columns)
{
    int most = 0;
#pragma omp parallel num_threads(threads) if (threads > 1) reduction(max : most)
    {
        int *memory = malloc(sizeof(int) * (2 * (long)nodes + width + 1)), own = 0;
        memset(memory, -1, sizeof(int) * (2 * (long)nodes + width + 1));
#pragma omp for schedule(dynamic, 64)
        for (int row = 0; row < coarse; row++) {
            const int found = row_pattern(row, n, begin, rows, ptr, col, ghost_ptr, ghost_col, p_ptr, p_col, memory,
                                          memory + nodes, memory + nodes + width,
                                          columns ? columns + pointers[row] : 0, &own);
            if (!columns)
                pointers[row] = found;
        }
        most = own > most ? own : most;
        free(memory);
    }
    return most;
}

#define KERNELS "coarsening.h"
#include "shapes.h"
