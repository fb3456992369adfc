"""A folder of FCLIB problems, or generated ones, by coulomb and by Siconos: a table and a performance profile.

Every solver has a process of its own for every problem, on one thread, and the same limit of processor time.  A
problem counts as solved if the residual by the collection's measure is at most 1e-8; for Siconos also if it reports
success at its own tolerance of 1e-8, which is relative to |q|.
"""

from __future__ import annotations

import importlib.util
import json
import math
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from coulomb.io.fclib import FCLIBProblem, read_fclib

from .fclib_solvers import OURS, SICONOS, TOLERANCE
from .processes import alone
from .rigid_bodies import collection

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
    command = [sys.executable, "-m", f"{__package__}.fclib_solvers", solver, str(file), str(limit)]
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


def generated(seed: int) -> list[Made]:
    """Problems of `rigid_bodies`."""
    return list(collection(seed))
