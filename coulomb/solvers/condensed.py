"""Condensed Newton systems: one sparse system on the displacements per step, K with springs at the contact nodes.

Derivation.  A step of path following solves (A + C) dx = r with A = B K^-1 B^T and C nodal.  In place of A x the path
keeps a displacement y near K^-1 B^T x, by which A x is B y, and its residual R = B^T x - K y.  With w the change of y
the step is

    B w + C dx = r,   K w - B^T dx = R        hence        (K + B^T C^-1 B) w = B^T C^-1 r + R,   dx = C^-1 (r - B w)

The contact rows hold exactly even if the system is solved inexactly: its residual e, with the curvature of the curve on
which x moves, becomes R at the end of the step, and the next step removes it.  (Making A x exact after every step would
turn e into the gradient error B K^-1 e, which stiff springs amplify to large forces.)  So |e| need only decrease with
theta: to a fraction of |R|, and to a fraction of the right-hand side.

The matrix has the nonzeros of K, since C couples only the three unknowns of a node: C^-1 is the stiffness of a spring,
soft where a node opens, stiff where it sticks, between the two where it slips.  C is bounded from below by a small
fraction of 1/K_ii, so that springs stay finite; this changes the step, not the solution.

- Without slope C = J11 - A + J12 D22^-1 J21 is symmetric.  CG.
- With slope dx_n acts on the row of dx_t, so C and C^-1 are block-triangular.  FGMRES on the whole of it, the
  preconditioner made with C_d, which is C without that entry: (K + B^T C^-1 B) preconditioned is then nearly the
  identity plus the linearised fixed-point map g -> r(x_n), whose size is the contraction of successive Tresca.

Preconditioner: PETSc's GAMG on K + B^T C_d^-1 B, made anew every step, with the rigid body modes; two symmetric sweeps
of Gauss-Seidel on the finest level, which PETSc does by 3 x 3 blocks where the rows of a node have the same nonzeros;
Chebyshev with Jacobi on the others, where blocks of small aggregates are singular.

Observed: the steps of the default, 7 to 13 FGMRES iterations per step for Coulomb
friction, 11 to 16 of CG for Tresca's.  There is no proven bound.  CONVERGED is decided by the residual of the problem
with the most accurate A x, corrected from y, independent of R.

Memory: K, this matrix and its multigrid, in addition to the multigrid of K^-1 for the final residual; vectors.  Nothing
grows with the square of the contact nodes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from ..arrays import FloatArray
from ..linalg.compliance import MatrixFreeCompliance
from ..linalg.petsc_arrays import CHOLESKY, configured_ksp
from ..linalg.reductions import Reductions
from .linearization import NodalInverse
from .newton_systems import ROUNDING, NewtonEquations, NewtonStep, NewtonSystem
from .scaled_problem import IterateProducts, ScaledCompliance
from .settings import Settings, within

_MULTIGRID: dict[str, str | float] = {
    "ksp_norm_type": "unpreconditioned",
    "pc_type": "gamg",
    "pc_gamg_threshold": 0.02,
    "mg_levels_ksp_type": "chebyshev",
    "mg_levels_pc_type": "jacobi",
}


@dataclass(frozen=True)
class CondensedSystem(Settings):
    """K with springs at the contact nodes in place of A; needs a compliance with access to K and B.

    Attributes:
        contrast: C is at least this part of 1/K_ii.
        loose: |e| over that of the right-hand side, at most.
        share: |e| over |R|: R falls with theta.
        tight: |e| over that of the right-hand side, at least: below it is rounding.
        first: Accuracy of the first y, at best.
        max_iterations: Krylov iterations of a step.
        multigrid: PETSc's options; where K is factorised, so is this matrix.
    """

    contrast: float = within("(0, inf)", 1e-7)
    loose: float = within("(0, 1)", 1e-2)
    share: float = within("(0, 1)", 0.3)
    tight: float = within("(0, 1)", 1e-10)
    first: float = within("(0, 1)", 0.03)
    max_iterations: int = within("[1, inf)", 200)
    multigrid: dict[str, str | float] = field(default_factory=_MULTIGRID.copy)

    def system(self, A: ScaledCompliance, sloped: bool) -> NewtonSystem:
        """See `NewtonChoice`; a ValueError on every rank if the compliance has no K and B."""
        return _Condensed(A, sloped, self)


class _DisplacementProducts(IterateProducts):
    """A x of the iterates as B y, of a compliance with K and B; `first` is the accuracy of the first y, at best.

    Attributes:
        y: Near K^-1 B^T x.
        R: B^T x - K y.
        w: Change of y in a step of length 1.
    """

    corrects = False  # R is the error

    def __init__(self, A: ScaledCompliance, compliance: MatrixFreeCompliance, first: float):
        super().__init__(A)
        self._compliance, self._first = compliance, first
        self.y, self.R = compliance.K.createVecs()
        self.w, self._rhs = self.y.duplicate(), self.y.duplicate()

    def first(self, x: FloatArray, tolerance: float) -> FloatArray:
        """B y of the first iterate; the first step adds the rest of y."""
        self._compliance.response(self._scaled.forces(x), self.y, max(tolerance, self._first))
        return self._image(x)

    def advance(self, x: FloatArray, predicted: FloatArray | None, alpha: float, tolerance: float) -> FloatArray:
        """B y of the next iterate: a product by K, no solve."""
        self.y.axpy(alpha, self.w)
        return self._image(x)

    def exact(self, x: FloatArray) -> FloatArray:
        """The most accurate A x, by a correction of y; y is unchanged."""
        self._compliance.guess(self.y)
        return super().exact(x)

    def _image(self, x: FloatArray) -> FloatArray:
        self._compliance.forces(self._scaled.forces(x), self._rhs)
        self._compliance.K.mult(self.y, self.R)
        self.R.aypx(-1.0, self._rhs)
        return self._scaled.image(self._compliance.displaced(self.y))

    def destroy(self) -> None:
        for vector in (self.y, self.R, self.w, self._rhs):
            vector.destroy()


class _Condensed(NewtonSystem):
    """The displacement y, the stiffened matrix, and a step with it."""

    def __init__(self, A: ScaledCompliance, sloped: bool, settings: CondensedSystem):
        compliance = A.A.matrix_free
        if compliance is None:
            raise ValueError(
                f"newton: a condensed system is made of the stiffness matrix, which the {A.A.name} compliance "
                'does not keep: use ContactProblem(..., explicit=False), in a case file compliance = "matrix-free"'
            )
        if A.G.shape[2]:
            raise ValueError(
                "newton: a condensed system needs bodies that supports hold; for bodies that contact alone holds use "
                "SchurComplementSystem() or AugmentedSystem()"
            )
        self._settings, self._scaled, self._compliance = settings, A, compliance
        self._method = PETSc.KSP.Type.FGMRES if sloped else PETSc.KSP.Type.CG
        self._K, self._B = compliance.K, compliance.B
        self._nodes, self._frames = _nodal(self._B, self._K)
        self._stiffened = self._K.duplicate(copy=True)
        self._stiffened.setNearNullSpace(self._K.getNearNullSpace())
        for option in (PETSc.Mat.Option.SYMMETRIC, PETSc.Mat.Option.SPD):
            self._stiffened.setOption(option, True)
        self.products: _DisplacementProducts = _DisplacementProducts(A, compliance, settings.first)
        self._rhs = self.products.y.duplicate()
        self._x = self._B.createVecLeft()
        diagonal = self._K.getDiagonal()
        stiffness = np.einsum("ijk,ik->ij", self._frames**2, diagonal.array_r.reshape(-1, 3)[self._nodes])
        diagonal.destroy()
        # a row of B along a prescribed direction is zero: C there needs no more than to be regular
        stiffness = np.where(stiffness > 0.0, stiffness, stiffness.max(axis=1, keepdims=True, initial=0.0))
        self._least: FloatArray = A.W**2 * settings.contrast / (stiffness * A.a)
        self._operator = None  # K + B^T C^-1 B, where that is not the stiffened matrix
        if sloped:
            self._operator = PETSc.Mat().createPython(self._K.getSizes(), context=_Product(self._mult), comm=A.comm)
            self._operator.setUp()

    def _gathered(self, v: PETSc.Vec) -> FloatArray:
        """B v, scaled as A x is, shape (m, 3)."""
        self._B.mult(v, self._x)
        return self._scaled.image(self._x.array_r)

    def solve(self, equations: NewtonEquations) -> NewtonStep:
        """The step; its accuracy depends on R (module docstring); weight, tolerance and cap are not used."""
        nodal, r1, r2 = equations.at, equations.r1, equations.r2
        r = r1 + nodal.J12(r2 / nodal.D22)
        self._spring = NodalInverse(nodal, self._least)
        self._stiffen()
        self._x.array[:] = self._scaled.forces(self._spring(r))
        self._B.multTranspose(self._x, self._rhs)
        self._rhs.axpy(1.0, self.products.R)
        size, lacking = self._rhs.norm(), self.products.R.norm()
        settings = self._settings
        factorised = self._compliance.factorised
        options = {"ksp_norm_type": "unpreconditioned", **CHOLESKY} if factorised else settings.multigrid
        ksp = configured_ksp(self._stiffened, self._method, options, operator=self._operator)
        if not factorised:
            _sweep_by_nodes(ksp)
        ksp.setErrorIfNotConverged(False)  # a poor step leads to a short step length, and shows in the final residual
        least = ROUNDING if factorised else settings.tight
        goal = max(min(settings.loose * size, settings.share * lacking), least * size)
        ksp.setTolerances(rtol=0.0, atol=goal, divtol=1e30, max_it=settings.max_iterations)
        ksp.solve(self._rhs, self.products.w)
        iterations = int(ksp.getIterationNumber())
        ksp.destroy()
        A_dx = self._gathered(self.products.w)
        dx = self._spring(r - A_dx)
        return NewtonStep(dx, nodal.multipliers(dx, r2), A_dx, iterations)

    def _stiffen(self) -> None:
        """K + B^T C_d^-1 B: K, and a block per contact node on its diagonal."""
        A = self._scaled
        springs = self._spring.uncoupled(np.tile(np.eye(3), (A.nodes, 1, 1))) * A.W[:, :, None] * A.W[:, None, :] / A.a
        blocks = np.einsum("iak,iab,ibl->ikl", self._frames, springs, self._frames)
        self._K.copy(self._stiffened, structure=PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        at = (self._stiffened.getOwnershipRange()[0] // 3 + self._nodes).astype(PETSc.IntType)[:, None]
        if A.nodes:  # petsc4py divides by the number of blocks
            self._stiffened.setValuesBlockedRCV(at, at, blocks.reshape(-1, 9), addv=PETSc.InsertMode.ADD_VALUES)
        self._stiffened.assemble()

    def destroy(self) -> None:
        operator = [] if self._operator is None else [self._operator]
        for thing in (self._stiffened, self.products, self._rhs, self._x, *operator):
            thing.destroy()

    def _mult(self, w: PETSc.Vec, image: PETSc.Vec) -> None:
        """(K + B^T C_d^-1 B) w and, by the part of C^-1 that C_d^-1 leaves out, the pressure-dependent friction."""
        self._stiffened.mult(w, image)
        following = self._spring.follow(self._spring.uncoupled(self._gathered(w))[:, :1])
        self._x.array[:] = self._scaled.forces(following)
        self._B.multTransposeAdd(self._x, image, image)


class _Product:
    """Context of a matrix that is a product; a separate class, since PETSc would call its method `destroy`."""

    def __init__(self, product: Callable[[PETSc.Vec, PETSc.Vec], None]):
        self._product = product

    def mult(self, _: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        self._product(x, y)


def _sweep_by_nodes(ksp: PETSc.KSP) -> None:
    """Symmetric Gauss-Seidel in place of the finest smoother; it needs no estimate of eigenvalues."""
    multigrid = ksp.getPC()
    if multigrid.getMGLevels() > 1:
        smoother = multigrid.getMGSmoother(multigrid.getMGLevels() - 1)
        smoother.setType(PETSc.KSP.Type.RICHARDSON)
        smoother.getPC().setType(PETSc.PC.Type.SOR)


def _nodal(B: PETSc.Mat, K: PETSc.Mat) -> tuple[npt.NDArray[np.int64], FloatArray]:
    """This rank's displacement node of every contact node (m,), and its frame (m, 3, 3): B, row by row.

    Raises:
        ValueError: On every rank, if the rows of a contact node are not made of one node of the same rank.
    """
    indptr, indices, values = B.getValuesCSR()
    first, last = K.getOwnershipRange()
    m = B.getLocalSize()[0] // 3
    rows, columns = np.repeat(np.arange(3 * m), np.diff(indptr)), indices.astype(np.int64) - first
    nodes = np.zeros(m, dtype=np.int64)
    nodes[rows // 3] = columns // 3
    mine = bool(np.all((columns >= 0) & (columns < last - first) & (nodes[rows // 3] == columns // 3)))
    if not Reductions(B.getComm().tompi4py()).all(mine):
        raise ValueError("newton: a condensed system needs contact nodes that are nodes of the body, on their rank")
    frames = np.zeros((m, 3, 3))
    frames[rows // 3, rows % 3, columns % 3] = values
    return nodes, frames
