/* Nonsmooth Gauss-Seidel sweeps for Coulomb's law: u = W r + q, contact by contact (n, t1, t2), 0 <= u_n _|_ r_n >= 0,
   |r_t| <= F r_n, r_t opposes u_t.  M. Jean, J. J. Moreau: Unilaterality and dry friction in the dynamics of rigid body
   collections (1992).  Displacements u are kept up to date: a contact whose force stays costs nothing but a look. */

#include <stdlib.h>

#include "mixing.h"
#include "one_contact.h"
#include "trend.h"

#define SYMMETRIC 1e-8 /* largest difference of two entries that should be equal, over the Frobenius norm */
/* friction_problem.py and scales.py */
#define UNDILUTED 10.0
#define CARRIED_FROM 1e-6
#define OF_CARRIED 1e-2
#define SHARE 1e-2
#define LEAST_LOAD 1e-3
#define LOADS 1e-6
#define MIXED 100.0
#define SEARCH 20 /* contacts whose work is that of a search from one angle */
/* Microseconds: of a contact in a sweep, and of a block of a force that has changed; orders of magnitude: of the path
   after them, at least, for each block, or each operation of one dense factorisation; TRIAL: part of it always spent. */
static const double CONTACT = 0.014, BLOCK = 0.0014, PATH = 8000.0, PATH_BLOCK = 6.5, PATH_WORK = 5.6e-4, TRIAL = 0.2;

/* A as given: compressed rows, in any order and with entries that are to be added, or dense, then indptr is NULL, with
   strides in numbers. */
struct given {
    long m, entries;
    const int *indptr, *indices;
    const double *data, *b;
    long row, column;
};

struct system {
    long m;
    long *first; /* blocks of each row of 3 x 3 blocks, the diagonal one as well */
    int *column;
    v4 (*block)[3]; /* their rows, over the mean diagonal */
    struct contact *contact;
    v4 *u, *r, *q;
    v4 *left, *caused; /* of the residual */
};

/* The blocks of rows 3 i to 3 i + 2 of A, from number `begin` on; their end, or -1 if an entry is outside.
   place[j] is the last block of column j, if it is at least `begin`. */
static long blocks_of_row(struct system *s, const struct given *A, long i, long begin, int *place)
{
    long count = begin;
    if (A->indptr == NULL) {
        const double *data = A->data + 3 * i * A->row;
        for (long j = 0; j < A->m; j++, count++) {
            s->column[count] = j;
            for (int a = 0; a < 3; a++)
                for (int b = 0; b < 4; b++)
                    s->block[count][a][b] = b < 3 ? data[a * A->row + (3 * j + b) * A->column] : 0.0;
        }
        return count;
    }
    for (int a = 0; a < 3; a++) {
        const long end = A->indptr[3 * i + a + 1];
        long j = -1, here = 0;
        if (A->indptr[3 * i + a] < 0 || end > A->entries)
            return -1;
        for (long k = A->indptr[3 * i + a]; k < end; k++) {
            const unsigned column = A->indices[k];
            if (column >= 3 * (unsigned)A->m)
                return -1;
            if (column / 3 != j) {
                j = column / 3;
                if (place[j] < begin) {
                    place[j] = count;
                    s->column[count] = j;
                    memset(s->block[count++], 0, sizeof s->block[0]);
                }
                here = place[j];
            }
            s->block[here][a][column - 3 * j] += A->data[k];
        }
    }
    return count;
}

/* Whether blocks are equal to those on the other side of the diagonal, to a difference; a block without a counterpart
   is not.  Workspace: m + 1 and twice as many numbers as there are blocks. */
