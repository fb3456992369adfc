"""A body with its contact faces, which all times share, and its state at one of them.

The faces have foundations or faces against them at any time, and a common surface.
"""

from __future__ import annotations

import copy
import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from mpi4py import MPI

from ..arrays import BoolArray, FloatArray, IntArray
from ..fem.bodies import Deformable, End, Loading, locking_by_volume, unjoined_parts
from ..fem.contact import (
    ContactSurface,
    FullyHeld,
    KeptMatrix,
    Pair,
    Pretension,
    Tied,
    refuse_uneven_sectors,
    refuse_uneven_supports,
    rows_of,
    with_unknowns,
)
from ..fem.geometry import Refused, RigidMotion, Spin, same_place, since_at, spin
from ..linalg.compliance import LinearSolver, chosen
from .contact import Contact
from .contact_faces import ContactFaces, StatePoints, slaves_as_faces
from .contact_stiffness import ContactStiffness
from .heat import HeatProblem
from .held_nodes import HeldInPairs, refuse_held_inside
from .linear_problem import ContactState
from .memory import memory_needed
from .nodal_answer import Accumulated
from .overlap import OutsideContacts
from .pair_checks import JudgedPair
from .probes import LocatedProbes, Probe
from .provenance import timed
from .state import State

_log = logging.getLogger(__name__)


def refuse_untouched(elasticity: Deformable, surface: ContactSurface) -> None:
    """Check that every component that supports do not hold has contact points; collective."""
    free = elasticity.free
    if not len(free):
        return
    R = elasticity.free_unknowns
    for number in dict.fromkeys(motion.component for motion in free.motions):
        own = [k for k, motion in enumerate(free.motions) if motion.component == number]
        moved = [rows_of(surface.free_B, R[:, :, k]) for k in own]  # all of them, on every rank
        if not elasticity.comm.allreduce(bool(np.any(moved)), op=MPI.LOR):
            moves = ", ".join(str(free.motions[k]) for k in own)
            raise Refused(
                f"nothing holds {free.bodies[number]}: it has no contact face; clamps and springs leave it free: it "
                f"{moves}; give it a clamp, a spring or a contact"
            )


def refuse_tied(elasticity: Deformable, contacts: Sequence[Contact]) -> None:
    """Check that no tie holds both faces of a pair together, unless for some time: the same faces, or parts of them of
    which all nodes on the slave of the tie are tied; collective."""
    comm = elasticity.comm

    def some(which: BoolArray) -> bool:
        return bool(comm.allreduce(bool(np.any(which)), op=MPI.LOR))

    lasting = [id(one) for one in elasticity.constraints.lasting]
    for tie in (one for one in elasticity.constraints.every if one.kind in (Tied.kind, Pretension.kind)):
        masters = elasticity.nodes(tie.against, tie.kind)
        for contact in contacts:
            faces = (contact.face, contact.against)
            if None in faces or (id(tie) in lasting and set(faces) == {tie.face, tie.against}):
                continue
            own, other = (elasticity.nodes(str(name), "contact") for name in faces)
            tied = set(faces) == {tie.face, tie.against}
            for one, opposite in ((own, other), (other, own)):
                beyond, beside = some(~np.isin(one, tie.nodes)), some(np.isin(opposite, masters))
                tied |= beside and not beyond
            if tied:
                raise ValueError(
                    f"contact of {contact.face!r} with {contact.against!r}: the {tie.kind} of {tie.face!r} and "
                    f"{tie.against!r} holds these faces together, so that they neither open nor slip: leave out one"
                    + (", or give both the same faces" if id(tie) in lasting else "")
                )


@dataclass(frozen=True, eq=False)
class _Positioned:
    """A contact surface, the motions of the foundations for which it was computed, and the factors of the gaps."""

    surface: ContactSurface
    motions: Sequence[RigidMotion]
    gap_factors: FloatArray

    def is_at(self, motions: Sequence[RigidMotion], gap_factors: FloatArray) -> bool:
        return bool(np.array_equal(gap_factors, self.gap_factors)) and all(map(same_place, motions, self.motions))


