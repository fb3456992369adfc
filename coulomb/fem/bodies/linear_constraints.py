"""What follows what in bodies, u = T v + g: ties, cyclic symmetry, rigid faces, bolts and equations, all as rows of one
`Reduction`.

Equilibrium is T^T (internal - outer forces) = F, with F the forces of bolts along their own unknowns: the stiffness is
T^T K T, as sparse as that of one mesh where the meshes match, and positive definite.  The rows of nodes that follow
others, and of own unknowns that are prescribed, as the shortening of a locked bolt, have a diagonal alone, as those of
held directions.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Protocol

import numpy as np
import numpy.typing as npt
import scipy.sparse
from mpi4py import MPI
from scipy.sparse.csgraph import connected_components

from ...arrays import FloatArray, IntArray
from ..meshes import fetched, starts_of
from .constraints import HeldNodes, at_nodes_of, distributed_rows, rows_of
from .free_motions import FreeMotions, OpenedPart, least_energy
from .lasting_supports import End, Lasting, act_together, acts, limits_of, share_left
from .loads import Loading, NodalForces
from .reduction import LONGEST_CHAIN, Reduction
from .rigid_modes import RigidPart, component_modes, null_space
from .ties import FaceMotion, Section, Tie

TIE_STRESSES = ("peel_stress", "shear_stress")
"""Tractions of ties at slave nodes: along the outward normal, positive where the tie pulls, and the size of the part
across it."""


class LinkedNodes(Protocol):
    """Springs between nodes: `Links`."""

    given: Sequence[Any]

    @property
    def nodes(self) -> list[IntArray]: ...

    @property
    def stiffness(self) -> scipy.sparse.csr_matrix: ...

    def forces(self, u: FloatArray, unit: bool = False) -> Iterator[tuple[Any, FloatArray]]: ...


class Follower(Lasting, Protocol):
    """What makes nodes follow others, as given."""

    @property
    def what(self) -> str:
        """Kind and faces, for messages."""
        ...

    def joined(self, body: Any, taken: npt.NDArray[np.bool_]) -> Tie:
        """Its rows, of nodes that do not follow others already (`taken`, (k,)); ValueError on every rank if there are
        none; collective."""
        ...

    def as_made(self, tie: Tie) -> Follower:
        """The same, with the nodes of the same face as slaves whatever the meshes and supports."""
        ...


@dataclass(frozen=True)
class Bolt:
    """The section of a bolt: its slave face, its middle (3,) in metres, its direction out of that face (3,), by how
    much it is shortened, metres, and whether that is given."""

    face: str
    centre: FloatArray
    direction: FloatArray
    shortening: float
    locked: bool


_ROUNDING: Final = 2.0**-46
"""Displacement of slave nodes that is left, over the largest displacement, that is a rounding error."""


class Constraints:
    """The constraints of some bodies that act at a time, with the shortening of some bolts given; none by default;
    collective.

    Args:
        nodes: The nodes, with what supports hold.
        given: Ties, rigid faces, bolts and equations; of those that meet at some time, a later one may refuse nodes of
            earlier ones.
        time: By which ties act and bolts are locked.
        links: Springs between nodes; None without.

    Attributes:
        given: As given.
        every: These with their nodes, also those that do not act.
        ties: Those that act.
        acting: Which of `every` do; () if all act at all times.
        motions: Those of the rigid faces.
        bolts: The sections of bolts.
        locked: Whether the shortening of each bolt is given, prescribed or locked: it is no unknown then.
        reduction: The map from unknowns to displacements.
        as_made: Those given, with the slaves that they have.
    """

    _displaced: FloatArray | None = None
    reduction: Reduction

    def __init__(
        self, nodes: HeldNodes, given: Sequence[Follower] = (), time: float = 0.0, links: LinkedNodes | None = None
    ):
        self._links = links
        self.comm, self.given, every = nodes.comm, tuple(given), list[Tie]()
        for one in given:
            taken = np.zeros(len(nodes.x), dtype=bool)
            for other, tie in zip(given, every, strict=False):
                taken[tie.nodes] |= act_together(one, other)
            every.append(one.joined(nodes, taken))
        self.every = tuple(every)
        self.as_made = [one.as_made(tie) for one, tie in zip(given, every, strict=True)]
        self._reductions = {acting: self._reduction_of(acting, nodes) for acting in self._actings}
        self._take(self._acting(time), time)

    @property
    def _actings(self) -> set[tuple[bool, ...]]:
        """Which of the constraints act, between the times at which some begin or end."""
        return {self._acting(time) for time in (*limits_of(self.given), np.inf)}

    def _acting(self, time: float) -> tuple[bool, ...]:
        return tuple(acts(one, time) for one in self.given) if limits_of(self.given) else ()

    def _those(self, acting: tuple[bool, ...]) -> tuple[Tie, ...]:
        return tuple(tie for tie, on in zip(self.every, acting, strict=True) if on) if acting else self.every

    def _reduction_of(self, acting: tuple[bool, ...], nodes: HeldNodes) -> Reduction:
        """That of the constraints that act, no bolt being locked; collective."""
        ties = self._those(acting)
        of = [tie.motion or tie.bolt for tie in ties]
        places = [one.place for one, tie in zip(of, ties, strict=True) if one is not None and tie.own.shape[2]]
        found = Reduction(nodes, ties, places)
        weights = [(own, N) for _, own, N, _ in found.weights]
        for motion, own in zip(of, found.own, strict=True):
            if isinstance(motion, FaceMotion) and motion.motions.shape[1]:
                N = next(N for at, N in weights if at == own)
                along = self.comm.allreduce(np.einsum("mcp,mcq->pq", motion.spread, N), op=MPI.SUM)
                found.stiffness[own, own] = (along.T * motion.given.stiffness) @ along
        return found

    def _take(self, acting: tuple[bool, ...], time: float) -> None:
        """Let these constraints act, and those bolts be locked that are at a time."""
        found = self._reductions[acting]
        self._unlocked = found if self._displaced is None else found.at_place(self.reduction.x)
        self.ties, self.acting = self._those(acting), acting
        owned = [(tie.motion or tie.bolt, own) for tie, own in zip(self.ties, found.own, strict=True)]
        self._of_faces = [(motion, own) for motion, own in owned if isinstance(motion, FaceMotion)]
        self._of_bolts = [(bolt, own.start) for bolt, own in owned if isinstance(bolt, Section)]
        self.motions, self.bolts = [one for one, _ in self._of_faces], [one for one, _ in self._of_bolts]
        self.locked = tuple(bolt.given.fixed(time) for bolt in self.bolts)
        self.reduction = self._prescribed()

    def _prescribed(self) -> Reduction:
        given = [own for (_, own), locked in zip(self._of_bolts, self.locked, strict=True) if locked]
        return self._unlocked.prescribing(given) if self.bolts else self._unlocked

    def at_time(self, time: float) -> Constraints:
        """The same with those that act and the bolts that are locked at a time, itself if these do and are; faces are
        shared, and T by the same that act."""
        acting, locked = self._acting(time), tuple(bolt.given.fixed(time) for bolt in self.bolts)
        if acting == self.acting and locked == self.locked:
            return self
        other = copy.copy(self)
        other._take(acting, time)
        return other

    def same(self, other: Constraints) -> bool:
        """Whether those of the same bodies act, and the same bolts are locked, as of others."""
        return (self.acting, self.locked) == (other.acting, other.locked)

    def at_place(self, x: FloatArray, u: FloatArray) -> Constraints:
        """The same of nodes at another place x (k, 3), metres, displaced by u (k, 3): loadings are of changes of it."""
        other = copy.copy(self)
        other._displaced = u
        other._unlocked = self._unlocked.at_place(x)
        other.reduction = other._prescribed()
        return other

    # --- free motions -------------------------------------------------------------------------------------------------

    def joined(self, component: IntArray, names: tuple[str, ...]) -> tuple[IntArray, tuple[str, ...]]:
        """The component of every node, where those that move together, or are linked by springs, are one, and their
        names; collective."""
        return self._together(self.ties, component, names, [] if self._links is None else self._links.nodes)

    def _together(
        self, ties: Sequence[Tie], component: IntArray, names: tuple[str, ...], links: Sequence[IntArray] = ()
    ) -> tuple[IntArray, tuple[str, ...]]:
        """The component of every node, where those of these ties, and of linked nodes, are one, shape (k,), and their
        names; collective."""
        if not ties and not links:
            return component, names
        starts, found = starts_of(self.comm, len(component)), [np.empty((0, 2), dtype=np.int64)]
        for tie in ties:
            entries = tie.rows.tocoo()
            masters = fetched(self.comm, starts, (entries.col // 3).astype(np.int64), component)
            found.append(np.unique(np.column_stack([component[tie.nodes[entries.row // 3]], masters]), axis=0))
            if tie.own.shape[2]:  # moved by the same unknowns
                together = np.unique(np.concatenate(self.comm.allgather(np.unique(component[tie.nodes]))))
                found.append(np.column_stack([together[:-1], together[1:]]))
        for nodes in links:
            linked = fetched(self.comm, starts, nodes, component)
            found.append(np.column_stack([linked[:-1], linked[1:]]))
        pairs = np.concatenate(self.comm.allgather(np.concatenate(found)))
        graph = scipy.sparse.coo_matrix((np.ones(len(pairs)), pairs.T), (len(names), len(names)))
        number = connected_components(graph, directed=False)[1].astype(np.int64)
        _, number = np.unique(number, return_inverse=True)
        groups = [[name for name, at in zip(names, number, strict=True) if at == k] for k in range(max(number) + 1)]
        return number[component], tuple(group[0] if len(group) == 1 else " with ".join(group) for group in groups)

    def opened(
        self,
        found: FreeMotions,
        component: IntArray,
        names: tuple[str, ...],
        resisted: Callable[[FloatArray], FloatArray],
    ) -> FreeMotions:
        """Free motions, with those in which bolts that are not locked become shorter, or bodies that equations alone
        join move against each other, and nothing is deformed; collective.

        The parts on the two sides of a section, or of an equation, are bodies of their own there; of the motions of all
        of them against which nothing has energy, those are taken that change the lengths of bolts, and then those that
        are no motions of components.
        """
        loose = [of for of, locked in zip(self._of_bolts, self.locked, strict=True) if not locked]
        bolts, own = [bolt for bolt, _ in loose], [at for _, at in loose]
        firm = [tie for tie in self.ties if tie.bolt not in bolts and tie.prescribed is None]
        if len(firm) == len(self.ties) and self._links is None:
            return found
        part, names = self._together(firm, component, names)
        modes, parts = component_modes(self.reduction.x, part, self.comm)
        each = np.concatenate([np.where((part == k)[:, None, None], modes, 0.0) for k in range(len(parts))], axis=2)
        forces = self.reduction.prevented(each) + resisted(each)
        of_modes = found.modes(self.reduction.x)
        energy, gram, whole = (
            self.comm.allreduce(np.einsum("kci,kcj->ij", each, of), op=MPI.SUM) for of in (forces, each, of_modes)
        )
        free = null_space(energy, least_energy(energy))
        motions = each @ free
        ways, named = _openings(self._amounts(motions)[own], bolts)
        known = np.column_stack([free.T @ np.linalg.solve(gram, whole), ways])
        left, sizes, _ = np.linalg.svd(known)
        others = left[:, int(np.sum(sizes > _SHORTENS)) :]
        for amounts in (free @ others).T.reshape(-1, len(parts), 6):
            most = int(np.argmax(np.linalg.norm(amounts, axis=1)))
            along = amounts[most, :3] if np.any(np.abs(amounts[most, :3]) > _SHORTENS) else amounts[most, 3:]
            named.append((names[most], parts[most], along))
        if not named:
            return found
        ways = np.column_stack([ways, others])
        of_parts = (free @ ways).reshape(len(parts), 6, -1)
        numbers = [int(np.max(found.component[part == k], initial=-1)) for k in range(len(parts))]
        numbers = np.max(self.comm.allgather(numbers), axis=0).tolist()
        opened = [OpenedPart(*one) for one in zip(names, numbers, parts, of_parts, strict=True)]
        return found.opened(motions @ ways, named, opened)

    def _amounts(self, u: FloatArray, offset: FloatArray | float = 0.0) -> FloatArray:
        """The own unknowns of displacements of which slave nodes are to be apart by an offset; collective."""
        return self.reduction.amounts(self.reduction.apart(u) - offset)

    # --- what is prescribed -------------------------------------------------------------------------------------------

    @property
    def limits(self) -> tuple[float, ...]:
        """The times at which ties begin or end, or tightening ends."""
        locks = (bolt.given.lock for bolt in self.bolts if bolt.given.lock is not None)
        return (*limits_of(self.given), *locks)

    @property
    def lasting(self) -> list[Tie]:
        """Those that do not act at all times."""
        both = zip(self.given, self.every, strict=True)
        return [tie for one, tie in both if one.begin is not None or one.end is not None]

    @property
    def _begun(self) -> list[tuple[Follower, Tie]]:
        """Those that act and have begun after the start."""
        both = zip(self.given, self.every, self.acting, strict=False)
        return [(one, tie) for one, tie, on in both if on and one.begin is not None]

    def refuse_beginning(self, time: float) -> None:
        """Raise ValueError on every rank if what the bodies are at a time depends on load steps before."""
        for one in (bolt.given for bolt in self.bolts):
            if one.force is not None and one.locked(time):
                raise ValueError(
                    f"{one.what}: at time {time:g} it is locked (lock = {one.lock:g}), at a length that only the load "
                    "steps before determine: begin at the time of lock or before"
                )
        for given, _ in self._begun:
            raise ValueError(
                f"{given.what}: at time {time:g} it holds nodes where the load steps before have left them "
                f"(begin = {given.begin:g}): begin at this time or before"
            )

    def loading(self, of_bodies: Loading, before: End | None = None) -> Loading:
        """A loading of the bodies with what constraints prescribe: displacements u with no unknowns, those of supports,
        rigid faces and bolts and what follows them; after a load step, the end of which fixes the shortening of locked
        bolts, and how far faces are from each other where ties have begun; collective."""
        if not self.ties:
            return of_bodies
        found, time, x = self.reduction, of_bodies.time, self.reduction.x
        kept = np.zeros(found.width) if before is None else self._amounts(before.displacement)
        offset = np.zeros_like(x)
        for motion in self.motions:
            offset += motion.prescribed(x, time, self.comm)
        for tie in self.ties:
            if tie.prescribed is not None:
                offset[tie.nodes] += tie.prescribed.at(time, self.comm)
        if before is not None and self._begun:
            left = found.apart(before.displacement)
            for one, tie in self._begun:
                offset[tie.nodes] += share_left(one, before.time, time) * left[tie.nodes]
        if self.motions:
            given = (float(np.max(np.abs(of), initial=0.0)) for of in (offset, of_bodies.prescribed))
            size = self.comm.allreduce(max(given), op=MPI.MAX)
            for motion in self.motions:
                motion.refuse_other(found.held.held_part(of_bodies.prescribed - offset), size, self.comm)
        y = np.zeros(found.width)
        for (bolt, own), locked in zip(self._of_bolts, self.locked, strict=True):
            if locked:
                y[own] = bolt.given.value(time, self.comm) if bolt.given.force is None else kept[own]
        apart = found.followed(offset) + found.moved(y)
        if self._displaced is not None:  # what is left
            apart -= found.left_apart(self._displaced)
            size = self.comm.allreduce(float(np.max(np.abs(self._displaced), initial=0.0)), op=MPI.MAX)
            apart[np.abs(apart) <= _ROUNDING * size] = 0.0
        offset = apart
        prescribed = found.lifted(found.with_own(of_bodies.prescribed, np.zeros(found.width)))
        for _ in range(LONGEST_CHAIN):  # u = W u + apart at slave nodes
            prescribed = prescribed + offset
            offset = found.followed(rows_of(found.W, offset))
            if not self.comm.allreduce(bool(np.any(offset)), op=MPI.LOR):
                break
        return replace(of_bodies, prescribed=prescribed, apart=apart, tension=self._tension(time))

    def after_transposed(self, time: float, start: float, owed: FloatArray) -> FloatArray:
        """What a function owes to the displacements after a load step that ended at `start`, by the lengths of locked
        bolts and by how far faces are apart where ties have begun, from what it owes to prescribed displacements; per
        metre, shapes (k, 3); collective."""
        if not self.ties:
            return np.zeros_like(owed)
        found, whole = self.reduction, owed
        for _ in range(LONGEST_CHAIN):
            whole = owed + at_nodes_of(found.W, found.followed(whole))
        along, apart = found.moved_transposed(whole), np.zeros_like(owed)
        kept = np.zeros(found.width)
        for (bolt, own), locked in zip(self._of_bolts, self.locked, strict=True):
            kept[own] = along[own] if locked and bolt.given.force is not None else 0.0
        for one, tie in self._begun:
            apart[tie.nodes] += share_left(one, start, time) * found.followed(whole)[tie.nodes]
        return found.on_followed(found.followed(apart + found.amounts_transposed(kept)))

    def _tension(self, time: float) -> FloatArray:
        """The forces of bolts along own unknowns at a time, newtons, shape (width,); collective."""
        forces = np.zeros(self.reduction.width)
        for bolt, own in self._of_bolts:
            if not bolt.given.fixed(time):
                forces[own] = bolt.given.value(time, self.comm)
        return forces

    # --- forces and motions -------------------------------------------------------------------------------------------

    def _lacking(self, imbalance: FloatArray, time: float) -> FloatArray:
        return self.reduction.lacking(imbalance, self._tension(time))

    def forces(self, imbalance: FloatArray, time: float) -> FloatArray:
        """The forces of all constraints on the bodies at a time in newtons, by the internal forces less all other
        forces, shapes (k, 3); collective."""
        return self.reduction.on_followed(self._lacking(imbalance, time)) if self.ties else np.zeros_like(imbalance)

    def shares(self, imbalance: FloatArray, time: float) -> Iterator[NodalForces]:
        """The forces of every tie on the nodes of its slave face, in the order given; those of ties that do not act are
        0; collective."""
        forces = self._lacking(imbalance, time)
        for number, tie in enumerate(self.every):
            if self.acting and not self.acting[number]:
                yield NodalForces(tie.kind.replace(" ", "_"), tie.face, np.zeros_like(forces))
                continue
            share, own = np.zeros_like(forces), np.einsum("mij,mj->mi", tie.directions, forces[tie.nodes])
            share[tie.nodes] = own
            beside = distributed_rows(tie.beside, (forces.size, tie.beside.shape[1]), self.reduction, None)
            share -= at_nodes_of(beside, own)
            beside.destroy()
            yield NodalForces(tie.kind.replace(" ", "_"), tie.face, share)

    def stresses(self, imbalance: FloatArray, time: float) -> dict[str, FloatArray]:
        """The `TIE_STRESSES` in pascals at this rank's nodes, shapes (k,), 0 off slave nodes; collective."""
        forces = self._lacking(imbalance, time)
        starts, found = starts_of(self.comm, len(forces)), np.zeros((2, len(forces)))
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
        """Of every rigid face its name, reference point (3,) in metres, and motion (6,) at displacements u (k, 3):
        translation of the point in metres, rotation about it in radians; collective."""
        for motion, own in self._of_faces:
            given = motion.prescribed(self.reduction.x, time, self.comm)
            y = self._amounts(u, self.reduction.followed(given))[own]
            yield motion.given.face, motion.place, motion.values(time, self.comm) + motion.motions @ y

    def bolts_at(self, u: FloatArray) -> Iterator[Bolt]:
        """Of every bolt what is known of it at displacements u (k, 3), in the order given; collective."""
        y = self._amounts(u)
        for (bolt, own), locked in zip(self._of_bolts, self.locked, strict=True):
            yield Bolt(bolt.face, bolt.place, bolt.direction, float(y[own]), locked)

    # --- springs at reference points ----------------------------------------------------------------------------------

    @property
    def sprung(self) -> list[FaceMotion]:
        """The rigid faces with springs at their reference points."""
        return [motion for motion in self.motions if np.any(motion.given.stiffness)]

    @property
    def link_equations(self) -> Sequence[Any]:
        """The springs between nodes, as given."""
        return () if self._links is None else self._links.given

    @property
    def springs(self) -> list[dict[str, Any]]:
        """Kind, face and what it holds of each of these springs, and of those between nodes."""
        found = [(motion.given.face, motion.given.holds) for motion in self.sprung]
        found += [(one.eliminated, f"stiffness {one.stiffness:g} N/m between nodes") for one in self.link_equations]
        return [{"kind": "spring", "face": face, "holds": holds} for face, holds in found]

    def with_links(self, rows: scipy.sparse.csr_matrix) -> scipy.sparse.csr_matrix:
        """This rank's rows of a stiffness with springs between nodes."""
        return rows if self._links is None else (rows + self._links.stiffness).tocsr()

    def link_force(self, u: FloatArray) -> FloatArray:
        """The forces of springs between nodes at displacements u (k, 3), newtons, shape (k, 3); collective."""
        return sum((of for _, of in self._links.forces(u)), np.zeros_like(u)) if self._links else np.zeros_like(u)

    def ground_forces(self, u: FloatArray) -> list[NodalForces]:
        """The forces of springs at reference points at displacements u (k, 3), or (k, 3, j); collective."""
        each = ((one.given, one.spring_force(u, one.given.stiffness, self.comm)) for one in self.sprung)
        return [NodalForces("spring", given.face, forces) for given, forces in each]

    def spring_forces(self, u: FloatArray) -> list[NodalForces]:
        """The same, and those of every spring between nodes; collective."""
        linked = () if self._links is None else self._links.forces(u)
        return self.ground_forces(u) + [NodalForces("spring", one.eliminated, forces) for one, forces in linked]

    def resisted(self, modes: FloatArray) -> FloatArray:
        """Nodal forces of springs of stiffness 1 in place of these, in rigid motions (k, 3, j); collective."""
        forces = np.zeros_like(modes)
        for motion in self.sprung:
            stiffness = motion.unit_stiffness(self.reduction.x, self.comm)
            forces = forces - motion.spring_force(modes, stiffness, self.comm)
        for _, pull in () if self._links is None else self._links.forces(modes, unit=True):
            forces = forces - pull
        return forces


