"""Directions along which nodes are held, with their prescribed displacements; they need not be coordinate axes.

Each support prescribes the displacement of its nodes along up to three directions, d . u = value.  Where supports meet,
the later one applies: of an earlier one there remains what is independent of the later ones, first what is orthogonal
to them.  The rows of a node span its held directions; with H, the projector onto them, a nodal vector v has the held
part H v and the free part v - H v.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final, Protocol

import numpy as np
import numpy.typing as npt
import scipy.sparse
from mpi4py import MPI
from petsc4py import PETSc

from ...arrays import BoolArray, FloatArray, Int32Array, IntArray
from ..geometry import first_place
from .supports import Support


@dataclass(frozen=True)
class Numbering:
    """Global numbers of this rank's nodes, which follow those of the ranks before: the first, how many here, and in
    all."""

    first: int
    local: int
    total: int


class Shared(Protocol):
    """What ranks share."""

    @property
    def comm(self) -> MPI.Comm:
        """The ranks."""
        ...

    @property
    def lifetime(self) -> object:
        """What its matrices must keep alive (`compat.assemble_matrix`)."""
        ...


class Nodes(Shared, Protocol):
    """Nodes with displacements, of one body or of several; those of this rank are at x (k, 3), metres."""

    x: FloatArray

    @property
    def reference(self) -> FloatArray:
        """Where they are before deformation, shape (k, 3)."""
        ...

    @property
    def numbering(self) -> Numbering:
        """Their global numbers."""
        ...

    def deformation(self, way: FloatArray) -> FloatArray:
        """Deformation gradients at them after displacements (k, 3) in metres, shape (k, 3, 3)."""
        ...

    def linear_between_vertices(self, values: FloatArray) -> FloatArray:
        """A nodal field that is linear on all edges and has these values (k,) or (k, d <= 3) at vertices."""
        ...


class HeldNodes(Nodes, Protocol):
    """Nodes whose displacement is prescribed along some directions, `held`; along `still` it is 0 at all times."""

    held: HeldDirections
    still: HeldDirections


def block_diagonal(blocks: FloatArray, numbering: Numbering) -> scipy.sparse.csr_matrix:
    """This rank's rows of the matrix with these blocks (k, 3, 3) on its diagonal, by the numbers of their nodes."""
    count = len(blocks)
    entries = (blocks, numbering.first + np.arange(count), np.arange(count + 1))
    return scipy.sparse.bsr_matrix(entries, shape=(3 * count, 3 * numbering.total)).tocsr()


def distributed_rows(
    rows: scipy.sparse.csr_matrix, columns: tuple[int, int], nodes: Shared, block: int | None = 3
) -> PETSc.Mat:
    """The matrix of the rows of every rank, with global numbers of columns; of `columns` there are so many on this rank
    and in all."""
    if not rows.has_sorted_indices:
        rows = rows.sorted_indices()
    matrix = PETSc.Mat().createAIJ(
        ((rows.shape[0], PETSc.DETERMINE), columns),
        bsize=block,
        csr=(rows.indptr.astype(PETSc.IntType), rows.indices.astype(PETSc.IntType), rows.data),
        comm=nodes.comm,
    )
    matrix.setAttr("mesh", nodes.lifetime)  # keeps it alive: see compat.assemble_matrix
    return matrix


def local_rows(matrix: PETSc.Mat) -> scipy.sparse.csr_matrix:
    """This rank's rows of a distributed matrix, with global numbers of columns."""
    indptr, columns, values = matrix.getValuesCSR()
    return scipy.sparse.csr_matrix((values, columns, indptr), (len(indptr) - 1, matrix.getSize()[1]))


def diagonal_of(matrix: PETSc.Mat) -> FloatArray:
    """This rank's entries on the diagonal of a distributed matrix, shape (n,); collective."""
    diagonal = matrix.getDiagonal()
    values: FloatArray = diagonal.array_r.copy()
    diagonal.destroy()
    return values


def rows_of(B: PETSc.Mat, u: FloatArray) -> FloatArray:
    """B u in metres, shape (m, 3), of displacements u of this rank's nodes, shape (k, 3); collective."""
    return matrix_product(B, u).reshape(-1, 3)


def at_nodes_of(B: PETSc.Mat, x: FloatArray) -> FloatArray:
    """B^T x in newtons, this rank's nodes, shape (k, 3), of forces x, shape (m, 3) or (3 m,); collective."""
    return matrix_product(B, x, transposed=True).reshape(-1, 3)


def matrix_product(A: PETSc.Mat, values: FloatArray, transposed: bool = False) -> FloatArray:
    """A, or A^T, times this rank's values of any shape, those of the result in a row, shape (n,); collective."""
    given, result = reversed(A.createVecs()) if transposed else A.createVecs()
    given.array[:] = values.ravel()
    (A.multTranspose if transposed else A.mult)(given, result)
    product: FloatArray = result.array_r.copy()
    given.destroy()
    result.destroy()
    return product


