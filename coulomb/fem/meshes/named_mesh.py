"""Meshes whose boundary faces and cell groups have names; several that share no nodes, as the bodies of one problem."""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import PurePath
from typing import Any, Final

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from ...arrays import FloatArray, Int32Array, IntArray, in_words, is_number, short
from ...nearest import tree_of
from .. import compat
from ..geometry import Point, RigidFoundation, RigidMotion, Rotation, Turn, check_point, evaluate_vectors, on_all_ranks
from .among_ranks import bounds
from .lagrange import corner_geometry
from .mesh_file import A_SLICE
from .mesh_parts import SAME_PLACE
from .slices import Slice
from .user_groups import cells_of, faces_of, is_mesh, is_mesh_data

Way = Point | Callable[[FloatArray], Any]
"""Of all nodes, or of each by a function of their places, metres."""

Planes = tuple[FloatArray, FloatArray, FloatArray]
"""Of a box, the coordinates of the planes between its cells along x, y and z, ends included, metres."""


@dataclass(frozen=True, eq=False)
class Grid:
    """How a box was made.

    Attributes:
        planes: Before it was placed or moved.
        slabs: Of this rank's own cells the slabs between planes along x, y and z, shape (3, k).
        corners: Their corners on the planes before (0) and behind (1) the slab, shape (k, 4 or 8, 3).
        make: Makes it with other planes; collective.
    """

    planes: Planes
    slabs: IntArray
    corners: IntArray
    make: Callable[[Planes], NamedMesh]


