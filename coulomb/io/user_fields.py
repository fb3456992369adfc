"""The user's own functions beside the results: interpolated to the nodes of the displacements, or to the cells."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from mpi4py import MPI

from ..arrays import FloatArray
from ..fem import compat, compat_forms
from ..fem.bodies import DisplacementSpace
from ..fem.compat import fem
from ..fem.geometry import on_all_ranks

Fields = dict[str, FloatArray]


def interpolated(
    given: Mapping[str, Any], space: DisplacementSpace, taken: tuple[str, ...], comm: MPI.Comm
) -> tuple[Fields, Fields]:
    """Values of functions at this rank's nodes, and in its own cells; collective.

    A function of a continuous space is interpolated to the nodes of the displacements, another one to the midpoints of
    the cells.

    Args:
        given: Functions of DOLFINx on the mesh of the body, of scalars, vectors or tensors, by name.
        space: The displacements of the body.
        taken: Names of the fields that the package writes.
        comm: The ranks.

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
            there = fem.Function(compat_forms.tensor_space(space.domain, degree, shape, family))
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
    found: list[dict[str, Any]] = [{} for _ in bodies]

    def add(name: str, function: Any) -> None:
        if not isinstance(function, fem.Function):
            raise ValueError(f"must be a Function of DOLFINx, but is {function!r}; interpolate an expression first")
        mesh = compat_forms.cpp_of(function.function_space.mesh)
        mine = [number for number, body in enumerate(bodies) if compat_forms.cpp_of(body.domain) is mesh]
        if not mine:
            raise ValueError("is on the mesh of none of the bodies")
        found[mine[0]][name] = function

    for name, function in given.items():
        on_all_ranks(lambda name=name, function=function: add(name, function), f"fields: {name!r}", comm)  # type: ignore[misc]
    return found


def _refuse(name: Any, function: Any, space: DisplacementSpace, taken: tuple[str, ...]) -> None:
    if not isinstance(name, str) or not name.isprintable() or not name or "/" in name:
        raise ValueError("the name must be a printable word without /")
    if name in taken:
        raise ValueError("the results have a field of this name; choose another one")
    if not isinstance(function, fem.Function):
        raise ValueError(f"must be a Function of DOLFINx, but is {function!r}; interpolate an expression first")
    if compat_forms.cpp_of(function.function_space.mesh) is not compat_forms.cpp_of(space.domain):
        raise ValueError("is on another mesh than the body")


def _is_continuous(function: Any) -> bool:
    try:
        return compat_forms.lagrange_vectors(function.function_space)[0]
    except RuntimeError:
        return False


def _rows(function: Any, space: DisplacementSpace, continuous: bool) -> FloatArray:
    """One row per node of the displacements that this rank owns, or per own cell."""
    W = function.function_space
    dofs, values = compat.cell_dofs(W), function.x.array.reshape(-1, W.dofmap.bs)
    if not continuous:
        rows: FloatArray = values[dofs[: space.domain.topology.index_map(3).size_local, 0]]
        return rows
    there = compat.cell_dofs(space.V).ravel()
    at_nodes = np.zeros((int(np.max(there, initial=-1)) + 1, values.shape[1]))
    at_nodes[there] = values[dofs.ravel()]
    own: FloatArray = at_nodes[: len(space.x)]
    return own