class ContactBody:
    """An elastic body and its contact faces.

    `make` makes the body, with K, loads and supports; at `time` are the reference frames in which A is computed (for
    others it is rotated); the other arguments are those of `ContactProblem`.

    Attributes:
        contacts: The contact faces; of pairs of deformable faces with the slave as face.
        chosen: Which face of every pair is the slave, in words.
        foundations: Of all contact faces before any motion; by default the plane of the face; None against a
            deformable face.
        foundation_loads: Force and moment on them.
        elasticity: K, loads and supports.
        probes: The probes, found in the mesh.
        seconds: Wall time of assembly, factorisation and A so far.
        kept_matrix: The contact matrix of the evidence.
        judged_pairs: By the number of the contact, by what the evidence judges its pair.
        held_in_pairs: The nodes of pairs that supports hold on both sides.
        remarks: What a user should know of supports, contact faces and elements.
        unknowns: Free displacement unknowns and contact unknowns, over all ranks.
        stiffness: K^-1 and A, and the method by which they are computed.
        heat: Conduction of heat; None without.
        undeformed: The same before any deformation, of bodies that are linearised at a deformed place; else None.
        motion_factors: By which the given motions of the foundations are multiplied, shape (faces,); None for 1.
    """

    heat: HeatProblem | None = None
    undeformed: ContactBody | None = None
    motion_factors: FloatArray | None = None

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
        self.comm, self.seconds = comm, dict[str, float]()
        with timed(self.seconds, "assembly"):
            self.elasticity = make()
            self.contacts, self.chosen = slaves_as_faces(self.elasticity, contacts)
            refuse_tied(self.elasticity, self.contacts)
            refuse_uneven_sectors(self.elasticity)
            pairs = [(c.face, c.against) for c in contacts if c.against is not None]
            pairs += [(tie.face, tie.against) for tie in self.elasticity.constraints.ties if tie.of_faces]
            touching = unjoined_parts(self.elasticity, pairs)
            for text in touching if self.comm.rank == 0 else ():  # before these are refused as parts that nothing holds
                _log.warning("%s", text)
            self._methods, self._by_supports = (linear_solver, explicit), {self.elasticity.acting: self}
            self._take(self.elasticity, time)
            self.probes = self.located(probes)

    def _take(self, elasticity: Deformable, time: float) -> None:
        """Find contact faces and unknowns of the bodies, with the supports that act at a time; collective."""
        self.elasticity, self._faces = elasticity, ContactFaces(self.contacts, elasticity, time)
        self.foundations, self.foundation_loads = tuple(self._faces.foundations), self._faces.loads
        self.held_in_pairs = HeldInPairs(self.contacts, elasticity, self.pair)
        motions = self._faces.foundation_motions(time)
        try:
            reference = self._faces.surface(elasticity, motions, time)
        except FullyHeld:  # a contradiction says more
            then = elasticity.at_time(time)
            self.refuse_wrong_supports(then, then.at(time))
            raise
        self._latest = {elasticity.constraints.locked: _Positioned(reference, motions, self._faces.gap_factors(time))}
        refuse_untouched(elasticity, reference)
        self._references = {elasticity.constraints.locked: reference}  # with the unknowns of which bolts are locked
        of_ties = (text for tie in elasticity.constraints.ties for text in tie.remarks)
        self.remarks = (*elasticity.contradictions, *reference.remarks, *of_ties, *locking_by_volume(elasticity))
        self.kept_matrix, self.judged_pairs = KeptMatrix(), dict[int, JudgedPair]()
        free, points = 3 * len(elasticity.x) - elasticity.held.number, 3 * len(reference.nodes)
        self.unknowns = {
            "displacement": self.comm.allreduce(free),
            "contact": self.comm.allreduce(points),
        }
        self.stiffness = ContactStiffness(
            elasticity, self._references, self.unknowns, *self._methods, seconds=self.seconds
        )
        self.stiffness.loaded_foundations = any(contact.load for contact in self.contacts)

    def keep_stiffness(self, known: ContactBody) -> None:
        """Take K^-1 and A of the same bodies with other values of material, supports, loads and contacts, as far as K
        is the same, or else its fronts, if contact points and the directions that are held are; collective."""
        self.stiffness.load_steps = known.stiffness.load_steps
        there, locked = known._by_supports.get(self.elasticity.acting), self.elasticity.constraints.locked
        theirs = None if there is None else there._references.get(locked)
        if there is None or theirs is None:
            return
        mine, held, others = self._references[locked], self.elasticity.held, there.elasticity.held
        pairs = [(mine.nodes, theirs.nodes), (mine.frames, theirs.frames)]
        pairs += [(held.nodes, others.nodes), (held.projector, others.projector)]
        if not self.comm.allreduce(all(map(np.array_equal, *zip(*pairs, strict=True))), op=MPI.LAND):
            return
        if not (mine.B.equal(theirs.B) and mine.free_B.equal(theirs.free_B)):
            return
        kept = replace(mine, B=theirs.B, free_B=theirs.free_B)
        self._references, self.stiffness = there._references, there.stiffness
        self._latest[locked] = replace(self._latest[locked], surface=kept)

    def at_time(self, time: float) -> ContactBody:
        """The same with the supports and ties that act at a time: itself if they are its own; ValueError on every rank
        as `ContactProblem`; collective."""
        known = self._of(self.elasticity.at_time(time), time)
        for other in self._by_supports.values():
            if other is not known:
                other.stiffness.forget()
        return known

    def _of(self, elasticity: Deformable, time: float) -> ContactBody:
        """The same with the supports and ties that act on bodies at a time; collective."""
        known = self._by_supports.get(elasticity.acting)
        if known is None:
            known = copy.copy(self)
            known._take(elasticity, time)
            known.stiffness.load_steps = self.stiffness.load_steps
            self._by_supports[elasticity.acting] = known
        return known

    def surface_of(self, elasticity: Deformable, time: float, poses: FloatArray | None) -> ContactSurface:
        """The contact surface of the bodies as they are at a time, with foundations under load in these poses;
        collective."""
        there = self._of(elasticity, time)
        return there.surface(there.foundation_motions(time, poses), time, elasticity)

    def points_of_states(self, surface: ContactSurface) -> StatePoints:
        """The contact points of states: those of a surface, or all nodes of the contact faces where which of them are
        contact points changes with supports and ties."""
        if self.elasticity.limits:
            return StatePoints.of_faces(self.elasticity, self.contacts)
        return StatePoints(surface.nodes, surface.part)

    def places(self, surface: ContactSurface) -> IntArray:
        """Numbers of the contact points of a surface among those of states, shape (m,)."""
        return self.points_of_states(surface).places(surface)

    @cached_property
    def outside(self) -> OutsideContacts:
        """What is outside of the contacts; collective."""
        return OutsideContacts(self.elasticity, self.contacts, self.foundations)

    def on_sides(self, elasticity: Deformable) -> ContactBody:
        """The same with bodies whose faces in contact with themselves have other sides, for what looks at contact faces
        before deformation; collective."""
        there = copy.copy(self)
        there.elasticity = elasticity
        vars(there).pop("outside", None)
        there.probes = there.located(self.probes.probes)
        return there

    def located(self, probes: Sequence[Probe]) -> LocatedProbes:
        """Probes found in the mesh; collective.  Raises ValueError as `Solution.probed`."""
        faces = [self.elasticity.face(contact.face, "contact") for contact in self.contacts]
        return LocatedProbes(probes, self.elasticity.members, [(member.name, facets) for member, facets in faces])

    def memory(self, method: tuple[LinearSolver, bool] | None = None) -> float:
        """Bytes that it needs over all ranks (`memory_needed`), by default with its own method; collective."""
        stiffness = self.stiffness
        linear_solver, explicit = method or (stiffness.linear_solver, stiffness.explicit)
        sizes = self.unknowns["displacement"], stiffness.interface, self.comm.size
        return memory_needed(*sizes, linear_solver, explicit, self.nodes_of_cell, stiffness.in_double)

    @property
    def nodes_of_cell(self) -> int:
        """The largest number of nodes of a cell."""
        return max(int(member.body.V.dofmap.dof_layout.num_dofs) for member in self.elasticity.members)

    def replace(self, elasticity: Deformable) -> None:
        """Take another stiffness (a tangent), loads and supports with the same nodes and held directions; states that
        are asked for afterwards (`ContactProblem.at`) have them; collective.

        Raises:
            ValueError: On every rank, if it has other nodes, or holds others.
        """
        before, same = self.elasticity, elasticity.x.shape == self.elasticity.x.shape
        same = same and np.array_equal(elasticity.x, before.x) and elasticity.held.number == before.held.number
        if not self.comm.allreduce(same, op=MPI.LAND):
            raise ValueError("replace: the other stiffness must be of the same mesh, with the same held directions")
        self.elasticity = elasticity
        self.stiffness.replace(elasticity)

    def with_motions(self, factors: FloatArray | None) -> ContactBody:
        """With these `motion_factors`."""
        there = copy.copy(self)
        there.motion_factors = factors
        return there

    # --- state at a time ----------------------------------------------------------------------------------------------

    def refuse_undefined(self, time: float) -> None:
        """Raise ValueError on every rank if an amplitude or a motion has no value at a time; collective."""
        self.elasticity.at_time(time).at(time)
        self.foundation_motions(time)
        if self.heat is not None:
            self.heat.conduction.factors(time)
        for contact in self.contacts:
            contact.friction_factor(time, self.comm)
            contact.gap_factor(time, self.comm)

    def refuse_wrong_supports(self, elasticity: Deformable, loading: Loading, exact: bool = False) -> None:
        """Refuse supports that hold nodes of contact faces inside foundations, or cut faces of a sector unevenly, with
        the bodies and what is prescribed at a time; arguments and errors as of `held_nodes.refuse_held_inside`;
        collective."""
        refuse_uneven_supports(elasticity, loading)
        time, given = loading.time, loading.prescribed
        refuse_held_inside(self.contacts, self.foundations, self.held_in_pairs, elasticity, time, given, exact)

    def foundation_motions(self, time: float, poses: FloatArray | None = None) -> tuple[RigidMotion, ...]:
        """Of all foundations at a time, of those under load with their `ContactState.poses`, by default 0;
        collective."""
        return self._faces.foundation_motions(time, poses, self.motion_factors)

    @cached_property
    def faces_meet(self) -> bool:
        """Whether a node is on several contact faces, and so has several contact points; collective."""
        nodes = np.concatenate([self.elasticity.nodes(contact.face, "contact") for contact in self.contacts])
        return bool(self.comm.allreduce(len(np.unique(nodes)) < len(nodes), op=MPI.LOR))

    def pair(self, number: int) -> Pair:
        return self._faces.pair(number, self.elasticity)

    @property
    def pairs(self) -> list[Pair]:
        """Of all contacts against a deformable face; collective."""
        against = [number for number, one in enumerate(self.contacts) if one.against is not None]
        return [self.pair(number) for number in against]

    def judged_pair(self, number: int) -> JudgedPair:
        """What judges the pair of a contact; collective."""
        known = self.judged_pairs.get(number)
        if known is None or known.pair is not self.pair(number):
            known = self.judged_pairs[number] = JudgedPair(self.elasticity, self.contacts[number], self.pair(number))
        return known

    def off_linear(self, surface: ContactSurface, u: FloatArray, given: FloatArray) -> tuple[FloatArray, FloatArray]:
        """`JudgedPair.off_linear` and `depths` at the contact points of a surface with given gaps (m,), metres, shapes
        (m,) and (2, m), 0 on foundations; collective."""
        off, depths = np.zeros(len(surface.nodes)), np.zeros((2, len(surface.nodes)))
        for number, contact in enumerate(self.contacts):
            if contact.against is not None:
                points, pair = surface.part == number, self.judged_pair(number)
                off[points] = pair.off_linear(u, surface.nodes[points], surface.frames[points, 0])
                depths[:, points] = pair.depths(u, given[points])
        return off, depths

    def recorded_poses(self, contents: Mapping[str, Any]) -> FloatArray | None:
        """`ContactState.poses` as a summary.json has them; None without foundations under load; ValueError if it does
        not fit."""
        names = self.foundation_loads.names
        if not names:
            return None
        poses = np.zeros((len(self.contacts), 6))
        try:
            pose_of = {one["face"]: [*one["translation"], *one["rotation"]] for one in contents["loaded_foundations"]}
            poses[list(names)] = [pose_of[name] for name in names.values()]
        except (KeyError, TypeError, ValueError):
            raise ValueError(
                "summary.json: loaded_foundations: has not the motions of the contacts under load"
            ) from None
        return poses

    def recorded_turns(self, contents: Mapping[str, Any]) -> FloatArray | None:
        """`State.turns` as a summary.json has them; None in small motions, and without rigid faces; ValueError if it
        does not fit."""
        motions = self.elasticity.constraints.motions
        if not any(motion.finite for motion in motions):
            return None
        try:
            turn_of = {one["face"]: one["rotation"] for one in contents["rigid_faces"]}
            turns = np.array([turn_of[motion.given.face] for motion in motions], dtype=np.float64)
            return turns.reshape(len(motions), 3)
        except (KeyError, TypeError, ValueError):
            raise ValueError("summary.json: rigid_faces: has not the rotations of the rigid faces") from None

    def given_gap(self, surface: ContactSurface, time: float) -> FloatArray:
        """The gaps given with the contacts at the points of a surface at a time, metres, shape (m,); collective."""
        return self._faces.gap_factors(time)[surface.part] * surface.gap_field

    def foundation_displacement(self, state: ContactState, before: State, x: FloatArray) -> FloatArray:
        """Displacement of the foundations in a load step at places x (m, 3) of the contact points, metres, shape
        (m, 3)."""
        then = self.foundation_motions(before.time, before.poses)
        return since_at(state.foundation_motions, then, state.surface.part, x)

    def surface(
        self, motions: Sequence[RigidMotion], time: float, elasticity: Deformable | None = None
    ) -> ContactSurface:
        """The contact surface with the foundations moved, and their gaps at a time, by default for the bolts that are
        locked at first; frames and B stay the same objects while the normals do; collective.

        Raises:
            ValueError: On every rank, if the set of contact nodes changes.
        """
        factors, elasticity = self._faces.gap_factors(time), elasticity or self.elasticity
        locked = elasticity.constraints.locked
        if locked not in self._latest:  # the same points, by other unknowns
            (first, *_), (known, *_) = self._references.values(), self._latest.values()
            if locked not in self._references:
                self._references[locked] = with_unknowns(elasticity, first)
            refuse_untouched(elasticity, self._references[locked])
            self._latest[locked] = replace(known, surface=with_unknowns(elasticity, known.surface))
        latest, before = self._latest[locked], self._references[locked]
        if self.comm.allreduce(latest.is_at(motions, factors), op=MPI.LAND):
            return latest.surface
        after = self._faces.surface(elasticity, motions, time)
        if not self.comm.allreduce(np.array_equal(before.nodes, after.nodes), op=MPI.LAND):
            raise ValueError(f"contact: at time {time:g} the foundation's normals make other nodes contact nodes")
        turned = not np.allclose(before.frames, after.frames, rtol=0.0, atol=1e-14)
        if not self.comm.allreduce(turned, op=MPI.LOR):
            same = before.slip_prescribed
            after = replace(after, frames=before.frames, B=before.B, free_B=before.free_B, slip_prescribed=same)
        self._latest[locked] = _Positioned(after, motions, factors)
        return after

    def slid(self, state: ContactState, u: FloatArray) -> ContactSurface:
        """As of `ContactFaces`, of a state here; collective."""
        return self._faces.slid(state.surface, state.elasticity, u, state.time)

    def state(self, time: float, before: State | None = None, poses: FloatArray | None = None) -> ContactState:
        """The state at a time, in which slip is measured from the end of the load step before, moved with the
        foundation since; by default from zero displacement; arguments and errors as of `ContactProblem.at`; foundations
        under load have these poses, by default those after the step before; collective."""
        elasticity = self.elasticity.at_time(time)
        poses = before.poses if poses is None and before is not None else poses
        motions = self.foundation_motions(time, poses)
        surface = self.surface(motions, time, elasticity)
        slip_rate: FloatArray = np.zeros(len(surface.x))
        accumulated, force = Accumulated.none(len(surface.x)), np.zeros_like(surface.x)
        if before is not None:
            at = self.places(surface)
            slip_rate, accumulated, force = before.slip_rate[at], before.accumulated.at(at), before.force_on_body[at]
        law = self._faces.law(surface, time, slip_rate)
        if before is None:
            elasticity.refuse_beginning(time)
        loading = elasticity.after(time, None if before is None else End(before.time, before.displacement))
        spins, origin = self._spins_and_origin(motions, surface, time, before)
        loaded = self._faces.loaded(elasticity, motions, time, poses)
        return ContactState(
            elasticity, loading, motions, spins, surface, law, slip_rate, origin, accumulated, force, loaded=loaded
        )

    def posed(self, state: ContactState, poses: FloatArray | None, before: State | None) -> ContactState:
        """The state with foundations under load in other poses (faces, 6); collective."""
        motions = self.foundation_motions(state.time, poses)
        surface = self.surface(motions, state.time, state.elasticity)
        spins, origin = self._spins_and_origin(motions, surface, state.time, before)
        loaded = self._faces.loaded(state.elasticity, motions, state.time, poses)
        return replace(
            state, foundation_motions=motions, surface=surface, spins=spins, slip_origin=origin, loaded=loaded
        )

    def shifted(self, state: ContactState, elasticity: Deformable, before: State | None) -> ContactState:
        """The state of bodies with nodes elsewhere, of which the given gaps stay, as the foundations do; collective."""
        pairs = zip(self.contacts, self.foundations, strict=True)
        contacts = tuple(one if rigid is None else replace(one, foundation=rigid) for one, rigid in pairs)
        faces, time = ContactFaces(contacts, elasticity, state.time), state.time
        surface = faces.surface(elasticity, state.foundation_motions, time)
        points = [(of.nodes, of.part) for of in (state.surface, surface)]
        if not self.comm.allreduce(all(np.array_equal(*of) for of in zip(*points, strict=True)), op=MPI.LAND):
            raise ValueError("along places: as nodes move, other nodes become contact points")
        gap = surface.gap + self.given_gap(state.surface, time) - self.given_gap(surface, time)
        surface = replace(surface, gap=gap, gap_field=state.surface.gap_field)
        spins, origin = self._spins_and_origin(state.foundation_motions, surface, time, before)
        return replace(state, elasticity=elasticity, surface=surface, spins=spins, slip_origin=origin)

    def _spins_and_origin(
        self, motions: Sequence[RigidMotion], surface: ContactSurface, time: float, before: State | None
    ) -> tuple[tuple[Spin | None, ...], FloatArray]:
        """Given rotations of the foundations, and the displacement from which slip counts, after a load step;
        collective."""
        start = time if before is None else before.time
        then = self.foundation_motions(start, None if before is None else before.poses)
        carried = surface.components(since_at(motions, then, surface.part, surface.x))
        spins = tuple(
            None if one.rotation is None else spin(now, earlier if before else None, time - start)
            for one, now, earlier in zip(self.contacts, motions, then, strict=True)
        )
        return spins, carried if before is None else surface.rows(before.displacement) + carried
