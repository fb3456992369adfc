"""Frees what earlier bodies left behind, in a process that makes many of them.

A compiled form is in a reference cycle (in DOLFINx's `fem.form`) and holds the mesh, its matrices and some ten
communicators, of which MPICH has 2046.  Python collects cycles by the number of small objects, not by these.  PETSc
moreover destroys matrices only when all ranks ask for it, while their communicator exists (3.18 also on one rank).
"""

from __future__ import annotations

import gc
import weakref
from dataclasses import dataclass, field
from typing import Any

from mpi4py import MPI
from petsc4py import PETSc

from .. import compat_forms

_BODIES, _NODES = 16, 100_000  # searching takes 0.1 s: little beside 16 small problems, or beside one of 1e5 nodes


@dataclass
class _Earlier:
    """Bodies on the same ranks since the last search: their number and nodes; and meshes that matrices may have."""

    bodies: int = 0
    nodes: int = 0
    meshes: list[tuple[weakref.ref[Any], Any]] = field(default_factory=list)


_earlier: dict[tuple[int, ...], _Earlier] = {}


def free_earlier_bodies(domain: Any) -> None:
    """Called for each new body, by all ranks of its mesh; after 16 bodies, or 1e5 nodes, frees what nobody uses."""
    comm = domain.comm
    ranks = tuple(MPI.Group.Translate_ranks(comm.group, list(range(comm.size)), MPI.COMM_WORLD.group))
    earlier = _earlier.setdefault(ranks, _Earlier())
    if earlier.bodies >= _BODIES or earlier.nodes >= _NODES:
        gc.collect()
        for _, mesh in earlier.meshes:
            PETSc.garbage_cleanup(mesh.comm)
        used = comm.allreduce([mesh() is not None for mesh, _ in earlier.meshes], lambda a, b: [*map(max, a, b)])
        earlier.meshes = [kept for kept, is_used in zip(earlier.meshes, used, strict=True) if is_used]
        earlier.bodies = earlier.nodes = 0
    earlier.bodies += 1
    earlier.nodes += domain.geometry.index_map().size_global
    if not any(mesh() is domain for mesh, _ in earlier.meshes):
        earlier.meshes.append((weakref.ref(domain), compat_forms.cpp_of(domain)))