static int symmetric(const struct system *s, double difference, int *place, long *after, int *across, int *row)
{
    const long m = s->m, *first = s->first;
    memset(after, 0, (m + 1) * sizeof *after);
    for (long k = 0; k < first[m]; k++)
        after[s->column[k] + 1]++;
    for (long j = 0; j < m; j++) {
        if (after[j + 1] != first[j + 1] - first[j]) /* blocks of column and row j */
            return 0;
        after[j + 1] += after[j];
    }
    for (long i = 0; i < m; i++)
        for (long k = first[i]; k < first[i + 1]; k++) {
            const long at = after[s->column[k]]++;
            across[at] = k, row[at] = i;
        }
    for (long j = 0; j < m; j++) { /* those of column j are now numbers first[j] to first[j + 1] of across */
        for (long k = first[j]; k < first[j + 1]; k++)
            place[s->column[k]] = k;
        for (long k = first[j]; k < first[j + 1]; k++) {
            const long here = place[row[k]];
            if (here < first[j] || here >= first[j + 1])
                return 0;
            const v4 *B = s->block[here], *C = s->block[across[k]];
            if (row[k] <= j)
                for (int a = 0; a < 3; a++)
                    for (int b = 0; b < 3; b++)
                        if (!(fabs(B[a][b] - C[b][a]) <= difference))
                            return 0;
        }
    }
    return 1;
}

/* Blocks of W = A / a and of each contact; the mean diagonal a, or 0 if A is not finite, symmetric and of a positive
   diagonal. */
static double prepare(struct system *s, const struct given *A, int *place, long *after, int *across, int *row)
{
    const long m = s->m;
    double squares = 0.0, trace = 0.0;
    for (long j = 0; j < m; j++)
        place[j] = -1;
    s->first[0] = 0;
    for (long i = 0; i < m; i++) {
        const long begin = s->first[i], end = blocks_of_row(s, A, i, begin, place);
        if (end < 0)
            return 0.0;
        v4 sum = {0.0, 0.0, 0.0, 0.0};
        for (long k = begin; k < end; k++) {
            for (int a = 0; a < 3; a++)
                sum += s->block[k][a] * s->block[k][a];
            if (s->column[k] == i)
                for (int a = 0; a < 9; a++)
                    s->contact[i].own[a] = s->block[k][a / 3][a % 3];
        }
        squares += sum[0] + sum[1] + sum[2];
        s->first[i + 1] = end;
        for (int a = 0; a < 9; a += 4) {
            if (!(s->contact[i].own[a] > 0.0))
                return 0.0;
            trace += s->contact[i].own[a];
        }
    }
    if (!(squares < 1e300 && symmetric(s, SYMMETRIC * sqrt(squares), place, after, across, row)))
        return 0.0;
    const double a = trace / (3.0 * m), scale = 1.0 / a;
    if (!(a > 0.0 && a < 1e300 && scale < 1e300))
        return 0.0;
    for (long k = 0; k < s->first[m]; k++)
        for (int c = 0; c < 3; c++)
            s->block[k][c] *= scale;
    for (long i = 0; i < m; i++) {
        struct contact *here = s->contact + i;
        for (int k = 0; k < 9; k++)
            here->own[k] *= scale;
        if (!inverted(here->own, here->inverse)) {
            double moved[9];
            memcpy(moved, here->own, sizeof moved);
            here->proximal = 1e-3 * (moved[0] + moved[4] + moved[8]);
            for (int k = 0; k < 9; k += 4)
                moved[k] += here->proximal;
            if (!inverted(moved, here->inverse))
                return 0.0;
        }
    }
    return a;
}

/* to += W[:, i] d, by symmetry with the rows of i. */
static inline void moved_in(const struct system *s, v4 *to, long i, v4 d)
{
    const v4 n = {d[0], d[0], d[0], d[0]}, t1 = {d[1], d[1], d[1], d[1]}, t2 = {d[2], d[2], d[2], d[2]};
    for (long k = s->first[i]; k < s->first[i + 1]; k++)
        to[s->column[k]] += s->block[k][0] * n + s->block[k][1] * t1 + s->block[k][2] * t2;
}

static inline void moved(const struct system *s, long i, v4 d)
{
    moved_in(s, s->u, i, d);
}

static void refresh(const struct system *s)
{
    memcpy(s->u, s->q, s->m * sizeof *s->u);
    for (long i = 0; i < s->m; i++)
        if (s->r[i][0] != 0.0 || s->r[i][1] != 0.0 || s->r[i][2] != 0.0)
            moved(s, i, s->r[i]);
}

static inline double square(v4 x)
{
    return x[0] * x[0] + x[1] * x[1] + x[2] * x[2];
}

