"""Other meshes of the same bodies, on which a problem is solved again to estimate the error of an answer."""

from __future__ import annotations

from collections.abc import Callable, Iterator

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
    """The same cells with elements of the other order, the second one with a smooth boundary; where it is the first,
    also first-order cells on the same nodes.  None for bodies of both orders; collective."""
    bodies = _bodies(mesh)
    orders = {one.degree for one in bodies.values()}
    others: dict[int, tuple[Callable[[NamedMesh], NamedMesh], ...]] = {1: (_curved,), 2: (first_order, split)}
    for other in others[orders.pop()] if len(orders) == 1 else ():
        yield _like(mesh, {name: other(one) for name, one in bodies.items()})


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
