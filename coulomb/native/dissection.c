/* Nested dissection by planes: nested_dissection.py has the same in Python, and says what it is. */

#include <math.h>
#include <stdlib.h>
#include <string.h>

typedef struct {
    const long *ptr, *col; /* the nodes coupled with each */
    const double *points;  /* coordinates, three per node */
    long leaf;             /* largest number of nodes of a part that is not cut */
    long *own, *counts;    /* results: nodes of the fronts one after another, and how many each has */
    long *children;        /* two of each front, or -1 */
    long fronts, placed;
    int *inside;           /* number of the part that a node is in */
    int parts;
    signed char *high, *best; /* of the nodes of a part: side of the cut, and the best cut with its separator, 2 */
    double *along, *sorted;
    long *moved;
} Tree;

/* The value that would be at a place if the values were sorted; they are reordered. */
static double selected(double *v, long n, long place)
{
    long low = 0, high = n - 1;
    while (low < high) {
        const double pivot = v[(low + high) / 2];
        long i = low, j = high;
        while (i <= j) {
            while (v[i] < pivot)
                i++;
            while (v[j] > pivot)
                j--;
            if (i <= j) {
                const double kept = v[i];
                v[i++] = v[j];
                v[j--] = kept;
            }
        }
        if (place <= j)
            high = j;
        else if (place >= i)
            low = i;
        else
            break;
    }
    return v[place];
}

/* The eigenvector of the largest eigenvalue of a symmetric 3 x 3 matrix, by Jacobi's rotations. */
static void principal_axis(double a[3][3], double axis[3])
{
    double v[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    for (int sweep = 0; sweep < 30; sweep++) {
        const double off = a[0][1] * a[0][1] + a[0][2] * a[0][2] + a[1][2] * a[1][2];
        const double size = a[0][0] * a[0][0] + a[1][1] * a[1][1] + a[2][2] * a[2][2];
        if (!(off > 1e-32 * size))
            break;
        for (int p = 0; p < 2; p++)
            for (int q = p + 1; q < 3; q++) {
                if (a[p][q] == 0.0)
                    continue;
                const double turn = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
                const double t = (turn >= 0 ? 1.0 : -1.0) / (fabs(turn) + sqrt(turn * turn + 1.0));
                const double c = 1.0 / sqrt(t * t + 1.0), s = t * c;
                for (int k = 0; k < 3; k++) {
                    const double x = a[k][p], y = a[k][q];
                    a[k][p] = c * x - s * y;
                    a[k][q] = s * x + c * y;
                }
                for (int k = 0; k < 3; k++) {
                    const double x = a[p][k], y = a[q][k], z = v[k][p], w = v[k][q];
                    a[p][k] = c * x - s * y;
                    a[q][k] = s * x + c * y;
                    v[k][p] = c * z - s * w;
                    v[k][q] = s * z + c * w;
                }
            }
    }
    int most = 0;
    for (int k = 1; k < 3; k++)
        if (a[k][k] >= a[most][most])
            most = k;
    int largest = 0; /* of its components, which becomes positive */
    for (int k = 1; k < 3; k++)
        if (fabs(v[k][most]) > fabs(v[largest][most]))
            largest = k;
    for (int k = 0; k < 3; k++)
        axis[k] = v[largest][most] < 0 ? -v[k][most] : v[k][most];
}

/* Cut along one direction at the median: the nodes beyond it are high; whether there are any on both sides. */
static int halved(Tree *tree, long n)
{
    const double *along = tree->along;
    memcpy(tree->sorted, along, sizeof(double) * n);
    const long middle = (long)(0.5 * (double)(n - 1));
    const double cut = selected(tree->sorted, n, middle);
    double low = along[0], top = along[0];
    for (long k = 1; k < n; k++) {
        low = along[k] < low ? along[k] : low;
        top = along[k] > top ? along[k] : top;
    }
    long count = 0;
    for (int again = 0; again < 2; again++) {
        const double beyond = cut + (again ? -1e-9 : 1e-9) * (top - low);
        count = 0;
        for (long k = 0; k < n; k++)
            count += tree->high[k] = along[k] > beyond;
        if (2.0 * (double)count >= 0.5 * (double)n) /* else many nodes are at the cut itself */
            break;
    }
    return count > 0 && count < n;
}

/* 0 and 1 for the nodes of two parts that are not coupled, 2 for the smallest separator found, in `best`; whether there
is any. */
static int cut(Tree *tree, long n, const long *nodes, const int *place)
{
    double mean[3] = {0}, spread[3][3] = {{0}}, axis[3];
    for (long k = 0; k < n; k++)
        for (int i = 0; i < 3; i++)
            mean[i] += tree->points[3 * nodes[k] + i];
    for (int i = 0; i < 3; i++)
        mean[i] /= (double)n;
    for (long k = 0; k < n; k++)
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++)
                spread[i][j] += (tree->points[3 * nodes[k] + i] - mean[i]) * (tree->points[3 * nodes[k] + j] - mean[j]);
    principal_axis(spread, axis);
    const int oblique = fmax(fabs(axis[0]), fmax(fabs(axis[1]), fabs(axis[2]))) < 0.999;
    const int part = tree->inside[nodes[0]];
    long least = n;
    int found = 0;
    for (int direction = 0; direction < 3 + oblique; direction++) {
        for (long k = 0; k < n; k++) {
            const double *x = tree->points + 3 * nodes[k];
            tree->along[k] = direction < 3 ? x[direction] - mean[direction]
                                           : (x[0] - mean[0]) * axis[0] + (x[1] - mean[1]) * axis[1] +
                                                 (x[2] - mean[2]) * axis[2];
        }
        if (!halved(tree, n))
            continue;
        long touching[2] = {0, 0};
        for (long k = 0; k < n; k++) { /* bit 1: coupled with a node on the other side */
            const int side = tree->high[k] & 1;
            for (long at = tree->ptr[nodes[k]]; at < tree->ptr[nodes[k] + 1]; at++) {
                const long other = tree->col[at];
                if (tree->inside[other] == part && (tree->high[place[other]] & 1) != side) {
                    tree->high[k] |= 2;
                    touching[side]++;
                    break;
                }
            }
        }
        for (int side = 1; side >= 0; side--)
            if (!found || touching[side] < least) {
                found = 1;
                least = touching[side];
                for (long k = 0; k < n; k++)
                    tree->best[k] = tree->high[k] == (2 | side) ? 2 : tree->high[k] & 1;
            }
    }
    return found;
}

