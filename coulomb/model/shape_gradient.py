"""What contact points owe to the places of nodes: normals, gaps, areas, and what of other bodies is opposite.

Each point depends on a few nodes near it alone.  So values of all points are differentiated by central differences in
which many nodes move at once, none of which any point depends on together with another (A. R. Curtis, M. J. D. Powell,
J. K. Reid: On the estimation of sparse Jacobian matrices, IMA J. Appl. Math. 13, 1974): on any mesh by as many
evaluations of the contact surface as on a small one.  Those are without solves, and accurate to 1e-8; of pairs to
1e-5, where plane facets become warped, which have other rules of integration.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np
import numpy.typing as npt
import scipy.sparse

from ..arrays import FloatArray
from ..fem.bodies import Member
from ..fem.contact import facet_patch
from ..linalg.reductions import Reductions, concatenated
from .discrete_problem import DiscreteProblem
from .linear_problem import ContactState

_log = logging.getLogger(__name__)

_STEP: Final = 1e-4
"""Shift of nodes over the distance of contact points."""

_LEAST: Final = 1e-7
"""The same over the extent of the bodies: gaps below 1e-8 of it are taken for rounding errors."""

_RINGS: Final = 4
"""Rings of facets around the nodes in a point's row on which it depends at most: those of the mortar's functions."""

_OTHER: Final = 1e-5
"""Change of the values that is not by the nodes on which they are taken to depend, over the whole change."""

_KINK: Final = 1e-4
"""By how much changes of the values along two ways do not add up, over the changes, from which on there is a kink."""

_SIDES: Final = 1e-3
"""Difference of the changes of the values on both sides of a way, over the changes, from which on there is a kink."""


_Face = tuple[Member, npt.NDArray[np.int32]]


def contact_along_places(answer: DiscreteProblem, values: Callable[[ContactState], FloatArray]) -> FloatArray:
    """Derivatives of a sum over contact points along the places of this rank's nodes, shape (k, 3); collective.

    The gap of a pair is the largest of several measures of the distance, which are the same between plane facets.  Each
    is linear as nodes move, along the faces none changes.  Where meshes match, or nodes of the slave alone move, they
    stay the same; else their average and their interpolant differ by what the master's motion is off linear in a facet
    of the slave, and the central differences here are the mean of both sides, which is linear.  Of facets covered in
    part the bound by the least distance counts, of which the mean is not.

    Args:
        answer: The problem.
        values: The terms of the sum, shape (m,), in a state in which nodes are elsewhere.

    Raises:
        ValueError: On every rank, if contact points come or go as nodes move, or depend on nodes far away, or if the
            mean of both sides is not linear.
    """
    over, body, surface = Reductions(answer.comm), answer.elasticity, answer.surface
    extent = float(np.max(over.extent(body.x)))
    h = max(_STEP * float(np.sqrt(-over.max(-surface.area))), _LEAST * extent)
    first, total = body.numbering.first, body.numbering.total

    def at(shift: FloatArray) -> FloatArray:
        """The values of all ranks, with nodes shifted (nodes of all ranks, 3)."""
        with body.shifted(shift[first : first + len(body.x)]) as there:
            columns = values(answer.body.shifted(answer.state, there, answer.before))
        return concatenated(answer.comm, columns)

    def change(ways: FloatArray) -> FloatArray:
        """Derivatives of the values along ways, the means of those on both sides."""
        return (at(h * ways) - at(-h * ways)) / (2.0 * h)

    rows, beside = nodes_of_points(answer), nodes_beside(answer, _contact_faces(answer))
    on_faces = np.flatnonzero(np.diff(beside.indptr))
    ways, others = np.zeros((2, total, 3))
    for one, seed in ((ways, 31), (others, 37)):
        one[on_faces] = np.random.default_rng(seed).uniform(-1.0, 1.0, (len(on_faces), 3))
    more, less = at(h * ways), at(-h * ways)
    whole = (more - less) / (2.0 * h)
    size = float(np.sum(np.abs(whole)))
    if float(np.sum(np.abs(change(ways + others) - whole - change(others)))) > _KINK * size:
        raise ValueError(
            "along places: gaps have kinks that no gradient has, as where faces lie flat on each other and facets of "
            "the finer one are covered in part, or their edges meet: there `between` gives the derivative along one "
            "shape, on either side"
        )
    apart, slight = float(np.sum(np.abs(more + less - 2.0 * at(0.0 * ways)))) / h, _OTHER * size
    if apart > _SIDES * size:
        _log.warning(
            "along places: gaps have kinks, as where plane facets that do not match are opposite: the gradient is the "
            "mean of both sides, which differ by %.2g of it where each node moves by itself; `between` gives either "
            "along one shape",
            apart / size,
        )
        slight = _KINK * size  # at a kink the differences are accurate to the first order of the shift
    for _ in range(_RINGS):
        site, colours = np.arange(rows.shape[0]), colours_of(rows)
        columns = by_colours(rows, site, colours, change, lambda of: bool(np.any(np.abs(of) > _OTHER * size)))
        if columns is not None and abs(float(np.sum(whole - columns @ ways.ravel()))) <= slight:
            return np.asarray(columns.sum(axis=0)).reshape(-1, 3)[first : first + len(body.x)]
        rows = pattern(rows @ beside)
    raise ValueError("along places: what contact points owe to them is not of nodes near")


def by_colours(
    sites: scipy.sparse.csr_matrix,
    site: npt.NDArray[np.int64],
    colours: npt.NDArray[np.int64],
    along: Callable[[FloatArray], FloatArray],
    counts: Callable[[FloatArray], bool],
) -> scipy.sparse.csr_matrix | None:
    """The matrix (v, 3 nodes) of values `along` ways (nodes, 3) of the nodes of all ranks, shape (v,), which owe to the
    nodes in the row of their `site` alone (s, nodes), of which no two have the same colour; None if what is owed to
    others counts; collective."""
    triplets = [np.zeros((3, 0))]
    for colour in range(int(colours.max(initial=-1)) + 1):
        moved = np.flatnonzero(colours == colour)
        of = sites[:, moved].tocoo()
        column = np.full(sites.shape[0], -1)
        column[of.row] = moved[of.col]
        for axis in range(3):
            way = np.zeros((sites.shape[1], 3))
            way[moved, axis] = 1.0
            values = along(way)
            known = (column[site] >= 0) & (values != 0.0)
            if counts(np.where(known, 0.0, values)):
                return None
            rows = np.flatnonzero(known)
            triplets.append(np.array([values[rows], rows, 3 * column[site[rows]] + axis]))
    entries, at, columns = np.concatenate(triplets, axis=1)
    return scipy.sparse.csr_matrix((entries, (at.astype(int), columns.astype(int))), (len(site), 3 * sites.shape[1]))


def nodes_of_points(answer: DiscreteProblem) -> scipy.sparse.csr_matrix:
    """The nodes in the rows of each contact point, over all ranks (m, nodes)."""
    starts, columns, _ = answer.surface.B.getValuesCSR()
    before = answer.comm.exscan(len(answer.surface.nodes)) or 0
    point = before + np.repeat(np.arange(len(starts) - 1) // 3, np.diff(starts))
    pairs = concatenated(answer.comm, np.column_stack([point, columns // 3]).astype(np.int64))
    shape = int(pairs[:, 0].max(initial=-1)) + 1, answer.elasticity.numbering.total
    return pattern(scipy.sparse.csr_matrix((np.ones(len(pairs)), pairs.T), shape))


def _contact_faces(answer: DiscreteProblem) -> list[_Face]:
    names = dict.fromkeys(face for contact in answer.contacts for face in (contact.face, contact.against) if face)
    return [answer.elasticity.face(name, "contact") for name in names]


def nodes_beside(answer: DiscreteProblem, faces: Sequence[_Face]) -> scipy.sparse.csr_matrix:
    """The nodes that are on a facet of some faces with each, over all ranks (nodes, nodes); collective."""
    body, total = answer.elasticity, answer.elasticity.numbering.total
    links = scipy.sparse.csr_matrix((total, total))
    for member, facets in faces:
        nodes = facet_patch(member.body, facets).nodes
        numbers = concatenated(answer.comm, body.numbers_of(member, nodes.ravel()).reshape(nodes.shape))
        pairs = np.repeat(np.arange(len(numbers)), numbers.shape[1]), numbers.ravel()
        on = scipy.sparse.csr_matrix((np.ones(numbers.size), pairs), (len(numbers), total))
        links = links + on.T @ on
    return pattern(links)


def pattern(matrix: scipy.sparse.csr_matrix) -> scipy.sparse.csr_matrix:
    matrix = matrix.tocsr()
    matrix.sum_duplicates()
    matrix.data[:] = 1.0
    return matrix


def colours_of(rows: scipy.sparse.csr_matrix) -> npt.NDArray[np.int64]:
    """Colours of the nodes, -1 of those in no row, by which no two in one row have the same, shape (nodes,)."""
    together = pattern(rows.T @ rows)
    colours = np.full(together.shape[0], -1, dtype=np.int64)
    for node in np.flatnonzero(np.diff(together.indptr)):
        taken = colours[together.indices[together.indptr[node] : together.indptr[node + 1]]]
        free = np.ones(len(taken) + 1, dtype=bool)
        free[taken[taken >= 0][taken[taken >= 0] <= len(taken)]] = False
        colours[node] = int(np.argmax(free))
    return colours
