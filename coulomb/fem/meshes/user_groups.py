"""Faces and groups of cells of a mesh of DOLFINx as users have them: arrays, MeshTags, locator functions, MeshData."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI

from ...arrays import Int32Array
from .. import compat
from ..compat import mesh
from ..geometry import on_all_ranks
from .mesh_parts import boundary_facets

Groups = dict[str, Int32Array]
"""Numbers of facets or cells of this rank, by name."""

_HOW = (
    "give the numbers of its facets as an array, (MeshTags, value), or a function of x, shape (3, k), that is True on "
    "the face"
)


def is_mesh(value: Any) -> bool:
    """Whether a value is a mesh of DOLFINx."""
    return hasattr(value, "topology") and hasattr(value, "geometry")


def is_mesh_data(value: Any) -> bool:
    """Whether a value is what `model_to_mesh` and `read_from_msh` of DOLFINx return: MeshData, until 0.9 a tuple of the
    mesh and the MeshTags of its cells and facets."""
    return isinstance(value, tuple) and len(value) >= 3 and is_mesh(value[0])


def is_tags(value: Any) -> bool:
    """Whether a value is MeshTags of DOLFINx."""
    return all(hasattr(value, name) for name in ("dim", "indices", "values", "find"))


def faces_of(domain: Any, given: Any, what: str) -> tuple[Groups, dict[str, str]]:
    """The faces of a mesh, ascending facets that this rank owns, by name, and the reasons why groups are none;
    collective.

    Args:
        given: By name arrays of facets, (MeshTags, value), or functions of x, shape (3, k), that are True on the face;
            or MeshTags, whose values become names such as "3"; or MeshData, whose physical groups have the names.
        what: Beginning of messages.

    Raises:
        ValueError: On every rank, if facets are not on the boundary of the mesh, there are none, or the argument is
            something else.
    """
    boundary, comm, names = boundary_facets(domain), domain.comm, dict[int, str]()
    if is_mesh_data(given):
        if compat.cpp_of(given[0]) is not compat.cpp_of(domain):
            raise ValueError(f"{what}: faces is the MeshData of another mesh")
        given, names = _tags_and_names(given, _sides(domain))
        if given is None:
            return {}, {}
    if is_tags(given):
        return _of_tags(domain, given, boundary, names, what)
    if not isinstance(given, Mapping):
        raise ValueError(
            f"{what}: faces must be names with facets, such as faces={{'sole': facets}}, MeshTags, the MeshData of "
            f"dolfinx.io.gmsh, or a NamedMesh, but is a {type(given).__name__}"
        )
    groups: Groups = {}
    for name, one in given.items():
        of = f"{what}: face {name!r}"
        if not isinstance(name, str) or not name:
            raise ValueError(f"{what}: faces: the name of a face must be a word, but is {name!r}")
        facets = on_all_ranks(partial(_facets, domain, one), of, comm)
        if count := comm.allreduce(int(np.sum(~np.isin(facets, boundary)))):
            raise ValueError(
                f"{of}: {count} of its facets are not on the boundary of the mesh: use "
                "mesh.locate_entities_boundary(domain, 2, ...)"
            )
        groups[name] = facets
        if comm.allreduce(len(facets)) == 0:
            raise ValueError(f"{of} has no facets")
    return groups, {}


def cells_of(domain: Any, given: Any, what: str) -> Groups:
    """The groups of cells of a mesh, this rank's own cells by name, from MeshTags of cells or MeshData; collective.

    Raises:
        ValueError: On every rank, if the MeshTags are of other entities, or of another mesh.
    """
    names = dict[int, str]()
    if is_mesh_data(given):
        given, names = _tags_and_names(given, domain.topology.dim)
    if given is None:
        return {}
    if not is_tags(given):
        raise ValueError(
            f"{what}: cells must be names with cells, MeshTags or MeshData, but is a {type(given).__name__}"
        )
    on_all_ranks(lambda: _refuse_tags(domain, given, domain.topology.dim), f"{what}: cells", domain.comm)
    own = domain.topology.index_map(domain.topology.dim).size_local
    cells_by_name = {_name(value, names): given.find(value) for value in _values(given, domain.comm)}
    return {name: np.sort(cells[cells < own]).astype(np.int32) for name, cells in cells_by_name.items()}


def _sides(domain: Any) -> int:
    """Dimension of the facets of a mesh: 2, or 1 of a section in 2D."""
    return int(domain.topology.dim) - 1


def _tags_and_names(data: Any, dim: int) -> tuple[Any, dict[int, str]]:
    """Of MeshData the MeshTags of cells or facets by their dimension, and the names of their values."""
    groups = getattr(data, "physical_groups", {})
    tags = data[1] if dim == data[0].topology.dim else data[2]
    return tags, {int(tag): str(name) for name, (of, tag) in groups.items() if of == dim}


def _name(value: int, names: Mapping[int, str]) -> str:
    return names.get(value, str(value))


def _values(tags: Any, comm: MPI.Comm) -> list[int]:
    """The values of MeshTags on all ranks, ascending; collective."""
    return sorted(set().union(*comm.allgather({int(value) for value in np.unique(tags.values)})))


def _facets(domain: Any, given: Any) -> Int32Array:
    """Facets that this rank owns, ascending."""
    if isinstance(given, tuple):
        if hasattr(given, "tag") and hasattr(given, "dim"):
            raise ValueError(
                f"{given} is the number of a physical group, without facets: give faces=data, the MeshData itself, or "
                f"(data.facet_tags, {given.tag}) for this face"
            )
        if len(given) != 2 or not is_tags(given[0]):
            raise ValueError(f"{_HOW}, but this is a tuple of {', '.join(type(one).__name__ for one in given)}")
        tags, value = given
        _refuse_tags(domain, tags, _sides(domain))
        given = tags.find(int(value))
    elif callable(given):
        given = mesh.locate_entities_boundary(domain, _sides(domain), given)
    try:
        facets = np.asarray(given)
    except ValueError:  # lists of different lengths
        facets = np.empty((0, 0))
    if facets.ndim != 1 or (facets.size and not np.issubdtype(facets.dtype, np.integer)):
        raise ValueError(f"{_HOW}, but this is a {type(given).__name__}")
    count = domain.topology.index_map(_sides(domain))
    outside = (facets < 0) | (facets >= count.size_local + count.num_ghosts)
    if np.any(outside):
        raise ValueError(
            f"{facets[outside][0]} is no facet of this mesh, which has the facets 0 to "
            f"{count.size_local + count.num_ghosts - 1}"
        )
    return np.unique(facets[facets < count.size_local]).astype(np.int32)


def _refuse_tags(domain: Any, tags: Any, dim: int) -> None:
    if tags.dim != dim:
        kind = "cells" if dim == domain.topology.dim else "facets"
        raise ValueError(f"the MeshTags are of dimension {tags.dim}, but {kind} have dimension {dim}")
    if compat.mesh_of_tags(tags) is not compat.cpp_of(domain.topology):
        raise ValueError("the MeshTags are of another mesh")


def _of_tags(
    domain: Any, tags: Any, boundary: npt.NDArray[Any], names: Mapping[int, str], what: str
) -> tuple[Groups, dict[str, str]]:
    """Each value of MeshTags as a face; one with facets inside the body is refused where it is used."""
    comm: MPI.Comm = domain.comm
    on_all_ranks(lambda: _refuse_tags(domain, tags, _sides(domain)), f"{what}: faces", comm)
    groups: Groups = {}
    refused: dict[str, str] = {}
    for value in _values(tags, comm):
        name, facets = _name(value, names), _facets(domain, tags.find(value))
        if count := comm.allreduce(int(np.sum(~np.isin(facets, boundary)))):
            refused[name] = f"face {name!r} of the MeshTags has {count} facets inside the body"
        else:
            groups[name] = facets
    return groups, refused
