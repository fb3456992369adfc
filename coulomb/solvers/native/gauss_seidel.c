/* Nonsmooth Gauss-Seidel sweeps for Coulomb's law: u = W r + q, contact by contact (n, t1, t2), 0 <= u_n _|_ r_n >= 0,
   |r_t| <= F r_n, r_t opposes u_t.  M. Jean, J. J. Moreau: Unilaterality and dry friction in the dynamics of rigid body
   collections (1992).  The problem of one contact is solved directly: open, stick, or slip along the direction at which
   slip and friction oppose each other, the root of a trigonometric polynomial. */

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define ANGLES 32 /* at which a root is searched where Newton's method finds none */

struct system {
    long m;
    long *first;       /* blocks of each row, without the diagonal one */
    long *column;
    double (*block)[9];
    double (*own)[9];  /* blocks of the diagonal, ... */
    double (*inverse)[9]; /* ... their inverses, of own + proximal 1, ... */
    double *proximal;  /* ... 0 where they are regular */
    const double *q, *F;
};

static int inverted(const double *d, double *out)
{
    const double a = d[4] * d[8] - d[5] * d[7], b = d[5] * d[6] - d[3] * d[8], c = d[3] * d[7] - d[4] * d[6];
    const double det = d[0] * a + d[1] * b + d[2] * c, size = d[0] * d[4] * d[8];
    if (!(det > 1e-9 * size))
        return 0;
    out[0] = a / det, out[1] = (d[2] * d[7] - d[1] * d[8]) / det, out[2] = (d[1] * d[5] - d[2] * d[4]) / det;
    out[3] = b / det, out[4] = (d[0] * d[8] - d[2] * d[6]) / det, out[5] = (d[2] * d[3] - d[0] * d[5]) / det;
    out[6] = c / det, out[7] = (d[1] * d[6] - d[0] * d[7]) / det, out[8] = (d[0] * d[4] - d[1] * d[3]) / det;
    return 1;
}

/* Whether slip along d is a root, after some Newton steps: friction F r_n d, slip -s d with s >= 0. */
static int slipping(const double *W, const double *v, double F, double *d, double *r)
{
    for (int step = 0; step < 20; step++) {
        const double p0 = -d[1], p1 = d[0];
        const double n = W[0] + F * (W[1] * d[0] + W[2] * d[1]);
        const double t0 = W[1] + F * (W[4] * d[0] + W[5] * d[1]), t1 = W[2] + F * (W[5] * d[0] + W[8] * d[1]);
        const double vp = v[1] * p0 + v[2] * p1, vd = v[1] * d[0] + v[2] * d[1];
        const double g = n * vp - v[0] * (t0 * p0 + t1 * p1);
        const double pWp = W[4] * p0 * p0 + 2.0 * W[5] * p0 * p1 + W[8] * p1 * p1;
        const double slope = F * (W[1] * p0 + W[2] * p1) * vp - n * vd
                             - v[0] * (F * pWp - (t0 * d[0] + t1 * d[1]));
        double turn = -g / slope;
        if (!(fabs(turn) < 1e6))
            return 0;
        if (fabs(turn) < 1e-12 || step == 19) {
            if (!(n > 0.0) || fabs(turn) > 1e-6)
                return 0;
            const double normal = -v[0] / n;
            if (vd + normal * (t0 * d[0] + t1 * d[1]) > 0.0) /* slip along the friction */
                return 0;
            r[0] = normal, r[1] = F * normal * d[0], r[2] = F * normal * d[1];
            return 1;
        }
        if (fabs(turn) > 0.5)
            turn = turn > 0.0 ? 0.5 : -0.5;
        const double e0 = d[0] + turn * p0, e1 = d[1] + turn * p1, size = sqrt(e0 * e0 + e1 * e1);
        d[0] = e0 / size, d[1] = e1 / size;
    }
    return 0;
}

