/* Internal nodal forces of linear hexahedra with an isotropic material, by 2 x 2 x 2 Gauss points.

Along each direction of the reference cell there are two nodes and two points, so that derivatives at the points are
three passes over the nodes; CELLS cells at once, side by side in vectors.  Node x + 2 y + 4 z of a cell is at the
corner (x, y, z) of the reference cell. */

#define CELLS 8
#define NEAR 0.21132486540518711775 /* (1 - 1/sqrt(3)) / 2 */
#define EACH for (int c = 0; c < CELLS; c++)

typedef double lanes[CELLS];

/* From the values at both ends of an edge to those at its points. */
static inline void at_points(const lanes first, const lanes second, lanes p, lanes q)
{
#pragma omp simd
    EACH
    {
        const double step = NEAR * (second[c] - first[c]);
        p[c] = first[c] + step;
        q[c] = second[c] - step;
    }
}

/* Derivatives of a field v, at the nodes, along the directions: they do not depend on the place along their own
direction; at the points (0, 0), (1, 0), (0, 1), (1, 1) of the other two, the earlier direction first. */
static inline void derivatives(lanes v[8], lanes d[3][4])
{
    for (int j = 0; j < 3; j++) {
        const int step = 1 << j, low = j == 0 ? 2 : 1, high = j == 2 ? 2 : 4;
        lanes edge[4], half[4];
        for (int k = 0; k < 4; k++) {
            const int node = (k & 1) * low + (k >> 1) * high;
#pragma omp simd
            EACH edge[k][c] = v[node + step][c] - v[node][c];
        }
        at_points(edge[0], edge[1], half[0], half[1]);
        at_points(edge[2], edge[3], half[2], half[3]);
        at_points(half[0], half[2], d[j][0], d[j][2]);
        at_points(half[1], half[3], d[j][1], d[j][3]);
    }
}

/* Its transpose: what acts on the derivatives, as forces at the nodes, added to f. */
static inline void from_derivatives(lanes d[3][4], lanes f[8])
{
    for (int j = 0; j < 3; j++) {
        const int step = 1 << j, low = j == 0 ? 2 : 1, high = j == 2 ? 2 : 4;
        lanes edge[4], half[4];
        at_points(d[j][0], d[j][2], half[0], half[2]); /* the weights are symmetric in nodes and points */
        at_points(d[j][1], d[j][3], half[1], half[3]);
        at_points(half[0], half[1], edge[0], edge[1]);
        at_points(half[2], half[3], edge[2], edge[3]);
        for (int k = 0; k < 4; k++) {
            const int node = (k & 1) * low + (k >> 1) * high;
#pragma omp simd
            EACH
            {
                f[node + step][c] += edge[k][c];
                f[node][c] -= edge[k][c];
            }
        }
    }
}

/* The nodal forces of the displacement u, added to f: three per node.

Of every cell: its nodes in u and f, a row of `nodes`; its corners, a row of `points` with coordinates in x; mu and
lambda. */
void hexahedral_forces(long cells, const int *nodes, const int *points, const double *x, const double *mu,
                       const double *lambda, const double *u, double *f)
{
    for (long first = 0; first < cells; first += CELLS) {
        const int here = cells - first < CELLS ? (int)(cells - first) : CELLS;
        lanes X[3][8], U[3][8], F[3][8], dX[3][3][4], dU[3][3][4], H[3][3][4], twice, lame;
        for (int c = 0; c < CELLS; c++) { /* behind the last cell it is repeated, and not added below */
            const long cell = first + (c < here ? c : here - 1);
            twice[c] = 2.0 * mu[cell];
            lame[c] = lambda[cell];
            for (int k = 0; k < 8; k++)
                for (int i = 0; i < 3; i++) {
                    X[i][k][c] = x[3 * (long)points[8 * cell + k] + i];
                    U[i][k][c] = u[3 * (long)nodes[8 * cell + k] + i];
                }
        }
        for (int i = 0; i < 3; i++) {
            derivatives(X[i], dX[i]);
            derivatives(U[i], dU[i]);
            for (int j = 0; j < 3; j++)
                for (int k = 0; k < 4; k++)
                    EACH H[i][j][k][c] = 0.0;
            for (int k = 0; k < 8; k++)
                EACH F[i][k][c] = 0.0;
        }
        for (int point = 0; point < 8; point++) {
            const int px = point & 1, py = point >> 1 & 1, pz = point >> 2;
            const int at[3] = {py + 2 * pz, px + 2 * pz, px + 2 * py};
#pragma omp simd
            EACH
            {
                double C[3][3], G[3][3], S[3][3]; /* cofactors of the Jacobian; gradient, stress */
                for (int i = 0; i < 3; i++)
                    for (int j = 0; j < 3; j++) {
                        const int a = (i + 1) % 3, b = (i + 2) % 3, k = (j + 1) % 3, l = (j + 2) % 3;
                        C[i][j] = dX[a][k][at[k]][c] * dX[b][l][at[l]][c] - dX[a][l][at[l]][c] * dX[b][k][at[k]][c];
                    }
                const double det = dX[0][0][at[0]][c] * C[0][0] + dX[0][1][at[1]][c] * C[0][1] +
                                   dX[0][2][at[2]][c] * C[0][2];
                const double inverse = 1.0 / det, weight = det < 0.0 ? -0.125 : 0.125; /* cells may be mirrored */
                for (int i = 0; i < 3; i++)
                    for (int j = 0; j < 3; j++)
                        G[i][j] = (dU[i][0][at[0]][c] * C[j][0] + dU[i][1][at[1]][c] * C[j][1] +
                                   dU[i][2][at[2]][c] * C[j][2]) * inverse;
                const double volume = lame[c] * (G[0][0] + G[1][1] + G[2][2]);
                for (int i = 0; i < 3; i++)
                    for (int j = 0; j < 3; j++)
                        S[i][j] = weight * (0.5 * twice[c] * (G[i][j] + G[j][i]) + (i == j ? volume : 0.0));
                for (int i = 0; i < 3; i++)
                    for (int j = 0; j < 3; j++)
                        H[i][j][at[j]][c] += S[i][0] * C[0][j] + S[i][1] * C[1][j] + S[i][2] * C[2][j];
            }
        }
        for (int i = 0; i < 3; i++)
            from_derivatives(H[i], F[i]);
        for (int c = 0; c < here; c++)
            for (int k = 0; k < 8; k++)
                for (int i = 0; i < 3; i++)
                    f[3 * (long)nodes[8 * (first + c) + k] + i] += F[i][k][c];
    }
}