@dataclass(frozen=True, eq=False, repr=False)
class NamedMesh:
    """A mesh of a body, of degree 1 or 2, whose boundary faces, and perhaps groups of cells, have names.

    Attributes:
        domain: The DOLFINx mesh, coordinates in metres; or the MeshData of dolfinx.io.gmsh, with the faces and cells of
            its physical groups.
        faces: This rank's boundary facets of each face, by name; facet numbers of `domain`.  For them may be given: by
            name also (MeshTags, value), or a function of x, shape (3, k), that is True on the face; or MeshTags, whose
            values become names such as "3"; or MeshData.  These are checked, arrays of int32 are taken as they are.
        cells: This rank's own cells of each group, by name; cell numbers of `domain`; or MeshTags, or MeshData.
        refused: Groups of facets in the file that cannot be faces, by name, with the reason.
        components: How many components the mesh in the file has, which share no nodes; 1 if it is not from a file.
        touching: Places in metres at which nodes of several components coincide, those found on this rank, shape
            (k, 3).
        coarser: Makes the same body with about half as many cells along each edge, collectively; None where there is
            no such mesh.  ValueError if its cells would be flat.
        grid: Of a box, how it was made.
        curved: Of first-order cells that are made of second-order ones, these cells' boundary, on which gaps of pairs
            are measured; None where the facets themselves count.
        surfaces: Exact surfaces of which faces are meshes, by face: nodes of meshes made of this one are there.
        node_sets: Nodes, on edges or at points, that supports may name in place of a face: this rank's, ghosts
            included, by the name of the set; numbers of `domain.geometry`.
        node_numbers: Of the points `domain.geometry.x` of this rank the numbers in the mesh file, 0 where it has no
            such node, shape (p,); None if the mesh is not from a file.
        file: Its name; empty if the mesh is not from a file.
        slice: Of what plane or axisymmetric body it is a layer; None of others.
    """

    domain: Any
    faces: dict[str, Int32Array] = field(default_factory=dict)
    cells: dict[str, Int32Array] = field(default_factory=dict)
    refused: dict[str, str] = field(default_factory=dict)
    components: int = 1
    touching: FloatArray = field(default_factory=lambda: np.empty((0, 3)), repr=False)
    coarser: Callable[[], NamedMesh] | None = field(default=None, repr=False, compare=False)
    grid: Grid | None = field(default=None, repr=False, compare=False)
    curved: RigidFoundation | None = field(default=None, repr=False, compare=False)
    surfaces: Mapping[str, RigidFoundation] = field(default_factory=dict, repr=False, compare=False)
    node_sets: Mapping[str, Int32Array] = field(default_factory=dict)
    node_numbers: IntArray | None = field(default=None, repr=False, compare=False)
    file: str = field(default="", repr=False, compare=False)
    slice: Slice | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        given: dict[str, Any] = {}
        if is_mesh_data(self.domain):
            given = {"domain": self.domain[0], "faces": self.faces or self.domain, "cells": self.cells or self.domain}
        domain, faces, cells = ({**vars(self), **given}[name] for name in ("domain", "faces", "cells"))
        if not is_mesh(domain):
            raise ValueError(f"NamedMesh: domain must be a mesh of DOLFINx, but is a {type(domain).__name__}")
        if domain.topology.dim != 3:
            raise ValueError(f"NamedMesh: the mesh is of dimension {domain.topology.dim}, not 3: {A_SLICE}")
        if domain.geometry.x.dtype != np.float64:
            raise ValueError(
                f"NamedMesh: the coordinates of the mesh are {domain.geometry.x.dtype}; make it with dtype=np.float64"
            )
        if not _are_arrays(faces):
            given["faces"], refused = faces_of(domain, faces, "NamedMesh")
            given["refused"] = {**self.refused, **refused}
        if not _are_arrays(cells):
            given["cells"] = cells_of(domain, cells, "NamedMesh")
        for name, value in given.items():
            object.__setattr__(self, name, value)

    def __repr__(self) -> str:
        groups = f", cells {_list(self.cells)}" if self.cells else ""
        kind, count = self.domain.topology.cell_type.name, self.domain.topology.index_map(3).size_global
        return f"NamedMesh({count} cells of type {kind}, order {self.degree}, faces {_list(self.faces)}{groups})"

    @property
    def comm(self) -> MPI.Comm:
        """The ranks that share it."""
        return self.domain.comm

    @property
    def copies(self) -> float:
        """How many layers as this one make the body that forces are for (`Slice`); 1 of a mesh that is the body."""
        return 1.0 if self.slice is None else self.slice.copies

    def shares_at(self, x: FloatArray) -> FloatArray:
        """What nodes x (k, 3) have of the forces that are given at them, shape (k,): all, but in a slice."""
        return np.ones(len(x)) if self.slice is None else self.slice.shares(x, self.degree)

    @property
    def degree(self) -> int:
        """Order of the cells: 1, or 2 for 10-node tetrahedra and 27-node hexahedra."""
        return compat.geometry_degree(self.domain)

    @property
    def tetrahedra(self) -> bool:
        """Whether the cells are tetrahedra."""
        return bool(self.domain.topology.cell_type.name == "tetrahedron")

    def facets(self, face: str, what: str) -> Int32Array:
        """This rank's facets of a face; ValueError, beginning with `what`, if there is none."""
        if isinstance(face, str) and face in self.refused:
            raise ValueError(f"{what}: {self.refused[face]}")
        return _named(self.faces, face, what, "face", self.file)

    def group(self, cells: str, what: str) -> Int32Array:
        """This rank's own cells of a group; ValueError, beginning with `what`, if there is none."""
        return _named(self.cells, cells, what, "cell group", self.file)

    def rows_of(self, numbers: npt.ArrayLike) -> IntArray:
        """Which of some numbers every point of this rank has, in the mesh file (`node_numbers`) or of the arrays that
        the mesh was made of, shape (p,); -1 without one of them."""
        own = self.domain.geometry.input_global_indices if self.node_numbers is None else self.node_numbers
        given = np.append(np.asarray(numbers, dtype=np.int64), -1)
        order = np.argsort(given)
        row = order[np.minimum(np.searchsorted(given, own, sorter=order), len(order) - 1)]
        return np.where(given[row] == own, row, -1)

    def with_nodes(
        self, name: str, at: npt.ArrayLike | Callable[[FloatArray], npt.ArrayLike] | None = None, numbers: Any = None
    ) -> NamedMesh:
        """The mesh with a set of nodes, which supports may name in place of a face; collective.

        Args:
            name: Of the set, such as "corner".
            at: Where its nodes are, metres, shape (3,) or (q, 3), every rank the same; or a function of coordinates
                (3, k) that is True at them, shape (k,).  Of several nodes at one place, as on the two sides of a cut,
                it has all.
            numbers: In place of it their numbers in the mesh file (`node_numbers`), or, of a mesh that is not from a
                file, 0 for the first node of the arrays that it was made of, shape (q,), every rank the same.

        Raises:
            ValueError: On every rank, if the name is that of a face or no text, not exactly one of `at` and `numbers`
                is given, or no node is there.
        """
        what = f"set of nodes {name!r}"
        if not isinstance(name, str) or not name or name in self.faces:
            raise ValueError(f"{what}: the name must be text, and not that of a face")
        if (at is None) == (numbers is None):
            raise ValueError(f"{what}: give either places of nodes (at) or their numbers")
        x = self.domain.geometry.x
        own = np.arange(len(x)) < self.domain.geometry.index_map().size_local
        if numbers is not None:
            given = np.unique(on_all_ranks(lambda: np.asarray(numbers, dtype=np.int64), what, self.comm))
            here = self.rows_of(given) >= 0
            count = self.comm.allreduce(int(np.sum(here & own)))
            missing = f"{len(given) - count} of its {len(given)} nodes belong to no cell" if count < len(given) else ""
        elif callable(at):
            here = on_all_ranks(lambda: np.broadcast_to(np.asarray(at(x.T), dtype=bool), len(x)), what, self.comm)
            missing = ""
        else:
            places = on_all_ranks(lambda: np.reshape(np.asarray(at, dtype=np.float64), (-1, 3)), what, self.comm)
            near = SAME_PLACE * float(np.linalg.norm(np.ptp(bounds(self.comm, x), axis=0)))
            here = tree_of(places).query(x)[0] <= near if len(places) else np.zeros(len(x), dtype=bool)
            distance = tree_of(x).query(places)[0] if len(x) else np.full(len(places), np.inf)
            far = np.min(self.comm.allgather(distance), axis=0) > near
            missing = f"there is no node at x = {in_words(places[np.argmax(far)])}" if np.any(far) else ""
        if not missing and self.comm.allreduce(int(np.sum(here))) == 0:
            missing = "it has no nodes"
        if missing:
            raise ValueError(f"{what}: {missing}")
        fault = f"{name!r} is a set of nodes, which supports may hold, and no face"
        sets = {**self.node_sets, name: np.flatnonzero(here).astype(np.int32)}
        return replace(self, node_sets=sets, refused={**self.refused, name: fault})