DEPENDENT: Final = 1e-4
"""Sine of the angle below which a direction depends on others: more than the rounding of coordinates in single
precision, less than any angle between the planes of two supports."""

HELD_OBLIQUE = "held_oblique"
"""Field of the files, of bodies that are held along directions other than the axes: see `HeldDirections.fields`."""


@dataclass(frozen=True, eq=False)
class HeldDirections:
    """The held directions of this rank's `count` nodes, as projectors.

    Attributes:
        nodes: Those that are held along some direction, ascending, shape (m,).
        projector: H of each, shape (m, 3, 3).
    """

    count: int
    nodes: IntArray
    projector: FloatArray

    def held_part(self, v: FloatArray) -> FloatArray:
        """The part of nodal vectors along held directions; shapes (k, 3), or (k, 3, j) for j vectors per node."""
        part = np.zeros_like(v)
        part[self.nodes] = np.einsum("kij,kj...->ki...", self.projector, v[self.nodes])
        return part

    def free_part(self, v: FloatArray) -> FloatArray:
        """The part of nodal vectors along free directions; shapes as for `held_part`."""
        return v - self.held_part(v)

    def projector_at(self, nodes: npt.NDArray[np.integer[Any]]) -> FloatArray:
        """H of some nodes, shape (q, 3, 3); zero for a free node."""
        H = np.zeros((len(nodes), 3, 3))
        if len(self.nodes):
            place = np.minimum(np.searchsorted(self.nodes, nodes), len(self.nodes) - 1)
            held = self.nodes[place] == nodes
            H[held] = self.projector[place[held]]
        return H

    def of(self, here: BoolArray) -> HeldDirections:
        """Those of some of the nodes, which are True in `here` (k,)."""
        kept = here[self.nodes]
        return HeldDirections(int(here.sum()), (np.cumsum(here) - 1)[self.nodes[kept]], self.projector[kept])

    @cached_property
    def number(self) -> int:
        """Number of held directions, over all nodes of this rank."""
        return int(np.sum(np.round(np.trace(self.projector, axis1=1, axis2=2))))

    @cached_property
    def components(self) -> BoolArray:
        """Which components of the displacements are prescribed whatever the others are, shape (k, 3)."""
        components = np.zeros((self.count, 3), dtype=bool)
        components[self.nodes] = np.einsum("kii->ki", self.projector) > 1.0 - 1e-14
        return components

    @cached_property
    def oblique(self) -> BoolArray:
        """Which of `nodes` have held directions that are not coordinate axes, shape (m,)."""
        along_axes = (self.projector == 0.0) | (self.projector == np.eye(3))
        return ~np.all(along_axes, axis=(1, 2))

    @cached_property
    def fields(self) -> dict[str, FloatArray]:
        """H as nodal vectors (k, 3): "held", its diagonal, and "held_oblique", its entries yz, xz and xy."""
        H = np.zeros((self.count, 3, 3))
        H[self.nodes] = self.projector
        return {"held": np.einsum("kii->ki", H).copy(), HELD_OBLIQUE: H[:, [1, 0, 0], [2, 2, 1]]}

    @staticmethod
    def of_fields(diagonal: FloatArray, others: FloatArray | None) -> HeldDirections:
        """The held directions of `fields`, shapes (k, 3), all entries rounded to those of the nearest projector."""
        nodes = np.flatnonzero(np.any(diagonal > 0.3, axis=1))  # of a projector one entry is at least 1/3
        H = diagonal[nodes][:, :, None] * np.eye(3)
        if others is not None:
            H[:, [1, 0, 0], [2, 2, 1]] = H[:, [2, 2, 1], [1, 0, 0]] = others[nodes]
        sizes, axes = np.linalg.eigh(H)
        H = np.einsum("kia,ka,kja->kij", axes, np.clip(np.round(sizes), 0.0, 1.0), axes)
        return HeldDirections(len(diagonal), nodes, H)


