"""Stability of an equilibrium of large motions: the inertia of its tangent with the nodes in contact held.

An answer is a minimum of the energy where v^T K_t v > 0 for all motions v that contact allows.  Negative pivots of a
factorisation L D L^T are as many as the directions in which it is not (Sylvester's law of inertia).  With a stiff
spring at each contact row the directions that contact prevents do not count (Finsler's lemma).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy.linalg
from petsc4py import PETSc

from ..arrays import BoolArray, FloatArray
from ..fem.bodies import Deformable
from ..linalg.compliance import DirectSolver
from ..linalg.petsc_arrays import CHOLESKY
from ..linalg.reductions import Reductions

_STIFF: Final = 1e4
"""Stiffness of the springs at contact rows over the diagonal of K at their nodes."""

_PRESSING: Final = 1e-9
"""Normal force over the largest from which a contact point is held."""

_SIZE: Final = 600_000
"""Unknowns up to which a tangent is factorised for its inertia alone: tens of seconds, and a few GB."""

_INERTIA: Final = {"mat_mumps_icntl_13": 1, "mat_mumps_icntl_24": 1}
"""Of MUMPS: pivots of the root are counted on all ranks, and null pivots are found."""

_ROUNDING: Final = 1e-13
"""Energy of a rigid motion, over that of each of its displacements alone, up to which it is a rounding error."""

_UNBALANCED: Final = 1e-7
"""Part of the forces of the stress that may be out of balance."""

_ROUNDS: Final = 12
"""Inverse iterations for the mode."""


@dataclass(frozen=True, eq=False)
class Stability:
    """In how many directions an equilibrium is unstable.

    Attributes:
        unstable: With contact points that press held along n, and along t1 and t2 where they have friction: more than
            any coefficient above 0 does.
        by_friction: With normals held alone, if the first is 0: stable as long as friction holds.
        mode: The direction of the lowest energy if it is unstable, largest displacement 1, shape (k, 3); else 0.
    """

    unstable: int
    by_friction: int
    mode: FloatArray


def stability(body: Deformable, B: PETSc.Mat, x: FloatArray, frictional: BoolArray) -> Stability | None:
    """Of a linearised body with contact rows B (3 m rows, by the unknowns of K) and contact forces x (3 m,) in newtons,
    at points that have friction or not (m,); None above `_SIZE` unknowns; collective."""
    none, over = np.zeros_like(body.x), Reductions(body.comm)
    if over.sum(3.0 * len(body.reduction.points)) > _SIZE:
        return None
    pressing = x[0::3] > _PRESSING * max(over.max(x[0::3]), 0.0)
    smooth, mode = _negative(body, _held(body.K, B, pressing, np.zeros_like(pressing)))
    if smooth == 0:
        return Stability(0, 0, none)
    if over.all(not np.any(pressing & frictional)):
        return Stability(smooth, 0, mode)
    count, mode = _negative(body, _held(body.K, B, pressing, frictional))
    return Stability(0, smooth, none) if count == 0 else Stability(count, 0, mode)


def without_stiffness(body: Deformable, R: FloatArray, stress: FloatArray) -> FloatArray:
    """The combinations (q, p) of rigid motions, unknowns (k + p, 3, q), that a tangent does not resist, beyond rounding
    errors and what forces of the stress (k, 3), in newtons, may be out of balance; collective."""
    K, over = body.K, Reductions(body.comm)
    diagonal, (motion, force) = K.getDiagonal(), K.createVecs()
    forces, moved = np.empty_like(R), body.reduction.displacement(R)
    for number in range(R.shape[2]):
        motion.array[:] = R[:, :, number].ravel()
        K.mult(motion, force)
        forces[:, :, number] = force.array_r.reshape(-1, 3) - body.anchoring * R[:, :, number]
    stiff = diagonal.array_r.reshape(-1, 3)
    per_length = np.linalg.norm(stress, axis=1) / float(np.max(over.extent(body.x)))
    energy, rounding, unbalanced = over.totals(
        np.einsum("kcp,kcq->pq", R, forces),
        np.einsum("kc,kcp,kcq->pq", stiff, R, R),
        np.einsum("k,kcp,kcq->pq", per_length, moved, moved),
    )
    for vector in (diagonal, motion, force):
        vector.destroy()
    limit = _ROUNDING * (rounding + _ROUNDING * np.trace(rounding) * np.eye(len(rounding))) + _UNBALANCED * unbalanced
    sizes, ways = scipy.linalg.eigh(energy + energy.T, 2.0 * limit)
    return ways[:, np.abs(sizes) <= 1.0]


def _held(K: PETSc.Mat, B: PETSc.Mat, pressing: BoolArray, tangents: BoolArray) -> PETSc.Mat:
    """K with a spring at each row of B that presses: at those along normals, and along the tangents of points that have
    them held (m,); collective."""
    starts, columns, values = B.getValuesCSR()
    squares = PETSc.Mat().createAIJ(B.getSizes(), csr=(starts, columns, values**2), comm=B.comm)
    diagonal, rows, scale = K.getDiagonal(), B.copy(), B.createVecLeft()
    squares.mult(diagonal, scale)  # of each row's own nodes: soft and stiff bodies may stand beside each other
    held_rows = (pressing[:, None] & np.stack([np.ones_like(tangents), tangents, tangents], axis=1)).ravel()
    scale.array[:] = np.sqrt(_STIFF * np.abs(scale.array_r)) * held_rows
    for one in (squares, diagonal):
        one.destroy()
    rows.diagonalScale(scale)
    springs = rows.transposeMatMult(rows)
    held = K.copy() if K.getType().endswith("aij") and "b" not in K.getType() else K.convert("aij", PETSc.Mat())
    held.axpy(1.0, springs, PETSc.Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    for one in (rows, scale, springs):
        one.destroy()
    held.setOption(PETSc.Mat.Option.SPD, False)
    held.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    return held


def _negative(body: Deformable, K: PETSc.Mat) -> tuple[int, FloatArray]:
    """The number of negative pivots of K, which is destroyed, and the mode of its lowest eigenvalue if there are any;
    collective."""
    solver = DirectSolver(K, {**CHOLESKY, **_INERTIA})
    count, mode = int(solver.factor.getInertia()[0]), np.zeros_like(body.x)
    if count:
        over, rng = Reductions(body.comm), np.random.default_rng(body.comm.rank)
        rhs, u = K.createVecs()
        block: FloatArray = rng.standard_normal((count + 2, rhs.getLocalSize()))
        for _ in range(_ROUNDS):
            images = np.empty_like(block)
            for row, image in zip(block, images, strict=True):
                rhs.array[:] = row
                solver.solve(rhs, u)
                image[:] = u.array_r
            block = _orthonormal(images, over)
        products = np.empty_like(block)
        for row, product in zip(block, products, strict=True):
            rhs.array[:] = row
            K.mult(rhs, u)
            product[:] = u.array_r
        _, ways = np.linalg.eigh(over.total((block @ products.T).ravel()).reshape(len(block), -1))
        mode = body.reduction.displacement((ways[:, 0] @ block).reshape(-1, 3))
        mode = mode / over.max(np.linalg.norm(mode, axis=1))
        for vector in (rhs, u):
            vector.destroy()
    solver.destroy()
    K.destroy()
    return count, mode


def _orthonormal(rows: FloatArray, over: Reductions) -> FloatArray:
    """Rows that span the same space, by the eigenvectors of their products; collective."""
    rows = rows / np.sqrt(over.total(np.einsum("ki,ki->k", rows, rows)))[:, None]
    sizes, ways = np.linalg.eigh(over.total((rows @ rows.T).ravel()).reshape(len(rows), -1))
    keep = sizes > 1e-12 * sizes[-1]
    return (ways[:, keep] / np.sqrt(sizes[keep])).T @ rows
