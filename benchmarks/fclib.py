"""A folder of FCLIB problems, or generated ones, by coulomb and by Siconos: a table and a performance profile.

Every solver has a process of its own for every problem (`python -m benchmarks.fclib SOLVER FILE LIMIT`), on one thread,
and the same limit of processor time.  A problem counts as solved if the residual by the collection's measure is at most
1e-8; for Siconos also if it reports success at its own tolerance of 1e-8, which is relative to |q|.

Siconos gets the problem scaled to a mean diagonal of W of 1 and a largest |q| of 1.  The time is that of the processor
from the matrix in memory, in each package's own format, to the forces, by a call from Python; the least of a few runs
where it is short.  Imports and the scaling for Siconos are not counted.
"""

from __future__ import annotations

import importlib
import importlib.util
import json
import math
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse

from coulomb.arrays import FloatArray
from coulomb.io.fclib import FCLIBProblem, read_fclib
from coulomb.solvers.results import NotConverged
from coulomb.solvers.rigid import solve_coulomb

from .processes import alone

TOLERANCE = 1e-8
OURS = "coulomb"
SICONOS = {
    "NSGS": ("SICONOS_FRICTION_3D_NSGS", 10_000_000),
    "NSN_AC": ("SICONOS_FRICTION_3D_NSN_AC", 2_000),
    "ADMM": ("SICONOS_FRICTION_3D_ADMM", 1_000_000),
    "DSFP": ("SICONOS_FRICTION_3D_DSFP", 10_000_000),
}
"""Siconos' solvers with their names there and their largest number of iterations: beyond the limit of time."""

_SHORT = 0.05  # seconds: shorter runs are repeated
_REPEATS = 50


Answer = tuple[FloatArray, bool, str]
"""Forces, whether success is reported, and the reason if not."""


def by_coulomb(problem: FCLIBProblem) -> Callable[[], Answer]:
    """What solves the problem, to be called for each timing."""
    b = -problem.q

    def run() -> Answer:
        try:
            return solve_coulomb(problem.W, b, problem.mu).x, True, ""
        except NotConverged as failure:
            return failure.result.x, False, str(failure)

    return run


def by_siconos(problem: FCLIBProblem, name: str) -> Callable[[], Answer]:
    """As `by_coulomb`, by a solver in `SICONOS`."""
    sn: Any = importlib.import_module("siconos.numerics")
    attribute, iterations = SICONOS[name]
    a, size = float(problem.W.diagonal().mean()), float(np.abs(problem.q).max()) or 1.0
    W, q = scipy.sparse.csc_matrix(problem.W / a), problem.q / size
    W.indices, W.indptr = W.indices.astype(np.int64), W.indptr.astype(np.int64)

    def run() -> Answer:
        contact = sn.FrictionContactProblem(3, len(problem.mu), W, q, problem.mu)
        options = sn.SolverOptions(getattr(sn, attribute))
        options.dparam[sn.SICONOS_DPARAM_TOL], options.iparam[sn.SICONOS_IPARAM_MAX_ITER] = TOLERANCE, iterations
        r: FloatArray = np.zeros_like(q)
        status = sn.fc3d_driver(contact, r, np.zeros_like(r), options)
        return r * size / a, status == 0, "" if status == 0 else f"status {status}"

    return run


def solve(problem: FCLIBProblem, name: str) -> dict[str, object]:
    """Seconds, residual by the collection's measure, whether success was reported, and what was said.

    The time is that of the thread: the clock of a process with a limit has a resolution of milliseconds.
    """
    run, spent = by_coulomb(problem) if name == OURS else by_siconos(problem, name), []
    while True:
        began = time.thread_time()
        r, claimed, said = run()
        spent.append(time.thread_time() - began)
        if sum(spent) > _SHORT or len(spent) == _REPEATS:
            break
    residual = problem.residual(r) if np.isfinite(r).all() else float("inf")
    return {"seconds": min(spent), "residual": residual, "claimed": claimed, "said": said}


# --- the table ------------------------------------------------------------------------------------------------------

RATIOS = tuple(10.0 ** (k / 10.0) for k in range(41))
"""Times over the quickest solver's at which a performance profile is written, 1 to 10 000."""

_RANK_UP_TO = 2000  # rows of W up to which its rank is computed, by dense algebra


class Row(NamedTuple):
    """A row of fclib.csv.

    Attributes:
        problem: Its name.
        contacts: m.
        rows: Rows of W, 3 m.
        rank: Of W; None for large ones.
        friction: Largest coefficient.
        solver: Its name.
        seconds: Processor time; the limit where that was reached.
        residual: By the collection's measure; None without an answer.
        solved: See above.
        said: The reason if it was not solved.
    """

    problem: str
    contacts: int
    rows: int
    rank: int | None
    friction: float
    solver: str
    seconds: float
    residual: float | None
    solved: bool
    said: str


Made = tuple[str, Callable[[], FCLIBProblem]]


