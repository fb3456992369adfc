"""The stiffness of bodies in their unknowns: nothing is held or follows, and springs are where contact alone holds."""

from __future__ import annotations

import copy
import weakref
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final, Self

import numpy as np
import scipy.sparse
from mpi4py import MPI
from petsc4py import PETSc

from ...arrays import BoolArray, FloatArray, IntArray
from ...units import amount
from .constraints import HeldNodes, Numbering, diagonal_of, distributed_rows, local_rows, rows_of
from .free_motions import FreeMotions, anchors, free_motions
from .linear_constraints import Constraints
from .loads import Loading
from .reduction import Reduction
from .rigid_modes import component_modes, of_components


@dataclass(eq=False)
class Reduced:
    """The stiffness in the unknowns, N/m.

    Attributes:
        K: The matrix; None from when it has been let go until it is asked for.
        held_diagonal: Its entry for held components: the mean diagonal of the node without supports, shape (k, 1).
        anchoring: Of the springs at the anchors of free motions, shape (k + p, 3).
    """

    K: PETSc.Mat | None
    held_diagonal: FloatArray
    anchoring: FloatArray
    _diagonal: PETSc.Vec | None = None

    def let_go(self) -> None:
        """Free K but for its diagonal; collective."""
        if self.K is not None:
            comm, self._diagonal = self.K.comm, self.K.getDiagonal()
            self.K = None
            PETSc.garbage_cleanup(comm)

    def vector(self) -> PETSc.Vec:
        """Of the unknowns, with any values; collective."""
        if self.K is None:
            assert self._diagonal is not None
            return self._diagonal.duplicate()
        return self.K.createVecRight()

    @property
    def diagonal(self) -> FloatArray:
        """Of K, this rank's entries, shape (n,); collective."""
        if self.K is None:
            assert self._diagonal is not None
            return self._diagonal.array.copy()
        return diagonal_of(self.K)


@dataclass(frozen=True, eq=False)
class AddedSprings:
    """Springs beside those of the bodies.

    Attributes:
        stiffness: On displacements of all nodes, N/m.
        force: At this rank's nodes where nothing is displaced, newtons, shape (k, 3).
        inside: Whether each couples the displacements of one node alone.
        along: Of springs that stand for conditions of contact, the stiffness along its unknowns, N/m, shape (m, 3).
    """

    stiffness: PETSc.Mat
    force: FloatArray
    inside: bool
    along: FloatArray | None = None

    def added_to(self, K: PETSc.Mat, lifetime: object) -> None:
        """Add them to a stiffness, and to what this must keep alive; collective."""
        pattern = PETSc.Mat.Structure
        K.axpy(1.0, self.stiffness, pattern.SUBSET if self.inside else pattern.DIFFERENT_NONZERO_PATTERN)
        K.setAttr("mesh", lifetime)

    def of_components(self, modes: FloatArray, component: IntArray) -> FloatArray:
        """Their forces in motions (k, 3, j) of one component after the other, all others at rest, over the largest
        stiffness, shape (k, 3, j); collective."""
        comm, forces = self.stiffness.comm.tompi4py(), np.zeros_like(modes)
        stiffest = comm.allreduce(float(np.max(diagonal_of(self.stiffness), initial=-np.inf)), op=MPI.MAX) or 1.0
        for number in range(1 + comm.allreduce(int(np.max(component, initial=-1)), op=MPI.MAX)):
            here = component == number
            for j in range(modes.shape[2]):
                moved = np.where(here[:, None], modes[:, :, j], 0.0)
                forces[here, :, j] = rows_of(self.stiffness, moved)[here] / stiffest
        return forces


@dataclass(eq=False)
class Made:
    """What follows from the coefficients of the stiffness and from supports: made when it is asked for, thrown away
    when these change.

    Attributes:
        values: The coefficients of the user's forms.
        diagonal: Of the matrix of the user's form alone, N/m, shape (k, 3).
        ground: Nodal forces of the rigid modes by the user's form, and the motions that it does not resist.
    """

    values: Any = None
    free: FreeMotions | None = None
    reduced: Reduced | None = None
    constraints: Constraints | None = None
    diagonal: FloatArray | None = None
    ground: tuple[FloatArray | None, FreeMotions] | None = None
    free_unknowns: FloatArray | None = None


