"""A body with its contact faces: everything that does not depend on time, computed once and shared by all states."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import repeat
from typing import Protocol

import numpy as np
from mpi4py import MPI

from ..arrays import FloatArray
from ..fem.bodies import Deformable, Loading, unjoined_parts
from ..fem.contact import ContactSurface, KeptMatrix, Pair, rows_of
from ..fem.geometry import RigidFoundation, RigidMotion, Spin, same_place, since_at, spin
from ..fem.meshes import NamedMesh
from ..linalg.compliance import (
    EXPLICIT_UP_TO,
    BodyCompliance,
    DirectSolver,
    IterativeSolver,
    LinearSolver,
    Measures,
    Precision,
    StiffnessSolver,
    chosen,
    factorise,
    fits,
    patience,
    undecided,
)
from ..linalg.factors import (
    DistributedMultifrontalSolver,
    Front,
    MultifrontalSolver,
    SharedSymbolic,
    Work,
    predicted_work,
    symbolic,
)
from ..linalg.reductions import Reductions
from ..solvers.laws import FrictionLaw
from ..solvers.rigid_motions import RigidMotions
from .accumulated import Accumulated
from .conditioning import ill_conditioned, measures_of, on_soft_springs
from .contact import Contact
from .contact_faces import ContactFaces, oriented
from .contact_stiffness import ContactStiffness
from .evidence import rounding_forces
from .free_memory import least_room
from .probes import LocatedProbes, Part, Probe
from .stopwatch import timed


@dataclass(frozen=True)
class ContactState:
    """A contact problem at one time; this rank's m contact points.

    Attributes:
        elasticity: The body with the coefficients of its stiffness at this time.
        loading: Loads and prescribed displacements.
        rigid_motions: Of the foundations of the faces.
        spins: Axis and angular velocity of the foundations of the faces; None where there is no rotation.
        surface: Contact points with their frames, gaps and B, for the foundations at this time.
        law: Of friction at the contact points.
        slip_rate: Slip rate in the load step before, metres per second, shape (m,); 0 without one.
        slip_origin: Displacement of the contact points from which slip is measured, along n, t1, t2, metres, shape (m,
            3): 0 at first, in a later load step that after the step before, moved with the foundation.
        accumulated: Slip, friction work and largest pressure of the load steps before.
    """

    elasticity: Deformable
    loading: Loading
    rigid_motions: tuple[RigidMotion, ...]
    spins: tuple[Spin | None, ...]
    surface: ContactSurface
    law: FrictionLaw
    slip_rate: FloatArray
    slip_origin: FloatArray
    accumulated: Accumulated

    @property
    def time(self) -> float:
        """The time of loads and foundations in seconds."""
        return self.loading.time


class Before(Protocol):
    """Start of a load step: time, displacement (k, 3) in metres, slip rates (m,) in m/s and what has accumulated, after
    the step before."""

    @property
    def time(self) -> float: ...

    @property
    def displacement(self) -> FloatArray: ...

    @property
    def slip_rate(self) -> FloatArray: ...

    @property
    def accumulated(self) -> Accumulated: ...


def rigid_motions(elasticity: Deformable, surface: ContactSurface, loading: Loading) -> RigidMotions | None:
    """The motions that contact alone prevents, with the loads along them; None if supports prevent all; collective."""
    free = elasticity.free
    if not len(free):
        return None
    R = elasticity.free_part(free.modes(elasticity.x))
    G = np.stack([rows_of(surface.free_B, R[:, :, number]).ravel() for number in range(len(free))])
    e = elasticity.comm.allreduce(np.einsum("kcq,kc->q", R, loading.load), op=MPI.SUM)
    return RigidMotions(G, e, tuple(map(str, free.motions)))


def refuse_untouched(elasticity: Deformable, surface: ContactSurface) -> None:
    """Check that every component that supports do not hold has contact points; collective.

    Raises:
        ValueError: On every rank, with the component and its motions.
    """
    free = elasticity.free
    if not len(free):
        return
    R = elasticity.free_part(free.modes(elasticity.x))
    for number in dict.fromkeys(motion.component for motion in free.motions):
        own = [k for k, motion in enumerate(free.motions) if motion.component == number]
        moved = [rows_of(surface.free_B, R[:, :, k]) for k in own]  # all of them, on every rank
        if not elasticity.comm.allreduce(bool(np.any(moved)), op=MPI.LOR):
            moves = ", ".join(str(free.motions[k]) for k in own)
            raise ValueError(
                f"nothing holds {free.bodies[number]}: it has no contact face; clamps and springs leave it free: it "
                f"{moves}; give it a clamp, a spring or a contact"
            )


_log = logging.getLogger(__name__)

_PRODUCTS = 1000
"""Products by A in a load step after which Newton systems are condensed: four times as many as bent parts need."""

_DENSE_UP_TO = 6000
"""Contact unknowns up to which Newton systems are factorised where nothing else has an answer: 10 s each."""

_DOUBLE_FROM, _DOUBLE_UP_TO = 8, 50_000
"""Load steps from which, and displacement unknowns up to which (half a gigabyte), factors in double precision take less
time in all than in single precision."""


@dataclass(frozen=True)
class _Positioned:
    """A contact surface, the motions of the foundations for which it was computed, and the factors of the gaps."""

    surface: ContactSurface
    motions: Sequence[RigidMotion]
    gap_factors: FloatArray

    def is_at(self, motions: Sequence[RigidMotion], gap_factors: FloatArray) -> bool:
        """Whether foundations moved like this have the same surface."""
        return bool(np.array_equal(gap_factors, self.gap_factors)) and all(map(same_place, motions, self.motions))


class ContactBody:
    """An elastic body and its contact faces: K, K^-1 and A, each computed when first needed.

    Args:
        make: Makes the body: K, loads and supports.
        comm: The ranks that share it.
        contacts: The contact faces.
        time: Time of the reference frames in which A is computed; for other frames it is rotated.
        linear_solver: DirectSolver or IterativeSolver for K^-1; by default the one that is predicted to be faster.
        explicit: Whether to form the matrix A; by default chosen by size.
        probes: Points at which displacement, slip and pressure are reported.

    Attributes:
        contacts: The contact faces; of pairs of deformable faces with the slave as face.
        chosen: Which face of every pair is the slave, in words.
        elasticity: K, loads and supports.
        probes: The probes, found in the mesh.
        seconds: Wall time of assembly, factorisation and A so far.
        kept_matrix: The contact matrix of the evidence.
        changed: Why another method than the one that was chosen first is used for K^-1 or A; empty if none is.

    Raises:
        ValueError: On every rank, if the input is inconsistent.
    """

    def __init__(
        self,
        make: Callable[[], Deformable],
        comm: MPI.Comm,
        contacts: Sequence[Contact],
        time: float,
        linear_solver: LinearSolver | None,
        explicit: bool | None,
        probes: Sequence[Probe] = (),
    ):
        chosen(0, 0, comm.size, linear_solver, explicit)  # impossible combinations are refused before the assembly
        self.seconds: dict[str, float] = {}
        with timed(self.seconds, "assembly"):
            self.elasticity = make()
            self.contacts, self.chosen = oriented(self.elasticity, contacts)
            touching = unjoined_parts(self.elasticity, [(c.face, c.against) for c in contacts if c.against is not None])
            for text in touching if self.comm.rank == 0 else ():  # before these are refused as parts that nothing holds
                _log.warning("%s", text)
            faces, still = ContactFaces(self.contacts, self.comm), (RigidMotion(np.zeros(3)),) * len(self.contacts)
            self._reference: ContactSurface = faces.surface(self.elasticity, still, time)
            self._faces = faces.against(self._reference.foundations)  # the plane of the face if none was given
            self._latest = _Positioned(self._reference, still, faces.gap_factors(time))
            self._reference = self.surface(self.rigid_motions(time), time)
            refuse_untouched(self.elasticity, self._reference)
            self.probes = self.located(probes)
        for text in (*self.elasticity.contradictions, *self._reference.remarks):
            if self.comm.rank == 0:
                _log.warning("%s", text)
        self._given, self._load_steps = (linear_solver, explicit), 1
        self._symbolic: list[Front] | SharedSymbolic | None = None
        self._work: Work | None = None
        self.changed, self._condensed, self._may_condense = "", False, True
        self._dense = False
        self._rounding: tuple[object, float, FloatArray] | None = None
        self.kept_matrix = KeptMatrix()
        self._stiffness: ContactStiffness | None = None

    def expect_load_steps(self, steps: int) -> None:
        """Declare how many load steps are to come, by default one; without effect on what has been computed before.

        For more steps factors of K pay, as every later step then costs only products.
        """
        self._load_steps = max(steps, 1)

    @cached_property
    def _chosen(self) -> tuple[LinearSolver, bool]:
        """The solver for K, and whether A is formed, the same on all ranks; collective.

        Bodies of the user's forms, whose stiffness is assembled when it is needed, are judged by their size.
        """
        comm, m, (linear_solver, explicit) = self.comm, self.interface, self._given
        n = self.unknowns["displacement"]
        if not undecided(n, m, linear_solver, explicit) or self.elasticity.forms() is not None:
            return chosen(n, m, comm.size, linear_solver, explicit)
        with timed(self.seconds, "stiffness"):
            formed = m <= EXPLICIT_UP_TO
            found, work = self._fronts(formed)
            soft, room = on_soft_springs(self.elasticity), least_room(comm)
            direct = factorise(work, self.measures, self._load_steps, soft, self.precision, room, comm.size, formed)
            if not comm.bcast(direct):  # sums over the ranks may differ by rounding errors
                self._work = work
                return IterativeSolver, False
            self._symbolic = found
        return DirectSolver, formed

    def _fronts(self, contact_last: bool) -> tuple[list[Front] | SharedSymbolic, Work]:
        """The fronts of K, and what a factorisation takes; collective."""
        K, x, comm = self.elasticity.K, self.elasticity.x, self.comm
        last = self._reference.nodes_in_rows if contact_last else np.empty(0, dtype=np.int64)
        if comm.size == 1:
            fronts = symbolic(K, x, last)
            return fronts, predicted_work(fronts)
        shared = SharedSymbolic(K, x, last)
        return shared, shared.work()

    @contextmanager
    def limited(self, solver: StiffnessSolver) -> Iterator[None]:
        """No more iterations of multigrid than its `patience`, where it was chosen by predicted time and the factors
        fit into the memory; collective.

        Args:
            solver: K^-1 of this body.
        """
        formed = self.interface <= EXPLICIT_UP_TO
        if self._work is None or not isinstance(solver, IterativeSolver) or not self._fit(self._work, formed):
            yield
            return
        allowed = patience(self._work, self.measures, self._load_steps, self.precision, self.comm.size, formed)
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
        """Whether condensed Newton systems may be tried: K is factorised, supports hold the bodies, and a contact point
        is a node; collective."""
        seen, (first, last) = self._reference.nodes_in_rows, self._reference.B.getOwnershipRangeColumn()
        nodal = len(seen) == len(self._reference.nodes) and bool(np.all((3 * seen >= first) & (3 * seen < last)))
        mine = nodal and self._may_condense and self._given[1] is None and len(self.elasticity.free) == 0
        return self.linear_solver is DirectSolver and bool(self.comm.allreduce(mine, op=MPI.LAND))

    @property
    def condensed(self) -> bool:
        """Whether Newton systems are made of K with springs in place of A (`CondensedSystem`), where the user chooses
        no solver: from the beginning where a body bends and A is not formed; collective."""
        return self._condensed or (not self.explicit and self._condensable and ill_conditioned(self.elasticity))

    @property
    def dense(self) -> bool:
        """Whether Newton systems are factorised with the formed A, where the user chooses no solver and condensed ones
        have failed."""
        return self.explicit and self._dense

    def _fit(self, work: Work, formed: bool) -> bool:
        """Whether factors of K fit into the memory, where A is formed or not, the same on all ranks; collective."""
        return bool(self.comm.bcast(fits(work, self.precision is Precision.SINGLE, least_room(self.comm), formed)))

    def change_method(self, why: str, condense: bool = False) -> bool:
        """From multigrid to factors of K, from products by A to condensed Newton systems, or from solves with factors
        to a formed A, from now on, if that is not against the user's choice and fits into the memory; whether it is
        done, the same on all ranks; collective.

        Args:
            why: What the present method did not do.
            condense: Whether condensed Newton systems may help.
        """
        condense = condense and self._condensable and not self.condensed
        solver, explicit = self._given
        if self.linear_solver is IterativeSolver and solver is None:
            explicit, then = self.interface <= EXPLICIT_UP_TO if explicit is None else explicit, "K is factorised"
        elif condense:
            explicit, then = False, "Newton systems are made of K with springs in place of A"
        elif self.linear_solver is DirectSolver and explicit is None and not self.explicit:
            explicit, then = True, "A is formed"
            self._dense = self.condensed and self.comm.size == 1 and self.unknowns["contact"] <= _DENSE_UP_TO
            self._may_condense = False
        else:
            return False
        with timed(self.seconds, "stiffness"):
            found, work = self._fronts(explicit)
        fit = self._fit(work, explicit)
        if self.comm.rank == 0:
            _log.warning("%s; %s", why, f"{then} instead" if fit else "factors of K do not fit into the memory")
        if fit:
            self.changed, self._symbolic, self._stiffness = f"{why}; {then} instead", found, None
            self._chosen, self._condensed = (DirectSolver, explicit), condense
        self._work = None  # and no limit
        return fit

    @cached_property
    def measures(self) -> Measures:
        """What decides how long multigrid takes; collective."""
        return measures_of(self._reference, self.elasticity, self.unknowns["displacement"], self.interface)

    @property
    def precision(self) -> Precision:
        """Expected of factors of K; collective."""
        if self.in_double:
            return Precision.DOUBLE
        return Precision.REPEATED if ill_conditioned(self.elasticity) else Precision.SINGLE

    @property
    def in_double(self) -> bool:
        """Whether factors are in double precision from the beginning, as many load steps then take less time."""
        return self._load_steps >= _DOUBLE_FROM and self.unknowns["displacement"] <= _DOUBLE_UP_TO

    @property
    def linear_solver(self) -> LinearSolver:
        """The solver class for K^-1 (DirectSolver: by nested dissection, see `stiffness_method`); collective."""
        return self._chosen[0]

    @property
    def explicit(self) -> bool:
        """Whether A is formed; collective."""
        return self._chosen[1]

    @property
    def comm(self) -> MPI.Comm:
        """The ranks that share the body."""
        return self.elasticity.comm

    @property
    def mesh(self) -> NamedMesh:
        """The mesh of the body, if there is one body only."""
        return self.elasticity.alone.mesh

    @property
    def foundations(self) -> tuple[RigidFoundation | None, ...]:
        """Foundations of all contact faces before any motion; by default the plane of the face; None against a
        deformable face."""
        return tuple(self._faces.foundations)

    def located(self, probes: Sequence[Probe]) -> LocatedProbes:
        """Probes found in the mesh; collective.

        Raises:
            ValueError: On every rank, if two have the same name, or a point is outside the body.
        """
        members = self.elasticity.members
        faces = [self.elasticity.face(contact.face, "contact") for contact in self.contacts]
        parts = [Part(member.name, member.body, member.nodes) for member in members]
        return LocatedProbes(probes, parts, [(member.name, facets) for member, facets in faces])

    @cached_property
    def unknowns(self) -> dict[str, int]:
        """Free displacement unknowns and contact unknowns, over all ranks."""
        free = 3 * len(self.elasticity.x) - self.elasticity.held.number
        contact = 3 * len(self._reference.nodes)
        return {
            "displacement": self.comm.allreduce(free, op=MPI.SUM),
            "contact": self.comm.allreduce(contact, op=MPI.SUM),
        }

    @cached_property
    def interface(self) -> int:
        """Displacements on which contact forces act, over all ranks: of pairs of faces those of both; A is formed from
        as many columns of K^-1."""
        mine = 3 * len(self._reference.nodes_in_rows)  # nodes at the border of ranks count twice
        return max(int(self.comm.allreduce(mine, op=MPI.SUM)), self.unknowns["contact"])

    # --- state at a time ----------------------------------------------------------------------------------------------

    def refuse_undefined(self, time: float) -> None:
        """Check that loads, supports, motions, gaps and friction have values at a time, such as the end of a history;
        collective.

        Raises:
            ValueError: On every rank, if an amplitude or a motion has none.
        """
        self.elasticity.at_time(time).at(time)
        self.rigid_motions(time)
        for contact in self.contacts:
            contact.friction_factor(time, self.comm)
            contact.gap_factor(time, self.comm)

    def rigid_motions(self, time: float) -> tuple[RigidMotion, ...]:
        """Of the foundations of all contact faces at a time; collective."""
        return self._faces.rigid_motions(time)

    def pair(self, number: int) -> Pair:
        """The pair of faces of a contact against a deformable face; collective."""
        return self._faces.pair(number, self.elasticity)

    def given_gap(self, surface: ContactSurface, time: float) -> FloatArray:
        """The gaps given with the contacts at a time, at the points of a surface of this body, metres, shape (m,);
        collective."""
        given: FloatArray = self._faces.gap_factors(time)[surface.part] * surface.gap_field
        return given

    def foundation_displacement(self, surface: ContactSurface, then: float, now: float) -> FloatArray:
        """Displacement of the foundations' surfaces between two times at the contact points, metres, shape (m, 3);
        collective.

        Besides the rigid motion, that of a changing gap along the normals.
        """
        moved = since_at(self.rigid_motions(now), self.rigid_motions(then), surface.part, surface.x)
        closed = self.given_gap(surface, now) - self.given_gap(surface, then)
        moved += closed[:, None] * surface.frames[:, 0]
        return moved

    def surface(self, motions: Sequence[RigidMotion], time: float) -> ContactSurface:
        """The contact surface with the foundations of the faces moved, and their gaps at a time; collective.

        Frames and B are the same objects for all positions of the foundations with the same normals.

        Raises:
            ValueError: On every rank, if the set of contact nodes changes.
        """
        factors = self._faces.gap_factors(time)
        if self.comm.allreduce(self._latest.is_at(motions, factors), op=MPI.LAND):
            return self._latest.surface
        after, before = self._faces.surface(self.elasticity, motions, time), self._reference
        if not self.comm.allreduce(np.array_equal(before.nodes, after.nodes), op=MPI.LAND):
            raise ValueError(f"contact: at time {time:g} the foundation's normals make other nodes contact nodes")
        turned = not np.allclose(before.frames, after.frames, rtol=0.0, atol=1e-14)
        if not self.comm.allreduce(turned, op=MPI.LOR):
            after = replace(after, frames=before.frames, B=before.B, free_B=before.free_B)
        self._latest = _Positioned(after, motions, factors)
        return after

    def state(self, time: float, before: Before | None = None) -> ContactState:
        """The state at a time; collective.

        Args:
            time: The time.
            before: End of the load step before: slip is measured from its displacement plus the foundation's
                displacement since; by default from zero displacement.

        Raises:
            ValueError: On every rank, if an amplitude or a motion has no value then, or the set of contact nodes
                changes.
        """
        motions = self.rigid_motions(time)
        surface = self.surface(motions, time)
        spins = tuple(spin(motion, None, 1.0) for motion in motions)
        origin: FloatArray = np.zeros_like(surface.x)
        slip_rate: FloatArray = np.zeros(len(surface.x))
        accumulated = Accumulated.none(len(surface.x))
        if before is not None:
            then = self.rigid_motions(before.time)
            carried = since_at(motions, then, surface.part, surface.x)
            slip_rate, accumulated = before.slip_rate, before.accumulated
            origin = surface.rows(before.displacement) + surface.components(carried)
            spins = tuple(map(spin, motions, then, repeat(time - before.time)))
        law = self._faces.law(surface, time, slip_rate)
        elasticity = self.elasticity.at_time(time)
        return ContactState(
            elasticity, elasticity.at(time), motions, spins, surface, law, slip_rate, origin, accumulated
        )

    def rounding_forces(self, elasticity: Deformable, u: FloatArray) -> FloatArray:
        """`evidence.rounding_forces` of this body in a state; they are proportional to the largest displacement, and
        computed anew only where the stiffness changes; collective."""
        motion = Reductions(self.comm).max(np.abs(u))
        if self._rounding is None or self._rounding[0] is not elasticity.K or not 0.0 < self._rounding[1] < math.inf:
            self._rounding = elasticity.K, motion, rounding_forces(elasticity, u)
        forces: FloatArray = self._rounding[2] * (motion / self._rounding[1] if motion != self._rounding[1] else 1.0)
        return forces

    # --- K^-1 and A ---------------------------------------------------------------------------------------------

    @property
    def stiffness_method(self) -> str:
        """Name of the solver for K^-1."""
        if self.linear_solver is DirectSolver:
            return (MultifrontalSolver if self.comm.size == 1 else DistributedMultifrontalSolver).method
        return self.linear_solver.name

    @property
    def stiffness_solver(self) -> StiffnessSolver:
        """K^-1 of `elasticity`."""
        return self.stiffness(self.elasticity).solver

    def stiffness(self, elasticity: Deformable, seconds: dict[str, float] | None = None) -> ContactStiffness:
        """K^-1 and A of this body with the coefficients of a state; those of the last state asked for are kept.

        Args:
            elasticity: The body in that state.
            seconds: Dictionary to which wall times are added; by default that of the body.
        """
        if self._stiffness is None or self._stiffness.elasticity.K is not elasticity.K:
            first, spent = self._stiffness is None, self.seconds if seconds is None else seconds
            solver, explicit = self._chosen
            double = first and self.in_double
            self._stiffness = ContactStiffness(
                elasticity, self._reference, solver, explicit, spent, self._symbolic, double
            )
        return self._stiffness
