"""Bodies of which some faces are tied to each other.

With T, the map from the displacements v of nodes that follow no other to those of all, u = T v, equilibrium is
T^T (internal - outer forces) = 0: the stiffness is T^T K T, as sparse as that of one mesh where the meshes match, and
positive definite.  The rows of nodes that follow others have a diagonal alone, as those of held directions, so that K
has the same unknowns as without ties.  The forces of a tie are the forces that slave nodes lack, and -W^T times them on
the master.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cached_property, partial
from typing import Any, Final

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
    OpenedPart,
    Tie,
    WrappedBodies,
    at_nodes_of,
    attach_interpolation,
    attach_rigid_body_modes,
    block_diagonal,
    component_modes,
    distributed_rows,
    free_motions,
    local_rows,
    null_space,
    rigid_modes,
    rows_of,
)
from ..meshes import fetched, starts_of
from .rigid_faces import FaceMotion, RigidFace
from .sections import Section, openings
from .ties import Tied

_LONGEST_CHAIN: Final = 8
"""Ties of which each follows the next."""


def _each_column(of: Callable[[FloatArray], FloatArray], v: FloatArray) -> FloatArray:
    """A function of nodal vectors (k, 3) for each of several (k, 3, j)."""
    if v.ndim == 2:
        return of(v)
    return np.stack([of(v[:, :, j]) for j in range(v.shape[2])], axis=2) if v.shape[2] else v


class TiedBodies(WrappedBodies):
    """Bodies with ties; nodes, faces and loads are those of the bodies.

    Attributes:
        bodies: The bodies without ties.
        given: The ties, rigid faces and bolts as given.
        ties: These with their nodes, rigid faces first.
        face_motions: The motions of the rigid faces.
        sections: The sections of the bolts.
        locked: Whether the shortening of each of them is given.
    """

    def __init__(
        self,
        bodies: Deformable,
        given: Sequence[Tied | RigidFace],
        time: float = 0.0,
        like: TiedBodies | None = None,
        locked: tuple[bool, ...] = (),
    ):
        super().__init__(bodies)
        self.given = tuple(given)
        self._K: tuple[PETSc.Mat, PETSc.Mat, FloatArray] | None = None
        self._ties: tuple[Tie, ...] = () if like is None else like.ties
        self.face_motions: tuple[FaceMotion, ...] = () if like is None else like.face_motions
        self.sections: tuple[Section, ...] = () if like is None else like.sections
        self.slaves: npt.NDArray[np.bool_] = np.zeros(len(self.x), dtype=bool) if like is None else like.slaves
        self._others: list[TiedBodies] = [self] if like is None else like._others
        self._locked = locked
        if like is not None:
            return
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
        self._ties = tuple(ties)
        self.face_motions = tuple(part for part in moving if isinstance(part, FaceMotion))
        self.sections = tuple(part for part in moving if isinstance(part, Section))
        self._locked = tuple(section.given.fixed(time) for section in self.sections)

    @property
    def ties(self) -> tuple[Tie, ...]:
        return self._ties

    @property
    def locked(self) -> tuple[bool, ...]:
        return self._locked

    @property
    def locks(self) -> tuple[float, ...]:
        return tuple(s.given.lock for s in self.sections if s.given.lock is not None)

    @property
    def _movable(self) -> tuple[Section, ...]:
        """The sections of which the shortening is not given."""
        return tuple(section for section, locked in zip(self.sections, self._locked, strict=True) if not locked)

    @property
    def _linked(self) -> tuple[Tie, ...]:
        """The ties as they are now."""
        movable = {id(section.fixed): section.movable for section in self._movable}
        return tuple(movable.get(id(tie), tie) for tie in self._ties)

    def _with(self, bodies: Deformable, locked: tuple[bool, ...]) -> TiedBodies:
        """The same with other coefficients of K, or other bolts locked; collective."""
        for known in self._others:
            if known.bodies is bodies and known.locked == locked:
                return known
        first = self._others[0].bodies
        self._others[:] = [known for known in self._others if known.bodies is bodies or known.bodies is first]
        self._others.append(TiedBodies(bodies, self.given, like=self, locked=locked))
        return self._others[-1]

    @property
    def _whole(self) -> TiedBodies:
        """The same with all bolts locked."""
        return self._with(self.bodies, (True,) * len(self.sections))

    # --- the map ------------------------------------------------------------------------------------------------------

    @cached_property
    def _tied(self) -> FloatArray:
        """Projectors on the directions along which nodes follow others, shape (k, 3, 3)."""
        tied = np.zeros((len(self.x), 3, 3))
        for tie in self._linked:
            free = np.eye(3) - self.held.projector_at(tie.nodes)
            sizes, directions = np.linalg.eigh(free @ tie.directions @ free)
            tied[tie.nodes] = np.einsum("mia,ma,mja->mij", directions, np.round(sizes), directions)
        return tied

    def _not_following(self) -> PETSc.Mat:
        """The matrix that keeps the displacements of nodes that follow no other."""
        rows = block_diagonal(np.eye(3) - self._tied, self)
        rows.eliminate_zeros()
        return distributed_rows(rows, rows.shape, self)

    @cached_property
    def _rows(self) -> PETSc.Mat:
        """W of all slave nodes, shape (n, n), distributed; rows of others are empty."""
        n, axes = 3 * len(self.x), np.arange(3)
        follow = scipy.sparse.csr_matrix((n, 3 * self.numbering.total))
        for tie in self._linked:
            at = (3 * tie.nodes[:, None] + axes).ravel()
            lift = scipy.sparse.csr_matrix((np.ones(len(at)), (at, np.arange(len(at)))), (n, len(at)))
            follow = follow + lift @ tie.rows
        return distributed_rows(follow.tocsr(), (n, follow.shape[1]), self)

    @cached_property
    def _follows(self) -> PETSc.Mat:
        """T, from the displacements of nodes that follow no other to those of all; collective."""
        E, W = self._not_following(), self._rows
        T, change = E.copy(), 1.0
        for _ in range(_LONGEST_CHAIN):  # nodes that follow nodes that follow others
            then = W.matMult(T)
            then.axpy(1.0, E)
            T.axpy(-1.0, then)
            change, T = T.norm(), then
            if change == 0.0:
                T.setAttr("mesh", self.lifetime)  # keeps it alive: see compat.assemble_matrix
                return T
        raise ValueError(f"{', '.join(one.what for one in self.given)}: nodes follow each other in a circle")

    def free_part(self, v: FloatArray) -> FloatArray:
        """T P v: the displacement of which v (k, 3), or (k, 3, j), is the part along free directions; collective."""
        return _each_column(partial(rows_of, self._follows), self.held.free_part(v))

    def transferred(self, forces: FloatArray) -> FloatArray:
        """T^T times the forces."""
        return _each_column(partial(at_nodes_of, self._follows), forces)

    def prevented(self, modes: FloatArray) -> FloatArray:
        apart = modes - _each_column(partial(rows_of, self._follows), modes)
        return self.held_part(modes) + apart - self.transferred(apart)

    def reduced(self, u: FloatArray) -> FloatArray:
        return u - np.einsum("kij,kj...->ki...", self._tied, u)

    def projection(self) -> PETSc.Mat:
        """T P, shape (n, n), distributed."""
        P = super().projection()
        product = self._follows.matMult(P)
        P.destroy()
        product.setAttr("mesh", self.lifetime)
        return product

    # --- stiffness ----------------------------------------------------------------------------------------------------

    @property
    def K(self) -> PETSc.Mat:
        """(T P)^T K T P of the stiffness K of the bodies, and what K has on the diagonal of held directions and of
        slave nodes."""
        of_bodies = self.bodies.K
        if self._K is None or self._K[0] is not of_bodies:
            self._K = (of_bodies, *self._reduced_stiffness(of_bodies))
        return self._K[1]

    @property
    def anchoring(self) -> FloatArray:
        assert self.K is not None and self._K is not None
        return self._K[2]

    def _reduced_stiffness(self, of_bodies: PETSc.Mat) -> tuple[PETSc.Mat, FloatArray]:
        S, diagonal = of_bodies.copy(), of_bodies.getDiagonal()
        diagonal.array[:] -= self.bodies.anchoring.ravel()
        S.setDiagonal(diagonal)
        blocks = np.zeros((len(self.x), 3, 3))
        blocks[self.held.nodes] = self._held_diagonal[self.held.nodes][:, :, None] * self.held.projector
        mean = diagonal.array_r.reshape(-1, 3).mean(axis=1)
        blocks[self.slaves] += (mean[:, None, None] * self._tied)[self.slaves]
        TP = self.projection()
        product = S.PtAP(TP)
        present = product.getDiagonal()
        anchoring: FloatArray = self.free.anchored(self.x.shape) * present.array_r.reshape(-1, 3)
        blocks[:, [0, 1, 2], [0, 1, 2]] += anchoring
        rows = local_rows(product) + block_diagonal(blocks, self) + self._springs_in_K()
        for thing in (S, diagonal, TP, product, present):
            thing.destroy()
        K = distributed_rows(rows.tobsr((3, 3)).tocsr(), (3 * len(self.x), rows.shape[1]), self)
        K.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        K.setOption(PETSc.Mat.Option.SPD, True)
        attach_rigid_body_modes(K, self.x)
        if of_bodies.getAttr(INTERPOLATION) is not None:
            attach_interpolation(K, self._interpolation)
        return K, anchoring

    def _springs_in_K(self) -> scipy.sparse.csr_matrix:
        """This rank's rows of (T P)^T C S C^T T P of all rigid faces: C^T T P is not zero at the anchors alone."""
        n, axes = 3 * len(self.x), np.arange(3)
        found = scipy.sparse.csr_matrix((n, 3 * self.numbering.total))
        for motion in self._sprung:
            spread = np.zeros((len(self.x), 3, 6))
            spread[motion.nodes] = motion.spread
            at = np.unique([node for node, _ in motion.anchors if node >= 0]).astype(np.int64)
            dofs = (3 * at[:, None] + axes).ravel()
            own = self.held.free_part(self.transferred(spread))[at].reshape(-1, 6)
            columns = np.concatenate(self.comm.allgather(3 * self.numbering.first + dofs))
            block = (own * motion.given.stiffness) @ np.concatenate(self.comm.allgather(own)).T
            entries = (block.ravel(), (np.repeat(dofs, len(columns)), np.tile(columns, len(dofs))))
            found = found + scipy.sparse.csr_matrix(entries, found.shape)
        return found

    def _interpolation(self) -> PETSc.Mat:
        """That of the bodies, without what follows other nodes."""
        P = self.bodies.K.getAttr(INTERPOLATION)()
        E = self._not_following()
        product = E.matMult(P)
        product.setNearNullSpace(P.getNearNullSpace())
        product.setAttr("mesh", self.lifetime)
        for one in (E, P):
            one.destroy()
        return product

    @cached_property
    def free(self) -> FreeMotions:
        """The rigid motions of bodies and of what is tied together, and those along bolts that are not locked."""
        component, names = self._joined_components(self.ties)
        modes, _ = component_modes(self.x, component, self.comm)
        places = np.zeros((3, len(self.x)), dtype=bool)
        for member in self.members:
            places[:, member.nodes] = member.body.anchor_places
        found = free_motions(
            self.x, component, self._resisted(modes), self._limit, tuple(places & ~self.slaves), self.comm
        )
        found = replace(found, bodies=names)
        return self._opened(found, places[-1] & ~self.slaves) if self._movable else found

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

    def _opened(self, found: FreeMotions, places: npt.NDArray[np.bool_]) -> FreeMotions:
        """With the motions in which bolts that are not locked become shorter and nothing is deformed; collective.

        The parts on the two sides of a section are bodies of their own there; of the motions of all of them against
        which nothing has energy, those are taken that change the lengths of bolts.
        """
        movable = [section.fixed for section in self._movable]
        part, names = self._joined_components([tie for tie in self.ties if not any(tie is one for one in movable)])
        modes, parts = component_modes(self.x, part, self.comm)
        each = np.concatenate([np.where((part == k)[:, None, None], modes, 0.0) for k in range(len(parts))], axis=2)
        energy = self.comm.allreduce(np.einsum("kci,kcj->ij", each, self._resisted(each)), op=MPI.SUM)
        free = null_space(energy, self._limit)
        motions = each @ free
        loose = ~np.array(self.locked)
        amounts = [self._amounts(motions[:, :, j])[loose] for j in range(motions.shape[2])]
        if not amounts:
            return found
        ways, named = openings(np.array(amounts).T, self._movable)
        if not named:
            return found
        of_parts = (free @ ways).reshape(len(parts), 6, -1)
        numbers = [int(np.max(found.component[part == k], initial=-1)) for k in range(len(parts))]
        numbers = np.max(self.comm.allgather(numbers), axis=0).tolist()
        opened = [OpenedPart(*one) for one in zip(names, numbers, parts, of_parts, strict=True)]
        return found.opened(motions @ ways, named, self.x, places, opened)

    def _joined_components(self, ties: Sequence[Tie]) -> tuple[IntArray, tuple[str, ...]]:
        """The component of every node, where those of these ties are one, shape (k,), and their names; collective."""
        of_bodies = self.bodies.free
        component, count = of_bodies.component, len(of_bodies.bodies)
        starts, found = starts_of(self.comm, len(self.x)), [np.empty((0, 2), dtype=np.int64)]
        for tie in ties:
            entries = tie.rows.tocoo()
            masters = fetched(self.comm, starts, (entries.col // 3).astype(np.int64), component)
            found.append(np.unique(np.column_stack([component[tie.nodes[entries.row // 3]], masters]), axis=0))
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
        return self._loading(time, np.zeros(len(self.sections)))

    def refuse_beginning(self, time: float) -> None:
        for one in (section.given for section in self.sections):
            if one.force is not None and one.locked(time):
                raise ValueError(
                    f"{one.what}: at time {time:g} it is locked (lock = {one.lock:g}), at a length that only the load "
                    "steps before determine: begin at the time of lock or before"
                )

    def after(self, time: float, before: FloatArray) -> Loading:
        return self._loading(time, self._amounts(before) if self.sections else np.empty(0))

    def _loading(self, time: float, kept: FloatArray) -> Loading:
        """Prescribed displacements are u with no unknowns: those of supports, rigid faces and bolts, and what follows
        them; `kept` are the amounts of bolts that are locked; collective."""
        of_bodies, offset = self.bodies.at(time), np.zeros_like(self.x)
        for motion in self.face_motions:
            offset += motion.prescribed(self.x, time, self.comm)
        if self.face_motions:
            given = (float(np.max(np.abs(of), initial=0.0)) for of in (offset, of_bodies.prescribed))
            size = self.comm.allreduce(max(given), op=MPI.MAX)
            for motion in self.face_motions:
                motion.refuse_other(self.held_part(of_bodies.prescribed - offset), size, self.comm)
            followed = rows_of(self._rows, offset)
            for motion in self.face_motions:
                offset[motion.nodes] -= followed[motion.nodes]
        for section, locked, amount in zip(self.sections, self.locked, kept, strict=True):
            if locked:
                value = section.given.value(time, self.comm) if section.given.force is None else amount
                offset += section.along(value, offset.shape)
        prescribed = rows_of(self._follows, of_bodies.prescribed)
        apart = offset = np.einsum("kij,kj->ki", self._tied, offset)
        for _ in range(_LONGEST_CHAIN):  # u = W u + apart at slave nodes
            prescribed = prescribed + offset
            offset = np.einsum("kij,kj->ki", self._tied, rows_of(self._rows, offset))
            if not self.comm.allreduce(bool(np.any(offset)), op=MPI.LOR):
                break
        return replace(
            of_bodies, load=of_bodies.load + self.pretension(time), prescribed=prescribed, untied=of_bodies, apart=apart
        )

    def pretension(self, time: float) -> FloatArray:
        forces = np.zeros_like(self.x)
        movable = [section for section in self.sections if not section.given.fixed(time)]
        for section in movable:
            forces += section.along(section.given.value(time, self.comm) * section.weights, forces.shape)
        return forces - at_nodes_of(self._whole._rows, forces) if movable else forces

    def _amounts(self, u: FloatArray) -> FloatArray:
        """The shortening of every bolt at displacements u (k, 3), metres; collective."""
        apart = u - rows_of(self._whole._rows, u)
        return np.array([section.amount(apart, self.comm) for section in self.sections])

    def bolts(self, u: FloatArray) -> Iterator[Bolt]:
        amounts = self._amounts(u) if self.sections else ()
        for section, amount, locked in zip(self.sections, amounts, self.locked, strict=True):
            yield Bolt(section.fixed.face, section.centre, section.direction, float(amount), locked)

    def f(self, loading: Loading) -> PETSc.Vec:
        f, forces, g = self.K.createVecRight(), loading.load, loading.prescribed
        if self.comm.allreduce(bool(np.any(g)), op=MPI.LOR):
            forces = forces - self.internal_force(g) + self.spring_force(g)
        free = self.held.free_part(self.transferred(forces))
        f.array[:] = (free + self._held_diagonal * self.held_part(g)).ravel()
        return f

    def _on_slaves(self, imbalance: FloatArray) -> FloatArray:
        """The forces of all ties on their slave nodes, shapes (k, 3); collective."""
        forces = np.zeros_like(imbalance)
        for _ in range(_LONGEST_CHAIN):
            before = forces
            forces = np.einsum("kij,kj->ki", self._tied, imbalance + at_nodes_of(self._rows, before))
            if not self.comm.allreduce(bool(np.any(forces != before)), op=MPI.LOR):
                break
        return forces

    def shares_of_ties(self, imbalance: FloatArray) -> Iterator[NodalForces]:
        forces = self._whole._on_slaves(imbalance)
        for tie in self.ties:
            share, own = np.zeros_like(forces), forces[tie.nodes]
            share[tie.nodes] = own
            beside = distributed_rows(tie.beside, (forces.size, tie.beside.shape[1]), self, None)
            share -= at_nodes_of(beside, own)
            beside.destroy()
            yield NodalForces(tie.kind.replace(" ", "_"), tie.face, share)

    def stresses_of_ties(self, imbalance: FloatArray) -> dict[str, FloatArray]:
        forces = self._whole._on_slaves(imbalance)
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
        for motion in self.face_motions:
            values, t = motion.values(time, self.comm), motion.prescribed(self.x, time, self.comm)
            yield motion.given.face, motion.point, motion.found(u, t, values, self.comm)

    def jump(self, u: FloatArray, loading: Loading) -> FloatArray:
        return np.einsum("kij,kj->ki", self._tied, u - rows_of(self._rows, u)) - loading.apart

    def at_time(self, time: float) -> TiedBodies:
        return self._with(self.bodies.at_time(time), tuple(section.given.fixed(time) for section in self.sections))

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
