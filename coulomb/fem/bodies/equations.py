"""Linear equations between the displacements of nodes: sum a_i u_i = c, of which the first displacement is eliminated.

u_1 = (c - a_2 u_2 - ...) / a_1 is a row of W (`Tie`) along one axis.  Displacements that other equations eliminate are
replaced first: with S the coefficients of eliminated displacements, u_s = S u_s + R u + c gives (I - S)^-1.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt
import scipy.sparse
import scipy.sparse.linalg

from ...arrays import BoolArray, FloatArray, IntArray, as_list, in_words, is_number
from ...nearest import tree_of
from .. import compat
from ..geometry import Amplitude, on_all_ranks
from ..meshes import SAME_PLACE, SEPARATOR
from .deformable import Deformable, Member
from .ties import Prescribed, Tie

_HELD: Final = 1e-9
"""Held part of a direction up to which it is free."""

_SOLVABLE: Final = 1e12
"""Coefficients of equations among each other beyond which they are in a circle."""


@dataclass(frozen=True)
class Equation:
    """A linear equation between components of the displacements of nodes: sum coefficient * displacement = constant.

    The displacement of the first term is eliminated: it follows from the others, as in `*EQUATION` of CalculiX and
    Abaqus.  With several nodes in the first term there is an equation for each.

    Attributes:
        terms: Of each its nodes, its component "x", "y" or "z", and its coefficient.  Nodes are a set of the mesh by
            its name ("corner", of several bodies "lower:corner"; `NamedMesh.with_nodes`), numbers of the mesh file (12,
            [12, 13], ["lower:12"]), or places in metres ((0, 0, 1) or several): one, or as many as in the first term,
            matched in the order given, in sets by their numbers.
        constant: Of the sum, metres.
        amplitude: Factor of the constant as a function of time.
        stiffness: In place of a constant: of a spring that the sum stretches, N/m, with the energy stiffness * sum^2 /
            2; nothing is eliminated then.  Of small motions.

    Raises:
        ValueError: If there is no term, one is not of three such entries, a coefficient or the constant is not finite,
            or the stiffness is negative or beside a constant.
    """

    terms: Sequence[tuple[Any, str, float]]
    constant: float = 0.0
    amplitude: Amplitude = 1.0
    stiffness: float | None = None

    kind = "equation"

    def __post_init__(self) -> None:
        terms = self.terms
        if isinstance(terms, str) or not isinstance(terms, Sequence) or not len(terms):
            raise ValueError(f"equation: terms must be a list of (nodes, component, coefficient), but is {terms!r}")
        for term in terms:
            if isinstance(term, str) or not isinstance(term, Sequence) or len(term) != 3 or term[1] not in _AXES:
                raise ValueError(f'equation: a term must be (nodes, "x", "y" or "z", coefficient), but one is {term!r}')
            if not is_number(term[2], -np.inf):
                raise ValueError(f"equation: a coefficient must be a finite number, but one is {term[2]!r}")
        if not is_number(self.constant, -np.inf):
            raise ValueError(f"equation: the constant must be a finite number of metres, but is {self.constant!r}")
        if self.stiffness is not None and (not is_number(self.stiffness, 0.0) or self.constant != 0.0):
            raise ValueError(
                f"equation: stiffness must be a number of N/m, without a constant, but is {self.stiffness!r}"
            )

    @property
    def what(self) -> str:
        return f"equation of {self.eliminated} along {self.terms[0][1]}"

    @property
    def eliminated(self) -> str:
        """The nodes of the first term, in words."""
        nodes = self.terms[0][0]
        if isinstance(nodes, str) or not isinstance(nodes, Sequence):
            return repr(nodes) if isinstance(nodes, str) else f"nodes {nodes}".replace("[", "").replace("]", "")
        if len(nodes) <= _LISTED:
            return f"nodes {list(nodes)}".replace("[", "").replace("]", "")
        return f"nodes {', '.join(map(str, nodes[: _LISTED - 1]))} and {len(nodes) - _LISTED + 1} more"


_AXES: Final = "xyz"

_LISTED: Final = 5
"""Most nodes that are listed in words."""


@dataclass(frozen=True)
class Equations:
    """All equations of a problem, which may eliminate different components of one node."""

    equations: Sequence[Equation]

    what = Equation.kind
    begin = end = reaches = None

    def as_made(self, tie: Tie) -> Equations:
        """Themselves."""
        return self

    def joined(self, body: Deformable, taken: BoolArray) -> Tie:
        """Their rows, of nodes that do not follow others already (`taken`, (k,)); collective.

        Raises:
            ValueError: On every rank, if a node is unknown, terms have different numbers of nodes, the first
                coefficient is zero, equations cannot be solved for their first terms, or supports hold one, or it
                follows others.
        """
        nodes, given = _Nodes(body), self.equations
        A, s, number_of = _coefficients(body, nodes, given)

        def what(row: int) -> str:
            return f"{given[number_of[row]].what}{nodes.called(int(s[row] // 3))}"

        own = np.asarray(A[np.arange(len(s)), s]).ravel()
        if np.any(own == 0.0):
            raise ValueError(f"{what(int(np.argmax(own == 0.0)))}: the coefficient of its first term is 0")
        _, back, counts = np.unique(s, return_inverse=True, return_counts=True)
        if np.any(counts > 1):
            row = int(np.flatnonzero(counts[back] > 1)[-1])
            raise ValueError(f"{what(row)}: another equation eliminates this displacement already: put another first")
        _refuse_prescribed(body, taken, s, what)
        C = scipy.sparse.csr_matrix(
            ([given[k].constant for k in number_of], (np.arange(len(s)), number_of)), (len(s), len(given))
        )
        scale = scipy.sparse.diags(1.0 / own)
        R, C = _without_each_other(scale @ A, scale @ C, s, what)
        mine = np.flatnonzero((s // 3 >= body.numbering.first) & (s // 3 < body.numbering.first + len(body.x)))
        local, place = np.unique(s[mine] // 3 - body.numbering.first, return_inverse=True)
        at, axis, count = 3 * place + s[mine] % 3, s[mine] % 3, len(local)
        lift = scipy.sparse.csr_matrix((np.ones(len(mine)), (at, mine)), (3 * count, len(s)))
        directions = np.zeros((count, 3, 3))
        directions[place, axis, axis] = 1.0
        timed = [k for k, one in enumerate(given) if one.constant != 0.0]
        constants = (lift @ C)[:, timed].toarray().reshape(count, 3, len(timed))
        none = scipy.sparse.csr_matrix((3 * count, A.shape[1]))
        name = given[0].eliminated.strip("'") if len(given) == 1 else f"{len(given)} equations"
        return Tie(
            Equation.kind,
            name,
            name,
            "it is in the first term",
            nodes=local.astype(np.int64),
            area=np.zeros(count),
            normal=np.zeros((count, 3)),
            rows=(lift @ R).tocsr(),
            beside=none,
            traction=scipy.sparse.csr_matrix((count, body.numbering.total)),
            remarks=(),
            directions=directions,
            own=np.zeros((count, 3, 0)),
            prescribed=Prescribed(constants, tuple((given[k].what, given[k].amplitude) for k in timed)),
        )


def _coefficients(
    body: Deformable, nodes: _Nodes, given: Sequence[Equation]
) -> tuple[scipy.sparse.csr_matrix, IntArray, IntArray]:
    """The coefficients of all equations over all displacements, the displacement of each first term, and the number of
    what it is of; the same on every rank; ValueError on each if a node is unknown, or terms have different numbers of
    nodes; collective."""
    rows, columns, slave, of = (list[IntArray]() for _ in range(4))
    values, first = list[FloatArray](), 0
    for number, one in enumerate(given):
        places = [nodes.of(where, one.what) for where, _, _ in one.terms]
        count = len(places[0])
        for (where, component, coefficient), dofs in zip(one.terms, places, strict=True):
            if len(dofs) not in (1, count):
                raise ValueError(
                    f"{one.what}: {where!r} has {len(dofs)} nodes, the first term {count}: give one, or as many"
                )
            columns.append(3 * np.broadcast_to(dofs, count) + _AXES.index(component))
            rows.append(first + np.arange(count))
            values.append(np.full(count, float(coefficient)))
        slave.append(3 * places[0] + _AXES.index(one.terms[0][1]))
        of.append(np.full(count, number))
        first += count
    s, entries = np.concatenate(slave), (np.concatenate(rows), np.concatenate(columns))
    A = scipy.sparse.csr_matrix((np.concatenate(values), entries), (len(s), 3 * body.numbering.total))
    return A, s, np.concatenate(of)


Linked = Sequence[Equation]


class Links:
    """Springs between nodes, each of the energy k (a . u)^2 / 2, of the bodies; none by default; collective.

    Args:
        given: Equations with a stiffness.

    Raises:
        ValueError: On every rank, as of `Equations`.
    """

    def __init__(self, body: Deformable, given: Sequence[Equation]):
        self.given, self._comm = given, body.comm
        nodes = _Nodes(body)
        self._whole, slave, of = _coefficients(body, nodes, given)
        self._of, first = of, 3 * body.numbering.first
        self._own = self._whole[:, first : first + 3 * len(body.x)].tocsr()
        parts = [nodes.copies(int(one)) for one in slave // 3]  # of a slice each carries its part
        self._k = np.array([float(given[n].stiffness or 0.0) / copies for n, copies in zip(of, parts, strict=True)])

    @property
    def nodes(self) -> list[IntArray]:
        """Numbers of the nodes of every spring, the same on every rank."""
        A = self._whole
        return [np.unique(A.indices[A.indptr[k] : A.indptr[k + 1]] // 3) for k in range(A.shape[0])]

    @property
    def stiffness(self) -> scipy.sparse.csr_matrix:
        """This rank's rows, N/m."""
        return (self._own.T @ scipy.sparse.diags(self._k) @ self._whole).tocsr()

    def forces(self, u: FloatArray, unit: bool = False) -> Iterator[tuple[Equation, FloatArray]]:
        """Of every equation the forces on the nodes, newtons, at displacements u (k, 3), or (k, 3, j), of the same
        shape, or of springs of stiffness 1; collective."""
        stretch = self._comm.allreduce(self._own @ u.reshape(3 * len(u), math.prod(u.shape[2:])))
        pull = ((self._k > 0.0) if unit else self._k)[:, None] * stretch
        for number, one in enumerate(self.given):
            mine = (self._of == number)[:, None] * pull
            yield one, -(self._own.T @ mine).reshape(u.shape)