class ReducedBodies(HeldNodes, ABC):
    """Bodies with their stiffness in the unknowns.

    Attributes:
        component: The component of the meshes of each of this rank's nodes, whether or not it is tied to others, shape
            (k,).
        added_springs: Springs beside those of the bodies.
    """

    component: IntArray
    added_springs: AddedSprings | None = None
    _made: Made
    _K_of: ReducedBodies | None = None

    @property
    @abstractmethod
    def members(self) -> tuple[Any, ...]:
        """The bodies by themselves, `Member`."""

    def on_springs(self, springs: AddedSprings) -> Self:
        """The same with these springs beside those of the bodies."""
        there = copy.copy(self)
        there.added_springs, there._made = springs, Made(self._made.values, constraints=self._made.constraints)
        return there

    def _with_springs(self, forces: FloatArray, u: FloatArray) -> FloatArray:
        """Internal forces (k, 3) at displacements u (k, 3), and those of the springs; collective."""
        return forces if self.added_springs is None else forces + rows_of(self.added_springs.stiffness, u)

    def _resisted_by_springs(self, modes: FloatArray) -> FloatArray:
        """`AddedSprings.of_components` of motions (k, 3, j), of the components of the meshes; collective."""
        springs = self.added_springs
        return np.zeros_like(modes) if springs is None else springs.of_components(modes, self.component)

    def _under_springs(self, loading: Loading) -> Loading:
        return loading if self.added_springs is None else replace(loading, load=loading.load + self.added_springs.force)

    @property
    def constraints(self) -> Constraints:
        """What follows what in them."""
        if self._made.constraints is None:
            self._made.constraints = Constraints(self)
        return self._made.constraints

    @property
    def reduction(self) -> Reduction:
        """The map from unknowns to displacements."""
        return self.constraints.reduction

    @abstractmethod
    def assembled(self) -> PETSc.Mat:
        """The stiffness of the bodies as they are, N/m, with springs on their faces, without supports and ties; block
        size 3; that of the caller, who may change it; collective."""

    @abstractmethod
    def resisted(self, modes: FloatArray) -> FloatArray:
        """Nodal forces of springs of stiffness 1 in place of those on faces, and of what else is in the stiffness, in
        rigid motions of components (k, 3, j); collective."""

    @abstractmethod
    def interpolated(self) -> tuple[scipy.sparse.csr_matrix, FloatArray, Numbering]:
        """Displacements by those of the vertices in second order, by themselves in first: this rank's rows, where these
        nodes are, metres, and their numbers; collective."""

    @property
    @abstractmethod
    def component_names(self) -> tuple[str, ...]:
        """What each component is called in messages; collective."""

    @property
    def moving_together(self) -> tuple[IntArray, tuple[str, ...]]:
        """The component of each of this rank's nodes, where those that are tied are one, shape (k,), and what each is
        called in messages; collective."""
        return self.constraints.joined(self.component, self.component_names)

    @property
    def free(self) -> FreeMotions:
        """The rigid motions along which contact alone holds it."""
        if self._made.free is None:
            self._made.free = self._rigid_motions(self.resisted)
        return self._made.free

    @property
    def unheld(self) -> FreeMotions:
        """The rigid motions that supports and ties allow, whatever springs and stress resist of them; collective."""
        return self._rigid_motions(np.zeros_like)

    def _rigid_motions(self, resisted: Callable[[FloatArray], FloatArray]) -> FreeMotions:
        """Those that neither supports and ties nor what is `resisted` prevent, with loose bolts; collective."""
        component, names = self.moving_together
        modes, _ = component_modes(self.x, component, self.comm)
        motions = free_motions(self.x, component, names, self.reduction.prevented(modes) + resisted(modes), self.comm)
        return self.constraints.opened(motions, self.component, self.component_names, resisted)

    @property
    def K(self) -> PETSc.Mat:
        """Stiffness of the unknowns, N/m, with held directions eliminated; block size 3, symmetric positive definite,
        with the rigid body modes as its near-nullspace.

        Raises:
            ValueError: On every rank, if every direction of every node of a body is held, or if rigid motions are
                resisted by no more than rounding errors.
        """
        if self.reduced.K is None:
            self.reduced.K = eliminated(self._K_of or self).K
        return self.reduced.K

    @property
    def anchoring(self) -> FloatArray:
        """Stiffness of the springs that K has at the `anchors` of `free`, N/m, shape (k + p, 3); they are no internal
        forces, and carry nothing where loads and contact forces are in equilibrium."""
        return self.reduced.anchoring

    def keep_stiffness(self, known: ReducedBodies) -> None:
        """Take the stiffness of bodies that differ in loads and in the values of what supports prescribe alone, if the
        same directions are held; collective."""
        mine, theirs = self.held, known.held
        same = np.array_equal(mine.nodes, theirs.nodes) and np.array_equal(mine.projector, theirs.projector)
        if self.comm.allreduce(same, op=MPI.LAND):
            self._made.reduced, self._K_of = known.reduced, known._K_of or known  # which K does not keep alive

    @property
    def reduced(self) -> Reduced:
        """The stiffness of the unknowns: one object for all bodies that have the same."""
        if self._made.reduced is None:
            self._made.reduced = eliminated(self)
        return self._made.reduced

    def interpolation(self) -> PETSc.Mat:
        """From linear displacements to unknowns of second order, with their rigid body modes as near-nullspace; for
        multigrid; collective."""
        linear, x, numbering = self.interpolated()
        second = np.zeros(len(self.x), dtype=bool)
        for member in self.members:
            second[member.nodes] = member.body.degree == 2
        P = self.reduction.interpolation(linear, 3 * numbering.local, second)
        attach_rigid_modes(P, x, self.reduction)
        return P

    @property
    def free_unknowns(self) -> FloatArray:
        """The unknowns of K in each of the free motions, shape (k + p, 3, q), not to be changed; collective."""
        if self._made.free_unknowns is None:
            self._made.free_unknowns = self.reduction.reduced(self.held.free_part(self.free.modes(self.x)))
        return self._made.free_unknowns

    @property
    def ground(self) -> FloatArray | None:
        """Nodal forces in newtons of the `rigid_modes`, of one metre, shape (k, 3, 6): those of springs, and of elastic
        foundations in the user's forms; None if there are none; collective."""
        return None