/* Over the compliances a_n, a_t, a_t of a contact. */
static inline v4 felt(const struct system *s, long i, v4 w)
{
    const double *W = s->contact[i].own, t = 0.5 * (W[4] + W[8]);
    return (v4){w[0] / W[0], w[1] / t, w[2] / t, 0.0};
}

/* r - P'(r - l) of a contact, P' with the disc of r. */
static inline v4 left_over(v4 x, v4 l, double bound)
{
    const double y[2] = {x[1] - l[1], x[2] - l[2]}, t = sqrt(y[0] * y[0] + y[1] * y[1]);
    const double n = fmin(l[0], x[0]);
    if (t <= bound)
        return (v4){n, l[1], l[2], 0.0};
    return (v4){n, x[1] - bound / t * y[0], x[2] - bound / t * y[1], 0.0};
}

/* The largest natural residual of a contact, by its own compliance and force, and what small ones do to each other. */
static double worst(const struct system *s)
{
    double most = 0.0, loads = 0.0, lightest = 1e300, found = 0.0, caused = 0.0, least = 1e300, largest = 0.0;
    for (long i = 0; i < s->m; i++) {
        const double load = square(felt(s, i, s->q[i]));
        most = fmax(most, square(s->r[i])), loads = fmax(loads, load), lightest = fmin(lightest, load);
        least = fmin(least, s->contact[i].own[0]), largest = fmax(largest, s->contact[i].own[0]);
    }
    const double share = SHARE * SHARE * fmax(most, fmax(LOADS * LOADS * loads, LEAST_LOAD * LEAST_LOAD * lightest));
    for (long i = 0; i < s->m; i++) {
        s->left[i] = left_over(s->r[i], felt(s, i, s->u[i]), s->contact[i].F * fmax(s->r[i][0], 0.0));
        const double off = square(s->left[i]), scale = fmax(square(s->r[i]), share);
        if (off != 0.0)
            found = off / scale > found || off != off ? off / scale : found;
    }
    if (!(found > 0.0 && sqrt(found) <= CARRIED_FROM && largest > MIXED * least))
        return sqrt(found);
    memset(s->caused, 0, s->m * sizeof *s->caused);
    for (long i = 0; i < s->m; i++)
        moved_in(s, s->caused, i, s->left[i]);
    for (long i = 0; i < s->m; i++)
        caused = fmax(caused, square(felt(s, i, s->caused[i])) / fmax(square(s->r[i]), share));
    return fmax(sqrt(found), OF_CARRIED * sqrt(caused));
}

/* |r - P(r - (u + F |u_t| n))| / (1 + |q|), P the projection on the cones, and |r - P'(r - u)| / |r|, P' with the discs
   of r, times the dilution |r|^2 / (10 r.W r) or |r| / (10 |q|), at least 1 (FrictionProblem.dilution): the larger one. */
static double whole(const struct system *s, double loads)
{
    double cone = 0.0, natural = 0.0, size = 0.0, work = 0.0;
    for (long i = 0; i < s->m; i++) {
        const v4 x = s->r[i], u = s->u[i];
        const double F = s->contact[i].F;
        const double y[3] = {x[0] - u[0] - F * sqrt(u[1] * u[1] + u[2] * u[2]), x[1] - u[1], x[2] - u[2]};
        const double t = sqrt(y[1] * y[1] + y[2] * y[2]), bound = F * fmax(x[0], 0.0);
        double p[3] = {y[0], y[1], y[2]};
        if (t > F * y[0] || y[0] < 0.0) {
            const double normal = fmax(y[0] + F * t, 0.0) / (1.0 + F * F), along = t > 0.0 ? F * normal / t : 0.0;
            p[0] = normal, p[1] = along * y[1], p[2] = along * y[2];
        }
        natural += square(left_over(x, u, bound));
        for (int k = 0; k < 3; k++) {
            cone += (x[k] - p[k]) * (x[k] - p[k]);
            size += x[k] * x[k];
            work += x[k] * (u[k] - s->q[i][k]);
        }
    }
    const double share = UNDILUTED * fmin(fmax(work, 0.0), loads * sqrt(size));
    const double dilution = size > share ? size / share : 1.0;
    const double first = sqrt(cone) / (1.0 + loads), second = natural > 0.0 ? sqrt(natural / size) * dilution : 0.0;
    return first > second || first != first ? first : second;
}