def _are_arrays(groups: object) -> bool:
    """Whether groups are numbers by name already."""
    return isinstance(groups, dict) and all(isinstance(group, np.ndarray) for group in groups.values())


def without_nodes(mesh: NamedMesh) -> dict[str, Any]:
    """Of a mesh with other nodes that is made of this one: no sets of nodes, with the reason, where one is used."""
    fault = "is a set of nodes of the mesh that this one was made of: name the nodes of this one (with_nodes)"
    return {"node_sets": {}, "refused": mesh.refused | {name: f"{name!r} {fault}" for name in mesh.node_sets}}


_NAMING: Final = {
    ".msh": {
        "face": 'Physical Surface("left") = {1}; and Physical Volume("body") = {1}; in the .geo file, with the numbers '
        "of the surface and of the volume, and mesh again",
        "cell group": 'Physical Volume("steel") = {1}; in the .geo file, with the number of the volume, and mesh again',
    },
    ".inp": {"face": "*SURFACE, NAME=left, or *NSET, NSET=left", "cell group": "*ELSET, ELSET=steel"},
}
"""How a face and a group of cells get a name, by the end of the file's name."""


def _none(kind: str, file: str) -> str:
    """That a mesh has no group of a kind, and how one is made in its file."""
    lines = _NAMING.get(PurePath(file).suffix.lower(), {})
    return f"{file or 'it'} has no {kind}s{f': write {lines[kind]}' if kind in lines else ''}"