def in_folder(directory: Path) -> list[Made]:
    """Names and readers of the problems of a folder, .hdf5 and .npz.

    Raises:
        ValueError: If there is no such folder, or none in it.
    """
    if not directory.is_dir():
        raise ValueError(f"{directory}: there is no such directory")
    files = sorted(path for path in directory.glob("*") if path.suffix in (".hdf5", ".h5", ".npz"))
    if not files:
        raise ValueError(f"{directory}: there are no FCLIB problems there, .hdf5 or .npz")
    return [(path.name, lambda path=path: read_fclib(path)) for path in files]  # type: ignore[misc]


def solvers_here(names: Sequence[str] | None = None) -> list[str]:
    """The solvers to compare, coulomb first; Siconos' only where it is installed.

    Raises:
        ValueError: If there is no such solver.
    """
    for name in names or ():
        if name != OURS and name not in SICONOS:
            raise ValueError(f"there is no solver {name!r}; they are {OURS}, {', '.join(SICONOS)}")
    chosen = list(SICONOS)[:3] if names is None else [name for name in names if name != OURS]
    return [OURS, *chosen] if importlib.util.find_spec("siconos") is not None else [OURS]


def measure(problems: Iterable[Made], solvers: Sequence[str], limit: float, within: float = math.inf) -> Iterator[Row]:
    """Rows as they are measured.

    Args:
        problems: Names and makers.
        solvers: Names.
        limit: Seconds of processor time for each.
        within: A solver is also ended after this many times the time of the quickest one before it on the problem, at
            least a second: a performance profile does not need more for ratios up to this.

    Raises:
        ValueError: If a file cannot be read.
    """
    with tempfile.TemporaryDirectory() as folder:
        for name, make in problems:
            problem, file = make(), Path(folder) / "problem.npz"
            W = problem.W.tocsr()
            np.savez(file, W_data=W.data, W_indices=W.indices, W_indptr=W.indptr, q=problem.q, mu=problem.mu)
            rank = int(np.linalg.matrix_rank(W.toarray(), hermitian=True)) if W.shape[0] <= _RANK_UP_TO else None
            quickest = math.inf
            for solver in solvers:
                allowed = min(limit, max(1.0, within * quickest))
                seconds, residual, claimed, said = _in_process(solver, file, allowed)
                solved = residual is not None and (residual <= TOLERANCE or (claimed and solver != OURS))
                quickest = min(quickest, seconds if solved else math.inf)
                m, friction = len(problem.mu), float(problem.mu.max())
                yield Row(name, m, 3 * m, rank, friction, solver, seconds, residual, solved, said)


def _in_process(solver: str, file: Path, limit: float) -> tuple[float, float | None, bool, str]:
    """Seconds, residual, whether success was reported, and what was said."""
    command = [sys.executable, "-m", "benchmarks.fclib", solver, str(file), str(limit)]
    done = subprocess.run(command, env=alone(), capture_output=True, text=True, errors="replace", check=False)
    if done.returncode < 0:
        return limit, None, False, f"limit of {limit:g} s"
    try:
        report = json.loads(done.stdout.strip().splitlines()[-1])
    except (IndexError, ValueError):
        return limit, None, False, f"ended with code {done.returncode}"
    if report["seconds"] > limit:
        return limit, None, False, f"limit of {limit:g} s"
    return report["seconds"], report["residual"], report["claimed"], report["said"]


def profile(rows: Sequence[Row], floor: float = 0.0, within: float = math.inf) -> list[tuple[float, ...]]:
    """The performance profile (E. D. Dolan, J. J. More, 2002): the ratio, and for each solver, in the order of the
    rows, the fraction of the problems that it solves within this multiple of the quickest solver's time.

    Args:
        rows: Of all problems and solvers.
        floor: Seconds; shorter times count as this.
        within: Largest ratio.
    """
    names, problems = list(dict.fromkeys(row.solver for row in rows)), list(dict.fromkeys(row.problem for row in rows))
    times = {(row.problem, row.solver): max(row.seconds, floor) for row in rows if row.solved}
    best = {p: min((times[p, s] for s in names if (p, s) in times), default=np.inf) for p in problems}
    return [
        (
            ratio,
            *(
                sum(times.get((p, s), np.inf) <= ratio * best[p] < np.inf for p in problems) / len(problems)
                for s in names
            ),
        )
        for ratio in RATIOS
        if ratio <= within
    ]


def above(curve: Sequence[Sequence[float]]) -> list[float]:
    """The largest ratio at which a solver's curve is above that of the first, for each of the others; 0 if at none."""
    return [max((line[0] for line in curve if line[k] > line[1]), default=0.0) for k in range(2, len(curve[0]))]


if __name__ == "__main__":
    given = read_fclib(sys.argv[2])
    _small = FCLIBProblem(scipy.sparse.identity(3, format="csr"), np.array([-1.0, 0.5, 0.0]), np.array([0.3]))
    solve(_small, sys.argv[1])  # loads what is loaded late
    _end = math.ceil(time.process_time() + float(sys.argv[3]))
    resource.setrlimit(resource.RLIMIT_CPU, (_end, _end))
    sys.stdout.write("\n" + json.dumps(solve(given, sys.argv[1])) + "\n")