@dataclass(frozen=True, eq=False)
class PrescribedRows:
    """Rows d . u = value, those of a node independent of each other.

    Attributes:
        held: The directions that they hold.
        node: Node of each row, shape (r,).
        support: Number of the support that prescribes it, shape (r,).
        direction: d, a unit vector, shape (r, 3).
        dual: The vectors by which values become displacements: those along held directions with d' . dual = 1 for the
            row itself and 0 for the other rows of its node; d where these are orthogonal.  Shape (r, 3).
    """

    held: HeldDirections
    node: IntArray
    support: IntArray
    direction: FloatArray
    dual: FloatArray

    def displacement(self, values: FloatArray) -> FloatArray:
        """The displacement along held directions that has these values (r,), shape (k, 3)."""
        u = np.zeros((self.held.count, 3))
        np.add.at(u, self.node, values[:, None] * self.dual)
        return u

    def along(self, chosen: BoolArray) -> HeldDirections:
        """The directions that some of the rows (r,) hold by themselves."""
        nodes, place = np.unique(self.node[chosen], return_inverse=True)
        gram = np.zeros((len(nodes), 3, 3))
        np.add.at(gram, place, np.einsum("ri,rj->rij", self.direction[chosen], self.direction[chosen]))
        return HeldDirections(self.held.count, nodes, gram @ np.linalg.pinv(gram, DEPENDENT**2, hermitian=True))

    def shares(self, reaction: FloatArray, supports: int) -> Iterator[FloatArray]:
        """The forces of every support by itself, shape (k, 3), in a reaction (k, 3) along held directions."""
        forces = np.einsum("ri,ri->r", self.dual, reaction[self.node])[:, None] * self.direction
        for number in range(supports):
            here, share = self.support == number, np.zeros_like(reaction)
            np.add.at(share, self.node[here], forces[here])
            yield share


def prescribed_rows(count: int, supports: Sequence[tuple[npt.NDArray[np.integer[Any]], FloatArray]]) -> PrescribedRows:
    """The rows of supports, of which a later one applies where they meet: of each its nodes (q,) among this rank's
    `count`, and orthonormal rows or zeros (q, 3, 3)."""
    nodes: IntArray = np.unique(np.concatenate([np.empty(0, np.int64), *(given for given, _ in supports)]))
    H = np.zeros((len(nodes), 3, 3))
    rows_of: list[tuple[IntArray, IntArray, FloatArray]] = []
    for number, (given, directions) in reversed(list(enumerate(supports))):
        place = np.searchsorted(nodes, given)
        rows, added = _independent(directions, H[place])
        H[place] += np.einsum("kai,kaj->kij", added, added)
        full = np.round(np.trace(H[place], axis1=1, axis2=2)) >= 3.0
        H[place[full]] = np.eye(3)
        at, which = np.nonzero(np.any(rows != 0.0, axis=2))
        rows_of.append((place[at], np.full(len(at), number), rows[at, which]))
    place, support, direction = (
        np.concatenate(parts)
        for parts in zip((np.empty(0, np.int64), np.empty(0, np.int64), np.empty((0, 3))), *rows_of, strict=True)
    )
    held = HeldDirections(count, nodes, H)
    return PrescribedRows(held, nodes[place], support, direction, _duals(place, direction, len(nodes)))


def _independent(directions: FloatArray, H: FloatArray) -> tuple[FloatArray, FloatArray]:
    """What directions add to those that are held, with projectors H: unit vectors in the span of the rows, independent
    of the held directions, or zeros; and orthonormal vectors that are orthogonal to H, with the same span beside H."""
    rest = directions - directions @ H
    same, none = np.all(rest == directions, axis=2), np.all(rest == 0.0, axis=2)
    rows = np.where(none[:, :, None], 0.0, directions)
    added = rows.copy()
    mixed = ~np.all(same | none, axis=1)
    left, sizes, right = np.linalg.svd(rest[mixed])
    new = (sizes > DEPENDENT)[:, :, None]
    rows[mixed] = np.where(new, np.swapaxes(left, 1, 2) @ directions[mixed], 0.0)
    added[mixed] = np.where(new, right, 0.0)
    return rows, added


def _duals(place: IntArray, direction: FloatArray, count: int) -> FloatArray:
    """`PrescribedRows.dual` of directions (r, 3) at places among `count` nodes, shape (r, 3)."""
    order = np.argsort(place, kind="stable")
    sorted_place = place[order]
    number = np.empty(len(place), dtype=np.int64)
    number[order] = np.arange(len(place)) - np.searchsorted(sorted_place, sorted_place)
    D = np.zeros((count, 3, 3))
    D[place, number] = direction
    gram = np.einsum("kai,kbi->kab", D, D) * (1.0 - np.eye(3))
    askew = np.any(gram != 0.0, axis=(1, 2))
    dual = D.copy()
    dual[askew] = np.swapaxes(np.linalg.pinv(D[askew], rcond=0.1 * DEPENDENT), 1, 2)
    return dual[place, number]


_DIFFERENT = 2.0 * DEPENDENT
"""Difference of two displacements, relative to the larger one, below which they are the same: as much as there is
between directions that count as one."""

_MUCH_FARTHER: Final = 5.0
"""How many times as far as prescribed a node is moved by directions at less than 12 degrees."""