def eliminated(bodies: ReducedBodies) -> Reduced:
    """The stiffness of the bodies in their unknowns; collective.

    With P, from unknowns to displacements without held directions, K becomes P^T K P + m (I - P): where a component is
    held, its row and column are zero except for the diagonal.  The numbers m are means of the diagonal of the node: a 1
    there would disturb multigrid and all scales.  So would the same number at all nodes if one material is much stiffer
    than another: multigrid takes the coupling of two nodes for weak where it is small beside their diagonals, nodes
    that are held along one direction in the softer material are then on no coarser grid, and motions of the body as a
    whole are not either.

    Springs at anchors are as stiff as K there: multigrid then takes as many iterations as for a clamped body; with 1e3
    times K's diagonal up to twice as many.

    Raises:
        ValueError: On every rank, if every direction of every node of all bodies is held, or if rigid motions are
            resisted by no more than rounding errors.
    """
    comm = bodies.comm
    free = [3 * len(member.body.x) - member.body.held.number for member in bodies.members]
    if not np.any(comm.allreduce(np.array(free))):
        raise ValueError("the supports hold every node: there is nothing to compute; use a finer mesh")
    K = bodies.assembled()
    if bodies.added_springs is not None:
        bodies.added_springs.added_to(K, bodies.lifetime)
    alone = diagonal_of(K).reshape(-1, 3)
    mean: FloatArray = alone.mean(axis=1, keepdims=True)
    typical = comm.allreduce(float(mean.sum())) / bodies.numbering.total
    mean = np.where(mean > 0.0, mean, typical)  # forms may vanish where everything is held
    anchored = _anchors(bodies)
    if bodies.added_springs is None:  # with them the same is asked of the bodies themselves
        _refuse_soft(bodies, anchored, alone)
    reduction = bodies.reduction
    if not reduction.trivial:
        P = reduction.projection()
        product = K.PtAP(P)
        stiff = diagonal_of(product).reshape(-1, 3)
        rigid = stiff[len(bodies.x) :] <= _RIGID * typical
        stiff[len(bodies.x) :][rigid] = typical
        anchoring = anchored * stiff
        rows = local_rows(product) + reduction.filled(mean, anchoring)
        for thing in (K, P, product):
            thing.destroy()
        K = distributed_rows(rows.tobsr((3, 3)).tocsr(), (3 * len(reduction.points), rows.shape[1]), bodies)
    else:  # P is diagonal
        anchoring, scale = anchored * alone, K.createVecRight()
        scale.array[:] = reduction.kept(np.ones_like(bodies.x)).ravel()
        K.diagonalScale(scale, scale)
        scale.array[:] = np.where(bodies.held.components, mean, alone + anchoring).ravel()
        K.setDiagonal(scale)
        scale.destroy()
    K.setOption(PETSc.Mat.Option.SYMMETRIC, True)
    K.setOption(PETSc.Mat.Option.SPD, True)
    attach_rigid_modes(K, bodies.x, reduction)
    count = 1 + comm.allreduce(int(np.max(bodies.component, initial=-1)), op=MPI.MAX)
    if count > 1:  # own unknowns may couple components, or be coupled to none
        K.setAttr(COMPONENTS, np.append(bodies.component, count + np.arange(reduction.here)).astype(np.int32))
    if any(member.body.degree == 2 for member in bodies.members):
        of_body = weakref.WeakMethod(bodies.interpolation)  # Python cannot collect a cycle through a matrix of PETSc
        K.setAttr(INTERPOLATION, lambda: (make := of_body()) and make())
    return Reduced(K, mean, anchoring)


