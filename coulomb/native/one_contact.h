/* Coulomb's law at one contact (n, t1, t2) with a given free velocity, solved directly: open, stick, or slip along the
   direction at which slip and friction oppose each other, the root of a trigonometric polynomial. */

#include <math.h>
#include <string.h>

#define ANGLES 32 /* at which a root is searched where Newton's method finds none */

struct contact {
    double own[9];     /* its block of the compliance, rows */
    double inverse[9]; /* of own + proximal 1 */
    double proximal;   /* 0 where own is regular */
    double F;
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

/* The forces r of one contact with the free velocity v; unchanged if none is found.  Returns the number
   of angles at which a direction of slip was searched, 0 for most. */
static int one_contact(const struct contact *s, const double *v, double *r)
{
    const double *W = s->own, *V = s->inverse, F = s->F, weight = s->proximal;
    if (v[0] >= 0.0) {
        r[0] = r[1] = r[2] = 0.0;
        return 0;
    }
    if (F == 0.0) {
        r[0] = -v[0] / W[0], r[1] = r[2] = 0.0;
        return 0;
    }
    const double y[3] = {weight * r[0] - v[0], weight * r[1] - v[1], weight * r[2] - v[2]};
    const double x[3] = {V[0] * y[0] + V[1] * y[1] + V[2] * y[2], V[3] * y[0] + V[4] * y[1] + V[5] * y[2],
                         V[6] * y[0] + V[7] * y[1] + V[8] * y[2]};
    if (x[0] >= 0.0 && x[1] * x[1] + x[2] * x[2] <= F * F * x[0] * x[0]) {
        memcpy(r, x, sizeof x);
        return 0;
    }
    double d[2] = {r[1], r[2]}, size = sqrt(d[0] * d[0] + d[1] * d[1]);
    if (!(size > 0.0))
        d[0] = x[0] > 0.0 ? x[1] : -v[1], d[1] = x[0] > 0.0 ? x[2] : -v[2], size = sqrt(d[0] * d[0] + d[1] * d[1]);
    if (size > 0.0) {
        d[0] /= size, d[1] /= size;
        if (slipping(W, v, F, d, r))
            return 0;
    }
    for (int k = 0; k < ANGLES; k++) {
        d[0] = cos(2.0 * M_PI * k / ANGLES), d[1] = sin(2.0 * M_PI * k / ANGLES);
        if (slipping(W, v, F, d, r))
            return k + 1;
    }
    return ANGLES;
}
