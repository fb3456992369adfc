"""The map from unknowns to displacements that supports, ties, rigid faces and bolts make: u = T v + g.

Unknowns v are the displacements of nodes, and those that constraints have of their own, six or fewer of a rigid face
and one of a bolt, in metres.  Along the directions D in which nodes follow others, u = W u + N y, with y own unknowns;
W of one constraint may be on nodes of others.  With E = I - D,

    T = E + D (W T + N T_own).

The forces of constraints are those that slave nodes lack, lambda = D (internal - outer forces + W^T lambda), and
-W^T lambda on what these follow; along own unknowns that are free N^T lambda = F, the forces of bolts.  Own unknowns
are those that fit displacements best.

With H, along which nodes are held, D is at most I - H, and unknowns along H are prescribed, as are those own ones that
are not `loose`; P is T without them.

Own unknowns are on the last rank, after its nodes and padded to nodes of three, so that nodes have the same numbers
among unknowns as among displacements.  Which of them are free changes in time: T does not.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cached_property, partial
from typing import Final

import numpy as np
import scipy.sparse
from mpi4py import MPI
from petsc4py import PETSc

from ...arrays import BoolArray, FloatArray, IntArray
from .constraints import HeldNodes, Numbering, at_nodes_of, block_diagonal, distributed_rows, rows_of
from .rigid_modes import component_modes, displacements_of
from .ties import Tie

LONGEST_CHAIN: Final = 8
"""Ties of which each follows the next."""


def _each_column(of: Callable[[FloatArray], FloatArray], v: FloatArray) -> FloatArray:
    """A function of nodal vectors (k, 3) for each of several (k, 3, j)."""
    if v.ndim == 2:
        return of(v)
    if not v.shape[2]:
        return of(np.zeros(v.shape[:2]))[:, :, None][:, :, :0]
    return np.stack([of(v[:, :, j]) for j in range(v.shape[2])], axis=2)


def _scaled(factors: FloatArray, values: FloatArray) -> FloatArray:
    """Values of any shape (n, ...) times factors (n,)."""
    return factors.reshape(-1, *(1,) * (values.ndim - 1)) * values


def chained(E: PETSc.Mat, W: PETSc.Mat, ties: Sequence[Tie], lifetime: object) -> PETSc.Mat:
    """T = E + W T, of nodes that follow nodes that follow others, with what it must keep alive; collective.  ValueError
    on every rank if nodes of these ties follow each other in a circle."""
    T, change = E.copy(), 1.0
    for _ in range(LONGEST_CHAIN):
        then = W.matMult(T)
        then.axpy(1.0, E)
        T.axpy(-1.0, then)
        change, T = T.norm(), then
        if change == 0.0:
            T.setAttr("mesh", lifetime)  # keeps it alive: see compat.assemble_matrix
            return T
    said = ", ".join(f"{tie.kind} of {tie.face!r}" for tie in ties)
    raise ValueError(f"{said}: nodes follow each other in a circle")


class Reduction:
    """T of some constraints on nodes; this rank's k nodes and p nodes of own unknowns.

    Args:
        nodes: The nodes, with what supports hold.
        ties: What nodes follow.
        places: Where the own unknowns of those that have any are, metres, each of shape (3,).

    Attributes:
        x, held: Of the nodes.
        points: Where the unknowns are, metres, shape (k + p, 3); p is 0 but on the last rank.
        own: Where those of each tie are among all own unknowns.
        width: How many these are on all ranks, with what pads them.
        loose: 1 at own unknowns that are free, 0 at those that are prescribed and at what pads them, shape (width,).
        stiffness: Of springs along own unknowns, N/m, shape (width, width).
        trivial: Whether nothing is held but along axes, and nothing follows.
    """

    stiffness: FloatArray
    _bent: FloatArray | None = None

    def __init__(self, nodes: HeldNodes, ties: Sequence[Tie] = (), places: Sequence[FloatArray] = ()):
        self.x, self.held, self.comm, self.lifetime = nodes.x, nodes.held, nodes.comm, nodes.lifetime
        self._ties, self._of_nodes = tuple(ties), nodes.numbering
        padded = [-(-tie.own.shape[2] // 3) for tie in ties]
        starts = 3 * np.cumsum([0, *padded])
        self.own = [slice(int(at), int(at) + tie.own.shape[2]) for at, tie in zip(starts, ties, strict=False)]
        self.width = int(starts[-1])
        self.loose, self.stiffness = np.zeros(self.width), np.zeros((self.width, self.width))
        for own in self.own:
            self.loose[own] = 1.0
        x = np.repeat(np.reshape(places, (-1, 3)), [count for count in padded if count], axis=0)
        last = self.comm.rank == self.comm.size - 1
        self.points: FloatArray = np.concatenate([self.x, x]) if last else self.x
        self.here = len(self.points) - len(self.x)
        total = self._of_nodes.total + self.width // 3
        self.numbering = replace(self._of_nodes, local=len(self.points), total=total)

    @cached_property
    def trivial(self) -> bool:
        return not (self._ties or self.comm.allreduce(bool(np.any(self.held.oblique)), op=MPI.LOR))

    def prescribing(self, own: Sequence[int]) -> Reduction:
        """The same with these own unknowns prescribed; collective."""
        other = copy.copy(self)
        other.loose = self.loose.copy()
        other.loose[list(own)] = 0.0
        return other

    def at_place(self, x: FloatArray) -> Reduction:
        """The same of nodes at another place x (k, 3), metres."""
        other = copy.copy(self)
        other.x, other.points = x, np.concatenate([x, self.points[len(x) :]])
        return other

    def of_weights(self, ties: Sequence[Tie]) -> Reduction:
        """The same of the same ties with other weights, of other nodes and of their own unknowns, without springs along
        these."""
        other = copy.copy(self)
        other._ties, other.stiffness = tuple(ties), np.zeros_like(self.stiffness)
        for name in ("weights", "W", "T"):
            other.__dict__.pop(name, None)
        return other

    def bent(self, stiffness: FloatArray) -> Reduction:
        """The same with a stiffness (width, width) along own unknowns beside that of springs, N/m, the forces of which
        are `bent_force`."""
        other = copy.copy(self)
        other.stiffness, other._bent = self.stiffness + stiffness, stiffness
        return other

    def bent_force(self, u: FloatArray) -> FloatArray:
        """Internal forces of the stiffness of `bent` at displacements u (k, 3), newtons, of the same shape;
        collective."""
        forces = np.zeros_like(u)
        if self._bent is not None:
            along = self._bent @ self.amounts(self.apart(u))
            for nodes, own, _, fit in self.weights:
                forces[nodes] += fit @ along[own]
        return forces

    @cached_property
    def tied(self) -> FloatArray:
        """D: projectors on the directions along which nodes follow others, shape (k, 3, 3)."""
        tied = np.zeros((len(self.x), 3, 3))
        for tie in self._ties:
            free = np.eye(3) - self.held.projector_at(tie.nodes)
            sizes, directions = np.linalg.eigh(free @ tie.directions @ free)
            tied[tie.nodes] = np.einsum("mia,ma,mja->mij", directions, np.round(sizes), directions)
        return tied

    @cached_property
    def W(self) -> PETSc.Mat:
        """W of all slave nodes, shape (n, n), distributed; rows of others are empty."""
        n, axes = 3 * len(self.x), np.arange(3)
        follow = scipy.sparse.csr_matrix((n, 3 * self._of_nodes.total))
        for tie in self._ties:
            rows = (3 * tie.nodes[:, None] + axes).ravel()
            lift = scipy.sparse.csr_matrix((np.ones(len(rows)), (rows, np.arange(len(rows)))), (n, len(rows)))
            follow = follow + lift @ tie.rows
        return self._distributed(follow.tocsr(), n)

    @cached_property
    def weights(self) -> list[tuple[IntArray, slice, FloatArray, FloatArray]]:
        """Of every constraint with own unknowns its nodes, where its unknowns are among all own ones, and D N and the
        fit (N^T D N)^-1 N^T D of these to displacements of the nodes, shapes (m, 3, q); collective."""
        weights = []
        for tie, own in zip(self._ties, self.own, strict=True):
            if tie.own.shape[2]:
                N = np.einsum("mij,mjq->miq", self.tied[tie.nodes], tie.own)
                gram = self.comm.allreduce(np.einsum("miq,mip->qp", N, N))
                weights.append((tie.nodes, own, N, N @ np.linalg.inv(gram)))
        return weights

    @cached_property
    def T(self) -> PETSc.Mat:
        """From all unknowns, own ones that are prescribed included, to displacements; collective.  ValueError on every
        rank if nodes follow each other in a circle."""
        rows = block_diagonal(np.eye(3) - self.tied, self.numbering)
        for nodes, own, N, _ in self.weights:
            dofs = (3 * nodes[:, None] + np.arange(3)).ravel()
            columns = 3 * self._of_nodes.total + np.arange(own.start, own.stop)
            where = np.repeat(dofs, len(columns)), np.tile(columns, len(dofs))
            rows = rows + scipy.sparse.csr_matrix((N.ravel(), where), rows.shape)
        rows.eliminate_zeros()
        E = self._distributed(rows.tocsr(), 3 * len(self.points))
        return chained(E, self.W, self._ties, self.lifetime)

    def _distributed(self, rows: scipy.sparse.csr_matrix, columns: int) -> PETSc.Mat:
        return distributed_rows(rows, (columns, rows.shape[1]), self)

    # --- own unknowns -------------------------------------------------------------------------------------------------

    def amounts(self, apart: FloatArray) -> FloatArray:
        """The own unknowns that fit what nodes are `apart` from those that they follow, (k, 3) or (k, 3, j), best,
        shape (width,) or (width, j), the same on every rank; collective."""
        y = np.zeros((self.width, *apart.shape[2:]))
        for nodes, own, _, fit in self.weights:
            y[own] = np.einsum("miq,mi...->q...", fit, apart[nodes])
        return self.comm.allreduce(y) if self.weights else y

    def moved(self, y: FloatArray) -> FloatArray:
        """D N y of own unknowns (width,) or (width, j), shape (k, 3) or (k, 3, j)."""
        u = np.zeros((*self.x.shape, *y.shape[1:]))
        for nodes, own, N, _ in self.weights:
            u[nodes] = np.einsum("miq,q...->mi...", N, y[own])
        return u

    def moved_transposed(self, forces: FloatArray) -> FloatArray:
        """Forces along own unknowns of nodal forces (k, 3), shape (width,), the same on every rank; collective."""
        y = np.zeros(self.width)
        for nodes, own, N, _ in self.weights:
            y[own] = np.einsum("miq,mi->q", N, forces[nodes])
        return self.comm.allreduce(y) if self.weights else y

    def amounts_transposed(self, y: FloatArray) -> FloatArray:
        """Nodal forces (k, 3) that do the work of forces y (width,) along the `amounts` of displacements."""
        forces = np.zeros_like(self.x)
        for nodes, own, _, fit in self.weights:
            forces[nodes] += fit @ y[own]
        return forces

    def apart(self, u: FloatArray) -> FloatArray:
        """D (u - W u) of displacements (k, 3), or (k, 3, j): by how much nodes are apart from those that they follow;
        collective."""
        if not self._ties:
            return np.zeros_like(u)
        return self.followed(u - _each_column(partial(rows_of, self.W), u))

    def followed(self, u: FloatArray) -> FloatArray:
        """D u of nodal vectors (k, 3), or (k, 3, j)."""
        return np.einsum("kij,kj...->ki...", self.tied, u)

    def left_apart(self, u: FloatArray, offset: FloatArray | float = 0.0) -> FloatArray:
        """What own unknowns that are free do not account for of how much nodes are apart from those that they follow,
        and should be by an offset; collective."""
        apart = self.apart(u) - offset
        return apart - self.moved(_scaled(self.loose, self.amounts(apart)))

    def prevented(self, modes: FloatArray) -> FloatArray:
        """Nodal forces (k, 3, j) of unit springs in place of supports and of ties, in motions (k, 3, j); collective."""
        return self.held.held_part(modes) + self.on_followed(self.left_apart(modes))

    def with_own(self, of_nodes: FloatArray, own: FloatArray) -> FloatArray:
        """Values at nodes (k, 3, ...), and those of own unknowns (width, ...) where these are, as of unknowns."""
        return np.concatenate([of_nodes, own[: 3 * self.here].reshape(self.here, 3, *own.shape[1:])])

    # --- unknowns and displacements -----------------------------------------------------------------------------------

    def kept(self, v: FloatArray) -> FloatArray:
        """Unknowns, or forces along them, without those that are prescribed; shapes (k + p, 3), or (k + p, 3, j)."""
        free = self.held.free_part(v)
        free[len(self.x) :] *= self.loose[: 3 * self.here].reshape(self.here, 3, *(1,) * (v.ndim - 2))
        return free

    def lifted(self, v: FloatArray) -> FloatArray:
        """T v, shape (k, 3), or (k, 3, j); collective."""
        if not self._ties:
            return v
        return _each_column(partial(rows_of, self.T), v)

    def transferred(self, forces: FloatArray) -> FloatArray:
        """T^T times nodal forces (k, 3), or (k, 3, j): those on nodes that follow others as forces on these, and along
        own unknowns, shape (k + p, 3), or (k + p, 3, j); collective."""
        if not self._ties:
            return forces
        return _each_column(partial(at_nodes_of, self.T), forces)

    def on_followed(self, forces: FloatArray) -> FloatArray:
        """Forces on slave nodes (k, 3), or (k, 3, j), less W^T times them on what these follow; collective."""
        if not self._ties:
            return forces
        return forces - _each_column(partial(at_nodes_of, self.W), forces)

    def displacement(self, v: FloatArray) -> FloatArray:
        """P v of unknowns v (k + p, 3), or (k + p, 3, j), shape (k, 3), or (k, 3, j); collective."""
        return self.lifted(self.kept(v))

    def along(self, forces: FloatArray, own: FloatArray | None = None) -> FloatArray:
        """P^T times nodal forces (k, 3), or (k, 3, j), and forces along `own` unknowns (width,), shape (k + p, 3), or
        (k + p, 3, j); collective."""
        transferred = self.transferred(forces)
        if own is not None:
            transferred = transferred + self.with_own(np.zeros_like(self.x), own)
        return self.kept(transferred)

    def led(self, prescribed: FloatArray, apart: FloatArray) -> FloatArray:
        """Displacements without unknowns, of nodes that supports prescribe to be displaced, or constraints to be apart
        from what they follow, metres, shapes (k, 3); collective."""
        if not self._ties:
            return prescribed
        u = self.lifted(self.with_own(prescribed, np.zeros(self.width)))
        for _ in range(LONGEST_CHAIN):  # u = W u + apart at slave nodes
            u = u + apart
            apart = self.followed(rows_of(self.W, apart))
            if not self.comm.allreduce(bool(np.any(apart)), op=MPI.LOR):
                break
        return u

    def reduced(self, u: FloatArray, offset: FloatArray | float = 0.0) -> FloatArray:
        """The unknowns of displacements u (k, 3), or (k, 3, j), of which slave nodes are prescribed to be apart by an
        offset; 0 at slave nodes; collective."""
        if not self._ties:
            return u
        return self.with_own(u - self.followed(u), _scaled(self.loose, self.amounts(self.apart(u) - offset)))

    # --- matrices -----------------------------------------------------------------------------------------------------

    def projection(self) -> PETSc.Mat:
        """P, distributed."""
        blocks = np.tile(np.eye(3), (len(self.points), 1, 1))
        blocks[: len(self.x)] -= self.held.projector_at(np.arange(len(self.x)))
        blocks[len(self.x) :] *= self.loose[: 3 * self.here].reshape(-1, 1, 3)
        P = self._distributed(block_diagonal(blocks, self.numbering), 3 * len(self.points))
        if not self._ties:
            return P
        product = self.T.matMult(P)
        P.destroy()
        product.setAttr("mesh", self.lifetime)
        return product

    def filled(self, mean: FloatArray, anchoring: FloatArray) -> scipy.sparse.csr_matrix:
        """This rank's rows of what a stiffness has beside P^T K P: numbers m (k, 1) in N/m along what is held or
        follows, their mean along own unknowns that are prescribed, springs (k + p, 3), and those of own unknowns;
        collective."""
        count = len(self.x)
        blocks = anchoring[:, :, None] * np.eye(3)
        blocks[:count] += mean[:, :, None] * (self.held.projector_at(np.arange(count)) + self.tied)
        typical = self.comm.allreduce(float(mean.sum())) / self._of_nodes.total
        blocks[count:] += typical * (1.0 - self.with_own(np.zeros((0, 3)), self.loose))[:, :, None] * np.eye(3)
        nodes = scipy.sparse.csr_matrix((3 * count, 3 * self._of_nodes.total))
        own = scipy.sparse.csr_matrix(self.stiffness)[: 3 * self.here]
        return block_diagonal(blocks, self.numbering) + scipy.sparse.block_diag([nodes, own], "csr")

    def interpolation(self, linear: scipy.sparse.csr_matrix, columns: int, second: BoolArray) -> PETSc.Mat:
        """From displacements that are linear between vertices, of which so many are on this rank, by these rows those
        of nodes, to unknowns: without what is held, at nodes of second order (k,), or follows; own unknowns as they
        are, and nodes of first order, of which K has a diagonal where they are held; collective."""
        count = len(self.x)
        left_out = self.tied + second[:, None, None] * self.held.projector_at(np.arange(count))
        rows = block_diagonal(np.eye(3) - left_out, Numbering(0, count, count)) @ linear
        own = scipy.sparse.identity(self.width, format="csr")[: 3 * self.here]
        rows = scipy.sparse.block_diag([rows, own], "csr")
        rows.eliminate_zeros()
        return self._distributed(rows, columns + 3 * self.here)

    def rigid_modes(self, x: FloatArray) -> FloatArray:
        """The rigid motions of all bodies at nodes x (n, 3) of a mesh of them, and own unknowns in these, shape (n + p,
        3, 6); collective."""
        (whole,) = component_modes(self.x, np.zeros(len(self.x), dtype=np.int64), self.comm)[1]
        at, there = (displacements_of(of - whole.centre, np.full(len(of), whole.radius)) for of in (x, self.x))
        return np.concatenate([at, self.reduced(there)[len(self.x) :]])

    def lacking(self, imbalance: FloatArray, tension: FloatArray) -> FloatArray:
        """lambda: the forces of all constraints on their slave nodes, by the internal forces less all other forces,
        shapes (k, 3), and forces along own unknowns (width,); collective."""
        forces = np.zeros_like(imbalance)
        for _ in range(LONGEST_CHAIN):
            before = forces
            forces = self.followed(imbalance + at_nodes_of(self.W, before))
            if self.weights:
                along = self.loose * (self.moved_transposed(forces) - tension)
                forces -= self.amounts_transposed(along)
            if not self.comm.allreduce(bool(np.any(forces != before)), op=MPI.LOR):
                break
        return forces