@dataclass(frozen=True, eq=False)
class SupportedNodes:
    """What a support prescribes by itself at this rank's q nodes.

    Attributes:
        nodes: Ascending, shape (q,).
        directions: Orthonormal rows or zeros, shape (q, 3, 3).
        displacement: In metres, of which the parts along the directions are prescribed, shape (q, 3).
    """

    support: Support
    nodes: Int32Array
    directions: FloatArray
    displacement: FloatArray

    @property
    def nowhere(self) -> SupportedNodes:
        """The same at none of them."""
        return SupportedNodes(self.support, self.nodes[:0], self.directions[:0], self.displacement[:0])


def contradictions(
    given: Sequence[SupportedNodes], rows: PrescribedRows, values: FloatArray, x: FloatArray, comm: MPI.Comm
) -> tuple[str, ...]:
    """Messages about supports that do not get what they prescribe, the same on every rank; collective.

    A face that is held by one support and then moved along some directions by a later one is no contradiction.
    Displacements whose amplitudes are different tables or functions differ, unless they are zero.

    Args:
        given: The supports, in their order.
        rows: The rows that count.
        values: Their values at an amplitude of 1, shape (r,).
        x: Coordinates of this rank's nodes in metres, shape (k, 3).
    """
    scale = _scales(given)
    u = rows.displacement(scale[rows.support] * values)
    messages = []
    faces = np.array([one.support.face for one in given])
    for number, one in enumerate(given):
        own = scale[number] * one.displacement
        wanted, there = (np.einsum("qai,qi->qa", one.directions, v) for v in (own, u[one.nodes]))
        size = np.maximum(np.linalg.norm(own, axis=1), np.linalg.norm(u[one.nodes], axis=1))
        elsewhere = (rows.support > number) & (faces[rows.support] != one.support.face)
        layered = (wanted == 0.0) & ~np.isin(one.nodes, rows.node[elsewhere])[:, None]
        different = (np.abs(wanted - there) > _DIFFERENT * size[:, None]) & ~layered
        lost = np.any(different, axis=1)
        missed = np.zeros_like(x)
        missed[one.nodes] = np.einsum("qa,qai->qi", np.where(different, wanted - there, 0.0), one.directions)
        along = np.abs(np.einsum("ri,ri->r", rows.direction, missed[rows.node]))
        takes = along > DEPENDENT * np.linalg.norm(missed[rows.node], axis=1)
        others = sorted({int(s) for s in rows.support[takes & (rows.support > number)]})
        count, place, takers = _count_and_place(lost, x[one.nodes], others, comm)
        if count:
            by = " and ".join(given[taker].support.what for taker in takers)
            nodes = "1 node" if count == 1 else f"{count} nodes"
            messages.append(
                f"{one.support.what} is overridden at {nodes} by {by}, which prescribes a different displacement there "
                f"(first seen at x = {place}): of two supports the later one counts"
            )
    return (*messages, *_amplified(given, rows, scale[rows.support] * values, u, x, comm))


def _amplified(
    given: Sequence[SupportedNodes],
    rows: PrescribedRows,
    values: FloatArray,
    u: FloatArray,
    x: FloatArray,
    comm: MPI.Comm,
) -> list[str]:
    largest = np.zeros(len(x))
    np.maximum.at(largest, rows.node, np.abs(values))
    moved = np.linalg.norm(u, axis=1)
    far = moved > _MUCH_FARTHER * largest
    supports = sorted({int(s) for s in rows.support[np.isin(rows.node, np.flatnonzero(far))]})
    count, place, involved = _count_and_place(far, x, supports, comm)
    if not count:
        return []
    ratio = comm.allreduce(float(np.max(moved[far] / largest[far], initial=0.0)), op=MPI.MAX)
    names = " and ".join(given[number].support.what for number in involved)
    return [
        f"{names} prescribe different displacements along nearly the same direction: together they move a node by up "
        f"to {ratio:.3g} times what each prescribes (first seen at x = {place})"
    ]


def _scales(given: Sequence[SupportedNodes]) -> FloatArray:
    """A factor for each support: its amplitude if this is a number, else one that other amplitudes do not have."""
    known: dict[str, float] = {}
    factors = []
    for one in given:
        amplitude = one.support.amplitude
        if isinstance(amplitude, int | float):
            factors.append(float(amplitude))
        else:
            factors.append(known.setdefault(repr(amplitude), 1.1 + (0.6180339887 * len(known)) % 0.5))
    return np.array(factors)


def _count_and_place(
    condition: BoolArray, x: FloatArray, supports: Sequence[int], comm: MPI.Comm
) -> tuple[int, str, list[int]]:
    """Number of nodes of all ranks where a condition holds, the first of them, and the supports of all ranks."""
    place = first_place(x, condition) if np.any(condition) else ""
    found = comm.allgather((int(np.count_nonzero(condition)), place, list(supports)))
    places = [place for count, place, _ in found if count]
    return sum(count for count, _, _ in found), places[0] if places else "", sorted({s for *_, of in found for s in of})
