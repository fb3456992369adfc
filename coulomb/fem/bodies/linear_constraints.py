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
from dataclasses import replace
from typing import Any, Final

import numpy as np
import scipy.sparse
from mpi4py import MPI

from ...arrays import FloatArray, IntArray
from ...units import used
from ..meshes import fetched, starts_of
from .constraints import HeldNodes, at_nodes_of, distributed_rows
from .finite_motions import turned_section, turned_tie
from .free_motions import SHORTENS, FreeMotions, OpenedPart, least_energy, openings, together
from .lasting_supports import End, act_together, acts, limits_of, share_left
from .loads import Loading, NodalForces
from .reduction import Reduction
from .rigid_modes import Wrench, component_modes, null_space
from .ties import Bolt, FaceMotion, Follower, LinkedNodes, Section, Tie

TIE_STRESSES = ("peel_stress", "shear_stress")
"""Tractions of ties at slave nodes: along the outward normal, positive where the tie pulls, and the size of the part
across it."""

_TOGETHER: Final = 2.0**-46
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
        every: These with their nodes, also those that do not act.
        ties: Those that act.
        acting: Which of `every` do; () if all act at all times.
        motions: Those of the rigid faces.
        bolts: The sections of bolts.
        of_faces, of_bolts: Both with where their own unknowns are among all.
        locked: Whether the shortening of each bolt is given, prescribed or locked: it is no unknown then.
        reduction: The map from unknowns to displacements.
        as_made: Those given, with the slaves that they have.
    """

    _displaced: FloatArray | None = None
    _pulling: FloatArray | None = None
    _before: End | None = None
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
        actings = {self._acting(time) for time in (*limits_of(self.given), np.inf)}  # between begins and ends
        self._reductions = {acting: self._reduction_of(acting, nodes) for acting in actings}
        self._take(self._acting(time), time)

    def _acting(self, time: float) -> tuple[bool, ...]:
        return tuple(acts(one, time) for one in self.given) if limits_of(self.given) else ()

    def _those(self, acting: tuple[bool, ...]) -> tuple[Tie, ...]:
        return tuple(tie for tie, on in zip(self.every, acting, strict=True) if on) if acting else self.every

    def _reduction_of(self, acting: tuple[bool, ...], nodes: HeldNodes) -> Reduction:
        """That of the constraints that act, no bolt being locked; collective."""
        ties = self._those(acting)
        of = [tie.motion or tie.bolt for tie in ties]
        places = [one.place for one, tie in zip(of, ties, strict=True) if one is not None and tie.own.shape[2]]
        return self._sprung(Reduction(nodes, ties, places), ties)

    def _sprung(self, reduction: Reduction, ties: Sequence[Tie]) -> Reduction:
        """With the springs of rigid faces along own unknowns; collective."""
        weights = [(own, N) for _, own, N, _ in reduction.weights]
        for tie, own in zip(ties, reduction.own, strict=True):
            if tie.motion is not None and tie.own.shape[2]:
                N = next(N for at, N in weights if at == own)
                along = self.comm.allreduce(np.einsum("mcp,mcq->pq", tie.motion.spread, N))
                reduction.stiffness[own, own] = (along.T * tie.motion.given.stiffness) @ along
        return reduction

    def _take(self, acting: tuple[bool, ...], time: float) -> None:
        """Let these constraints act, and those bolts be locked that are at a time."""
        self._unlocked = reduction = self._reductions[acting]
        self.acting = acting
        self._own(self._those(acting), reduction.own)
        self.locked = tuple(bolt.given.fixed(time) for bolt in self.bolts)
        self.reduction = self._prescribed()

    def _own(self, ties: tuple[Tie, ...], places: Sequence[slice]) -> None:
        """Let it have these ties, with their own unknowns at these places."""
        self.ties, owned = ties, [(tie.motion or tie.bolt, own) for tie, own in zip(ties, places, strict=True)]
        self.of_faces = [(motion, own) for motion, own in owned if isinstance(motion, FaceMotion)]
        self.of_bolts = [(bolt, own.start) for bolt, own in owned if isinstance(bolt, Section)]
        self.motions, self.bolts = [one for one, _ in self.of_faces], [one for one, _ in self.of_bolts]

    def _prescribed(self) -> Reduction:
        given = [own for (_, own), locked in zip(self.of_bolts, self.locked, strict=True) if locked]
        return self._unlocked.prescribing(given) if self.bolts else self._unlocked

    def at_time(self, time: float) -> Constraints:
        """The same with those that act and the bolts that are locked at a time, itself if these do and are; faces are
        shared, and T by the same that act."""
        acting, locked = self._acting(time), tuple(bolt.given.fixed(time) for bolt in self.bolts)
        if acting == self.acting and locked == self.locked:
            return self
        other = copy.copy(self)
        other._take(acting, time)
        return other if self._displaced is None else other.at_place(self.reduction.x, self._displaced, self._before)

    def same(self, other: Constraints) -> bool:
        """Whether those of the same bodies act, and the same bolts are locked, as of others."""
        return (self.acting, self.locked) == (other.acting, other.locked)

    def at_place(self, x: FloatArray, u: FloatArray, before: End | None = None) -> Constraints:
        """The same of nodes at another place x (k, 3), metres, displaced by u (k, 3), after the end of another load
        step: loadings are of changes of it.  Rotation vectors of rigid faces are the nearest to those before, by
        default 0; collective."""
        other = copy.copy(self)
        other._displaced, other._before = u, before
        other._unlocked = self._unlocked.at_place(x)
        if self.motions or self.bolts:
            reduction, apart, comm = self._before_deformation, self._apart(u), self.comm
            turns = None if before is None else before.turns
            near = iter(np.zeros((len(self.motions), 3)) if turns is None else turns)

            def there(tie: Tie) -> Tie:
                if tie.motion is not None:
                    motion = tie.motion.at_place(x, next(near), comm)
                    return replace(tie, own=motion.own(x), motion=motion)
                nodes = tie.nodes
                return tie if tie.bolt is None else turned_tie(tie, x[nodes], apart[nodes], reduction.tied[nodes], comm)

            other._own(tuple(map(there, self._those(self.acting))), reduction.own)
            other._unlocked = self._sprung(other._unlocked.of_weights(other.ties), other.ties)
        other.reduction = other._prescribed()
        return other

    def bent(self, imbalance: FloatArray, time: float, wrenches: Sequence[Wrench] = ()) -> Constraints:
        """The same, where rigid faces turn by finite angles with the stiffness by the forces that their nodes lack
        (`FiniteMotion.bent`), from the internal forces less all other forces (k, 3), among which are those of wrenches
        on faces; itself without; collective."""
        forces, stiffness = self.lacking(imbalance, time), np.zeros_like(self.reduction.stiffness)
        for motion, own in self.of_faces:
            here = [wrench for wrench in wrenches if wrench.face == motion.given.face]
            others = sum((one.forces for one in here), forces + motion.pull(self._displacement, self.comm))
            stiffness[own, own] = motion.bent(others, here, self.comm)
        if not np.any(stiffness):
            return self
        other = copy.copy(self)
        other._unlocked = self._unlocked.bent(stiffness)
        other.reduction = other._prescribed()
        return other

    @property
    def before_step(self) -> Constraints:
        """The same at the place after the load step before; itself where displacements are small."""
        before, x = self._before, self._before_deformation.x
        if self._displaced is None or before is None:
            return self
        return self.at_place(x + before.displacement, before.displacement)

    @property
    def _before_deformation(self) -> Reduction:
        """That of the constraints that act, of nodes that are not displaced."""
        return self._reductions[self.acting]

    def _apart(self, u: FloatArray) -> FloatArray:
        """By how much nodes are apart at displacements u (k, 3) from what they follow, metres, shape (k, 3), however
        far they have turned; collective."""
        return self._before_deformation.apart(u)

    def _sections(self, u: FloatArray) -> list[Section]:
        """The sections of bolts at displacements u (k, 3), in large motions turned; collective."""
        if self._displaced is None:
            y = self._amounts(u)
            return [replace(bolt, shortening=float(y[own])) for bolt, own in self.of_bolts]
        before, apart, ties = self._before_deformation, self._apart(u), self._those(self.acting)
        x = before.x + u
        each = ((tie, tie.nodes) for tie in ties if tie.bolt is not None)
        return [turned_section(tie, x[at], apart[at], before.tied[at], self.comm) for tie, at in each]

    @property
    def _displacement(self) -> FloatArray:
        """The displacement of which loadings are changes, metres, shape (k, 3)."""
        return np.zeros_like(self.reduction.x) if self._displaced is None else self._displaced

    @property
    def turns(self) -> FloatArray | None:
        """Where displaced, the rotation vectors of all rigid faces, radians, shape (faces, 3); None without any."""
        if self._displaced is None or not self.motions:
            return None
        return np.array([motion.turn for motion in self.motions])

    # --- free motions -------------------------------------------------------------------------------------------------

    def joined(self, component: IntArray, names: tuple[str, ...]) -> tuple[IntArray, tuple[str, ...]]:
        """The component of every node, where those that move together, or are linked by springs, are one, and their
        names; collective."""
        return together(self.ties, component, names, self.comm, [] if self._links is None else self._links.nodes)

    def opened(
        self,
        unheld: FreeMotions,
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
        loose = [of for of, locked in zip(self.of_bolts, self.locked, strict=True) if not locked]
        bolts, own = [bolt for bolt, _ in loose], [at for _, at in loose]
        firm = [tie for tie in self.ties if tie.bolt not in bolts and tie.prescribed is None]
        if len(firm) == len(self.ties) and self._links is None:
            return unheld
        part, names = together(firm, component, names, self.comm)
        modes, parts = component_modes(self.reduction.x, part, self.comm)
        each = np.concatenate([np.where((part == k)[:, None, None], modes, 0.0) for k in range(len(parts))], axis=2)
        forces = self.reduction.prevented(each) + resisted(each)
        of_modes = unheld.modes(self.reduction.x)
        energy, gram, whole = (
            self.comm.allreduce(np.einsum("kci,kcj->ij", each, of)) for of in (forces, each, of_modes)
        )
        free = null_space(energy, least_energy(energy))
        motions = each @ free
        ways, named = openings(self._amounts(motions)[own], bolts)
        known = np.column_stack([free.T @ np.linalg.solve(gram, whole), ways])
        left, sizes, _ = np.linalg.svd(known)
        others = left[:, int(np.sum(sizes > SHORTENS)) :]
        for amounts in (free @ others).T.reshape(-1, len(parts), 6):
            most = int(np.argmax(np.linalg.norm(amounts, axis=1)))
            along = amounts[most, :3] if np.any(np.abs(amounts[most, :3]) > SHORTENS) else amounts[most, 3:]
            named.append((names[most], parts[most], along))
        if not named:
            return unheld
        ways = np.column_stack([ways, others])
        of_parts = (free @ ways).reshape(len(parts), 6, -1)
        numbers = [int(np.max(unheld.component[part == k], initial=-1)) for k in range(len(parts))]
        numbers = np.max(self.comm.allgather(numbers), axis=0).tolist()
        opened = [OpenedPart(*one) for one in zip(names, numbers, parts, of_parts, strict=True)]
        return unheld.opened(motions @ ways, named, opened)

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
    def begun(self) -> list[tuple[Follower, Tie]]:
        """Those that act and have begun after the start."""
        both = zip(self.given, self.every, self.acting, strict=False)
        return [(one, tie) for one, tie, on in both if on and one.begin is not None]

    def refuse_beginning(self, time: float) -> None:
        """Raise ValueError on every rank if what the bodies are at a time depends on load steps before."""
        if self._displaced is not None:
            return
        for one in (bolt.given for bolt in self.bolts):
            if one.force is not None and one.locked(time):
                raise ValueError(
                    f"{one.what}: at time {time:g} it is locked (lock = {one.lock:g}), at a length that only the load "
                    "steps before determine: begin at the time of lock or before"
                )
        for given, _ in self.begun:
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
        reduction, time, x = self.reduction, of_bodies.time, self.reduction.x
        before = before or self._before
        offset = self._offset([one.prescribed(x, time, self.comm) for one in self.motions], time)
        if before is not None and self.begun:
            left = reduction.apart(before.displacement)
            for one, tie in self.begun:
                offset[tie.nodes] += share_left(one, before.time, time) * left[tie.nodes]
        if self.motions:
            given = (
                float(np.max(np.abs(of), initial=0.0)) for of in (offset, of_bodies.prescribed, self._displacement)
            )
            size = self.comm.allreduce(max(given), op=MPI.MAX)
            for motion in self.motions:
                motion.refuse_other(reduction.held.held_part(of_bodies.prescribed - offset), size, self.comm)
        y = np.zeros(reduction.width)
        kept = self.bolts if before is None else self._sections(before.displacement)
        for (bolt, own), locked, then in zip(self.of_bolts, self.locked, kept, strict=True):
            length = bolt.given.value(time, self.comm) if bolt.given.force is None else then.shortening
            y[own] = length if locked else bolt.shortening
        apart = reduction.followed(offset) + reduction.moved(y)
        if self._displaced is not None:  # what is left
            left = reduction.left_apart(self._displaced)
            for tie in self.ties:
                if tie.motion is not None and tie.motion.finite:
                    left[tie.nodes] = 0.0  # their offset is from where they are
                elif tie.bolt is not None:
                    left[tie.nodes] = self._apart(self._displaced)[tie.nodes]
            apart -= left
            size = self.comm.allreduce(float(np.max(np.abs(self._displaced), initial=0.0)), op=MPI.MAX)
            apart[np.abs(apart) <= _TOGETHER * size] = 0.0
        prescribed = reduction.led(of_bodies.prescribed, apart)
        load = of_bodies.load
        if self._displaced is not None:
            load = sum((one.forces for one in self.spring_forces(self._displaced)), load)
        return replace(of_bodies, load=load, prescribed=prescribed, apart=apart, tension=self._tension(time))

    def _offset(self, of_faces: Sequence[FloatArray], time: float) -> FloatArray:
        offset = sum(of_faces, np.zeros_like(self.reduction.x))
        for tie in self.ties:
            if tie.prescribed is not None:
                offset[tie.nodes] += tie.prescribed.at(time, self.comm)
        return offset

    def apart_rate(self, time: float) -> FloatArray:
        """Derivative of how far nodes are prescribed to be apart from what they follow, by rigid faces, bolts and
        equations, along the common factor of all that is prescribed, metres, shape (k, 3); collective."""
        reduction, y = self.reduction, np.zeros(self.reduction.width)
        offset = self._offset([motion.prescribed_rate(reduction.x, time, self.comm) for motion in self.motions], time)
        for bolt, own in self.of_bolts:
            y[own] = bolt.given.value(time, self.comm) if bolt.given.force is None else 0.0
        return reduction.followed(offset) + reduction.moved(y)

    def pulling(self, tension: FloatArray | None) -> Constraints:
        """The same under these forces of bolts along own unknowns at any time, newtons, shape (width,); of None 0."""
        other = copy.copy(self)
        other._pulling = np.zeros(self.reduction.width) if tension is None else tension
        return other

    def _tension(self, time: float) -> FloatArray:
        """The forces of bolts along own unknowns at a time, newtons, shape (width,); collective."""
        if self._pulling is not None:
            return self._pulling
        forces = np.zeros(self.reduction.width)
        for bolt, own in self.of_bolts:
            if not bolt.given.fixed(time):
                forces[own] = bolt.given.value(time, self.comm)
        return forces

    # --- forces and motions -------------------------------------------------------------------------------------------

    def lacking(self, imbalance: FloatArray, time: float) -> FloatArray:
        """The forces of all constraints on the nodes that follow; arguments as of `forces`; collective."""
        return self.reduction.lacking(imbalance, self._tension(time))

    def forces(self, imbalance: FloatArray, time: float) -> FloatArray:
        """The forces of all constraints on the bodies at a time in newtons, by the internal forces less all other
        forces, shapes (k, 3); collective."""
        return self.reduction.on_followed(self.lacking(imbalance, time)) if self.ties else np.zeros_like(imbalance)

    def shares(self, imbalance: FloatArray, time: float) -> Iterator[NodalForces]:
        """The forces of every tie on the nodes of its slave face, in the order given; those of ties that do not act are
        0; collective."""
        forces = self.lacking(imbalance, time)
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
        forces = self.lacking(imbalance, time)
        starts, stresses = starts_of(self.comm, len(forces)), np.zeros((2, len(forces)))
        for tie in self.ties:
            there = fetched(self.comm, starts, tie.traction.indices.astype(np.int64), forces)
            spread = scipy.sparse.csr_matrix(
                (tie.traction.data, np.arange(len(there)), tie.traction.indptr), (len(tie.nodes), len(there))
            )
            traction = spread @ there
            along = np.einsum("mi,mi->m", traction, tie.normal)
            stresses[:, tie.nodes] = along, np.linalg.norm(traction - along[:, None] * tie.normal, axis=1)
        return dict(zip(TIE_STRESSES, stresses, strict=True))

    def motions_of_faces(self, u: FloatArray, time: float) -> Iterator[tuple[str, FloatArray, FloatArray]]:
        """Of every rigid face its name, reference point (3,) in metres, and motion (6,) at displacements u (k, 3), if
        it has no place of its own: translation of the point in metres, rotation in radians; collective."""
        for motion, own in self.of_faces:
            given = motion.prescribed(self.reduction.x, time, self.comm)
            y = self._amounts(u, self.reduction.followed(given))[own]
            yield motion.given.face, *motion.moved_by(y, time, self.comm)

    def bolts_at(self, u: FloatArray) -> Iterator[Bolt]:
        """Of every bolt what is known of it at displacements u (k, 3), in the order given; collective."""
        for bolt, locked in zip(self._sections(u), self.locked, strict=True):
            yield Bolt(bolt.face, bolt.place, bolt.direction, bolt.shortening, locked)

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
        unit = used().name("N/m")
        found += [(one.eliminated, f"stiffness {one.stiffness:g} {unit} between nodes") for one in self.link_equations]
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

    def spring_force(self, u: FloatArray) -> FloatArray:
        """The forces of all springs by changes u (k, 3) of displacements, shape (k, 3); collective."""
        return sum((one.forces for one in self.ground_forces(u)), self.link_force(u))

    def spring_forces(self, u: FloatArray) -> list[NodalForces]:
        """The forces of springs at reference points where displacements are u (k, 3), and those of every spring between
        nodes; collective."""
        linked = () if self._links is None else self._links.forces(u)
        pulled = [NodalForces("spring", one.given.face, one.pull(u, self.comm)) for one in self.sprung]
        return pulled + [NodalForces("spring", one.eliminated, forces) for one, forces in linked]

    def spring_energy(self, u: FloatArray, time: float) -> float:
        """Of the springs at reference points at displacements u (k, 3), joules; collective."""
        each = zip(self.motions, self.motions_of_faces(u, time), strict=True)
        return sum(0.5 * float(one.given.stiffness @ motion**2) for one, (*_, motion) in each)

    def resisted(self, modes: FloatArray) -> FloatArray:
        """Nodal forces of springs of stiffness 1 in place of these, in rigid motions (k, 3, j); collective."""
        forces = np.zeros_like(modes)
        for motion in self.sprung:
            stiffness = motion.unit_stiffness(self.reduction.x, self.comm)
            forces = forces - motion.spring_force(modes, stiffness, self.comm)
        for _, pull in () if self._links is None else self._links.forces(modes, unit=True):
            forces = forces - pull
        return forces
