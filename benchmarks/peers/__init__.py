"""The block, or two blocks, with Coulomb friction solved by coulomb and by other packages, each in a separate process.

Times run from the description of the problem to the contact forces: they include meshing, assembly, factorisation and
whatever else a package needs to form its problem, but not imports and compilation.
"""

from __future__ import annotations

import importlib.util
import json
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from coulomb.arrays import FloatArray

from ..processes import alone
from .answer import Figures


class Peer(NamedTuple):
    """A peer.

    Attributes:
        module: In this package.
        function: Of the module, from p to an `Answer`.
        needs: A Python module, or an executable.
        package: Where to get it.
        up_to: Largest number of cells per metre that is measured; 0 for any.
    """

    module: str
    function: str
    needs: str
    package: str = ""
    up_to: int = 0


OURS = "coulomb"
_SICONOS, _GETFEM = ("siconos", "Debian's python3-siconos"), ("getfem", "Debian's python3-getfem++")
_CALCULIX = ("ccx", "Debian's calculix-ccx")

PROBLEMS = {
    "block": {
        OURS: Peer("ours", "solve", OURS),
        "Siconos": Peer("siconos", "solve_newton", *_SICONOS),
        "Siconos ADMM": Peer("siconos", "solve_admm", *_SICONOS),
        "GetFEM": Peer("getfem", "solve", *_GETFEM),
        "CalculiX": Peer("calculix", "solve", *_CALCULIX),
        "Clarabel": Peer("clarabel", "solve", "clarabel", "pip's clarabel", up_to=10),
    },
    "two-blocks": {
        OURS: Peer("ours", "solve_pair", OURS),
        "Siconos ADMM": Peer("siconos", "solve_pair", *_SICONOS),
        "GetFEM": Peer("pair_getfem", "solve", *_GETFEM),
        "CalculiX mortar": Peer("pair_calculix", "solve_mortar", *_CALCULIX),
        "CalculiX faces": Peer("pair_calculix", "solve_faces", *_CALCULIX),
        "CalculiX nodes": Peer("pair_calculix", "solve_nodes", *_CALCULIX),
    },
    "second-order": {
        OURS: Peer("ours", "solve_second_order", OURS),
        "Siconos ADMM": Peer("siconos", "solve_second_order", *_SICONOS),
    },
    "history": {
        OURS: Peer("ours", "solve_history", OURS),
        "GetFEM": Peer("getfem", "solve_history", *_GETFEM),
        "CalculiX": Peer("calculix", "solve_history", *_CALCULIX),
    },
}
"""The peers of each problem: `benchmarks.block`, `benchmarks.two_blocks` (CalculiX also with penalties, between faces
and between nodes and faces), the block of 10-node tetrahedra, and the load history of `answer`."""


class Row(NamedTuple):
    """A row of peers.csv.

    Attributes:
        peer: Its name.
        p: Cells per metre.
        seconds: From the description of the problem to the contact forces.
        peak_memory_bytes: Of the process that did the work, its imports included.
        iterations: The peer's own.
        force_error: |forces - coulomb's| / |coulomb's| over the contact nodes, coulomb's at tolerance 1e-8.
        figures: Of the two blocks.
        first_seconds: Of a load history, until the end of its first step; 0 if that is not known.
        products: Products by A, of coulomb on a load history.
    """

    peer: str
    p: int
    seconds: float
    peak_memory_bytes: int
    iterations: int
    force_error: float
    figures: Figures | None = None
    first_seconds: float = 0.0
    products: int = 0


class Skipped(NamedTuple):
    """A peer without a row, and why."""

    peer: str
    p: int
    reason: str


