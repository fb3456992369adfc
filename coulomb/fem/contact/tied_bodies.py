"""Bodies of which some faces are tied to each other, move as rigid bodies, or are the sections of bolts.

Displacements follow from unknowns, u = T v + g (`Reduction`): those of nodes that follow no other, and those that
constraints have of their own.  Equilibrium is T^T (internal - outer forces) = F, with F the forces of bolts along their
own unknowns: the stiffness is T^T K T, as sparse as that of one mesh where the meshes match, and positive definite.
The rows of nodes that follow others, and of own unknowns that are prescribed, as the shortening of a locked bolt, have
a diagonal alone, as those of held directions.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.sparse
from mpi4py import MPI
from petsc4py import PETSc
from scipy.sparse.csgraph import connected_components

from ...arrays import FloatArray, IntArray
from ..bodies import (
    INTERPOLATION,
    TIE_STRESSES,
    Bolt,
    Deformable,
    FreeMotions,
    Loading,
    NodalForces,
    Numbering,
    OpenedPart,
    Tie,
    WrappedBodies,
    anchors,
    at_nodes_of,
    attach_interpolation,
    attach_near_kernel,
    block_diagonal,
    component_modes,
    displacements_of,
    distributed_rows,
    free_motions,
    local_rows,
    null_space,
    rigid_modes,
    rows_of,
)
from ..meshes import fetched, starts_of
from .reduction import LONGEST_CHAIN, Reduction
from .rigid_faces import FaceMotion, RigidFace
from .sections import Section, openings
from .ties import Tied


class TiedBodies(WrappedBodies):
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
        super().__init__(bodies)
        self.given = tuple(given)
        self._K: tuple[PETSc.Mat, PETSc.Mat, FloatArray] | None = None
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
        self._map = Reduction(bodies, ties, places)
        of_tie = {id(tie): own for tie, own in zip(ties, self._map.own, strict=True)}
        self._of_bolts = [of_tie[id(section.tie)].start for section in self.sections]
        self._states = [self]

    @property
    def points(self) -> FloatArray:
        return self._map.points

    @property
    def locks(self) -> tuple[float, ...]:
        return tuple(s.given.lock for s in self.sections if s.given.lock is not None)

    def at_time(self, time: float) -> TiedBodies:
        """The same with the coefficients of K and the bolts locked at a time; T, ties and faces are shared;
        collective."""
        bodies, locked = self.bodies.at_time(time), tuple(section.given.fixed(time) for section in self.sections)
        for known in self._states:
            if known.bodies is bodies and known.locked == locked:
                return known
        other = self.over(bodies)
        other.locked = locked
        self._states[1:] = [known for known in self._states[1:] if known.bodies is bodies]
        self._states.append(other)
        return other

    def over(self, bodies: Deformable) -> TiedBodies:
        """The same ties of the same bodies with another stiffness, or at another place."""
        other = copy.copy(self)
        other.bodies, other.x, other._K = bodies, bodies.x, None
        for name in ("free", "_held_diagonal"):
            other.__dict__.pop(name, None)
        return other

    # --- the map ------------------------------------------------------------------------------------------------------

    @property
    def _loose(self) -> FloatArray:
        """1 at own unknowns that are free, 0 at those of locked bolts and where they are padded, shape (width,)."""
        loose: FloatArray = np.zeros(self._map.width)
        for own in self._map.own:
            loose[own] = 1.0
        loose[self._of_bolts] = ~np.array(self.locked, dtype=bool)
        return loose

    def free_part(self, v: FloatArray) -> FloatArray:
        """T v without its part along held directions and prescribed own unknowns, of unknowns v (k + p, 3), or
        (k + p, 3, j), shape (k, 3), or (k, 3, j); collective."""
        return self._map.lifted(self._map.kept(v, self._loose))

    def transferred(self, forces: FloatArray) -> FloatArray:
        return self._map.transferred(forces)

    def along_unknowns(self, forces: FloatArray, time: float | None = None) -> FloatArray:
        transferred = self.transferred(forces)
        if time is not None:
            transferred += self._map.with_own(np.zeros_like(self.x), self._tension(time))
        return self._map.kept(transferred, self._loose)

    def prevented(self, modes: FloatArray) -> FloatArray:
        apart = self._map.left_apart(self._map.apart(modes), self._loose)
        return self.held_part(modes) + self._map.on_followed(apart)

    def reduced(self, u: FloatArray, loading: Loading | None = None) -> FloatArray:
        return self._map.reduced(u, self._loose, 0.0 if loading is None else loading.apart)

    def projection(self) -> PETSc.Mat:
        return self._map.projection(self._loose)

    # --- stiffness ----------------------------------------------------------------------------------------------------

    @property
    def K(self) -> PETSc.Mat:
        """(T P)^T K T P of the stiffness K of the bodies, springs of own unknowns, and what K has on the diagonal of
        held directions, of slave nodes and of own unknowns that are prescribed."""
        of_bodies = self.bodies.K
        if self._K is None or self._K[0] is not of_bodies:
            self._K = (of_bodies, *self._reduced_stiffness(of_bodies))
        return self._K[1]

    @property
    def anchoring(self) -> FloatArray:
        assert self.K is not None and self._K is not None
        return self._K[2]

    def _reduced_stiffness(self, of_bodies: PETSc.Mat) -> tuple[PETSc.Mat, FloatArray]:
        count, axes = len(self.x), [0, 1, 2]
        S, diagonal = of_bodies.copy(), of_bodies.getDiagonal()
        diagonal.array[:] -= self.bodies.anchoring.ravel()
        S.setDiagonal(diagonal)
        blocks = np.zeros((len(self.points), 3, 3))
        blocks[self.held.nodes] = self._held_diagonal[self.held.nodes][:, :, None] * self.held.projector
        mean = diagonal.array_r.reshape(-1, 3).mean(axis=1)
        blocks[:count] += mean[:, None, None] * self._map.tied
        typical = self.comm.allreduce(float(mean.sum()), op=MPI.SUM) / self.numbering.total
        blocks[count:] = typical * (1.0 - self._map.with_own(np.zeros((0, 3)), self._loose))[:, :, None] * np.eye(3)
        TP = self.projection()
        product = S.PtAP(TP)
        present = product.getDiagonal()
        anchoring: FloatArray = self._anchors() * present.array_r.reshape(-1, 3)
        blocks[:, axes, axes] += anchoring
        rows = local_rows(product) + block_diagonal(blocks, self._map.numbering) + self._springs()
        for thing in (S, diagonal, TP, product, present):
            thing.destroy()
        K = distributed_rows(rows.tobsr((3, 3)).tocsr(), (3 * len(self.points), rows.shape[1]), self)
        K.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        K.setOption(PETSc.Mat.Option.SPD, True)
        attach_near_kernel(K, self._rigid_modes(self.x))
        if of_bodies.getAttr(INTERPOLATION) is not None:
            attach_interpolation(K, self._interpolation)
        return K, anchoring

    def _anchors(self) -> npt.NDArray[np.bool_]:
        """Which unknowns are anchors of free motions: those of nodes that follow no other, if these determine all
        motions, shape (k + p, 3); collective."""
        places = np.zeros((3, len(self.points)), dtype=bool)
        for member in self.members:
            places[:, member.nodes] = member.body.anchor_places
        places[:, : len(self.x)] &= ~self.slaves
        places[-1] = True
        return anchors(self.free, self.free_unknowns, self.points, list(places), self.comm)

    def _springs(self) -> scipy.sparse.csr_matrix:
        """This rank's rows of (C^T N)^T S C^T N of all rigid faces, along their own unknowns; collective."""
        width, here = self._map.width, 3 * self._map.here
        found = np.zeros((width, width))
        for motion, (_, own, N, _) in zip(self.face_motions, self._map.weights, strict=False):  # rigid faces are first
            along = self.comm.allreduce(np.einsum("mcp,mcq->pq", motion.spread, N), op=MPI.SUM)
            found[own, own] = (along.T * motion.given.stiffness) @ along
        nodes = scipy.sparse.csr_matrix((3 * len(self.x), 3 * self.numbering.total))
        return scipy.sparse.block_diag([nodes, scipy.sparse.csr_matrix(found)[:here]], "csr")

    def _rigid_modes(self, x: FloatArray) -> FloatArray:
        """The rigid motions of all bodies at nodes x (n, 3) of a mesh of them, and own unknowns in these, shape
        (n + p, 3, 6); collective."""
        (whole,) = component_modes(self.x, np.zeros(len(self.x), dtype=np.int64), self.comm)[1]
        at, there = (displacements_of(of - whole.centre, np.full(len(of), whole.radius)) for of in (x, self.x))
        return np.concatenate([at, self.reduced(there)[len(self.x) :]])

    def _interpolation(self) -> PETSc.Mat:
        """That of the bodies, without what follows other nodes, and with own unknowns as they are."""
        P, here = self.bodies.K.getAttr(INTERPOLATION)(), 3 * self._map.here
        E = block_diagonal(np.eye(3) - self._map.tied, Numbering(0, len(self.x), len(self.x)))
        own = scipy.sparse.identity(self._map.width, format="csr")[:here]
        rows = scipy.sparse.block_diag([E @ local_rows(P), own], "csr")
        rows.eliminate_zeros()
        product = distributed_rows(rows, (P.getLocalSize()[1] + here, rows.shape[1]), self)
        parts = [member.body for member in self.members]
        coarse = np.concatenate([one.x if one.degree == 1 else one.vertices.space.x for one in parts])
        attach_near_kernel(product, self._rigid_modes(coarse))
        P.destroy()
        return product

    @cached_property
    def free(self) -> FreeMotions:
        """The rigid motions of bodies and of what is tied together, and those along bolts that are not locked."""
        component, names = self._joined_components(self.ties)
        modes, _ = component_modes(self.x, component, self.comm)
        found = free_motions(self.x, component, self._resisted(modes), self._limit, self.comm)
        found = replace(found, bodies=names)
        return found if all(self.locked) else self._opened(found)

    @property
    def _limit(self) -> float:
        """Energy of a motion up to which it is free, m^2; collective."""
        return 1e-10 * float(self.comm.allreduce(float(len(self.x)), op=MPI.SUM))

    def _resisted(self, modes: FloatArray) -> FloatArray:
        """Forces of unit springs in place of supports, springs and ties in motions of one metre, shapes (k, 3, j);
        collective."""
        projected = [self.bodies.free.projected(modes[:, :, j], self.x) for j in range(modes.shape[2])]
        forces = np.stack(projected, axis=2) + self.prevented(modes) - self.held_part(modes)
        for motion in self._sprung:
            forces = forces - motion.spring_force(modes, motion.unit_stiffness(self.x, self.comm), self.comm)
        return forces

    def _opened(self, found: FreeMotions) -> FreeMotions:
        """With the motions in which bolts that are not locked become shorter and nothing is deformed; collective.

        The parts on the two sides of a section are bodies of their own there; of the motions of all of them against
        which nothing has energy, those are taken that change the lengths of bolts.
        """
        loose = np.flatnonzero(~np.array(self.locked))
        sections = [self.sections[k] for k in loose]
        part, names = self._joined_components([tie for tie in self.ties if not any(tie is s.tie for s in sections)])
        modes, parts = component_modes(self.x, part, self.comm)
        each = np.concatenate([np.where((part == k)[:, None, None], modes, 0.0) for k in range(len(parts))], axis=2)
        energy = self.comm.allreduce(np.einsum("kci,kcj->ij", each, self._resisted(each)), op=MPI.SUM)
        free = null_space(energy, self._limit)
        motions = each @ free
        amounts = self._map.amounts(self._map.apart(motions))[[self._of_bolts[k] for k in loose]]
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
        of_bodies = self.bodies.free
        component, count = of_bodies.component, len(of_bodies.bodies)
        starts, found = starts_of(self.comm, len(self.x)), [np.empty((0, 2), dtype=np.int64)]
        for tie in ties:
            entries = tie.rows.tocoo()
            masters = fetched(self.comm, starts, (entries.col // 3).astype(np.int64), component)
            found.append(np.unique(np.column_stack([component[tie.nodes[entries.row // 3]], masters]), axis=0))
            if tie.own.shape[2]:  # moved by the same unknowns
                together = np.unique(np.concatenate(self.comm.allgather(np.unique(component[tie.nodes]))))
                found.append(np.column_stack([together[:-1], together[1:]]))
        pairs = np.concatenate(self.comm.allgather(np.concatenate(found)))
        graph = scipy.sparse.coo_matrix((np.ones(len(pairs)), pairs.T), (count, count))
        number = connected_components(graph, directed=False)[1].astype(np.int64)
        _, number = np.unique(number, return_inverse=True)
        groups = [
            [name for name, at in zip(of_bodies.bodies, number, strict=True) if at == k] for k in range(max(number) + 1)
        ]
        return number[component], tuple(group[0] if len(group) == 1 else " with ".join(group) for group in groups)

    # --- loads and forces ---------------------------------------------------------------------------------------------

    def at(self, time: float) -> Loading:
        return self._loading(time, np.zeros(self._map.width))

    def refuse_beginning(self, time: float) -> None:
        for one in (section.given for section in self.sections):
            if one.force is not None and one.locked(time):
                raise ValueError(
                    f"{one.what}: at time {time:g} it is locked (lock = {one.lock:g}), at a length that only the load "
                    "steps before determine: begin at the time of lock or before"
                )

    def after(self, time: float, before: FloatArray) -> Loading:
        return self._loading(time, self._map.amounts(self._map.apart(before)))

    def _loading(self, time: float, kept: FloatArray) -> Loading:
        """Prescribed displacements are u with no unknowns: those of supports, rigid faces and bolts, and what follows
        them; `kept` are the own unknowns (width,) by which bolts are locked; collective."""
        of_bodies, offset = self.bodies.at(time), np.zeros_like(self.x)
        for motion in self.face_motions:
            offset += motion.prescribed(self.x, time, self.comm)
        if self.face_motions:
            given = (float(np.max(np.abs(of), initial=0.0)) for of in (offset, of_bodies.prescribed))
            size = self.comm.allreduce(max(given), op=MPI.MAX)
            for motion in self.face_motions:
                motion.refuse_other(self.held_part(of_bodies.prescribed - offset), size, self.comm)
        y, found = np.zeros(self._map.width), self._map
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
        return replace(of_bodies, prescribed=prescribed, untied=of_bodies, apart=apart)

    def _tension(self, time: float) -> FloatArray:
        """The forces of bolts along own unknowns at a time, newtons, shape (width,); collective."""
        forces = np.zeros(self._map.width)
        for section, own in zip(self.sections, self._of_bolts, strict=True):
            if not section.given.fixed(time):
                forces[own] = section.given.value(time, self.comm)
        return forces

    def bolts(self, u: FloatArray) -> Iterator[Bolt]:
        y = self._map.amounts(self._map.apart(u))
        for section, own, locked in zip(self.sections, self._of_bolts, self.locked, strict=True):
            yield Bolt(section.tie.face, section.place, section.direction, float(y[own]), locked)

    def f(self, loading: Loading) -> PETSc.Vec:
        f, forces, g = self.K.createVecRight(), loading.load, loading.prescribed
        if self.comm.allreduce(bool(np.any(g)), op=MPI.LOR):
            forces = forces - self.internal_force(g) + self.spring_force(g)
        along = self.along_unknowns(forces, loading.time)
        along[: len(self.x)] += self._held_diagonal * self.held_part(g)
        f.array[:] = along.ravel()
        return f

    def _lacking(self, imbalance: FloatArray, time: float) -> FloatArray:
        return self._map.lacking(imbalance, self._loose, self._tension(time))

    def forces_of_ties(self, imbalance: FloatArray, time: float) -> FloatArray:
        return self._map.on_followed(self._lacking(imbalance, time))

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
        for motion, (_, own, _, _) in zip(self.face_motions, self._map.weights, strict=False):
            given = motion.prescribed(self.x, time, self.comm)
            y = self._map.amounts(self._map.apart(u) - self._map.followed(given))[own]
            yield motion.given.face, motion.place, motion.values(time, self.comm) + motion.motions @ y

    def jump(self, u: FloatArray, loading: Loading) -> FloatArray:
        return self._map.left_apart(self._map.apart(u) - loading.apart, self._loose)

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