def _without_each_other(
    A: scipy.sparse.csr_matrix, C: scipy.sparse.csr_matrix, s: IntArray, what: Callable[[int], str]
) -> tuple[scipy.sparse.csr_matrix, scipy.sparse.csr_matrix]:
    """Of equations A u = C with 1 at the displacements s, the rows R without these, u_s = R u + C, and C."""
    A = A.tocsc()
    coupled = A[:, s].tocsc()
    kept = np.ones(A.shape[1])
    kept[s] = 0.0
    R = -(A @ scipy.sparse.diags(kept)).tocsr()
    R.eliminate_zeros()
    if (coupled != scipy.sparse.identity(len(s))).nnz:
        try:
            inverse = scipy.sparse.linalg.splu(coupled)
            R, C = (_solved(inverse, of) for of in (R, C))
            size = max(float(np.max(np.abs(of.data), initial=0.0)) for of in (R, C / (abs(C).max() or 1.0)))
        except RuntimeError:
            size = np.inf
        if not size < _SOLVABLE:
            rows = np.flatnonzero(np.diff(coupled.tocsr().indptr) > 1)
            raise ValueError(f"{what(int(rows[0]))}: it and other equations follow from each other in a circle")
    return R.tocsr(), C.tocsr()


def _solved(inverse: Any, right: scipy.sparse.csr_matrix) -> scipy.sparse.csc_matrix:
    """Columns of a sparse matrix that are not empty, solved for."""
    right = right.tocsc()
    used = np.flatnonzero(np.diff(right.indptr))
    dense = inverse.solve(right[:, used].toarray()) if len(used) else np.zeros((right.shape[0], 0))
    lifted = scipy.sparse.csc_matrix((np.ones(len(used)), (np.arange(len(used)), used)), (len(used), right.shape[1]))
    return scipy.sparse.csc_matrix(dense) @ lifted


