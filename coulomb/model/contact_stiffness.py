"""K^-1 and A of a body over a run, and the choice of the method by which they are computed."""

from __future__ import annotations

import logging
import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Final

import numpy as np
from mpi4py import MPI

from ..arrays import FloatArray
from ..fem.bodies import Deformable, NonlinearBody
from ..fem.contact import ContactSurface
from ..fem.geometry import inverse_frames
from ..linalg.compliance import (
    EXPLICIT_UP_TO,
    LEAST,
    BodyCompliance,
    DirectSolver,
    IterativeSolver,
    LinearResponseCache,
    LinearSolver,
    MatrixFreeCompliance,
    SchurCompliance,
    SoftMotions,
    StiffnessSolver,
    chosen,
    fits,
    patience,
    stiffness_in_blocks,
    undecided,
    worth,
)
from ..linalg.factors import (
    FirstRankSolver,
    Front,
    MultifrontalSolver,
    Work,
    predicted_work,
    symbolic,
    usual_work,
)
from ..linalg.reductions import Reductions
from ..linalg.solve_errors import CGNotConverged, TooSlow
from ..linalg.uncoupled import parts_of
from ..solvers.condensed import CondensedSystem
from ..solvers.newton_systems import DenseSystem
from .certificate_scales import EPSILON, largest_motions, lengths, rounding_forces
from .conditioning import explained, ill_conditioned, soft_motions
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

_SOLVED: Final = 1e-8
"""Accuracy of the solution whose iterations decide between multigrid and factors."""


@dataclass(frozen=True)
class Method:
    """By what K^-1 and A are computed.

    Attributes:
        linear_solver: The solver class for K^-1.
        explicit: Whether A is formed.
        newton: The Newton systems of the default solver where they are not those of `Automatic`.
        words: What it does, where another was tried before it.
        why: Why another one is used than the one that was chosen first; empty if none is.
        fronts: Of K, if they are known.
    """

    linear_solver: LinearSolver
    explicit: bool
    newton: type[CondensedSystem] | type[DenseSystem] | None = None
    words: str = ""
    why: str = ""
    fronts: list[Front] | None = field(default=None, repr=False)

    def is_tried_after(self, before: Method, condense: bool) -> bool:
        """Whether it may have an answer where another method has none; `condense`: if Newton systems are free."""
        if self.newton is CondensedSystem:
            return condense
        same = (self.linear_solver, self.explicit) == (before.linear_solver, before.explicit)
        return not same and (self.newton is None or before.newton is not None)