def _named(groups: dict[str, Int32Array], name: str, what: str, kind: str, file: str) -> Int32Array:
    if not isinstance(name, str):
        names = (
            ": facets get names with the mesh: NamedMesh(domain, {'sole': (facet_tags, 1), 'top': lambda x: "
            "np.isclose(x[2], 1)}), or Body(..., faces={...})"
        )
        advice = f": write {str(name)!r}" if str(name) in groups else names * (kind == "face")
        raise ValueError(
            f"{what}: a {kind} is given by its name, text in quotation marks, but is {short(name)}{advice}"
        )
    if name not in groups:
        listed = f"its {kind}s are {', '.join(groups)}" if groups else _none(kind, file)
        raise ValueError(f"{what}: there is no {kind} {name!r} on this mesh{_hint(name, groups)}; {listed}")
    return groups[name]


_SIX = ((0, 1, 3, 7), (0, 1, 7, 5), (0, 5, 7, 4), (0, 3, 2, 7), (0, 6, 4, 7), (0, 2, 6, 7))
"""A hexahedron with DOLFINx's order of corners as six tetrahedra."""


def volume(named: NamedMesh) -> float:
    """Volume in cubic metres of this rank's own cells by their corners; non-planar faces are split into triangles."""
    domain = named.domain
    corners = domain.geometry.x[corner_geometry(domain)[: domain.topology.index_map(3).size_local]]
    parts = ((0, 1, 2, 3),) if corners.shape[1] == 4 else _SIX
    total = 0.0
    for a, b, c, d in parts:
        edges = corners[:, [b, c, d]] - corners[:, [a]]
        total += float(np.sum(np.abs(np.linalg.det(edges)))) / 6.0
    return total


NOWHERE = (0.0, 0.0, 0.0)


def moved(
    mesh: NamedMesh, translate: Point | Callable[..., Any] = NOWHERE, rotate: Rotation | None = None
) -> NamedMesh:
    """The same mesh at another place: rotated, then translated; or in another shape, with each node moved by itself.

    Faces and groups of cells keep their names, cells their shape, curved ones too; the given mesh stays where it is, so
    that one mesh can be the model of several bodies.  Loads, directions of supports and axes of materials are those of
    space: they do not rotate with the mesh.

    Args:
        mesh: A mesh of any order.
        translate: In metres, along x, y and z; or of every node, a function of x, shape (3, k), with values of this
            shape, without a rotation.
        rotate: A rotation by a constant angle in radians; `point` and `axis` are those before the translation.

    Raises:
        ValueError: If the translation is not three finite numbers, or the angle not one; or of a slice, if it leaves
            the plane of its section, or its axis, or is a function.
    """
    if callable(translate):
        return _shaped(mesh, translate, rotate)
    motion = motion_of(translate, rotate)
    if mesh.slice is not None:
        mesh.slice.refuse(motion.translation, None if motion.turn is None else motion.turn.axis)
    domain = compat.copied_mesh(mesh.domain)
    domain.geometry.x[:] = placed(motion, domain.geometry.x)
    coarser, grid = mesh.coarser, mesh.grid
    return replace(
        mesh,
        domain=domain,
        touching=placed(motion, mesh.touching),
        coarser=None if coarser is None else lambda: moved(coarser(), translate, rotate),
        curved=None,
        surfaces={},
        grid=None if grid is None else replace(grid, make=lambda planes: moved(grid.make(planes), translate, rotate)),
    )


def _shaped(mesh: NamedMesh, way: Callable[..., Any], rotate: Rotation | None) -> NamedMesh:
    """The mesh with every node moved by a function of its place; collective."""
    if rotate is not None:
        raise ValueError("moved: translate is a function of place: it goes without rotate")
    if mesh.slice is not None:
        raise ValueError("moved: translate must be a vector: a slice keeps its shape")
    domain = compat.copied_mesh(mesh.domain)
    x, touching = domain.geometry.x, mesh.touching
    x[:] = x + evaluate_vectors(way, x, "moved: translate", mesh.comm)
    touching = touching + evaluate_vectors(way, touching, "moved: translate", mesh.comm)
    return replace(mesh, domain=domain, touching=touching, coarser=None, curved=None, surfaces={}, grid=None)


