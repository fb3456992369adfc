"""The grids of the result files, with the nodes of the displacements as points: of solution.xdmf one per body, of
contact.xdmf one for all faces of a single body, or one for every side of every contact; and the names of their fields,
beside those of the contact points in `contact_fields`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from mpi4py import MPI

from ..arrays import FloatArray, Int32Array
from ..contact_fields import names, side_names
from ..fem import compat
from ..fem.bodies import (
    FIELDS,
    HELD_OBLIQUE,
    STRESSES,
    TEMPERATURE,
    TIE_STRESSES,
    DisplacementSpace,
    Loading,
    Member,
    SingleBody,
)
from ..fem.compat import fem
from ..fem.geometry import on_all_ranks
from ..fem.meshes import FACETS, NODE_NUMBER, SOLIDS, corner_geometry, fetched, in_vtk_order, nodes_between, starts_of
from ..model.discrete_problem import DiscreteProblem
from ..model.face_answer import FaceAnswer
from ..model.nodal_answer import HELD, carried, carrying, spreading
from ..model.solution import Solution
from .field_files import NODE, OPPOSITE
from .grid_file import GridFields, GridPart

ON_CELLS = STRESSES
"""Fields of solution.h5, one number per cell; besides the materials."""

ON_BODY = ("displacement", "load", "held", "prescribed", "spring_force")
"""Fields of solution.h5, one vector per node."""

INTERNAL, ROUNDING = "internal_force", "rounding_force"
"""Fields of solution.h5 of a body of the user's forms, which are not in the files: its internal forces, and those of a
rounding error of the displacement (`rounding_forces`)."""

GROUND = tuple(f"rigid_force_{number}" for number in range(1, 7))
"""The nodal forces of the rigid motions of a body with springs or Robin terms: `Deformable.ground`."""

TIE_FORCE = "tie_force"
"""Forces of ties on the nodes of both faces."""

_OF_LOADS = (HELD_OBLIQUE, INTERNAL, ROUNDING, TEMPERATURE, TIE_FORCE, *TIE_STRESSES)

OURS = (*ON_CELLS, *ON_BODY, *FIELDS, *GROUND, *_OF_LOADS, NODE_NUMBER)
"""All names of fields of solution.h5."""


TRACTION = "traction"
"""The whole traction of contact on a body, pascals; it is not in the files, which have its parts."""

BETWEEN: dict[str, Callable[[FloatArray, FloatArray], FloatArray]] = {
    **dict.fromkeys(names(between="least"), np.minimum),
    **dict.fromkeys(names(between="most"), np.maximum),
}
"""Fields that are whole numbers: their values between two vertices of 10-node tetrahedra; of others the means."""


def body_grid(space: DisplacementSpace) -> GridPart:
    """The cells of a body, whose order is that of the displacements."""
    own = space.domain.topology.index_map(3).size_local
    cells = in_vtk_order(space.global_numbers(compat.cell_dofs(space.V)[:own]), "dolfinx")
    return GridPart(SOLIDS[cells.shape[1]], cells, space.reference)


def node_numbers(body: SingleBody) -> dict[str, FloatArray]:
    """`NODE_NUMBER` of this rank's nodes, if the mesh file has some of them; collective."""
    given, domain = body.mesh.node_numbers, body.domain
    if not body.comm.allreduce(given is not None and bool(np.any(given > 0)), op=MPI.LOR):
        return {}
    dofs, points = compat.cell_dofs(body.V), compat.cell_geometry(domain)
    if dofs.shape != points.shape:  # displacements of another order than the mesh
        points = corner_geometry(domain)
        dofs = dofs[:, : points.shape[1]]
    numbers, mine = np.zeros(len(body.x)), dofs < len(body.x)
    if given is not None:
        numbers[dofs[mine]] = given[points[mine]]
    return {NODE_NUMBER: numbers}