static double residual(const struct system *s, double loads)
{
    const double all = whole(s, loads), one = worst(s);
    return all > one || all != all ? all : one;
}

/* Sweeps forwards and backwards in turn, until the residual is at most tolerance, or more than trial is spent and more
   than the allowance is left; the last residual of all contacts together, which falls more evenly than that of the
   worst, and has to reach the goal at which the worst one is expected to reach the tolerance. */
static double sweep(struct system *s, struct mixing *x, double tolerance, double loads, double trial, double allowance,
                    long *sweeps)
{
    double size = 1e300, before = 1e300, small = tolerance * tolerance, goal = tolerance;
    struct trend trend = {0};
    long judged = 0, next = 1, visited = 0, changed = 0, begun = 0;
    for (*sweeps = 0;;) {
        double change = 0.0;
        for (long k = 0; k < s->m; k++) {
            const long i = *sweeps % 2 ? s->m - 1 - k : k;
            const struct contact *here = s->contact + i;
            const double *W = here->own;
            const v4 old = s->r[i], u = s->u[i];
            if (old[0] == 0.0 && u[0] >= 0.0 && old[1] == 0.0 && old[2] == 0.0)
                continue;
            double v[3], r[3] = {old[0], old[1], old[2]};
            for (int a = 0; a < 3; a++)
                v[a] = u[a] - (W[3 * a] * r[0] + W[3 * a + 1] * r[1] + W[3 * a + 2] * r[2]);
            visited += SEARCH * one_contact(here, v, r);
            const v4 new = {r[0], r[1], r[2], 0.0}, d = new - old;
            const double size = square(d);
            visited++;
            if (size == 0.0)
                continue;
            s->r[i] = new;
            moved(s, i, d);
            changed += s->first[i + 1] - s->first[i];
            change += size;
        }
        ++*sweeps;
        if (!(change < 1e300))
            return 1e300;
        if (*sweeps < next && change > small)
            continue;
        size = whole(s, loads);
        if (!(size > goal)) {
            refresh(s);
            size = whole(s, loads);
            const double one = size > goal ? 0.0 : worst(s);
            if (one > tolerance)
                goal = 0.9 * size * (tolerance / one);
        }
        if (!(size > goal) || change == 0.0)
            return size;
        small = fmin(small, change * (goal / size) * (goal / size)); /* where the residual will be small */
        const double rate = before < 1e300 ? pow(size / before, 1.0 / (*sweeps - judged)) : 1.0;
        before = size, judged = *sweeps;
        const double left = rate < 1.0 ? log(goal / size) / log(rate) : 1e300;
        const double spent = CONTACT * visited + BLOCK * changed;
        if (work_left(&trend, size, goal, spent) > allowance && spent > trial)
            return size;
        if (*sweeps == begun + BLOCK_OF_SWEEPS) {
            begun = *sweeps;
            if (x != NULL)
                mixed(x, s->r, size), refresh(s), changed += s->first[s->m];
        }
        next = *sweeps + (long)fmin(fmin(fmax(ceil(left), 1.0), judged), begun + BLOCK_OF_SWEEPS - *sweeps);
    }
}

/* Forces x, gradient A x - b from the entries of A as given, bounds F x_n and multipliers, and in s->r and s->u what
   the residual is computed from. */
static void answered(struct system *s, const struct given *A, double a, double force, double *x)
{
    const long m = s->m;
    double *gradient = x + 3 * m, *bound = gradient + 3 * m, *multipliers = bound + m;
    for (long i = 0; i < m; i++)
        for (int c = 0; c < 3; c++)
            x[3 * i + c] = s->r[i][c] * force;
    for (long i = 0; i < 3 * m; i++) {
        double sum = 0.0;
        if (A->indptr == NULL)
            for (long j = 0; j < 3 * m; j++)
                sum += A->data[i * A->row + j * A->column] * x[j];
        else
            for (long k = A->indptr[i]; k < A->indptr[i + 1]; k++)
                sum += A->data[k] * x[A->indices[k]];
        gradient[i] = sum - A->b[i];
        s->r[i / 3][i % 3] = x[i] / force, s->u[i / 3][i % 3] = gradient[i] / (a * force);
    }
    for (long i = 0; i < m; i++) {
        const double *w = gradient + 3 * i;
        bound[i] = s->contact[i].F * fmax(x[3 * i], 0.0);
        multipliers[2 * i] = fmax(w[0], 0.0), multipliers[2 * i + 1] = sqrt(w[1] * w[1] + w[2] * w[2]);
    }
}