def motion_of(translate: Point, rotate: Rotation | None) -> RigidMotion:
    check_point("moved: translate", translate)
    shift = np.asarray(translate, dtype=np.float64)
    if rotate is None:
        return RigidMotion(shift)
    if not isinstance(rotate, Rotation):
        raise ValueError(f"moved: rotate must be a Rotation(point, axis, angle), but is {rotate!r}")
    if not is_number(rotate.angle, -np.inf):
        raise ValueError(f"moved: the angle of rotate must be one finite number in radians, but is {rotate.angle!r}")
    axis = np.asarray(rotate.axis, dtype=np.float64)
    point = np.asarray(rotate.point, dtype=np.float64)
    return RigidMotion(shift, Turn(point, axis / np.linalg.norm(axis), float(np.asarray(rotate.angle))))


def placed(motion: RigidMotion, x: FloatArray) -> FloatArray:
    """Points x (k, 3) in metres after a motion, shape (k, 3)."""
    if motion.turn is None:
        return x + motion.translation
    return motion.turned(x - motion.turn.point) + motion.centre


SEPARATOR = ":"
"""Between the name of a body and that of its face or group of cells: "lower:top"."""

_MOST_LISTED: Final = 24


@dataclass(frozen=True)
class JoinedMesh:
    """Meshes of several bodies, each with its name; what holds them together is contact alone.

    A face is called by its body and its own name, as in "lower:top", a group of cells likewise, as in "lower:steel".

    Attributes:
        bodies: The mesh of each body, by its name.

    Raises:
        ValueError: As `join`.
    """

    bodies: dict[str, NamedMesh]

    def __post_init__(self) -> None:
        _check(self.bodies)

    @property
    def comm(self) -> MPI.Comm:
        """The ranks that share it."""
        return next(iter(self.bodies.values())).comm

    @property
    def faces(self) -> dict[str, Int32Array]:
        """This rank's boundary facets of each face by its name, as "lower:top"; facet numbers of its body's mesh."""
        return {_joined(body, name): one for body, mesh in self.bodies.items() for name, one in mesh.faces.items()}

    @property
    def cells(self) -> dict[str, Int32Array]:
        """This rank's own cells of each group by its name, as "lower:steel"; cell numbers of its body's mesh."""
        return {_joined(body, name): one for body, mesh in self.bodies.items() for name, one in mesh.cells.items()}

    def facets(self, face: str, what: str) -> Int32Array:
        """This rank's facets of a face, numbers of its body's mesh; errors as of `split`."""
        body, name = self.split(face, what)
        return self.bodies[body].facets(name, what)

    def group(self, cells: str, what: str) -> Int32Array:
        """This rank's own cells of a group, numbers of its body's mesh; errors as of `split`."""
        body, name = self.split_group(cells, what)
        return self.bodies[body].cells[name]

    def split(self, face: str, what: str) -> tuple[str, str]:
        """The name of the body of a face, and the name of the face there: "lower" and "top" of "lower:top".

        Raises:
            ValueError: If there is no such face; the message begins with `what`.
        """
        names = {body: tuple({**mesh.faces, **mesh.refused, **mesh.node_sets}) for body, mesh in self.bodies.items()}
        return self._split(face, what, "face", names)

    def split_group(self, cells: str, what: str) -> tuple[str, str]:
        """The same of a group of cells."""
        return self._split(cells, what, "cell group", {body: tuple(mesh.cells) for body, mesh in self.bodies.items()})

    def body(self, name: str, what: str) -> NamedMesh:
        """The mesh of a body; ValueError, beginning with `what`, if there is none."""
        if name not in self.bodies:
            raise ValueError(f"{what}: there is no body {name!r}{_hint(name, self.bodies)}; {self._listed}")
        return self.bodies[name]

    def moved(self, translate: Way = NOWHERE, rotate: Rotation | None = None) -> JoinedMesh:
        """All bodies at another place; arguments and errors as of `coulomb.moved`, which moves one."""
        return JoinedMesh({name: moved(mesh, translate, rotate) for name, mesh in self.bodies.items()})

    @property
    def _listed(self) -> str:
        return f"the bodies are {_list(self.bodies)}" if len(self.bodies) > 1 else f"the body is {_list(self.bodies)}"

    def _split(self, given: str, what: str, kind: str, names: Mapping[str, tuple[str, ...]]) -> tuple[str, str]:
        body, colon, name = given.partition(SEPARATOR) if isinstance(given, str) else ("", "", "")
        every = [_joined(one, inner) for one, own in names.items() for inner in own]
        if not colon:
            homes = [_joined(one, given) for one, own in names.items() if given in own]
            meant = f" (did you mean {' or '.join(map(repr, homes[:3]))}?)" if homes else _hint(str(given), every)
            form = f"{next(iter(self.bodies))}:{kind.split()[-1]}"
            raise ValueError(
                f"{what}: {kind} {given!r} does not say of which body; name it as in {form!r}{meant}; {self._listed}"
            )
        self.body(body, f"{what}: {kind} {given!r}")
        own = names[body]
        if name not in own:
            listed = [_joined(body, inner) for inner in own]
            has = f"its {kind}s are {_list(listed)}" if own else _none(kind, self.bodies[body].file)
            if not name:
                raise ValueError(f"{what}: {given!r} names a body, but none of its {kind}s; {has}")
            raise ValueError(f"{what}: body {body!r} has no {kind} {given!r}{_hint(given, listed or every)}; {has}")
        return body, name