/* The forces r of one contact with the free velocity v; unchanged if none is found. */
static void one_contact(const struct system *s, long i, const double *v, double *r)
{
    const double *W = s->own[i], *V = s->inverse[i], F = s->F[i], weight = s->proximal[i];
    if (v[0] >= 0.0) {
        r[0] = r[1] = r[2] = 0.0;
        return;
    }
    if (F == 0.0) {
        r[0] = -v[0] / W[0], r[1] = r[2] = 0.0;
        return;
    }
    const double y[3] = {weight * r[0] - v[0], weight * r[1] - v[1], weight * r[2] - v[2]};
    const double x[3] = {V[0] * y[0] + V[1] * y[1] + V[2] * y[2], V[3] * y[0] + V[4] * y[1] + V[5] * y[2],
                         V[6] * y[0] + V[7] * y[1] + V[8] * y[2]};
    if (x[0] >= 0.0 && x[1] * x[1] + x[2] * x[2] <= F * F * x[0] * x[0]) {
        memcpy(r, x, sizeof x);
        return;
    }
    double d[2] = {r[1], r[2]}, size = sqrt(d[0] * d[0] + d[1] * d[1]);
    if (!(size > 0.0))
        d[0] = x[0] > 0.0 ? x[1] : -v[1], d[1] = x[0] > 0.0 ? x[2] : -v[2], size = sqrt(d[0] * d[0] + d[1] * d[1]);
    if (size > 0.0) {
        d[0] /= size, d[1] /= size;
        if (slipping(W, v, F, d, r))
            return;
    }
    for (int k = 0; k < ANGLES; k++) {
        d[0] = cos(2.0 * M_PI * k / ANGLES), d[1] = sin(2.0 * M_PI * k / ANGLES);
        if (slipping(W, v, F, d, r))
            return;
    }
}

static void free_velocity(const struct system *s, long i, const double *r, double *v)
{
    memcpy(v, s->q + 3 * i, 3 * sizeof *v);
    for (long k = s->first[i]; k < s->first[i + 1]; k++) {
        const double *B = s->block[k], *x = r + 3 * s->column[k];
        v[0] += B[0] * x[0] + B[1] * x[1] + B[2] * x[2];
        v[1] += B[3] * x[0] + B[4] * x[1] + B[5] * x[2];
        v[2] += B[6] * x[0] + B[7] * x[1] + B[8] * x[2];
    }
}

/* |r - P(r - (u + F |u_t| n))| / (1 + |q|), P the projection on the cones, and |r - P'(r - u)| / |r|, P' with the discs
   of r: the larger one. */
static double residual(const struct system *s, const double *r, double loads)
{
    double cone = 0.0, natural = 0.0, size = 0.0;
    for (long i = 0; i < s->m; i++) {
        double u[3];
        const double *x = r + 3 * i, F = s->F[i], *W = s->own[i];
        free_velocity(s, i, r, u);
        for (int k = 0; k < 3; k++)
            u[k] += W[3 * k] * x[0] + W[3 * k + 1] * x[1] + W[3 * k + 2] * x[2];
        const double y[3] = {x[0] - u[0] - F * sqrt(u[1] * u[1] + u[2] * u[2]), x[1] - u[1], x[2] - u[2]};
        const double t = sqrt(y[1] * y[1] + y[2] * y[2]), n = x[0] - u[0], bound = F * fmax(x[0], 0.0);
        double p[3] = {y[0], y[1], y[2]};
        if (t > F * y[0]) {
            const double normal = fmax(y[0] + F * t, 0.0) / (1.0 + F * F), along = t > 0.0 ? F * normal / t : 0.0;
            p[0] = normal, p[1] = along * y[1], p[2] = along * y[2];
        }
        const double shrink = t > bound ? bound / t : 1.0;
        const double z[3] = {fmax(n, 0.0), shrink * y[1], shrink * y[2]};
        for (int k = 0; k < 3; k++) {
            cone += (x[k] - p[k]) * (x[k] - p[k]);
            natural += (x[k] - z[k]) * (x[k] - z[k]);
            size += x[k] * x[k];
        }
    }
    const double first = sqrt(cone) / (1.0 + loads), second = natural > 0.0 ? sqrt(natural / size) : 0.0;
    return fmax(first, second);
}

