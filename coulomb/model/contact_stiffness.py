"""K^-1 and A of a body over a run, and the choice of the method by which they are computed."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc

from ..arrays import FloatArray
from ..fem import compat
from ..fem.bodies import Deformable, SingleBody
from ..fem.contact import ContactSurface
from ..fem.geometry import inverse_frames
from ..linalg.compliance import (
    EXPLICIT_UP_TO,
    BodyCompliance,
    DirectSolver,
    IterativeSolver,
    LinearResponseCache,
    LinearSolver,
    MatrixFreeCompliance,
    Measures,
    Precision,
    SchurCompliance,
    SoftMotions,
    StiffnessSolver,
    chosen,
    factorise,
    fits,
    patience,
    undecided,
)
from ..linalg.factors import (
    FirstRankSolver,
    Front,
    MultifrontalSolver,
    NotPositiveDefinite,
    Work,
    predicted_work,
    symbolic,
    usual_work,
)
from ..linalg.reductions import Reductions
from ..linalg.solve_errors import CGNotConverged
from .certificate import rounding_forces
from .conditioning import ill_conditioned, measures_of, on_soft_springs, soft_motions
from .memory import first_room
from .provenance import timed

_log = logging.getLogger(__name__)

_PRODUCTS: Final = 1000
"""Products by A in a load step after which Newton systems are condensed: four times as many as bent parts need."""

_DENSE_UP_TO: Final = 6000
"""Contact unknowns up to which Newton systems are factorised where nothing else has an answer: 10 s each."""

_DOUBLE_FROM, _DOUBLE_UP_TO = 8, 50_000
"""Load steps from which, and displacement unknowns up to which (half a gigabyte), factors in double precision take less
time in all than in single precision."""

_FLAT: Final = 1e4
"""Length of a cell over its thickness from which its shape is named as the cause of a singular stiffness."""


@contextmanager
def explained(elasticity: Deformable) -> Iterator[None]:
    """Failures of K^-1 as errors in the form a, if K is made of the user's forms, or in the shape of cells."""
    try:
        yield
    except (ValueError, PETSc.Error, CGNotConverged) as error:
        slow = isinstance(error, CGNotConverged) and not error.indefinite
        if elasticity.forms() is not None and not slow:
            raise NotPositiveDefinite(
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


class FixedStiffness:
    """K^-1 and A for one K, each computed when first needed.

    Args:
        elasticity: The body.
        reference: The contact surface in whose frames A is computed; for other frames it is rotated.
        linear_solver: The solver class for K^-1.
        explicit: Whether A is formed.
        seconds: Dictionary to which wall times are added.
        symbolic: The fronts of K, if they are known.
        many: Whether many solves are expected: factors are then in double precision, with which products by A are exact
            and a solve is one substitution in place of an iteration.

    Attributes:
        responses: Displacements without contact under the loads so far.
    """

    def __init__(
        self,
        elasticity: Deformable,
        reference: ContactSurface,
        linear_solver: LinearSolver,
        explicit: bool,
        seconds: dict[str, float],
        symbolic: list[Front] | None = None,
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
    def _contact_last(self) -> MultifrontalSolver | FirstRankSolver:
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
        self, last: npt.NDArray[np.integer[Any]], symbolic: list[Front] | None
    ) -> MultifrontalSolver | FirstRankSolver:
        K, x, single = self.elasticity.K, self.elasticity.points, False if self._many else None
        if self.elasticity.comm.size > 1:
            return FirstRankSolver(K, x, last, single, self._many)
        return MultifrontalSolver(K, x, last, single, symbolic, self._many)

    @cached_property
    def _compliance(self) -> BodyCompliance:
        """A in the reference frames."""
        solver, B = self.solver, self._reference.free_B
        with timed(self._seconds, "compliance"):
            if self._explicit and isinstance(solver, MultifrontalSolver | FirstRankSolver):
                return SchurCompliance(B, solver)
            return MatrixFreeCompliance(B, self.elasticity.K, solver, soft=self._soft)

    def compliance(self, surface: ContactSurface, seconds: dict[str, float]) -> BodyCompliance:
        """A = B K^-1 B^T, metres per newton, in the frames of a surface of this body; what the Krylov methods have
        found of it turns with the frames; collective."""
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


class ContactStiffness:
    """K^-1 and A of a body over a run: all that is kept of them, and the method by which they are computed.

    What was computed for one K is used until another is asked for (`of`), or K is said to have changed (`replace`,
    `invalidate`).  Arguments as of `FixedStiffness`; without `linear_solver` the one that is predicted to be faster is
    taken, without `explicit` A is formed by size.  `references` are the contact surfaces in whose frames A is computed,
    by which bolts are locked.

    Attributes:
        version: Increases whenever what was computed before is no longer valid.
        load_steps: How many load steps are expected.
        changed: Why another method than the one that was chosen first is used for K^-1 or A; empty if none is.
    """

    def __init__(
        self,
        elasticity: Deformable,
        references: Mapping[tuple[bool, ...], ContactSurface],
        unknowns: Mapping[str, int],
        linear_solver: LinearSolver | None,
        explicit: bool | None,
        seconds: dict[str, float],
    ):
        self.elasticity, self._references, self._unknowns = elasticity, references, unknowns
        self.comm, self._seconds = elasticity.comm, seconds
        self._given, self.load_steps = (linear_solver, explicit), 1
        self._symbolic: list[Front] | None = None
        self._work: Work | None = None
        self.changed, self._condensed, self._may_condense, self._dense = "", False, True, False
        self._rounding: tuple[object, float, FloatArray] | None = None
        self._latest: FixedStiffness | None = None
        self._factors_of: set[tuple[bool, ...]] = set()
        self.version = 0

    # --- K^-1 and A ---------------------------------------------------------------------------------------------------

    def of(self, elasticity: Deformable, seconds: dict[str, float] | None = None) -> FixedStiffness:
        """K^-1 and A of the body in a state, the last of which are kept; wall times are added to `seconds`."""
        if self._latest is None or self._latest.elasticity.K is not elasticity.K:
            solver, explicit = self._chosen
            self.elasticity, spent = elasticity, self._seconds if seconds is None else seconds
            many = elasticity.locked not in self._factors_of and self.in_double
            self._factors_of.add(elasticity.locked)
            self._latest = FixedStiffness(elasticity, self._reference, solver, explicit, spent, self._symbolic, many)
        return self._latest

    @property
    def _reference(self) -> ContactSurface:
        """The contact surface in whose frames A is computed, by the unknowns that the body has now."""
        return self._references[self.elasticity.locked]

    def invalidate(self) -> None:
        """Forget K^-1, A and what the Krylov methods have found of it: the entries of K have changed."""
        self._latest = self._rounding = None
        self.version += 1

    def replace(self, elasticity: Deformable) -> None:
        """Take another K of the same sparsity from now on."""
        self.elasticity = elasticity
        self.invalidate()

    @property
    def solver(self) -> StiffnessSolver:
        """K^-1 of `elasticity`."""
        return self.of(self.elasticity).solver

    @property
    def method(self) -> str:
        """Name of the solver for K^-1."""
        if self.linear_solver is DirectSolver:
            return (MultifrontalSolver if self.comm.size == 1 else FirstRankSolver).method
        return self.linear_solver.name

    def rounding_forces(self, elasticity: Deformable, u: FloatArray) -> FloatArray:
        """`rounding_forces` of the body in a state, scaled by the largest displacement while K is the same;
        collective."""
        motion = Reductions(self.comm).max(np.abs(u))
        if self._rounding is None or self._rounding[0] is not elasticity.K or not 0.0 < self._rounding[1] < math.inf:
            self._rounding = elasticity.K, motion, rounding_forces(elasticity, u)
        forces: FloatArray = self._rounding[2] * (motion / self._rounding[1] if motion != self._rounding[1] else 1.0)
        return forces

    # --- the method -----------------------------------------------------------------------------------------------

    def expect_load_steps(self, steps: int) -> None:
        """Declare how many load steps are to come: for many, factors of K pay; what is computed already stays."""
        self.load_steps = max(steps, 1)

    @cached_property
    def _chosen(self) -> tuple[LinearSolver, bool]:
        """The solver for K, and whether A is formed; bodies of the user's forms are judged by size; collective."""
        comm, m, (linear_solver, explicit) = self.comm, self.interface, self._given
        n = self._unknowns["displacement"]
        if not undecided(n, m, linear_solver, explicit) or self.elasticity.forms() is not None:
            return chosen(n, m, comm.size, linear_solver, explicit)
        with timed(self._seconds, "stiffness"):
            formed = m <= EXPLICIT_UP_TO
            found, work = self._fronts(formed)
            soft, room = on_soft_springs(self.elasticity), first_room(comm)
            direct = factorise(work, self.measures, self.load_steps, soft, self.precision, room, comm.size, formed)
            if not comm.bcast(direct):  # sums over the ranks may differ by rounding errors
                self._work = work
                return IterativeSolver, False
            self._symbolic = found
        return DirectSolver, formed

    def _fronts(self, contact_last: bool) -> tuple[list[Front] | None, Work]:
        """The fronts of K on one rank, and what a factorisation takes; collective."""
        K, x, last = self.elasticity.K, self.elasticity.points, self._reference.nodes_in_rows
        if self.comm.size > 1:
            return None, usual_work(self._unknowns["displacement"], self.interface if contact_last else 0)
        fronts = symbolic(K, x, last if contact_last else np.empty(0, dtype=np.int64))
        return fronts, predicted_work(fronts)

    @contextmanager
    def limited(self, solver: StiffnessSolver) -> Iterator[None]:
        """No more iterations of multigrid than its `patience`, where it was chosen by predicted time and the factors
        fit into the memory; collective."""
        formed = self.interface <= EXPLICIT_UP_TO
        if self._work is None or not isinstance(solver, IterativeSolver) or not self._fit(self._work, formed):
            yield
            return
        allowed = patience(self._work, self.measures, self.load_steps, self.precision, self.comm.size, formed)
        solver.allow(self.comm.bcast(allowed))
        try:
            yield
        finally:
            solver.allow(math.inf)

    @contextmanager
    def few_products(self, A: BodyCompliance) -> Iterator[None]:
        """No more than `_PRODUCTS` by A, if Newton's method can be condensed; collective."""
        A.allow(_PRODUCTS if self._condensable and not self.condensed else math.inf)
        try:
            yield
        finally:
            A.allow(math.inf)

    @property
    def _condensable(self) -> bool:
        """Whether K is factorised, supports hold the bodies, and contact points are nodes, none of which is tied;
        collective."""
        seen, (first, last) = self._reference.nodes_in_rows, self._reference.B.getOwnershipRangeColumn()
        nodal = len(seen) == len(self._reference.nodes) and bool(np.all((3 * seen >= first) & (3 * seen < last)))
        nodal = nodal and (not self.elasticity.ties or not self._reference.slip_prescribed)
        mine = nodal and self._may_condense and self._given[1] is None and len(self.elasticity.free) == 0
        return self.linear_solver is DirectSolver and bool(self.comm.allreduce(mine, op=MPI.LAND))

    @property
    def condensed(self) -> bool:
        """Whether the default solver uses `CondensedSystem`: where a body bends and A is not formed; collective."""
        return self._condensed or (not self.explicit and self._condensable and ill_conditioned(self.elasticity))

    @property
    def dense(self) -> bool:
        """Whether the default solver factorises Newton systems with the formed A, since condensed ones have failed."""
        return self.explicit and self._dense

    def _fit(self, work: Work, formed: bool) -> bool:
        """Whether factors of K fit into the memory, where A is formed or not, the same on all ranks; collective."""
        return bool(self.comm.bcast(fits(work, self.precision is Precision.SINGLE, first_room(self.comm), formed)))

    def change_method(self, why: str, condense: bool = False) -> bool:
        """From multigrid to factors of K, from products by A to condensed Newton systems (if `condense`), or from
        factors to a formed A, if the user has not chosen otherwise and it fits into the memory; whether it is done;
        collective."""
        condense = condense and self._condensable and not self.condensed
        solver, explicit = self._given
        if self.linear_solver is IterativeSolver and solver is None:
            explicit, then = self.interface <= EXPLICIT_UP_TO if explicit is None else explicit, "K is factorised"
        elif condense:
            explicit, then = False, "Newton systems are made of K with springs in place of A"
        elif self.linear_solver is DirectSolver and explicit is None and not self.explicit:
            explicit, then = True, "A is formed"
            self._dense = self.condensed and self.comm.size == 1 and self._unknowns["contact"] <= _DENSE_UP_TO
            self._may_condense = False
        else:
            return False
        with timed(self._seconds, "stiffness"):
            found, work = self._fronts(explicit)
        fit = self._fit(work, explicit)
        if self.comm.rank == 0:
            _log.warning("%s; %s", why, f"{then} instead" if fit else "factors of K do not fit into the memory")
        if fit:
            self.changed, self._symbolic = f"{why}; {then} instead", found
            self._factors_of.clear()
            self.invalidate()
            self._chosen, self._condensed = (DirectSolver, explicit), condense
        self._work = None  # and no limit
        return fit

    @property
    def advice(self) -> str:
        """What the user may choose otherwise where no method has an answer, after a semicolon."""
        if self._given[0] is IterativeSolver:
            return '; with linear_solver = "auto" or "direct" products by A are more accurate'
        return ""

    @cached_property
    def measures(self) -> Measures:
        """What decides how long multigrid takes; collective."""
        return measures_of(self._reference, self.elasticity, self._unknowns["displacement"], self.interface)

    @property
    def precision(self) -> Precision:
        """Expected of factors of K; collective."""
        if self.in_double:
            return Precision.DOUBLE
        return Precision.REPEATED if ill_conditioned(self.elasticity) else Precision.SINGLE

    @property
    def in_double(self) -> bool:
        """Whether factors are in double precision from the beginning, as many load steps then take less time."""
        return self.load_steps >= _DOUBLE_FROM and self._unknowns["displacement"] <= _DOUBLE_UP_TO

    @property
    def linear_solver(self) -> LinearSolver:
        """The solver class for K^-1 (DirectSolver: by nested dissection, see `stiffness_method`); collective."""
        return self._chosen[0]

    @property
    def explicit(self) -> bool:
        """Whether A is formed; collective."""
        return self._chosen[1]

    @cached_property
    def interface(self) -> int:
        """Displacements on which contact forces act, over all ranks: of pairs of faces those of both; A is formed from
        as many columns of K^-1."""
        mine = 3 * len(self._reference.nodes_in_rows)  # nodes at the border of ranks count twice
        return max(int(self.comm.allreduce(mine, op=MPI.SUM)), self._unknowns["contact"])


def _turn(before: ContactSurface, after: ContactSurface) -> FloatArray:
    """T with frames of `after` = T times frames of `before`, point by point, shape (m, 3, 3)."""
    turn: FloatArray = after.frames @ inverse_frames(before.frames).transpose(0, 2, 1)
    return turn