def cell_values(functions: Sequence[Any]) -> dict[str, FloatArray]:
    """By name, the values (c,) or (c, 3) of functions that are constant on every cell, in this rank's own cells."""
    values = {}
    for function in functions:
        W = function.function_space
        own = compat.cell_dofs(W)[: W.mesh.topology.index_map(3).size_local, 0]
        rows = function.x.array.reshape(-1, W.dofmap.bs)[own]
        values[function.name] = rows if rows.shape[1] > 1 else rows[:, 0]
    return values


def middle(one: FloatArray, other: FloatArray) -> FloatArray:
    """The mean of two values."""
    return 0.5 * (one + other)


class FaceGrid:
    """This rank's facets of contact faces of a body, with the nodes on them.

    Attributes:
        node: The numbers of its points among those of `body_grid`, shape (p,).
    """

    def __init__(self, space: DisplacementSpace, facets: Int32Array):
        self._space, self._nodes = space, space.nodes_of(facets)
        cell, columns = space.in_cells(facets)
        nodes = compat.cell_dofs(space.V)[cell[:, None], columns]
        comm = space.domain.comm
        self.node = starts_of(comm, len(space.x))[comm.rank] + self._nodes.astype(np.float64)
        position = np.full(len(space.x), -1, dtype=np.int64)  # of this rank's nodes among those of the faces
        position[self._nodes] = starts_of(comm, len(self._nodes))[comm.rank] + np.arange(len(self._nodes))
        cells = fetched(comm, starts_of(comm, len(space.x)), space.global_numbers(nodes), position)
        self.grid = GridPart(FACETS[columns.shape[1]], cells, space.reference[self._nodes])

    def numbers(self, body: SingleBody) -> dict[str, FloatArray]:
        """The fields with the numbers of its points, in solution.xdmf and in the mesh file; collective."""
        return {NODE: self.node} | {name: self.at(values) for name, values in node_numbers(body).items()}

    def at(self, field: FloatArray) -> FloatArray:
        """A field at this rank's nodes, shape (k,) or (k, 3), at those of the faces."""
        return field[self._nodes]

    def values(self, field: FloatArray, between: Callable[[FloatArray, FloatArray], FloatArray]) -> FloatArray:
        """A field at this rank's nodes, shape (k,) or (k, 3), at those of the faces; collective.  On 10-node tetrahedra
        those at vertices are used, and `between` gives the value in the middle of an edge by those at its ends."""
        if self._space.positive:
            return field[self._nodes]
        width = 1 if field.ndim == 1 else 3
        columns = np.broadcast_to(field.reshape(-1, width), (len(field), 3)) if width == 1 else field
        everywhere = self._space.function(columns).x.array.reshape(-1, 3)[:, :width].copy()
        cells = in_vtk_order(compat.cell_dofs(self._space.V).astype(np.int64), "dolfinx")
        for column, (one, other) in nodes_between(cells.shape[1]):
            everywhere[cells[:, column]] = between(everywhere[cells[:, one]], everywhere[cells[:, other]])
        return everywhere[self._nodes].reshape(-1, *field.shape[1:])


Fields = dict[str, FloatArray]


def interpolated(
    given: Mapping[str, Any], space: DisplacementSpace, taken: tuple[str, ...], comm: MPI.Comm
) -> tuple[Fields, Fields]:
    """Values of functions of DOLFINx on the mesh of a body, of scalars, vectors or tensors, by name, at this rank's
    nodes, and in its own cells; collective.  `taken` are the names of the fields that the package writes.

    A function of a continuous space is interpolated to the nodes of the displacements, another one to the midpoints of
    the cells.

    Returns:
        By name, rows per node, and rows per cell.

    Raises:
        ValueError: On every rank, if a name cannot be used, or a function cannot be interpolated.
    """
    nodal: Fields = {}
    on_cells: Fields = {}
    for name, function in given.items():
        what = f"fields: {name!r}"
        on_all_ranks(lambda name=name, function=function: _refuse(name, function, space, taken), what, comm)  # type: ignore[misc]
        continuous = _is_continuous(function)

        def evaluate(function: Any = function, continuous: bool = continuous) -> FloatArray:
            shape = tuple(int(n) for n in function.ufl_shape)
            degree, family = (space.degree, "Lagrange") if continuous else (0, "DG")
            there = fem.Function(compat.functionspace(space.domain, degree, shape, family))
            there.interpolate(function)
            return _rows(there, space, continuous)

        (nodal if continuous else on_cells)[name] = on_all_ranks(evaluate, what, comm)
    return nodal, on_cells