class FixedStiffness:
    """K^-1 and A for one K by one method, each computed when first needed.

    Args:
        reference: The contact surface in whose frames A is computed; for other frames it is rotated.
        seconds: Dictionary to which wall times are added.
        many: Whether many solves are expected: factors are then in double precision, with which products by A are exact
            and a solve is one substitution in place of an iteration.
        before: Of another K of the same sparsity but for springs, whose fronts are used again.

    Attributes:
        responses: Displacements without contact under the loads so far.
    """

    def __init__(
        self,
        elasticity: Deformable,
        reference: ContactSurface,
        method: Method,
        seconds: dict[str, float],
        many: bool = False,
        before: FixedStiffness | None = None,
    ):
        self.elasticity, self.method, self._reference = elasticity, method, reference
        alike = before is not None and before.method is method and before._reference is reference
        self._fronts: list[Front] | None = before._fronts if before is not None and alike else method.fronts
        self._seconds, self._many = seconds, many
        self.responses = LinearResponseCache(elasticity.comm)
        self._latest: tuple[ContactSurface, BodyCompliance] | None = None
        self._tried = False

    @cached_property
    def with_formed(self) -> FixedStiffness:
        """With factors that give A as well."""
        method = replace(self.method, explicit=True, fronts=None)
        return FixedStiffness(self.elasticity, self._reference, method, self._seconds)

    @cached_property
    def solver(self) -> StiffnessSolver:
        """K^-1; where A is formed with the contact nodes eliminated last, which gives A."""
        if isinstance(self._solver, IterativeSolver):
            self.elasticity.let_go_of_matrix()
        return self._solver

    @cached_property
    def _solver(self) -> StiffnessSolver:
        """Multigrid has K in blocks, which are less than half of the matrix: this is let go before grids are made, and
        where factors may be needed in its place when they are not."""
        K, x, method = self.elasticity.K, self.elasticity.reduction.points, self.method
        with timed(self._seconds, "stiffness"), explained(self.elasticity):
            if method.explicit or method.linear_solver is DirectSolver:
                last = self._reference.nodes_in_rows if method.explicit else np.empty(0, dtype=np.int64)
                single = False if self._many else None
                if self.elasticity.comm.size > 1:
                    return FirstRankSolver(K, x, last, single, self._many)
                springs = self.elasticity.added_springs  # that couple nodes make other fronts
                if springs is not None and not springs.inside:
                    return MultifrontalSolver(K, x, last, single, None, self._many)
                factors = MultifrontalSolver(K, x, last, single, self._fronts, self._many)
                self._fronts = factors.fronts
                return factors
            soft = self._soft  # before grids are made, which take the memory that this leaves
            if method.linear_solver is not IterativeSolver or self._tried:
                solver = method.linear_solver(K)
            else:
                blocks = stiffness_in_blocks(K)
                del K
                self.elasticity.let_go_of_matrix()
                solver = IterativeSolver(blocks)
            if soft is not None and isinstance(solver, IterativeSolver):
                solver.separate(soft)
            return solver

    @cached_property
    def _soft(self) -> SoftMotions | None:
        """The motions on soft springs that multigrid computes apart."""
        return None if self.method.linear_solver is DirectSolver else soft_motions(self.elasticity)

    def iterations_within(self, most: float) -> float:
        """Of multigrid for the displacements under 1 N along the normal of every contact point, to 1e-8; inf if they
        are more than `most`, the same number on all ranks; collective."""
        self._tried = True
        solver, B = self._solver, self._reference.free_B
        assert isinstance(solver, IterativeSolver)
        f, u = self.elasticity.reduced.vector(), self.elasticity.reduced.vector()
        pressed = B.createVecLeft()
        pressed.array[0::3] = 1.0
        B.multTranspose(pressed, f)
        solver.allow(most)
        try:
            solver.solve(f, u, _SOLVED)
        except (TooSlow, CGNotConverged):
            return math.inf
        finally:
            solver.allow(math.inf)
            for vector in (pressed, f, u):
                vector.destroy()
        return solver.iterations

    @cached_property
    def _compliance(self) -> BodyCompliance:
        """A in the reference frames."""
        solver, B = self.solver, self._reference.free_B
        with timed(self._seconds, "compliance"):
            if self.method.explicit and isinstance(solver, MultifrontalSolver | FirstRankSolver):
                large = any(isinstance(member.body, NonlinearBody) for member in self.elasticity.members)
                return SchurCompliance(B, solver, halved=large)
            parts = solver.parts if isinstance(solver, IterativeSolver) else parts_of(self.elasticity.K)
            return MatrixFreeCompliance(B, self.elasticity, solver, parts, soft=self._soft)

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
    """K^-1 and A of a body over a run: all that is kept of them, and the methods by which they are computed.

    What was computed for one K is used until another is asked for (`of`), or taken in its place (`replace`).

    Args:
        references: The contact surfaces in whose frames A is computed, by which bolts are locked.
        unknowns: Of displacement and contact, over all ranks.
        linear_solver: The solver class for K^-1; None for the one that is expected to be faster.
        explicit: Whether A is formed; None for the choice by size.
        seconds: Dictionary to which wall times are added.

    Attributes:
        load_steps: How many load steps are expected.
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
        self._given, self.load_steps, self.loaded_foundations = (linear_solver, explicit), 1, False
        self._rounding: tuple[object, FloatArray] | None = None
        self._latest: FixedStiffness | None = None
        self._factors_of: set[tuple[bool, ...]] = set()
        self._patience = math.inf

    # --- K^-1 and A ---------------------------------------------------------------------------------------------------

    def of(self, elasticity: Deformable, seconds: dict[str, float] | None = None) -> FixedStiffness:
        """K^-1 and A of the body in a state, the last of which are kept; wall times are added to `seconds`."""
        method = self.present
        known = self._latest
        if known is None or known.elasticity.reduced is not elasticity.reduced or known.method is not method:
            self.elasticity, spent = elasticity, self._seconds if seconds is None else seconds
            many = elasticity.constraints.locked not in self._factors_of and self.in_double
            self._factors_of.add(elasticity.constraints.locked)
            known = self._latest = FixedStiffness(elasticity, self._reference, method, spent, many, known)
        return known

    @property
    def _reference(self) -> ContactSurface:
        """The contact surface in whose frames A is computed, by the unknowns that the body has now."""
        return self._references[self.elasticity.constraints.locked]

    def replace(self, elasticity: Deformable) -> None:
        """Take another K from now on, of the same sparsity but for springs, or the same with other entries."""
        self.elasticity, self._latest, self._rounding = elasticity, None, None

    def forget(self) -> None:
        """Free what is kept of K^-1 and A."""
        self._latest = self._rounding = None

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
        """`rounding_forces` of the body in a state, collective."""
        motion = largest_motions(elasticity.component, u, Reductions(self.comm))
        return self._of_unit_motion(elasticity) * motion[:, None]

    def of_nodes(self, elasticity: Deformable) -> FloatArray:
        """Force per displacement of the nodes of the body in a state, all others at rest, newtons per metre, shape
        (k,): the mean of three components of the forces of displacements with signs that vary from node to node;
        collective."""
        return lengths(self._of_unit_motion(elasticity)) / (EPSILON * 3.0**0.5)

    def _of_unit_motion(self, elasticity: Deformable) -> FloatArray:
        """`rounding_forces` of a displacement by 1 m, kept while K is the same: in large motions that of the bodies at
        their place, which is assembled only for linear problems there; collective."""
        of = elasticity if elasticity.members[0].body.large else elasticity.reduced
        if self._rounding is None or self._rounding[0] is not of:
            self._rounding = of, rounding_forces(elasticity, np.ones_like(elasticity.x))
        return self._rounding[1]

    # --- the method -----------------------------------------------------------------------------------------------

    def expect_load_steps(self, steps: int) -> None:
        """Declare how many load steps are to come: for many, factors of K pay; what is computed already stays."""
        self.load_steps = max(steps, 1)

    @property
    def present(self) -> Method:
        """The method that is used; collective."""
        return self._methods[0]

    @cached_property
    def _methods(self) -> list[Method]:
        """The methods in the order in which they are tried, as far as the user leaves them open; collective.

        Factors of K in place of multigrid; then condensed Newton systems in place of products by A, and a formed A,
        unless the user wants none: products by factors of thin sheets have rounding errors of 1e-5 of a force.
        """
        solver, explicit = self._given
        methods, small = [self._first], self.interface <= EXPLICIT_UP_TO
        if methods[0].linear_solver is IterativeSolver and solver is None:
            methods.append(Method(DirectSolver, small if explicit is None else explicit, words="K is factorised"))
        if methods[-1].linear_solver is not DirectSolver or explicit:
            return methods
        last = methods[-1]
        if self._condensable:
            words = "Newton systems are made of K with springs in place of A"
            condensed = Method(DirectSolver, False, CondensedSystem, words)
            if explicit is None and not last.explicit and self._ill_conditioned:  # from the beginning
                methods[-1] = replace(condensed, words=last.words)
            else:
                methods.append(condensed)
            if self.comm.size == 1 and explicit is None and self._unknowns["contact"] <= _DENSE_UP_TO:
                methods.append(Method(DirectSolver, True, DenseSystem, "A is formed"))
        return [*methods, Method(DirectSolver, True, words="A is formed")] if explicit is None else methods

    @property
    def _first(self) -> Method:
        """The given method, or by the first solution the one that is expected to be faster; collective."""
        comm, m, (linear_solver, explicit) = self.comm, self.interface, self._given
        n = self._unknowns["displacement"]
        if not undecided(n, m, linear_solver, explicit):
            return Method(*chosen(n, m, comm.size, linear_solver, explicit))
        with timed(self._seconds, "stiffness"):
            formed = m <= EXPLICIT_UP_TO
            fronts, work = self._fronts(formed)
            unheld = len(self.elasticity.free) > 0
            most = worth(work, n, m, self.load_steps, self._single, formed, comm.size, unheld)
            most = comm.bcast(most) if self._fit(work, formed) else math.inf
            if most >= LEAST:
                trial = FixedStiffness(self.elasticity, self._reference, Method(IterativeSolver, False), self._seconds)
                taken = trial.iterations_within(most) if math.isfinite(most) else 0.0
                if math.isfinite(taken):
                    self._latest, self._patience = trial, comm.bcast(patience(taken, most))
                    return trial.method
        return Method(DirectSolver, formed, fronts=fronts)

    def _fronts(self, contact_last: bool) -> tuple[list[Front] | None, Work]:
        """The fronts of K on one rank, and what a factorisation takes; collective."""
        K, x, last = self.elasticity.K, self.elasticity.reduction.points, self._reference.nodes_in_rows
        if self.comm.size > 1:
            return None, usual_work(self._unknowns["displacement"], self.interface if contact_last else 0)
        fronts = symbolic(K, x, last if contact_last else np.empty(0, dtype=np.int64))
        return fronts, predicted_work(fronts)

    @contextmanager
    def limited(self, solver: StiffnessSolver) -> Iterator[None]:
        """No more iterations of multigrid in a load step than it has patience for, where it was chosen by its first
        solution: then it does not contract as expected, and has taken as long as the step takes with factors;
        collective."""
        if not isinstance(solver, IterativeSolver):
            yield
            return
        solver.allow(self._patience)
        try:
            yield
        finally:
            solver.allow(math.inf)

    @contextmanager
    def few_products(self, A: BodyCompliance) -> Iterator[None]:
        """No more than `_PRODUCTS` by A, if Newton's method can be condensed; collective."""
        condensable = any(method.newton is CondensedSystem for method in self._methods[1:])
        A.allow(_PRODUCTS if self.linear_solver is DirectSolver and condensable else math.inf)
        try:
            yield
        finally:
            A.allow(math.inf)

    @property
    def _condensable(self) -> bool:
        """Whether supports hold the bodies, and contact points are nodes, none of which is tied, on foundations of
        given motion; collective."""
        seen, (first, last) = self._reference.nodes_in_rows, self._reference.B.getOwnershipRangeColumn()
        nodal = len(seen) == len(self._reference.nodes) and bool(np.all((3 * seen >= first) & (3 * seen < last)))
        nodal = nodal and (not self.elasticity.constraints.ties or not self._reference.slip_prescribed)
        held = not self.loaded_foundations and not len(self.elasticity.free)
        return bool(self.comm.allreduce(nodal and held, op=MPI.LAND))

    def _fit(self, work: Work, formed: bool) -> bool:
        """Whether factors of K fit into the memory, where A is formed or not, the same on all ranks; collective."""
        return bool(self.comm.bcast(fits(work, self._single, first_room(self.comm), formed)))

    def change_method(self, why: str, condense: bool = False) -> bool:
        """To the next method, if there is one, and its factors fit into the memory; condensed Newton systems only if
        `condense`; whether it is done; collective."""
        now = self.present
        left = [number for number, one in enumerate(self._methods) if number and one.is_tried_after(now, condense)]
        if not left:
            return False
        then, *others = self._methods[left[0] :]
        with timed(self._seconds, "stiffness"):
            fronts, work = self._fronts(then.explicit)
        fit = self._fit(work, then.explicit)
        if self.comm.rank == 0:
            _log.warning("%s; %s", why, f"{then.words} instead" if fit else "factors of K do not fit into the memory")
        if fit:
            self._methods = [replace(then, why=f"{why}; {then.words} instead", fronts=fronts), *others]
            self._latest = self._rounding = None
            self._factors_of.clear()
        self._patience = math.inf
        return fit

    @property
    def advice(self) -> str:
        """What the user may choose otherwise where no method has an answer, after a semicolon."""
        if self._given[0] is IterativeSolver:
            return '; with linear_solver = "auto" or "direct" products by A are more accurate'
        return ""

    @property
    def _single(self) -> bool:
        """Whether factors of K are expected to be in single precision where that is faster; collective."""
        return not self.in_double and not self._ill_conditioned

    @cached_property
    def _ill_conditioned(self) -> bool:
        return ill_conditioned(self.elasticity)

    @property
    def in_double(self) -> bool:
        """Whether factors are in double precision from the beginning, as many load steps then take less time."""
        return self.load_steps >= _DOUBLE_FROM and self._unknowns["displacement"] <= _DOUBLE_UP_TO

    @property
    def linear_solver(self) -> LinearSolver:
        """The solver class for K^-1; collective."""
        return self.present.linear_solver

    @property
    def explicit(self) -> bool:
        """Whether A is formed; collective."""
        return self.present.explicit

    @cached_property
    def interface(self) -> int:
        """Displacements on which contact forces act, over all ranks: of pairs of faces those of both; A is formed from
        as many columns of K^-1."""
        mine = 3 * len(self._reference.nodes_in_rows)  # nodes at the border of ranks count twice
        return max(int(self.comm.allreduce(mine)), self._unknowns["contact"])


def _turn(before: ContactSurface, after: ContactSurface) -> FloatArray:
    """T with frames of `after` = T times frames of `before`, point by point, shape (m, 3, 3)."""
    return after.frames @ inverse_frames(before.frames).transpose(0, 2, 1)
