"""A cube of 20-node hexahedra on another that is twice as wide, beside a computation by NumPy and SciPy alone:
27-node hexahedra, and a stiff penalty at points of the slave face."""

import itertools

import numpy as np
import pytest
import scipy.sparse as sparse
from scipy.sparse.linalg import spsolve

from coulomb.case.case import read_case

E, NU, PRESSURE = 210000.0, 0.3, 100.0
PENALTY, PARTS = 1e9, 6  # N/mm^3, of which a millionth of a cell yields; pieces of an edge of the slave face
SIGNS = np.array([(-1, -1, -1), (1, -1, -1), (1, 1, -1), (-1, 1, -1), (-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1)])
EDGES = [(0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)]
PLACES = np.vstack([SIGNS, [(SIGNS[a] + SIGNS[b]) / 2 for a, b in EDGES]])  # of CalculiX' C3D20
GRID = np.array(list(itertools.product((-1, 0, 1), repeat=3)))
BOXES = [((0.0, 0.0, 0.0), 1.0), ((0.25, 0.25, 1.0), 0.5)]  # corner and edge


def functions(at):
    """Values (q, 27) and derivatives (q, 27, 3) of the Lagrange functions of `GRID` at places (q, 3)."""
    value = np.stack([at * (at - 1) / 2, 1 - at**2, at * (at + 1) / 2], axis=1)
    slope = np.stack([at - 0.5, -2 * at, at + 0.5], axis=1)
    of = [np.where(np.arange(3) == k, slope, value) for k in range(3)]
    N, *grads = (np.einsum("qi,qj,qk->qijk", *np.moveaxis(one, 2, 0)).reshape(len(at), 27) for one in (value, *of))
    return N, np.stack(grads, axis=2)


def stiffness(edge):
    points, weights = np.polynomial.legendre.leggauss(3)
    at, weight = (np.array(list(itertools.product(of, repeat=3))) for of in (points, weights))
    grad = functions(at)[1] * 2.0 / edge
    lame, mu = E * NU / ((1 + NU) * (1 - 2 * NU)), E / (2 * (1 + NU))
    w = weight.prod(axis=1) * (edge / 2.0) ** 3
    K = lame * np.einsum("q,qai,qbj->aibj", w, grad, grad) + mu * np.einsum("q,qaj,qbi->aibj", w, grad, grad)
    K += mu * np.einsum("q,qak,qbk,ij->aibj", w, grad, grad, np.eye(3))
    return K.reshape(81, 81)


def by_penalty():
    """Displacements of both cubes at the nodes of `GRID`, shape (2, 27, 3)."""
    K = sparse.block_diag([stiffness(edge) for _, edge in BOXES]).tocsr()
    points, weights = np.polynomial.legendre.leggauss(2)
    line = np.concatenate([-1 + (2 * k + 1 + points) / PARTS for k in range(PARTS)])
    xy = np.array(list(itertools.product(line, repeat=2)))
    w = np.full(len(xy), (0.5 / (2 * PARTS)) ** 2)  # both weights of two points are 1
    assert np.allclose(weights, 1.0)
    low, up = (functions(np.column_stack([at, np.full(len(xy), z)]))[0] for at, z in ((xy / 2, 1.0), (xy, -1.0)))
    gap = np.zeros((len(xy), 162))
    gap[:, 2:81:3], gap[:, 83::3] = -low, up
    f = np.zeros(162)
    top = functions(np.column_stack([xy, np.ones(len(xy))]))[0]
    f[83::3] = -PRESSURE * w @ top
    fixed = [3 * k + c for k in np.flatnonzero(GRID[:, 2] == -1) for c in range(3)]
    fixed += [81 + 3 * k + c for k in np.flatnonzero(GRID[:, 2] == 1) for c in range(2)]
    free, active = np.setdiff1d(np.arange(162), fixed), np.ones(len(xy), dtype=bool)
    for _ in range(30):
        A = K + sparse.csr_matrix(gap[active].T @ (PENALTY * w[active, None] * gap[active]))
        u = np.zeros(162)
        u[free] = spsolve(A[free][:, free].tocsc(), f[free])
        before, active = active, gap @ u < 0.0
        if np.array_equal(before, active):
            return u.reshape(2, 27, 3)
    raise AssertionError("the active points do not settle")


def deck():
    x = [np.array(o) + edge * (PLACES + 1) / 2 for o, edge in BOXES]
    lines = ["*NODE", *(f"{k}, {a!r}, {b!r}, {c!r}" for k, (a, b, c) in enumerate(np.vstack(x).tolist(), 1))]
    lines.append("*ELEMENT, TYPE=C3D20, ELSET=all")
    order = [*range(1, 17), *range(17, 21)]
    for cell in (0, 1):
        row = [cell + 1, *(20 * cell + k for k in order)]
        lines += [", ".join(map(str, row[:11])) + ",", ", ".join(map(str, row[11:]))]
    sets = {"base": np.flatnonzero(PLACES[:, 2] == -1) + 1, "top": np.flatnonzero(PLACES[:, 2] == 1) + 21}
    for name, nodes in sets.items():
        lines += [f"*NSET, NSET={name}", *(f"{k}," for k in nodes)]
    lines += [
        "*SURFACE, NAME=s",
        "2, S1",
        "*SURFACE, NAME=m",
        "1, S2",
        "*MATERIAL, NAME=steel",
        "*ELASTIC",
        f"{E}, {NU}",
    ]
    lines += ["*SOLID SECTION, ELSET=all, MATERIAL=steel", "*BOUNDARY", "base, 1, 3", "top, 1, 2"]
    lines += ["*SURFACE INTERACTION, NAME=i", "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=HARD"]
    lines += ["*CONTACT PAIR, INTERACTION=i, TYPE=SURFACE TO SURFACE", "s, m"]
    return "\n".join([*lines, "*STEP", "*STATIC", "*DLOAD", f"2, P2, {PRESSURE}", "*END STEP", ""])


def test_cubes_of_20_node_hexahedra_are_those_of_27_nodes(tmp_path):
    (tmp_path / "deck.inp").write_text(deck())
    answer = read_case(tmp_path / "deck.inp").problem().solve()
    assert answer.valid and answer.forces["normal_force"] == pytest.approx(0.25 * PRESSURE, rel=1e-6)
    u, x = by_penalty(), answer.problem.elasticity.x
    for (o, edge), own in zip(BOXES, u, strict=True):
        near = np.linalg.norm(x[:, None] - (np.array(o) + edge * (GRID + 1) / 2), axis=2) < 1e-9
        assert np.all(near.any(axis=0))
        apart = np.linalg.norm(answer.displacement[:, None] - own, axis=2)
        apart = np.where(near, apart, np.inf).min(axis=0)  # at the middle of the contact both cubes have a node
        assert np.max(apart) < 1e-3 * np.abs(u).max()