static int prepare(struct system *s, long m, const int *indptr, const int *indices, const double *data, double scale)
{
    long *place = malloc(m * sizeof *place), count = 0;
    if (place == NULL)
        return 0;
    for (long j = 0; j < m; j++)
        place[j] = -1;
    for (long i = 0; i < m; i++) {
        const long start = count;
        double *own = s->own[i];
        memset(own, 0, sizeof s->own[i]);
        for (int a = 0; a < 3; a++)
            for (long k = indptr[3 * i + a]; k < indptr[3 * i + a + 1]; k++) {
                const long j = indices[k] / 3;
                const int b = indices[k] % 3;
                if (j == i) {
                    own[3 * a + b] += data[k] * scale;
                    continue;
                }
                if (place[j] < start) {
                    place[j] = count;
                    s->column[count] = j;
                    memset(s->block[count++], 0, sizeof s->block[0]);
                }
                s->block[place[j]][3 * a + b] += data[k] * scale;
            }
        s->first[i + 1] = count;
        if (!(own[0] > 0.0 && own[4] > 0.0 && own[8] > 0.0)) {
            free(place);
            return 0;
        }
        s->proximal[i] = 0.0;
        if (!inverted(own, s->inverse[i])) {
            double moved[9];
            memcpy(moved, own, sizeof moved);
            s->proximal[i] = 1e-3 * (own[0] + own[4] + own[8]);
            for (int k = 0; k < 9; k += 4)
                moved[k] += s->proximal[i];
            inverted(moved, s->inverse[i]);
        }
    }
    free(place);
    return 1;
}

/* Sweeps over all contacts, forwards and backwards in turn, until the residual is at most tolerance, or until the
   allowance is spent or will not do at the rate observed.

   The matrix has compressed rows with at most `blocks` blocks of 3 x 3; W is scale times it.  r (3 m) is start and
   answer.  A sweep costs `cost` of the allowance, of which a first part, `trial`, is spent in any case.  report: the
   last residual and the rate per sweep.  Returns the number of sweeps; -1 without memory, or if a diagonal entry is not
   positive. */
long gauss_seidel(long m, long blocks, const int *indptr, const int *indices, const double *data, double scale,
                  const double *q, const double *F, double tolerance, double cost, double trial, double allowance,
                  double *r, double *report)
{
    const long doubles = 9 * (blocks + 2 * m) + m, longs = m + 1 + blocks;
    double *memory = malloc(doubles * sizeof *memory);
    long *index = malloc(longs * sizeof *index), sweeps = 0;
    if (memory == NULL || index == NULL) {
        free(memory), free(index);
        return -1;
    }
    struct system s = {.m = m, .q = q, .F = F};
    s.block = (double(*)[9])memory, s.own = s.block + blocks, s.inverse = s.own + m;
    s.proximal = (double *)(s.inverse + m);
    s.first = index, s.column = index + m + 1, s.first[0] = 0;
    if (!prepare(&s, m, indptr, indices, data, scale)) {
        free(memory), free(index);
        return -1;
    }
    double loads = 0.0, size = 1e300, before = 1e300, rate = 1.0;
    for (long k = 0; k < 3 * m; k++)
        loads += q[k] * q[k];
    loads = sqrt(loads);
    long judged = 0, pause = 1;
    while (1) {
        double change = 0.0;
        for (long k = 0; k < m; k++) {
            const long i = sweeps % 2 ? m - 1 - k : k;
            double v[3], old[3], *x = r + 3 * i;
            memcpy(old, x, sizeof old);
            free_velocity(&s, i, r, v);
            one_contact(&s, i, v, x);
            for (int c = 0; c < 3; c++)
                change += (x[c] - old[c]) * (x[c] - old[c]);
        }
        sweeps++;
        if (!(change < 1e300))
            break;
        if (sweeps < judged + pause && sqrt(change) > tolerance)
            continue;
        size = residual(&s, r, loads);
        if (!(size > tolerance))
            break;
        rate = before < 1e300 ? pow(size / before, 1.0 / (sweeps - judged)) : 1.0;
        before = size, judged = sweeps;
        pause = pause < 16 ? 2 * pause : 16;
        const double left = rate < 1.0 ? log(tolerance / size) / log(rate) : 1e300;
        if (sweeps * cost > trial && (sweeps + left) * cost > allowance)
            break;
    }
    report[0] = size, report[1] = rate;
    free(memory), free(index);
    return sweeps;
}