def of_bodies(given: Mapping[str, Any], bodies: Sequence[DisplacementSpace], comm: MPI.Comm) -> list[dict[str, Any]]:
    """The given functions on the mesh of each body; with one body all of them.

    Raises:
        ValueError: On every rank, if one is no function, or on the mesh of no body.
    """
    if len(bodies) == 1:
        return [dict(given)]
    functions: list[dict[str, Any]] = [{} for _ in bodies]

    def add(name: str, function: Any) -> None:
        if not isinstance(function, fem.Function):
            raise ValueError(f"must be a Function of DOLFINx, but is {function!r}; interpolate an expression first")
        mesh = compat.cpp_of(function.function_space.mesh)
        mine = [number for number, body in enumerate(bodies) if compat.cpp_of(body.domain) is mesh]
        if not mine:
            raise ValueError("is on the mesh of none of the bodies")
        functions[mine[0]][name] = function

    for name, function in given.items():
        on_all_ranks(lambda name=name, function=function: add(name, function), f"fields: {name!r}", comm)  # type: ignore[misc]
    return functions


def _refuse(name: Any, function: Any, space: DisplacementSpace, taken: tuple[str, ...]) -> None:
    if not isinstance(name, str) or not name.isprintable() or not name or "/" in name:
        raise ValueError("the name must be a printable word without /")
    if name in taken:
        raise ValueError("the results have a field of this name; choose another one")
    if not isinstance(function, fem.Function):
        raise ValueError(f"must be a Function of DOLFINx, but is {function!r}; interpolate an expression first")
    if compat.cpp_of(function.function_space.mesh) is not compat.cpp_of(space.domain):
        raise ValueError("is on another mesh than the body")


def _is_continuous(function: Any) -> bool:
    try:
        return compat.lagrange_vectors(function.function_space)[0]
    except RuntimeError:
        return False


def _rows(function: Any, space: DisplacementSpace, continuous: bool) -> FloatArray:
    """One row per node of the displacements that this rank owns, or per own cell."""
    W = function.function_space
    dofs, values = compat.cell_dofs(W), function.x.array.reshape(-1, W.dofmap.bs)
    if not continuous:
        return values[dofs[: space.domain.topology.index_map(3).size_local, 0]]
    there = compat.cell_dofs(space.V).ravel()
    at_nodes = np.zeros((int(np.max(there, initial=-1)) + 1, values.shape[1]))
    at_nodes[there] = values[dofs.ravel()]
    return at_nodes[: len(space.x)]


BODIES, FACES = "bodies", "faces"
"""Names of the collections of several grids."""


def collections(problem: DiscreteProblem) -> tuple[str, str]:
    """Names of the collections in solution.xdmf and contact.xdmf; empty for a file with one grid without a name;
    collective."""
    members = problem.elasticity.members
    several, named = len(members) > 1, any(member.name for member in members)
    pairs = any(contact.against is not None for contact in problem.contacts)
    return BODIES if named else "", FACES if several or pairs or problem.body.faces_meet else ""