def _refuse_prescribed(body: Deformable, taken: BoolArray, s: IntArray, what: Callable[[int], str]) -> None:
    """ValueError on every rank if supports hold displacements s, or their nodes follow others; collective."""
    mine = np.flatnonzero((s // 3 >= body.numbering.first) & (s // 3 < body.numbering.first + len(body.x)))
    node, axis = s[mine] // 3 - body.numbering.first, s[mine] % 3
    along = np.linalg.norm(body.held.projector_at(node)[np.arange(len(node)), axis], axis=1)
    found = [int(np.min(mine[of], initial=len(s))) for of in (along > _HELD, taken[node])]
    held, follows = np.min(body.comm.allgather(found), axis=0)
    if held < len(s):
        raise ValueError(f"{what(int(held))}: a support holds this displacement: put a free one first")
    if follows < len(s):
        raise ValueError(f"{what(int(follows))}: the node is in a tie or rigid face already: put another first")


class _Nodes:
    """The nodes of bodies by sets, numbers and places; collective."""

    def __init__(self, body: Deformable):
        self._body, self._known = body, dict[str, IntArray]()
        self._numbers: dict[str, dict[int, IntArray]] = {}
        self._names: dict[int, str] = {}
        self._copies: dict[int, int] = {}

    def copies(self, node: int) -> int:
        """How many nodes have the number of one: those of a slice are some, one behind the other."""
        return self._copies.get(node, 1)

    def called(self, node: int) -> str:
        """A node that was asked for by its number, in words; else nothing."""
        return f" (node {self._names[node]})" if node in self._names else ""

    def of(self, where: Any, what: str) -> IntArray:
        """Numbers of nodes among those of all bodies, in their order; ValueError on every rank if one is unknown."""
        key = repr(where)
        if key not in self._known:
            self._known[key] = self._found(where, what)
        return self._known[key]

    def _found(self, where: Any, what: str) -> IntArray:
        if isinstance(where, str):
            body, _, name = where.rpartition(SEPARATOR)
            member = self._member(body, what)
            if name in member.body.mesh.node_sets:
                return self._gathered(member, member.body.mesh.node_sets[name])[1]
            if not name.isdigit():
                listed = ", ".join(member.body.mesh.node_sets) or "none"
                raise ValueError(f"{what}: there is no set of nodes {where!r}; those of the mesh are: {listed}")
            where = [where]
        if is_number(where, -np.inf):
            where = [where]
        if not isinstance(where, Sequence | np.ndarray) or not len(where):
            raise ValueError(f"{what}: nodes must be the name of a set, numbers or places, but are {where!r}")
        if all(is_number(one, -np.inf) for one in where) and len(where) == 3 and not all(map(_whole, where)):
            where = [where]
        if all(_whole(one) or isinstance(one, str) for one in where):
            return np.concatenate([self._of_number(one, what) for one in where])
        return np.array([self._at(place, what) for place in where], dtype=np.int64)

    def _member(self, name: str, what: str) -> Member:
        members = {member.name: member for member in self._body.members}
        if name not in members:
            listed = ", ".join(filter(None, members))
            said = f"give nodes with their body ({listed})" if listed else "there is one body, without a name"
            raise ValueError(f"{what}: there is no body {name!r}: {said}")
        return members[name]

    def _of_number(self, given: Any, what: str) -> IntArray:
        name, _, text = str(given).rpartition(SEPARATOR)
        member = self._member(name, what)
        if member.body.mesh.node_numbers is None:
            raise ValueError(f"{what}: the mesh is not from a file, so that nodes have no numbers: name sets or places")
        if name not in self._numbers:
            numbers, nodes = self._gathered(member, np.arange(len(member.body.domain.geometry.x)))
            each, starts = np.unique(numbers, return_index=True)
            self._numbers[name] = dict(zip(as_list(each), np.split(nodes, starts[1:]), strict=True))
        node = self._numbers[name].get(int(text)) if text.isdigit() else None
        if node is None:
            raise ValueError(f"{what}: no node of a cell has the number {given!r}")
        self._names.update(dict.fromkeys(as_list(node), str(given)))
        return node

    def _at(self, place: Any, what: str) -> int:
        body, comm = self._body, self._body.comm
        x = on_all_ranks(lambda: np.reshape(np.asarray(place, dtype=np.float64), 3), what, comm)
        ends = np.array([body.reference.min(axis=0, initial=np.inf), -body.reference.max(axis=0, initial=-np.inf)])
        near = SAME_PLACE * float(np.linalg.norm(np.min(comm.allgather(ends), axis=0).sum(axis=0)))
        own = tree_of(body.reference).query_ball_point(x, near) if len(body.x) else []
        nodes = np.concatenate(comm.allgather(body.numbering.first + np.array(own, dtype=np.int64)))
        if len(nodes) != 1:
            raise ValueError(f"{what}: {len(nodes) or 'no'} nodes are at x = {in_words(x)}; an equation needs one")
        return int(nodes[0])

    def _gathered(self, member: Member, points: npt.NDArray[np.integer[Any]]) -> tuple[IntArray, IntArray]:
        """Of points of a mesh's geometry on all ranks the numbers in the file, ascending, and the nodes, those of one
        number along z; collective."""
        body, mesh = member.body, member.body.mesh
        cells, on = compat.cell_dofs(body.V), compat.cell_geometry(body.domain)
        node = np.full(len(body.domain.geometry.x), -1, dtype=np.int64)
        node[on] = cells[:, : on.shape[1]]
        numbers = mesh.node_numbers
        if numbers is None:
            numbers = np.asarray(body.domain.geometry.input_global_indices, dtype=np.int64)
        mine = points[(node[points] >= 0) & (node[points] < len(body.x))]
        whole = self._body.numbers_of(member, body.numbering.first + node[mine])
        found = np.column_stack([numbers[mine], body.x[node[mine], 2], whole])
        rows = np.unique(np.concatenate(body.comm.allgather(found)), axis=0)
        number, nodes = rows[:, 0].astype(np.int64), rows[:, 2].astype(np.int64)
        _, back, counts = np.unique(number, return_inverse=True, return_counts=True)
        self._copies.update(zip(as_list(nodes), as_list(counts[back]), strict=True))
        return number, nodes


def _whole(value: Any) -> bool:
    return is_number(value, 0.0) and int(value) == value and not isinstance(value, float)