/* Forces by sweeps, with every check of the arguments that a correct problem passes.
   A (3 m x 3 m) has compressed rows with `entries` entries, or is dense with the strides row and column (indptr NULL);
   b (3 m); F (m), or NULL for the number friction; start (3 m), or NULL for 0; work: microseconds that are spent, 0 for
   as many as promise to be quicker than the path.  out, 2 + 9 m numbers: the residual after the sweeps, and computed
   afresh from A as given; forces, gradient, bounds of friction, multipliers (2 m).  Returns the number of sweeps; -1
   if something is wrong, or not suitable: the arguments, or the memory. */
long gauss_seidel(long m, long entries, const int *indptr, const int *indices, const double *data, long row,
                  long column, const double *b, const double *F, double friction, const double *start,
                  double tolerance, double work, double *out)
{
    const struct given A = {m, entries, indptr, indices, data, b, row, column};
    const long blocks = indptr == NULL || entries > m * m ? m * m : entries;
    const size_t bytes = blocks * (sizeof(v4[3]) + 3 * sizeof(int)) + (5 + MIXING_VECTORS) * m * sizeof(v4)
                         + m * sizeof(struct contact) + 2 * (m + 1) * sizeof(long) + m * sizeof(int);
    char *memory = aligned_alloc(32, (bytes + 31) / 32 * 32);
    if (memory == NULL)
        return -1;
    struct system s = {.m = m, .block = (v4(*)[3])memory};
    s.u = (v4 *)(s.block + blocks), s.r = s.u + m, s.q = s.r + m;
    s.left = s.q + m, s.caused = s.left + m;
    struct mixing x = mixing_in(m, s.caused + m);
    s.contact = (struct contact *)(s.caused + (1 + MIXING_VECTORS) * m), s.first = (long *)(s.contact + m);
    memset(s.contact, 0, m * sizeof *s.contact);
    long *after = s.first + m + 1, sweeps = -1;
    int *across = (s.column = (int *)(after + m + 1)) + blocks, *rows = across + blocks, *place = rows + blocks;
    double largest = 0.0, loads = 0.0;
    for (long i = 0; i < m; i++) {
        const double here = F == NULL ? friction : F[i];
        s.contact[i].F = here;
        if (!(here >= 0.0 && here < 1e100))
            goto end;
        for (int c = 0; c < 3; c++) {
            if (!(fabs(b[3 * i + c]) < 1e300))
                goto end;
            largest = fmax(largest, fabs(b[3 * i + c]));
        }
    }
    const double a = prepare(&s, &A, place, after, across, rows), force = largest > 0.0 ? largest / a : 1.0;
    if (!(a > 0.0 && force > 1e-290 && force < 1e290 && a * force > 1e-290 && a * force < 1e290))
        goto end;
    const v4 zero = {0.0, 0.0, 0.0, 0.0};
    for (long i = 0; i < m; i++) {
        s.q[i] = s.r[i] = zero;
        for (int c = 0; c < 3; c++) {
            s.q[i][c] = -b[3 * i + c] / (a * force), loads += s.q[i][c] * s.q[i][c];
            s.r[i][c] = start == NULL ? 0.0 : start[3 * i + c] / force;
        }
    }
    loads = sqrt(loads), memcpy(x.start, s.r, m * sizeof *s.r);
    refresh(&s);
    const double fill = s.first[m], dense = 18.0 * m * m * m;
    const double path = PATH + (m <= 30 || fill > 0.25 * m * m ? PATH_WORK * dense : PATH_BLOCK * fill);
    const double allowance = work > 0.0 ? 0.0 : path, trial = work > 0.0 ? work : TRIAL * path;
    out[0] = sweep(&s, work > 0.0 ? NULL : &x, 0.999 * tolerance, loads, trial, allowance, &sweeps);
    answered(&s, &A, a, force, out + 2);
    out[1] = residual(&s, loads);
end:
    free(memory);
    return sweeps;
}