def body_grids(solution: Solution, given: Mapping[str, Any]) -> list[GridFields]:
    """The bodies with their fields, and the user's functions by name, each on the mesh of one of them; collective.

    Raises:
        ValueError: On every rank, if a function cannot be written.
    """
    problem, u = solution.problem, solution.displacement
    elasticity, loading, comm = problem.elasticity, problem.loading, problem.comm
    acting, of_forms = solution.forces_at_nodes, dict[str, FloatArray]()
    for name in (INTERNAL, ROUNDING):
        if name in acting:
            of_forms[name] = acting.pop(name)
    acting |= elasticity.held.fields
    if not comm.allreduce(bool(np.any(elasticity.held.oblique)), op=MPI.LOR):
        del acting[HELD_OBLIQUE]
    ground = elasticity.ground
    of_ground = {} if ground is None else {name: ground[:, :, k] for k, name in enumerate(GROUND)}
    parts = loading.parts or (loading,)
    grids = []
    own = of_bodies(given, [member.body for member in elasticity.members], comm)
    for member, part, functions in zip(elasticity.members, parts, own, strict=True):
        fields = {"displacement": u, **acting, **({} if member.body.forms() is None else of_forms)}
        if ground is not None and comm.allreduce(bool(np.any(ground[member.nodes])), op=MPI.LOR):
            fields |= of_ground
        on_points = {name: values[member.nodes] for name, values in fields.items()}
        grids.append(_body_grid(member, on_points, part, functions, comm))
    return grids


def _body_grid(
    member: Member, fields: dict[str, FloatArray], loading: Loading, given: Mapping[str, Any], comm: MPI.Comm
) -> GridFields:
    """A body with its fields; collective."""
    body = member.body
    if loading.temperature is not None:
        fields[TEMPERATURE] = loading.temperature.change
    fields |= node_numbers(body)
    on_cells = cell_values(body.cell_fields(body.function(fields["displacement"]), loading))
    nodal, in_cells = interpolated(given, body, (*fields, *on_cells, *OURS), comm)
    return GridFields(body_grid(body), fields | nodal, on_cells | in_cells, member.name)


def contact_grids(solution: Solution) -> list[GridFields]:
    """The contact faces with the fields of the contact points; collective."""
    problem, fields = solution.problem, solution.at_nodes.fields()
    if not collections(problem)[1]:
        (member,) = problem.elasticity.members
        return [_face_grid("", member, contact_facets(problem, member.body), problem, fields)]
    grids, others = [], []
    for number, (contact, (mine, other)) in enumerate(zip(problem.contacts, names_of_sides(problem), strict=True)):
        member, facets = problem.elasticity.face(contact.face, "contact")
        grids.append(_face_grid(mine, member, facets, problem, fields, number))
        if contact.against is not None and other is not None:
            others.append(_opposite_grid(solution, number, contact.against, other, fields))
    return [*grids, *others]


def face_answers(solution: Solution) -> dict[str, FaceAnswer]:
    """The faces of all contacts, those opposite included, by their names in files (`side_names`); of a face in several
    pairs by its own name that of the first; collective."""
    problem, fields, answers = solution.problem, solution.at_nodes.fields(), dict[str, FaceAnswer]()
    for number, (contact, sides) in enumerate(zip(problem.contacts, names_of_sides(problem), strict=True)):
        member, facets = problem.elasticity.face(contact.face, "contact")
        grids = [(contact.face, _face_grid("", member, facets, problem, fields, number))]
        if contact.against is not None:
            grids.append((contact.against, _opposite_grid(solution, number, contact.against, "", fields)))
        for (face, of), side in zip(grids, sides, strict=False):
            for name in filter(None, (face, side)):
                answers.setdefault(name, FaceAnswer(name, of.grid.points, of.grid.cells, dict(of.on_points)))
    return answers