def measure(
    sizes: Iterable[int],
    names: Sequence[str] | None = None,
    repeats: int = 1,
    problem: str = "block",
    threads: int = 1,
) -> Iterator[Row | Skipped]:
    """Rows as they are measured; coulomb's row, with which the others are compared, is the first.

    Args:
        sizes: Cells per metre.
        names: Names of the problem's peers, by default all; coulomb is always included.
        repeats: How often each is run; the minimum time counts.
        problem: In PROBLEMS.
        threads: Of every package, at most.

    Raises:
        ValueError: If there is no such problem, or it has no such peer.
        RuntimeError: If coulomb itself fails.
    """
    if problem not in PROBLEMS:
        raise ValueError(f"there is no problem {problem!r}; the problems are {', '.join(PROBLEMS)}")
    peers = PROBLEMS[problem]
    chosen = list(peers) if names is None else list(names)
    for name in chosen:
        if name not in peers:
            raise ValueError(f"there is no peer {name!r}; the peers are {', '.join(peers)}")
    return _measure(problem, list(sizes), [OURS] + [name for name in chosen if name != OURS], repeats, threads)


def _measure(
    problem: str, sizes: Sequence[int], names: Sequence[str], repeats: int, threads: int
) -> Iterator[Row | Skipped]:
    peers = PROBLEMS[problem]
    with tempfile.TemporaryDirectory() as directory:
        for p in sizes:
            ours: _Run | None = None
            for name in names:
                run: _Run | str
                output = Path(directory) / "answer.npz"
                run = missing(peers[name]) or _beyond(peers[name], p)
                run = run or _least(problem, name, p, output, repeats, threads)
                if isinstance(run, str):
                    if name == OURS:
                        raise RuntimeError(f"p = {p}: {run}")
                    yield Skipped(name, p, run)
                    continue
                ours = ours or run
                error = force_error(run.points, run.forces, ours.points, ours.forces)
                yield Row(name, p, run.seconds, run.peak_memory_bytes, run.iterations, error, *run[5:])


def missing(peer: Peer) -> str:
    """Reason why a peer cannot run here; empty if it can."""
    if importlib.util.find_spec(peer.needs) is not None or shutil.which(peer.needs) is not None:
        return ""
    return f"not installed: {peer.needs} comes with {peer.package}"


def _beyond(peer: Peer, p: int) -> str:
    return f"takes too long beyond p = {peer.up_to}" if peer.up_to and p > peer.up_to else ""


class _Run(NamedTuple):
    seconds: float
    iterations: int
    peak_memory_bytes: int
    points: FloatArray
    forces: FloatArray
    figures: Figures | None = None
    first_seconds: float = 0.0
    products: int = 0


def _least(problem: str, name: str, p: int, output: Path, repeats: int, threads: int) -> _Run | str:
    """The fastest of several runs, or the reason why one of them failed."""
    best = _run(problem, name, p, output, threads)
    for _ in range(repeats - 1):
        if isinstance(best, str):
            break
        again = _run(problem, name, p, output, threads)
        best = again if isinstance(again, str) else min(best, again, key=lambda run: run.seconds)
    return best


def _run(problem: str, name: str, p: int, output: Path, threads: int = 1) -> _Run | str:
    """The answer of one peer in a separate process, or the reason why there is none."""
    output.unlink(missing_ok=True)
    command = [sys.executable, "-m", "benchmarks.peers", problem, name, str(p), str(output)]
    environment = alone(threads)
    done = subprocess.run(command, env=environment, capture_output=True, text=True, errors="replace", check=False)
    said = done.stdout.strip().splitlines()[-1:]
    if done.returncode < 0:
        return f"was ended by signal {-done.returncode}"
    try:
        report = json.loads(said[0])
    except (IndexError, ValueError):
        complaint = done.stderr.strip().splitlines()[-1:] or ["no error message"]
        return f"ended with code {done.returncode}: {complaint[0][:300]}"
    if "failed" in report:
        return str(report["failed"])
    values = report.pop("figures")
    figures = None if values is None else Figures(*values)
    with np.load(output) as answer:
        return _Run(**report, points=answer["points"], forces=answer["forces"], figures=figures)


def force_error(points: FloatArray, forces: FloatArray, our_points: FloatArray, our_forces: FloatArray) -> float:
    """|forces - ours| / |ours|, nodes matched by coordinates; infinite if a node has no partner."""
    if points.shape != our_points.shape:
        return float("inf")
    distance, theirs = cKDTree(points).query(our_points)
    if distance.max() > 1e-6 or len(np.unique(theirs)) < len(theirs):
        return float("inf")
    return float(np.linalg.norm(forces[theirs] - our_forces) / np.linalg.norm(our_forces))
