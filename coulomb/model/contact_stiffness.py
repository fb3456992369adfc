"""K^-1 and A of a body whose coefficients have fixed values."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
from petsc4py import PETSc

from ..arrays import FloatArray
from ..fem import compat
from ..fem.bodies import Deformable, SingleBody
from ..fem.contact import ContactSurface
from ..fem.geometry import inverse_frames
from ..linalg.compliance import (
    BodyCompliance,
    DirectSolver,
    IterativeSolver,
    LinearResponseCache,
    LinearSolver,
    MatrixFreeCompliance,
    SchurCompliance,
    SoftMotions,
    StiffnessSolver,
)
from ..linalg.factors import (
    DistributedMultifrontalSolver,
    Front,
    MultifrontalSolver,
    NotPositiveDefinite,
    SharedSymbolic,
)
from ..linalg.reductions import Reductions
from ..linalg.unsolved import Unsolved
from .conditioning import soft_motions
from .stopwatch import timed

_FLAT = 1e4
"""Length of a cell over its thickness from which its shape is named as the cause of a singular stiffness."""


@contextmanager
def explained(elasticity: Deformable) -> Iterator[None]:
    """Failures of K^-1 as errors in the form a, if K is made of the user's forms, or in the shape of cells.

    Raises:
        ValueError: On every rank.
    """
    try:
        yield
    except (ValueError, PETSc.Error, Unsolved) as error:
        slow = isinstance(error, Unsolved) and not error.indefinite
        if elasticity.forms() is not None and not slow:
            raise ValueError(
                "Body: a is not positive definite where bcs hold nothing, to rounding: look at the signs of its terms "
                "and coefficients, and whether bcs or Robin terms hold every part of the body"
                + "".join(member.body.suspects() for member in elasticity.members)
            ) from None
        flattest = max(_proportion(member.body) for member in elasticity.members)
        if not isinstance(error, NotPositiveDefinite) or flattest < _FLAT:
            raise
        raise NotPositiveDefinite(
            f"{error}: there are cells {flattest:.1e} times as long as they are thick; check the lengths and the unit "
            "of the mesh"
        ) from None


def _proportion(body: SingleBody) -> float:
    """The largest extent of a cell over its smallest one, of all cells; collective."""
    points = body.domain.geometry.x[compat.cell_geometry(body.domain)]
    sizes = np.linalg.svd(points - points.mean(axis=1, keepdims=True), compute_uv=False)
    return Reductions(body.comm).max(sizes[:, 0] / np.maximum(sizes[:, 2], np.finfo(float).tiny))


class ContactStiffness:
    """K^-1 and A, each computed when first needed.

    Args:
        elasticity: The body.
        reference: The contact surface in whose frames A is computed; for other frames it is rotated.
        linear_solver: The solver class for K^-1.
        explicit: Whether A is formed.
        seconds: Dictionary to which wall times are added.
        symbolic: The fronts of K, with the contact nodes last if A is formed, if they are known; on several ranks
            `SharedSymbolic`.
        many: Whether many solves are expected: K, if it is factorised, is factorised in double precision; then all
            products by A are exact, and a solve is one substitution in place of an iteration.

    Attributes:
        elasticity: The body.
        responses: Displacements without contact under the loads so far.

    Raises:
        ValueError: On every rank, when K^-1 is first needed, if K is not positive definite.
    """

    def __init__(
        self,
        elasticity: Deformable,
        reference: ContactSurface,
        linear_solver: LinearSolver,
        explicit: bool,
        seconds: dict[str, float],
        symbolic: list[Front] | SharedSymbolic | None = None,
        many: bool = False,
    ):
        self.elasticity, self._reference, self._symbolic = elasticity, reference, symbolic
        self._linear_solver, self._explicit, self._seconds = linear_solver, explicit, seconds
        self.responses, self._many = LinearResponseCache(elasticity.comm), many
        self._latest: tuple[ContactSurface, BodyCompliance] | None = None

    @property
    def solver(self) -> StiffnessSolver:
        """K^-1."""
        return self._contact_last if self._explicit else self._any_order

    @cached_property
    def _contact_last(self) -> MultifrontalSolver | DistributedMultifrontalSolver:
        """K^-1 with the contact nodes eliminated last, which gives A."""
        with timed(self._seconds, "stiffness"), explained(self.elasticity):
            return self._factorised(self._reference.nodes_in_rows, self._symbolic)

    @cached_property
    def _any_order(self) -> StiffnessSolver:
        """K^-1 where A is not formed."""
        with timed(self._seconds, "stiffness"), explained(self.elasticity):
            if self._linear_solver is DirectSolver:
                return self._factorised(np.empty(0, dtype=np.int64), self._symbolic)
            solver = self._linear_solver(self.elasticity.K)
            if self._soft is not None and isinstance(solver, IterativeSolver):
                solver.separate(self._soft)
            return solver

    @cached_property
    def _soft(self) -> SoftMotions | None:
        """The motions on soft springs that multigrid computes apart."""
        return None if self._linear_solver is DirectSolver else soft_motions(self.elasticity)

    def _factorised(
        self, last: npt.NDArray[np.integer[Any]], symbolic: list[Front] | SharedSymbolic | None
    ) -> MultifrontalSolver | DistributedMultifrontalSolver:
        """K^-1 with these nodes eliminated last; what is known of that before."""
        K, x, single = self.elasticity.K, self.elasticity.x, False if self._many else None
        if self.elasticity.comm.size > 1:
            shared = symbolic if isinstance(symbolic, SharedSymbolic) else None
            return DistributedMultifrontalSolver(K, x, last, single, shared)
        known = symbolic if isinstance(symbolic, list) else None
        return MultifrontalSolver(K, x, last, single, known, self._many)

    @cached_property
    def _compliance(self) -> BodyCompliance:
        """A in the reference frames."""
        solver, B = self.solver, self._reference.free_B
        with timed(self._seconds, "compliance"):
            if self._explicit and isinstance(solver, MultifrontalSolver | DistributedMultifrontalSolver):
                return SchurCompliance(B, solver)
            return MatrixFreeCompliance(B, self.elasticity.K, solver, soft=self._soft)

    def compliance(self, surface: ContactSurface, seconds: dict[str, float]) -> BodyCompliance:
        """A = B K^-1 B^T in the frames of a surface of this body, metres per newton; collective.

        What the Krylov methods have found of it in other frames turns with them.

        Args:
            surface: The surface.
            seconds: Dictionary to which the wall time of rotating A is added.
        """
        A = self._compliance
        before, latest = self._latest or (self._reference, A)
        if surface.free_B is before.free_B:
            return latest
        with timed(seconds, "compliance"):
            if surface.free_B is not self._reference.free_B:
                A = A.rotated(surface.free_B, _turn(self._reference, surface))
            A.learnt = latest.learnt.turned(_turn(before, surface))
        self._latest = surface, A
        return A


def _turn(before: ContactSurface, after: ContactSurface) -> FloatArray:
    """T with frames of `after` = T times frames of `before`, point by point, shape (m, 3, 3)."""
    turn: FloatArray = after.frames @ inverse_frames(before.frames).transpose(0, 2, 1)
    return turn