_SHORTENS: Final = 1e-6
"""Part by which a motion of bodies changes the length of a bolt above which it does."""


def _openings(
    amounts: FloatArray, sections: Sequence[Section]
) -> tuple[FloatArray, list[tuple[str, RigidPart, FloatArray]]]:
    """The combinations of q motions that change the lengths of bolts, by the amounts (bolts, q) of each: of every bolt
    by itself where that is possible, shape (q, p); and of each what it is called, where it is, and along which
    direction."""
    left, sizes, right = np.linalg.svd(amounts)
    rank = int(np.sum(sizes > _SHORTENS))
    bolts = left[:, :rank]
    alone = np.linalg.norm(bolts @ bolts.T - np.eye(len(sections)), axis=0) < _SHORTENS
    wanted = np.eye(len(sections))[:, alone]
    others = np.linalg.svd(bolts - wanted @ (wanted.T @ bolts))[0]
    wanted = np.column_stack([wanted, others[:, : rank - wanted.shape[1]]])
    named = []
    for way in wanted.T:
        moving = [sections[k] for k in np.flatnonzero(np.abs(way) > _SHORTENS)]
        name = " with ".join(f"the bolt at {section.face!r}" for section in moving)
        named.append((name, RigidPart(moving[0].place, moving[0].radius), moving[0].direction))
    ways: FloatArray = right[:rank].T @ ((bolts / sizes[:rank]).T @ wanted)
    return ways, named
