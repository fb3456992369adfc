"""Memory that is free, by the kernel and the limits of its control groups, and memory that a problem needs.

The need is a formula with n displacement and m contact unknowns, fitted to measurements of the block, and within a
factor of two for similar bodies: nested dissection of a body in 3D fills the factor with n^(4/3) numbers, the Schur
complement on the contact nodes is a dense matrix m x m, and multigrid is linear in n (memory.csv).
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from mpi4py import MPI

from ..linalg.compliance import DirectSolver, LinearSolver

# bytes
_BASE: Final = 1.4e8  # per rank without a mesh: Python, DOLFINx, PETSc
_BODY: Final = 1.4e3  # per displacement unknown: mesh, fields, K where it is assembled
_MULTIGRID: Final = 550.0  # per displacement unknown: K in blocks, grids, the last solutions
_ROWS: Final = 900.0  # per displacement unknown: K beside its factors
_FACTOR: Final = 104.0  # over n^(4/3): the factor of K in single precision; in double twice as much
_FRONTS: Final = 132.0  # the same with the contact nodes last, including memory of fronts not yet reused
_GATHERED: Final = 1.2e3  # per displacement unknown: K on the first of several ranks, which factorises it
_DENSE: Final = 6.0  # over m^2: the Schur complement and the inverse of its factor
_COLUMNS: Final = 8.0 / 3.0  # over m^2, in double precision: columns of the inverse for products (`DenseInverse`)
_WIDER: Final = 2.4  # rows of K of 27-node hexahedra over those of 8-node ones; of 10-node tetrahedra they are as long


def memory_needed(
    displacement: int,
    contact: int,
    ranks: int,
    linear_solver: LinearSolver,
    explicit: bool,
    nodes: int = 8,
    double: bool = False,
) -> float:
    """Bytes that a run needs over all ranks.

    Args:
        displacement: Displacement unknowns, over all ranks.
        contact: Contact unknowns, over all ranks.
        explicit: Whether A is formed.
        nodes: Nodes of a cell: 4 and 8, in second order 10 and 27.
        double: Whether factors are in double precision from the beginning, for a load history.
    """
    n, m = float(displacement), float(contact)
    wider = _WIDER if nodes == 27 else 1.0
    least = least_memory(displacement, ranks, nodes)
    if linear_solver is not DirectSolver:
        return least + _MULTIGRID * wider * n
    factor: float = (2.0 if double else 1.0) * (_FRONTS if explicit else _FACTOR) * n ** (4 / 3)
    dense = ((2.0 if double else 1.0) * _DENSE + (_COLUMNS if double else 0.0)) * m**2 if explicit else 0.0
    return least + factor + dense + (_ROWS + (_GATHERED if ranks > 1 else 0.0)) * wider * n


def least_memory(displacement: int, ranks: int, nodes: int = 8) -> float:
    """Bytes that any method needs."""
    return _BASE * ranks + _BODY * (_WIDER if nodes == 27 else 1.0) * displacement


def most_unknowns(size: float, ranks: int, nodes: int = 8) -> int:
    """Displacement unknowns for which so many bytes suffice by multigrid."""
    return int(max(size - _BASE * ranks, 0.0) / ((_WIDER if nodes == 27 else 1.0) * (_BODY + _MULTIGRID)))


_PROC, _GROUPS = Path("/proc"), Path("/sys/fs/cgroup")


def free_memory(proc: Path = _PROC, groups: Path = _GROUPS) -> float | None:
    """Free memory in bytes by the kernel and the control groups (version 1 or 2); None if it is not reported."""
    rooms = [_available(proc / "meminfo")]
    for line in _lines(proc / "self" / "cgroup"):
        _, controllers, path = (line.split(":", 2) + ["", ""])[:3]
        if controllers == "":
            rooms += _rooms(groups, path, "memory.max", "memory.current", "inactive_file")
        elif "memory" in controllers.split(","):
            root, limit, usage = groups / "memory", "memory.limit_in_bytes", "memory.usage_in_bytes"
            rooms += _rooms(root, path, limit, usage, "total_inactive_file")
    known = [value for value in rooms if value is not None]
    return min(known) if known else None


def first_room(comm: MPI.Comm) -> float:
    """The free memory where the first rank is, which has the factors, bytes; inf if it is unknown; collective."""
    free = free_memory() if comm.rank == 0 else None
    return float(comm.bcast(float("inf") if free is None else free))


def least_room(comm: MPI.Comm) -> float:
    """The memory that all ranks together may take until some node is full, bytes; inf if it is unknown; collective."""
    node = comm.Split_type(MPI.COMM_TYPE_SHARED)
    share = node.size / float(comm.size)
    node.Free()
    free = free_memory()
    mine = float("inf") if free is None else free / share
    return float(comm.allreduce(mine, op=MPI.MIN))


def _available(path: Path) -> float | None:
    for line in _lines(path):
        if line.startswith("MemAvailable:"):
            return 1024.0 * float(line.split()[1])
    return None


def _rooms(root: Path, path: str, limit: str, usage: str, cached: str) -> list[float | None]:
    """Free bytes of a group and its parents (in a container the root): limit less used memory without cached files."""
    parts = [part for part in path.split("/") if part]
    rooms: list[float | None] = []
    for depth in range(len(parts) + 1):
        group = root.joinpath(*parts[:depth])
        most, used = _number(group / limit), _number(group / usage)
        if most is not None and used is not None and most < 2.0**60:
            files = [float(line.split()[1]) for line in _lines(group / "memory.stat") if line.startswith(f"{cached} ")]
            rooms.append(max(most - used + sum(files), 0.0))
    return rooms


def _number(path: Path) -> float | None:
    lines = _lines(path)
    return float(lines[0]) if lines and lines[0].strip().isdigit() else None


def _lines(path: Path) -> list[str]:
    try:
        return path.read_text(encoding="utf-8").splitlines()
    except OSError:
        return []
