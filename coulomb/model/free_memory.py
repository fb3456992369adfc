"""Free memory of this node and of all nodes together, by the kernel and the limits of its control groups."""

from __future__ import annotations

from pathlib import Path

from mpi4py import MPI

_PROC, _GROUPS = Path("/proc"), Path("/sys/fs/cgroup")


def free_memory(proc: Path = _PROC, groups: Path = _GROUPS) -> float | None:
    """Free memory in bytes; None if the system does not report it.

    Args:
        proc: The proc file system, with memory and control groups of this process.
        groups: The file system of the control groups, version 1 or 2.
    """
    found = [_available(proc / "meminfo")]
    for line in _lines(proc / "self" / "cgroup"):
        _, controllers, path = (line.split(":", 2) + ["", ""])[:3]
        if controllers == "":
            found += _rooms(groups, path, "memory.max", "memory.current", "inactive_file")
        elif "memory" in controllers.split(","):
            root, limit, usage = groups / "memory", "memory.limit_in_bytes", "memory.usage_in_bytes"
            found += _rooms(root, path, limit, usage, "total_inactive_file")
    known = [value for value in found if value is not None]
    return min(known) if known else None


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
    """Free bytes of a group and its parents: limit minus used memory without cached files.

    Inside a container, its own group may be at the root.
    """
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