/* Cut these nodes down to the leaves; the number of their front, or -1 if there are no nodes. */
static long grow(Tree *tree, long n, long *nodes, int *place)
{
    if (n == 0)
        return -1;
    const int part = tree->parts++;
    for (long k = 0; k < n; k++) {
        tree->inside[nodes[k]] = part;
        place[nodes[k]] = (int)k;
    }
    long count[3] = {0, 0, n}, below[2] = {-1, -1};
    if (n > tree->leaf && cut(tree, n, nodes, place)) {
        count[2] = 0;
        for (long k = 0; k < n; k++)
            count[(int)tree->best[k]]++;
        long at[3] = {0, count[0], count[0] + count[1]};
        for (long k = 0; k < n; k++)
            tree->moved[at[(int)tree->best[k]]++] = nodes[k];
        memcpy(nodes, tree->moved, sizeof(long) * n);
        for (long k = n - count[2]; k < n; k++)
            tree->inside[nodes[k]] = -1;
        below[0] = grow(tree, count[0], nodes, place);
        below[1] = grow(tree, count[1], nodes + count[0], place);
    }
    memcpy(tree->own + tree->placed, nodes + n - count[2], sizeof(long) * count[2]);
    tree->placed += count[2];
    tree->counts[tree->fronts] = count[2];
    tree->children[2 * tree->fronts] = below[0];
    tree->children[2 * tree->fronts + 1] = below[1];
    return tree->fronts++;
}

/* Separators of n of `all` nodes in the order of elimination; their number, or -1 without memory.  `own` has room for n
nodes, `counts` for 2 n numbers and `children` for 4 n: parts that are not coupled have an empty separator; nodes are
reordered. */
long dissect_nodes(long all, long n, long *nodes, const long *ptr, const long *col, const double *points, long leaf,
                   long *own, long *counts, long *children)
{
    int *place = malloc(sizeof(int) * (all + 1));
    Tree tree = {.ptr = ptr, .col = col, .points = points, .leaf = leaf, .own = own, .counts = counts};
    tree.children = children;
    tree.inside = malloc(sizeof(int) * (all + 1));
    tree.high = malloc(n + 1);
    tree.best = malloc(n + 1);
    tree.along = malloc(sizeof(double) * (n + 1));
    tree.sorted = malloc(sizeof(double) * (n + 1));
    tree.moved = malloc(sizeof(long) * (n + 1));
    long fronts = -1;
    if (place && tree.inside && tree.high && tree.best && tree.along && tree.sorted && tree.moved) {
        for (long k = 0; k < all; k++)
            tree.inside[k] = -1;
        grow(&tree, n, nodes, place);
        fronts = tree.fronts;
    }
    free(place);
    free(tree.inside);
    free(tree.high);
    free(tree.best);
    free(tree.along);
    free(tree.sorted);
    free(tree.moved);
    return fronts;
}

typedef struct {
    double x;
    long node;
    int at;
} Placed;

static int by_place(const void *a, const void *b)
{
    const Placed *one = a, *two = b;
    if (one->x != two->x)
        return one->x < two->x ? -1 : 1;
    return one->at - two->at;
}

static void ordered(long n, long *nodes, const double *points, long block, Placed *work)
{
    if (n <= block)
        return;
    double low[3], high[3];
    for (int i = 0; i < 3; i++)
        low[i] = high[i] = points[3 * nodes[0] + i];
    for (long k = 1; k < n; k++)
        for (int i = 0; i < 3; i++) {
            const double x = points[3 * nodes[k] + i];
            low[i] = x < low[i] ? x : low[i];
            high[i] = x > high[i] ? x : high[i];
        }
    int axis = 0;
    for (int i = 1; i < 3; i++)
        if (high[i] - low[i] > high[axis] - low[axis])
            axis = i;
    for (long k = 0; k < n; k++)
        work[k] = (Placed){points[3 * nodes[k] + axis], nodes[k], (int)k};
    qsort(work, n, sizeof(Placed), by_place);
    for (long k = 0; k < n; k++)
        nodes[k] = work[k].node;
    ordered(n / 2, nodes, points, block, work);
    ordered(n - n / 2, nodes + n / 2, points, block, work);
}

/* Order nodes by halves, quarters and so on along their longest extents, down to `block` nodes; 0, or 1 without
memory. */
int order_along_space(long n, long *nodes, const double *points, long block)
{
    Placed *work = malloc(sizeof(Placed) * (n + 1));
    if (!work)
        return 1;
    ordered(n, nodes, points, block, work);
    free(work);
    return 0;
}
