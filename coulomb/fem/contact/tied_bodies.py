"""Bodies of which some faces are tied to each other, move as rigid bodies, or are the sections of bolts.

Displacements follow from unknowns, u = T v + g (`Reduction`): those of nodes that follow no other, and those that
constraints have of their own.  Equilibrium is T^T (internal - outer forces) = F, with F the forces of bolts along their
own unknowns: the stiffness is T^T K T, as sparse as that of one mesh where the meshes match, and positive definite.
The rows of nodes that follow others, and of own unknowns that are prescribed, as the shortening of a locked bolt, have
a diagonal alone, as those of held directions.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse.csgraph import connected_components

from ...arrays import FloatArray, IntArray
from ..bodies import (
    LONGEST_CHAIN,
    TIE_STRESSES,
    Bolt,
    Deformable,
    End,
    FreeMotions,
    HeldDirections,
    Loading,
    Made,
    Member,
    NodalForces,
    Numbering,
    OpenedPart,
    Reduction,
    Tie,
    at_nodes_of,
    component_modes,
    distributed_rows,
    least_energy,
    null_space,
    rigid_modes,
    rows_of,
)
from ..meshes import fetched, starts_of
from .rigid_faces import FaceMotion, RigidFace
from .sections import Section, openings
from .ties import Tied, with_slaves


class TiedBodies(Deformable):
    """Bodies with ties; nodes, faces and loads are those of the bodies.

    Attributes:
        bodies: The bodies without ties.
        given: The ties, rigid faces and bolts as given.
        ties: These with their nodes, rigid faces first.
        face_motions: The motions of the rigid faces.
        sections: The sections of the bolts.
        locked: Whether the shortening of each of them is given.
        slaves: Which of this rank's nodes follow others, shape (k,).
    """

    def __init__(self, bodies: Deformable, given: Sequence[Tied | RigidFace], time: float = 0.0):
        self.bodies, self.given = bodies, tuple(given)
        self.x, self.materials, self.loads = bodies.x, bodies.materials, bodies.loads
        self.held, self.still = bodies.held, bodies.still
        self.contradictions, self.component, self.acting = bodies.contradictions, bodies.component, bodies.acting
        self.slaves: npt.NDArray[np.bool_] = np.zeros(len(self.x), dtype=bool)
        pairs = [{one.face, one.against} for one in self.given if isinstance(one, Tied)]
        for number, pair in enumerate(pairs):
            if pair in pairs[:number]:
                raise ValueError(f"ties: the pair of {' and '.join(map(repr, sorted(pair)))} is given twice")
        ties, moving = list[Tie](), list[object]()
        for one in self.given:
            tie, part = one.joined(bodies, self.slaves)
            ties.append(tie)
            moving.append(part)
            self.slaves[tie.nodes] = True
        self.ties = tuple(ties)
        self.face_motions = tuple(part for part in moving if isinstance(part, FaceMotion))
        self.sections = tuple(part for part in moving if isinstance(part, Section))
        self.locked = tuple(section.given.fixed(time) for section in self.sections)
        places = [part.place for part in moving if isinstance(part, FaceMotion | Section)]
        found = Reduction(bodies, ties, places)
        of_tie = {id(tie): own for tie, own in zip(ties, found.own, strict=True)}
        self._of_bolts = [of_tie[id(section.tie)].start for section in self.sections]
        for motion, (_, own, N, _) in zip(self.face_motions, found.weights, strict=False):  # rigid faces are first
            along = self.comm.allreduce(np.einsum("mcp,mcq->pq", motion.spread, N), op=MPI.SUM)
            found.stiffness[own, own] = (along.T * motion.given.stiffness) @ along
        self._unlocked, self._states = found, [self]
        self._made = self._with(self.locked)

    def _with(self, locked: Sequence[bool]) -> Made:
        of_locked = [own for own, one in zip(self._of_bolts, locked, strict=True) if one]
        return Made(reduction=self._unlocked.prescribing(of_locked))

    @property
    def limits(self) -> tuple[float, ...]:
        return (*self.bodies.limits, *(s.given.lock for s in self.sections if s.given.lock is not None))

    def held_at(self, time: float) -> HeldDirections:
        return self.bodies.held_at(time)

    def at_time(self, time: float) -> TiedBodies:
        """The same with the coefficients of K, and the bolts locked, at a time; T, ties and faces are shared unless
        other supports act; collective."""
        bodies, locked = self.bodies.at_time(time), tuple(section.given.fixed(time) for section in self.sections)
        for known in self._states:
            if known.bodies is bodies and known.locked == locked:
                return known
        if bodies.acting != self.acting:
            faces = [one for one in self.given if isinstance(one, RigidFace)]
            ties = with_slaves([one for one in self.given if isinstance(one, Tied)], self.ties)
            other = TiedBodies(bodies, [*faces, *ties], time)
        else:
            other = self.over(bodies)
            other.locked, other._made = locked, self._with(locked)
        self._states[1:] = [known for known in self._states[1:] if known.bodies is bodies]
        self._states.append(other)
        return other

    def over(self, bodies: Deformable) -> TiedBodies:
        """The same ties of the same bodies with another stiffness, or at another place."""
        other = copy.copy(self)
        other.bodies, other.x, other._made = bodies, bodies.x, self._with(self.locked)
        return other

    # --- free motions -------------------------------------------------------------------------------------------------

    @property
    def moving_together(self) -> tuple[IntArray, tuple[str, ...]]:
        return self._joined_components(self.ties)

    def resisted(self, modes: FloatArray) -> FloatArray:
        forces = self.bodies.resisted(modes)
        for motion in self._sprung:
            forces = forces - motion.spring_force(modes, motion.unit_stiffness(self.x, self.comm), self.comm)
        return forces

    def _opened(self, found: FreeMotions) -> FreeMotions:
        """With the motions in which bolts that are not locked become shorter and nothing is deformed; collective.

        The parts on the two sides of a section are bodies of their own there; of the motions of all of them against
        which nothing has energy, those are taken that change the lengths of bolts.
        """
        if all(self.locked):
            return found
        loose = np.flatnonzero(~np.array(self.locked))
        sections = [self.sections[k] for k in loose]
        part, names = self._joined_components([tie for tie in self.ties if not any(tie is s.tie for s in sections)])
        modes, parts = component_modes(self.x, part, self.comm)
        each = np.concatenate([np.where((part == k)[:, None, None], modes, 0.0) for k in range(len(parts))], axis=2)
        forces = self.reduction.prevented(each) + self.resisted(each)
        energy = self.comm.allreduce(np.einsum("kci,kcj->ij", each, forces), op=MPI.SUM)
        free = null_space(energy, least_energy(energy))
        motions = each @ free
        amounts = self.reduction.amounts(self.reduction.apart(motions))[[self._of_bolts[k] for k in loose]]
        ways, named = openings(amounts, sections)
        if not named:
            return found
        of_parts = (free @ ways).reshape(len(parts), 6, -1)
        numbers = [int(np.max(found.component[part == k], initial=-1)) for k in range(len(parts))]
        numbers = np.max(self.comm.allgather(numbers), axis=0).tolist()
        opened = [OpenedPart(*one) for one in zip(names, numbers, parts, of_parts, strict=True)]
        return found.opened(motions @ ways, named, opened)

    def _joined_components(self, ties: Sequence[Tie]) -> tuple[IntArray, tuple[str, ...]]:
        """The component of every node, where those of these ties are one, shape (k,), and their names; collective."""
        component, names = self.component, self.component_names
        starts, found = starts_of(self.comm, len(self.x)), [np.empty((0, 2), dtype=np.int64)]
        for tie in ties:
            entries = tie.rows.tocoo()
            masters = fetched(self.comm, starts, (entries.col // 3).astype(np.int64), component)
            found.append(np.unique(np.column_stack([component[tie.nodes[entries.row // 3]], masters]), axis=0))
            if tie.own.shape[2]:  # moved by the same unknowns
                together = np.unique(np.concatenate(self.comm.allgather(np.unique(component[tie.nodes]))))
                found.append(np.column_stack([together[:-1], together[1:]]))
        pairs = np.concatenate(self.comm.allgather(np.concatenate(found)))
        graph = scipy.sparse.coo_matrix((np.ones(len(pairs)), pairs.T), (len(names), len(names)))
        number = connected_components(graph, directed=False)[1].astype(np.int64)
        _, number = np.unique(number, return_inverse=True)
        groups = [[name for name, at in zip(names, number, strict=True) if at == k] for k in range(max(number) + 1)]
        return number[component], tuple(group[0] if len(group) == 1 else " with ".join(group) for group in groups)

    # --- loads and forces ---------------------------------------------------------------------------------------------

    def depends_on_steps(self, time: float) -> bool:
        return self.bodies.depends_on_steps(time)

    def at(self, time: float) -> Loading:
        return self.after(time, None)

    def refuse_beginning(self, time: float) -> None:
        self.bodies.refuse_beginning(time)
        for one in (section.given for section in self.sections):
            if one.force is not None and one.locked(time):
                raise ValueError(
                    f"{one.what}: at time {time:g} it is locked (lock = {one.lock:g}), at a length that only the load "
                    "steps before determine: begin at the time of lock or before"
                )

    def after(self, time: float, before: End | None) -> Loading:
        """Prescribed displacements are u with no unknowns: those of supports, rigid faces and bolts, which are locked
        at the own unknowns of the step before, and what follows them; collective."""
        kept: FloatArray = np.zeros(self.reduction.width)
        if before is not None:
            kept = self.reduction.amounts(self.reduction.apart(before.displacement))
        of_bodies, offset = self.bodies.after(time, before), np.zeros_like(self.x)
        for motion in self.face_motions:
            offset += motion.prescribed(self.x, time, self.comm)
        if self.face_motions:
            given = (float(np.max(np.abs(of), initial=0.0)) for of in (offset, of_bodies.prescribed))
            size = self.comm.allreduce(max(given), op=MPI.MAX)
            for motion in self.face_motions:
                motion.refuse_other(self.held_part(of_bodies.prescribed - offset), size, self.comm)
        y, found = np.zeros(self.reduction.width), self.reduction
        for section, own, locked in zip(self.sections, self._of_bolts, self.locked, strict=True):
            if locked:
                y[own] = section.given.value(time, self.comm) if section.given.force is None else kept[own]
        apart = offset = found.followed(offset) + found.moved(y)
        prescribed = found.lifted(found.with_own(of_bodies.prescribed, np.zeros(found.width)))
        for _ in range(LONGEST_CHAIN):  # u = W u + apart at slave nodes
            prescribed = prescribed + offset
            offset = found.followed(rows_of(found.W, offset))
            if not self.comm.allreduce(bool(np.any(offset)), op=MPI.LOR):
                break
        return replace(of_bodies, prescribed=prescribed, untied=of_bodies, apart=apart, tension=self._tension(time))

    def _tension(self, time: float) -> FloatArray:
        """The forces of bolts along own unknowns at a time, newtons, shape (width,); collective."""
        forces = np.zeros(self.reduction.width)
        for section, own in zip(self.sections, self._of_bolts, strict=True):
            if not section.given.fixed(time):
                forces[own] = section.given.value(time, self.comm)
        return forces

    def bolts(self, u: FloatArray) -> Iterator[Bolt]:
        y = self.reduction.amounts(self.reduction.apart(u))
        for section, own, locked in zip(self.sections, self._of_bolts, self.locked, strict=True):
            yield Bolt(section.tie.face, section.place, section.direction, float(y[own]), locked)

    def _lacking(self, imbalance: FloatArray, time: float) -> FloatArray:
        return self.reduction.lacking(imbalance, self._tension(time))

    def forces_of_ties(self, imbalance: FloatArray, time: float) -> FloatArray:
        return self.reduction.on_followed(self._lacking(imbalance, time))

    def shares_of_ties(self, imbalance: FloatArray, time: float) -> Iterator[NodalForces]:
        forces = self._lacking(imbalance, time)
        for tie in self.ties:
            share, own = np.zeros_like(forces), forces[tie.nodes]
            share[tie.nodes] = own
            beside = distributed_rows(tie.beside, (forces.size, tie.beside.shape[1]), self, None)
            share -= at_nodes_of(beside, own)
            beside.destroy()
            yield NodalForces(tie.kind.replace(" ", "_"), tie.face, share)

    def stresses_of_ties(self, imbalance: FloatArray, time: float) -> dict[str, FloatArray]:
        forces = self._lacking(imbalance, time)
        starts, found = starts_of(self.comm, len(self.x)), np.zeros((2, len(self.x)))
        for tie in self.ties:
            there = fetched(self.comm, starts, tie.traction.indices.astype(np.int64), forces)
            spread = scipy.sparse.csr_matrix(
                (tie.traction.data, np.arange(len(there)), tie.traction.indptr), (len(tie.nodes), len(there))
            )
            traction = spread @ there
            along = np.einsum("mi,mi->m", traction, tie.normal)
            found[:, tie.nodes] = along, np.linalg.norm(traction - along[:, None] * tie.normal, axis=1)
        return dict(zip(TIE_STRESSES, found, strict=True))

    def motions_of_faces(self, u: FloatArray, time: float) -> Iterator[tuple[str, FloatArray, FloatArray]]:
        for motion, (_, own, _, _) in zip(self.face_motions, self.reduction.weights, strict=False):
            given = motion.prescribed(self.x, time, self.comm)
            y = self.reduction.amounts(self.reduction.apart(u) - self.reduction.followed(given))[own]
            yield motion.given.face, motion.place, motion.values(time, self.comm) + motion.motions @ y

    # --- springs at reference points ----------------------------------------------------------------------------------

    @property
    def ground(self) -> FloatArray | None:
        if not self._sprung:
            return self.bodies.ground
        of_bodies, modes = self.bodies.ground, rigid_modes(self.x, self.comm)
        own = -sum(self._spring_forces_of_faces(modes), np.zeros_like(modes))
        return own if of_bodies is None else of_bodies + own

    @property
    def _sprung(self) -> list[FaceMotion]:
        """The rigid faces with springs at their reference points."""
        return [motion for motion in self.face_motions if np.any(motion.given.stiffness)]

    def _spring_forces_of_faces(self, u: FloatArray) -> list[FloatArray]:
        """The forces of each of these springs at displacements u (k, 3), or (k, 3, j); collective."""
        return [one.spring_force(u, one.given.stiffness, self.comm) for one in self._sprung]

    def spring_forces(self, u: FloatArray) -> Iterator[NodalForces]:
        yield from self.bodies.spring_forces(u)
        for motion, forces in zip(self._sprung, self._spring_forces_of_faces(u), strict=True):
            yield NodalForces("spring", motion.given.face, forces)

    def spring_force(self, u: FloatArray) -> FloatArray:
        return sum(self._spring_forces_of_faces(u), self.bodies.spring_force(u))

    def support_entries(self) -> list[dict[str, Any]]:
        springs = [{"kind": "spring", "face": one.given.face, "holds": one.given.holds} for one in self._sprung]
        return self.bodies.support_entries() + springs

    # --- as of the bodies ---------------------------------------------------------------------------------------------

    @property
    def component_names(self) -> tuple[str, ...]:
        return self.bodies.component_names

    def assembled(self) -> PETSc.Mat:
        return self.bodies.assembled()

    def interpolated(self) -> tuple[scipy.sparse.csr_matrix, FloatArray, Numbering]:
        return self.bodies.interpolated()

    @property
    def reference(self) -> FloatArray:
        return self.bodies.reference

    @property
    def numbering(self) -> Numbering:
        return self.bodies.numbering

    @property
    def members(self) -> tuple[Member, ...]:
        return self.bodies.members

    def face(self, name: str, what: str) -> tuple[Member, npt.NDArray[np.int32]]:
        return self.bodies.face(name, what)

    def numbers_of(self, member: Member, numbers: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
        return self.bodies.numbers_of(member, numbers)

    def internal_force(self, u: FloatArray) -> FloatArray:
        return self.bodies.internal_force(u)

    def outdated(self, loading: Loading) -> bool:
        return self.bodies.outdated(loading.untied or loading)

    def loads_in(self, loading: Loading) -> Iterator[NodalForces]:
        return self.bodies.loads_in(loading.untied or loading)

    def shares(self, reaction: FloatArray) -> Iterator[NodalForces]:
        return self.bodies.shares(reaction)

    def blocked_displacement(self, loading: Loading) -> float:
        return self.bodies.blocked_displacement(loading.untied or loading)

    def blocked_displacements(self, loading: Loading) -> tuple[float, ...]:
        return self.bodies.blocked_displacements(loading.untied or loading)

    def forms(self) -> Mapping[str, Any] | None:
        return self.bodies.forms()