def fields_on_bodies(solution: Solution) -> dict[str, dict[str, FloatArray]]:
    """By the names of bodies, the fields of the contact points at this rank's nodes of each body, and "traction", the
    whole one on the body; off its contact faces 0, and the status 3; of a node in several contacts those of the first;
    shapes (k,) or (k, 3); collective."""
    problem, answer = solution.problem, solution.at_nodes
    fields = {**answer.fields(), TRACTION: answer.on_body / answer.area[:, None]}
    members, of_bodies = problem.elasticity.members, dict[str, dict[str, FloatArray]]()
    taken = {member.name: np.zeros(len(member.body.x), dtype=bool) for member in members}
    for number, contact in enumerate(problem.contacts):
        member, facets = problem.elasticity.face(contact.face, "contact")
        grids = [(member, _face_grid("", member, facets, problem, fields, number))]
        if contact.against is not None:
            opposite = _opposite_grid(solution, number, contact.against, "", answer.fields())
            area = opposite.on_points["area"][:, None]
            whole = opposite.on_points["contact_force"] / np.where(area > 0.0, area, np.inf)
            opposite = replace(opposite, on_points={**opposite.on_points, TRACTION: whole})
            grids.append((problem.elasticity.face(contact.against, "contact")[0], opposite))
        for owner, grid in grids:
            first = starts_of(problem.comm, len(owner.body.x))[problem.comm.rank]
            nodes = (grid.on_points[NODE] - first).astype(np.int64)
            free = ~taken[owner.name][nodes]
            for name in (*fields, *(() if owner is member else (OPPOSITE,))):
                if name not in grid.on_points:
                    continue
                values = grid.on_points[name]
                everywhere = of_bodies.setdefault(owner.name, {}).setdefault(
                    name, np.full((len(owner.body.x), *values.shape[1:]), float(HELD) if name == "status" else 0.0)
                )
                everywhere[nodes[free]] = values[free]
            taken[owner.name][nodes[grid.on_points["status"] != HELD]] = True
    return of_bodies


def names_of_sides(problem: DiscreteProblem) -> list[tuple[str, str | None]]:
    """Names of the grids of every contact, on its face and on that opposite."""
    return side_names((contact.face, contact.against) for contact in problem.contacts)


def contact_facets(problem: DiscreteProblem, body: SingleBody) -> Int32Array:
    """This rank's facets of all contact faces on a body, faces opposite in pairs included."""
    names = [name for contact in problem.contacts for name in (contact.face, contact.against) if name is not None]
    faces = [problem.elasticity.face(name, "contact") for name in names]
    mine = [facets for member, facets in faces if member.body is body]
    return np.unique(np.concatenate([np.empty(0, dtype=np.int32), *mine]))


def _face_grid(
    name: str,
    member: Member,
    facets: Int32Array,
    problem: DiscreteProblem,
    fields: Mapping[str, FloatArray],
    number: int | None = None,
) -> GridFields:
    """A face with the fields of the contact points of a contact, or of all; collective."""
    here = np.ones(len(problem.surface.nodes), dtype=bool) if number is None else problem.surface.part == number
    elsewhere = {"status": float(HELD), "face": float(number or 0)}  # without a contact point; 0 for other fields
    face, nodes = FaceGrid(member.body, facets), problem.surface.nodes[here] - member.nodes.start
    on_face = {}
    for field, values in fields.items():
        everywhere = np.full((len(member.body.x), *values.shape[1:]), elsewhere.get(field, 0.0))
        everywhere[nodes] = values[here]
        on_face[field] = face.values(everywhere, BETWEEN.get(field, middle))
    return GridFields(face.grid, on_face | face.numbers(member.body), {}, name)


def _opposite_grid(
    solution: Solution, number: int, against: str, name: str, fields: Mapping[str, FloatArray]
) -> GridFields:
    """The face opposite in a pair, with the fields carried over to it and the forces on its nodes; collective."""
    problem = solution.problem
    points, here = problem.surface.points, problem.surface.part == number
    assert points.opposite is not None
    member, facets = problem.elasticity.face(against, "contact")
    face, body, mine = FaceGrid(member.body, facets), member.body, points.only(here)
    rows = points.opposite[here]
    at_points = {name: values[here] for name, values in fields.items()}
    at_nodes = carried(at_points, spreading(mine, carrying(rows, mine.area)))
    at_nodes["contact_force"] = -spreading(mine, rows)(at_points["contact_force"])
    at_nodes[OPPOSITE] = np.full(len(at_nodes["status"]), float(number))
    area, outward = body.positive_weights(facets)
    length = np.linalg.norm(outward, axis=1)[:, None]
    on_face = {name: values[member.nodes] for name, values in at_nodes.items()}
    on_face |= {"normal": outward / np.where(length > 0.0, length, 1.0), "area": area}
    written = {field: face.at(values) for field, values in on_face.items()}
    return GridFields(face.grid, written | face.numbers(member.body), {}, name)
