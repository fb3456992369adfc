"""FGMRES on displacements and contact forces together: systems with A = B K^-1 B^T that take no product by A.

With contact forces X z, and w = -B u/a - G^T alpha, the equations are

    K u + B^T X z = f,    P z + Y w = g,    G X z = e

and A of the equations of contact is what is left as u is eliminated.  Each iteration takes one product by K and one
application of an approximation of K^-1, factors in single precision or a few V-cycles: block elimination with it is the
preconditioner.  With factors it gains their digits, three to five, in each iteration, for all right-hand sides in one
pass through them.

By multigrid K has springs besides, which stand for the contact that P and Y describe: with A replaced by d at every
node, z = N (g + Y B u/a), N = (P + Y d X)^-1, and u is a V-cycle of K + B^T X N Y B/a.  What the body gives way around
a point is about d, and where many points move together its stiffness is small beside that of springs: so this needs to
know nothing of A (M. Benzi, G. H. Golub, J. Liesen: Numerical solution of saddle point problems, Acta Numerica 14,
2005, on augmented Lagrangians).  On the block of 41 616 unknowns it takes 20 to 25 iterations; without springs 26 with
all of A in N, and 45 to 52 with what path following has learnt of it.  Bodies that contact or soft springs hold need A.

A solve starts from the best combination of what is known: earlier solutions, and vectors whose image is computed.  Of
several right-hand sides those that depend on the others come last, when the others are solved.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Final

import numpy as np
from petsc4py import PETSc

from ...arrays import FloatArray
from ..reductions import Reductions
from .krylov import Constraints, NodalMap
from .stiffness import StiffnessSolver

_KEPT: Final = 100
_CYCLES: Final = 10
"""Iterations before a restart, and restarts, at most: beyond what systems take that are not singular, nearly."""

_SURE: Final = 10.0
_FALLING: Final = 0.9
"""Residual over the tolerance above which a solution is improved, and over that before up to which this goes on."""

_AGAIN: Final = 0.5  # an image that orthogonalisation leaves less of than this part is made orthogonal once more

_DEPENDENT: Final = 1e-6
"""Part of an image, or of a right-hand side, that others leave of it, up to which it depends on these."""

_REMEMBERED: Final = 30  # known vectors, at most


class Elimination:
    """K, B, and an approximation of K^-1 in two halves, between which contact forces follow from displacements;
    collective.  Displacements of unknowns are in metres, forces in newtons, this rank's part, shape (n,); those of
    contact points have shape (3 m,).  The halves take c of each, shapes (c, n) and (c, 3 m).

    Attributes:
        size: n.

    Args:
        solver: Has K.
        B: The rows of the contact points.
        begin: B u of the displacement u under forces f, nearly.
        end: That u, under these and the contact forces x, nearly.
        sprung: Whether both are those of K with springs, with those contact forces among f that are without u.
    """

    def __init__(
        self,
        solver: StiffnessSolver,
        B: PETSc.Mat,
        begin: Callable[[FloatArray], FloatArray],
        end: Callable[[FloatArray], FloatArray],
        sprung: bool = False,
    ):
        self._solver, self._B, self.begin, self.end, self.sprung = solver, B, begin, end, sprung
        self._u, self._x = B.createVecs()
        self._forces = self._u.duplicate()
        self.size: int = self._u.getLocalSize()

    def multiply(self, u: FloatArray, x: FloatArray) -> FloatArray:
        """K u + B^T x."""
        self._u.array[:], self._x.array[:] = u, x
        self._solver.multiply(self._u, self._forces)
        self._B.multTransposeAdd(self._x, self._forces, self._forces)
        return self._forces.array_r.copy()

    def forces(self, x: FloatArray) -> FloatArray:
        """B^T x."""
        self._x.array[:] = x
        self._B.multTranspose(self._x, self._forces)
        return self._forces.array_r.copy()

    def rows(self, u: FloatArray) -> FloatArray:
        """B u."""
        self._u.array[:] = u
        self._B.mult(self._u, self._x)
        return self._x.array_r.copy()


class CoupledKrylov:
    """The equations above, at one point.

    Args:
        body: K, B and the approximation of K^-1.
        a: The unit of A, metres per newton.
        constraints: G; its resultant is G X z.
        forces: z -> X z, shapes (m, 3).
        equations: (z, w) -> P z + Y w, shapes (m, 3).
        inverse: (r (m, 3, c), r3 (q, c)) -> z and alpha of [P + Y A X/a, -Y G^T; G X, 0], nearly; with springs N r.
        rows: Weights of the equations of the contact points, shape (m, 3),
        weight: and of those of displacements.
        together: Whether right-hand sides are solved for together, as far as they do not depend on each other.
        most: Iterations for a right-hand side, at most; by default as many as systems take that are not singular.

    Attributes:
        rows, weight: As the arguments.
        iterations: Of all solutions.
    """

    iterations = 0

    def __init__(
        self,
        body: Elimination,
        a: float,
        constraints: Constraints,
        forces: NodalMap,
        equations: Callable[[FloatArray, FloatArray], FloatArray],
        inverse: Callable[[FloatArray, FloatArray], tuple[FloatArray, FloatArray]],
        rows: FloatArray,
        weight: float,
        together: bool = True,
        most: int | None = None,
    ):
        self._restarts, self._kept = (_CYCLES, _KEPT) if most is None else (1, most)
        self._body, self._a, self._constraints, self._forces = body, a, constraints, forces
        self._equations, self._inverse, self.rows, self.weight = equations, inverse, rows, weight
        self._over, self._together = Reductions(constraints.comm), together
        self._n, self._m = body.size, len(rows)
        self._known = _Known(self._over)

    def know(self, u: FloatArray, z: FloatArray, alpha: FloatArray) -> None:
        """Start from what these vectors (n,), (m, 3), (q,) are the solution of, too; collective."""
        (vector,) = self._joined(u[None], z[None], alpha[None])
        self._known.add(vector, self._image(vector))

    def solve(
        self, f: FloatArray, g: FloatArray, e: FloatArray, atol: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """u (c, n) in metres, z (c, m, 3), alpha (c, q), and the norms of the weighted residuals (c,), computed afresh,
        of which it goes on to improve those above `_SURE` times atol; collective.

        Args:
            f, g, e: c right-hand sides, shapes (c, n), (c, m, 3), (c, q).
            atol: Tolerances of the weighted residuals, shape (c,).
        """
        right = self._joined(self.weight * f, self.rows * g, e)
        solution, left = np.zeros_like(right), right.copy()
        sizes: FloatArray = np.zeros(len(right))
        for some in self._batches(right):
            for number in some:
                solution[number] = self._known.nearest(right[number])
                left[number] -= self._image(solution[number])
            self._improve(some, right, solution, left, sizes, atol)
            for number in some:
                self._known.add(solution[number], right[number] - left[number])
        return *self._parts(solution), sizes

    def _batches(self, right: FloatArray) -> Iterator[Sequence[int]]:
        """Numbers of right-hand sides: one after the other, or first those that do not depend on others and on what is
        known."""
        if not self._together:
            yield from ([number] for number in range(len(right)))
            return
        new, others, apart = list[int](), list[int](), list[FloatArray]()
        for number, one in enumerate(right):
            rest = self._known.without(one)
            for other in apart:
                rest -= self._over.dot(other, rest) * other
            size = self._over.norm(rest)
            if size > _DEPENDENT * self._over.norm(one):
                new.append(number)
                apart.append(rest / size)
            else:
                others.append(number)
        yield from (some for some in (new, others) if some)

    def _improve(
        self,
        some: Sequence[int],
        right: FloatArray,
        solution: FloatArray,
        left: FloatArray,
        sizes: FloatArray,
        atol: FloatArray,
    ) -> None:
        """Solutions of some of the right-hand sides, with what they leave over, and its norms, from a start."""
        sizes[some] = [self._over.norm(left[number]) for number in some]
        before: FloatArray = np.full(len(right), np.inf)
        going = np.isin(np.arange(len(right)), some) & (sizes > atol)
        for _ in range(self._restarts):
            wrong = np.flatnonzero(going)
            if not len(wrong):
                break
            spaces = [_Space(self._over, left[number], self._kept) for number in wrong]
            for _ in range(self._kept):
                moving = [one for one, number in zip(spaces, wrong, strict=True) if one.left > atol[number]]
                if not moving:
                    break
                self.iterations += len(moving)
                for one, z in zip(moving, self._preconditioned(np.array([one.latest for one in moving])), strict=True):
                    one.add(z, self._image(z))
            for number, one in zip(wrong, spaces, strict=True):  # of large parts that cancel rounding errors are left
                solution[number] += one.solution
                left[number] = right[number] - self._image(solution[number])
                sizes[number] = self._over.norm(left[number])
            going &= (sizes > _SURE * atol) & (sizes < _FALLING * before)
            before = sizes.copy()

    def _parts(self, v: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """u, z and alpha of vectors (c, ...), alpha the same on every rank; collective if there are any."""
        ends, comm = (self._n, self._n + 3 * self._m), self._constraints.comm
        shared: FloatArray = np.empty((len(v), self._constraints.count))
        if shared.size:
            if comm.rank == 0:
                shared[:] = v[:, ends[1] :]
            comm.Bcast(shared)
        return v[:, : ends[0]], v[:, slice(*ends)].reshape(len(v), self._m, 3), shared

    def _joined(self, u: FloatArray, z: FloatArray, alpha: FloatArray) -> FloatArray:
        """The vectors of these, with alpha on the first rank."""
        first = self._constraints.comm.rank == 0
        return np.concatenate([u, z.reshape(len(u), -1), alpha[:, : None if first else 0]], axis=1)

    def _image(self, v: FloatArray) -> FloatArray:
        """The left-hand side of a vector."""
        (u,), (z,), (alpha,) = self._parts(v[None])
        w = self._constraints.without(-self._body.rows(u).reshape(-1, 3) / self._a, alpha)
        forces = self.weight * self._body.multiply(u, self._forces(z).ravel())
        contact, resultant = self.rows * self._equations(z, w), self._constraints.resultant(z)
        return self._joined(forces[None], contact[None], resultant[None])[0]

    def _preconditioned(self, v: FloatArray) -> FloatArray:
        """Of right-hand sides (c, ...)."""
        f, g, e = self._parts(v)
        f = f / self.weight
        if self._body.sprung:
            z, _ = self._inverse(np.moveaxis(g / self.rows, 0, -1), e.T)
            f -= [self._body.forces(self._forces(one).ravel()) for one in np.moveaxis(z, -1, 0)]
        w = -self._body.begin(f).reshape(g.shape) / self._a
        left = [of / self.rows - self._equations(np.zeros_like(of), at) for of, at in zip(g, w, strict=True)]
        z, alpha = self._inverse(np.stack(left, axis=-1), e.T)
        z = z.transpose(2, 0, 1)
        u = self._body.end(np.array([self._forces(one).ravel() for one in z]))
        return self._joined(u, z, alpha.T)


class _Known:
    """Vectors with their images, which are orthonormal; collective."""

    def __init__(self, over: Reductions):
        self._over, self._vectors, self._images = over, list[FloatArray](), list[FloatArray]()

    def nearest(self, right: FloatArray) -> FloatArray:
        """The combination whose image is nearest to a right-hand side."""
        vector = np.zeros_like(right)
        for part, known in zip(self._parts(right), self._vectors, strict=True):
            vector += part * known
        return vector

    def without(self, right: FloatArray) -> FloatArray:
        """A right-hand side less that image."""
        rest = right.copy()
        for part, image in zip(self._parts(right), self._images, strict=True):
            rest -= part * image
        return rest

    def add(self, vector: FloatArray, image: FloatArray) -> None:
        """In place of the first one, where there are many; if its image does not depend on the others."""
        size = self._over.norm(image)
        for _ in range(2):
            vector, image = vector - self.nearest(image), self.without(image)
        left = self._over.norm(image)
        if left > _DEPENDENT * size:
            self._vectors = [*self._vectors, vector / left][-_REMEMBERED:]
            self._images = [*self._images, image / left][-_REMEMBERED:]

    def _parts(self, right: FloatArray) -> FloatArray:
        """Of the images in it."""
        return self._over.total(np.array([float(image @ right) for image in self._images]))


class _Space:
    """The directions z of FGMRES for one right-hand side, whose images are combinations of orthonormal v; collective.

    Attributes:
        left: Norm of the residual of the best combination.
    """

    def __init__(self, over: Reductions, right: FloatArray, kept: int):
        self._over, self._size, self._count = over, over.norm(right), 0
        self._v, self._z = (
            np.empty((kept + more, len(right))) for more in (1, 0)
        )  # memory is taken as rows are filled
        self._v[0], self._parts = right / self._size, np.zeros((kept + 1, kept))
        self.left = self._size

    @property
    def latest(self) -> FloatArray:
        """The v that has no direction yet."""
        return self._v[self._count]

    def add(self, z: FloatArray, image: FloatArray) -> None:
        """The direction of the latest v, with its image."""
        k, over = self._count, self._over
        v, parts = self._v[: k + 1], self._parts[:, k]
        image -= v[k]  # nearly all of it, as z is nearly the solution: less is left to cancel
        parts[k] = 1.0
        square = over.dot(image, image)
        while True:
            seen, before = over.total(v @ image), square
            image -= seen @ v
            parts[: k + 1] += seen
            square = over.dot(image, image)
            if not 0.0 < square < _AGAIN**2 * before:
                break
        size = math.sqrt(square)
        self._z[k], parts[k + 1] = z, size
        self._v[k + 1] = image / size if size > 0.0 else 0.0
        self._count = k + 1
        Q = np.linalg.qr(self._parts[: k + 2, : k + 1])[0]
        self.left = self._size * float(np.linalg.norm(np.eye(k + 2, 1)[:, 0] - Q @ Q[0]))

    @property
    def solution(self) -> FloatArray:
        """The best combination of the directions."""
        k = self._count
        if not math.isfinite(self.left):
            return np.zeros_like(self._v[0])
        start = np.append(self._size, np.zeros(k))
        return np.linalg.lstsq(self._parts[: k + 1, :k], start, rcond=None)[0] @ self._z[:k]