def _anchors(bodies: ReducedBodies) -> BoolArray:
    """Which unknowns are anchors of free motions: those of nodes that follow no other, if these determine all motions,
    shape (k + p, 3); collective."""
    places = np.zeros((4, len(bodies.reduction.points)), dtype=bool)
    for member in bodies.members:
        places[:3, member.nodes] = member.body.anchor_places
    for tie in bodies.constraints.ties:
        places[:3, tie.nodes] = False
    places[3] = True
    return anchors(bodies.free, bodies.free_unknowns, bodies.reduction.points, list(places), bodies.comm)


_RIGID: Final = 1e-9
"""Diagonal entry of a motion of a face over the mean one of nodes, up to which it is that of a body that is rigid as a
whole: a rounding error."""

_SOFT: Final = 1e-12
"""Energy of a rigid motion over the number of nodes and the largest diagonal entry of the stiffness, up to which it is
resisted by no more than rounding errors."""


def _refuse_soft(bodies: ReducedBodies, anchored: BoolArray, diagonal: FloatArray) -> None:
    """ValueError on every rank, if anchors, supports, ties and springs on bodies of materials resist rigid motions by
    no more than rounding errors of the diagonal (k, 3), N/m; collective."""
    comm, count = bodies.comm, len(bodies.x)
    component, names = bodies.moving_together
    if comm.allreduce(bool(np.any(anchored[count:])), op=MPI.LOR):
        return
    modes, parts = component_modes(bodies.x, component, comm)
    forces, ground = bodies.reduction.prevented(modes) + anchored[:count, :, None] * modes, bodies.ground
    if ground is not None:
        ground = of_components(ground, bodies.x, component, parts, comm)
    for member in bodies.members:
        here = member.nodes
        stiff = comm.allreduce(float(np.max(diagonal[here], initial=0.0)), op=MPI.MAX)
        if member.body.sprung is None:
            forces[here] = modes[here]
        elif ground is not None:
            forces[here] += ground[here] / stiff
    soft = free_motions(bodies.x, component, names, forces, comm, _SOFT)
    if not soft.motions:
        return
    numbers = [motion.component for motion in soft.motions]
    there = np.isin(component, numbers)
    moves = " or ".join(map(str, soft.motions))
    body = "" if len(bodies.members) == 1 else f"{' and '.join(names[k] for k in dict.fromkeys(numbers))}: "
    sprung = any(bool(one.body.sprung) and bool(np.any(there[one.nodes])) for one in bodies.members)
    if comm.allreduce(sprung, op=MPI.LOR):
        raise ValueError(
            f"{body}the springs are too soft in comparison with rounding errors: they hardly resist that the body "
            f"{moves}; against that the nodes have less than 1e-12 of the body's own stiffness; make the springs "
            "stiffer, or leave them out where contact holds the body"
        )
    ends = (np.max(side * bodies.x[there], axis=0, initial=-np.inf) for side in (1.0, -1.0))
    lengths = sum(np.max(comm.allgather(end), axis=0) for end in ends)
    raise ValueError(
        f"{body}the body is {amount(np.max(lengths))} long and {amount(np.min(lengths))} thin: supports and contact "
        f"resist that it {moves} by no more than rounding errors of its stiffness; check the lengths and the unit of "
        "the mesh"
    )


COMPONENTS: Final = "components"
"""Attribute of a stiffness of several components: the number of each unknown's, node by node, shape (k + p,)."""

INTERPOLATION = "interpolation"
"""Attribute of a second-order stiffness: makes the matrix that interpolates linear displacements; None without body."""


def attach_rigid_modes(matrix: PETSc.Mat, x: FloatArray, reduction: Reduction) -> None:
    """The near-nullspace of a matrix whose columns are displacements of nodes at x (n, 3), and own unknowns: the rigid
    motions, orthonormal; collective."""
    modes = reduction.rigid_modes(x)
    V: FloatArray = modes.reshape(-1, modes.shape[2])  # a rank may have no nodes
    V = np.linalg.solve(np.linalg.cholesky(reduction.comm.allreduce(V.T @ V)), V.T)
    vectors = []
    for column in V:
        vectors.append(matrix.createVecRight())
        vectors[-1].array[:] = column
    kernel = PETSc.NullSpace().create(constant=False, vectors=vectors, comm=matrix.comm)
    matrix.setNearNullSpace(kernel)
    for one in (kernel, *vectors):
        one.destroy()