def with_surfaces(mesh: NamedMesh | JoinedMesh, surfaces: Mapping[str, RigidFoundation]) -> NamedMesh | JoinedMesh:
    """The mesh with `NamedMesh.surfaces`, by the names of faces."""
    bodies = dict(mesh.bodies) if isinstance(mesh, JoinedMesh) else {"": mesh}
    for face, surface in surfaces.items():
        body, name = mesh.split(face, "surface") if isinstance(mesh, JoinedMesh) else ("", face)
        one = bodies[body]
        if surface is not one.curved:
            bodies[body] = replace(one, surfaces={**one.surfaces, name: surface})
    return JoinedMesh(bodies) if isinstance(mesh, JoinedMesh) else bodies[""]


def _check(bodies: Mapping[str, NamedMesh]) -> None:
    if not bodies:
        raise ValueError("join: give at least one body, as in join(lower=..., upper=...)")
    for name in bodies:
        if not (isinstance(name, str) and name.isidentifier()):  # it can stand before the ":"
            raise ValueError(
                "join: the name of a body must be an identifier (letters, digits and _, no digit first), but is "
                f"{name!r}"
            )
    (first, one), *others = bodies.items()
    for name, other in others:
        if MPI.Comm.Compare(one.comm, other.comm) not in (MPI.IDENT, MPI.CONGRUENT):
            raise ValueError(
                f"join: {first!r} and {name!r} are on different ranks ({one.comm.size} and {other.comm.size} of them); "
                "make all meshes with the same comm"
            )
    seen: dict[int, str] = {}
    for name, mesh in bodies.items():
        twin = seen.setdefault(id(mesh.domain), name)
        if twin != name:
            raise ValueError(
                f"join: {twin!r} and {name!r} are the same mesh at the same place; give one of them another place with "
                "coulomb.moved(mesh, translate=...)"
            )


def _joined(body: str, name: str) -> str:
    return f"{body}{SEPARATOR}{name}"


def _hint(name: str, known: Iterable[str]) -> str:
    close = difflib.get_close_matches(name, list(known), n=1)
    return f" (did you mean {close[0]!r}?)" if close else ""


def _list(names: Iterable[str]) -> str:
    names = list(names)
    more = f" and {len(names) - _MOST_LISTED} more" if len(names) > _MOST_LISTED else ""
    return ", ".join(names[:_MOST_LISTED]) + more
