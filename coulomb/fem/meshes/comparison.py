"""Other meshes of the same bodies, on which a problem is solved again to estimate the error of an answer."""

from __future__ import annotations

from collections.abc import Iterator

from .meshes import first_order, second_order
from .named_mesh import JoinedMesh, NamedMesh
from .splitting import split

COARSER = 2
"""Number of coarser meshes, of which each costs an eighth of the one before: two show the order of convergence."""


def coarser_meshes(mesh: NamedMesh | JoinedMesh) -> Iterator[NamedMesh | JoinedMesh]:
    """Up to two coarser meshes, from fine to coarse, as far as every body has them; collective.

    Raises:
        ValueError: As of `NamedMesh.coarser`.
    """
    bodies = _bodies(mesh)
    for _ in range(COARSER):
        if any(one.coarser is None for one in bodies.values()):
            return
        bodies = {name: one.coarser() for name, one in bodies.items() if one.coarser is not None}
        yield _like(mesh, bodies)


def same_cells(mesh: NamedMesh | JoinedMesh) -> Iterator[NamedMesh | JoinedMesh]:
    """The same cells with elements of the other order, the second one with a smooth boundary; and first-order cells on
    the nodes of second order, but beside first-order hexahedra, whose second order has as many contact points.  None
    for bodies of both orders; collective."""
    bodies = _bodies(mesh)
    orders = {one.degree for one in bodies.values()}
    if len(orders) > 1:
        return
    first = orders == {1}
    other = {name: _curved(one) if first else first_order(one) for name, one in bodies.items()}
    yield _like(mesh, other)
    second = other if first else bodies
    if not first or any(one.domain.topology.cell_type.name == "tetrahedron" for one in bodies.values()):
        yield _like(mesh, {name: split(one) for name, one in second.items()})


def _curved(mesh: NamedMesh) -> NamedMesh:
    """Second order with a smooth boundary, or with the given one if cells would become flat."""
    try:
        return second_order(mesh, curved=True)
    except ValueError:
        return second_order(mesh)


def _bodies(mesh: NamedMesh | JoinedMesh) -> dict[str, NamedMesh]:
    return dict(mesh.bodies) if isinstance(mesh, JoinedMesh) else {"": mesh}


def _like(mesh: NamedMesh | JoinedMesh, bodies: dict[str, NamedMesh]) -> NamedMesh | JoinedMesh:
    return JoinedMesh(bodies) if isinstance(mesh, JoinedMesh) else bodies[""]
