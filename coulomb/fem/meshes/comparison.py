"""Other meshes of the same bodies, on which a problem is solved again to estimate the error of an answer."""

from __future__ import annotations

from collections.abc import Callable

from .meshes import first_order, second_order
from .named_mesh import JoinedMesh, NamedMesh

COARSER = 2
"""Number of coarser meshes, of which each costs an eighth of the one before: two show the order of convergence."""


def comparison_meshes(mesh: NamedMesh | JoinedMesh) -> list[NamedMesh | JoinedMesh]:
    """Two coarser meshes, from fine to coarse, or one, where every body has them; else the same cells with elements
    of the other order; none for bodies of both orders; collective."""
    bodies = mesh.bodies if isinstance(mesh, JoinedMesh) else {"": mesh}
    found: list[dict[str, NamedMesh]] = []
    while len(found) < COARSER and all(one.coarser is not None for one in bodies.values()):
        bodies = {name: one.coarser() for name, one in bodies.items() if one.coarser is not None}
        found.append(bodies)
    if not found and len(orders := {one.degree for one in bodies.values()}) == 1:
        other: Callable[[NamedMesh], NamedMesh] = second_order if orders == {1} else first_order
        found.append({name: other(one) for name, one in bodies.items()})
    return [JoinedMesh(one) if isinstance(mesh, JoinedMesh) else one[""] for one in found]
