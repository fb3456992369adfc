"""`coulomb benchmark fclib`: rigid contact problems by coulomb and by Siconos."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .benchmark_output import line, measuring, write_table
from .console import refuse_ranks

if TYPE_CHECKING:
    from ..benchmarks.fclib_collection import Row

_MILLISECOND = "times below 1 ms count as 1 ms"


def fclib(
    folder: Annotated[
        Path | None, typer.Argument(help="Folder of problems in FCLIB's format, .hdf5 and .npz.", metavar="[DIRECTORY]")
    ] = None,
    seed: Annotated[
        int | None, typer.Option("--generated", min=0, help="Also 55 generated problems; the seed of their numbers.")
    ] = None,
    names: Annotated[list[str] | None, typer.Option("--solver", help="NSGS, NSN_AC, ADMM or DSFP; repeat.")] = None,
    only: Annotated[str, typer.Option("--only", help="Problems with this in their name.")] = "",
    limit: Annotated[float, typer.Option("--limit", min=1.0, help="Seconds of processor time for each.")] = 60.0,
    within: Annotated[
        float,
        typer.Option(
            "--within", min=1.0, help="End a solver after so many times the quickest before it, at least 1 s."
        ),
    ] = math.inf,
    directory: Annotated[Path | None, typer.Option("--output", help="For fclib.csv, fclib_profile.csv, .png.")] = None,
) -> None:
    """Friction problems of rigid bodies by coulomb and by Siconos' solvers: seconds, residual, performance profile."""
    from ..benchmarks.fclib_collection import Row, generated, in_folder, measure, solvers_here

    refuse_ranks("this benchmark")
    rows: list[Row] = []
    with measuring(directory, "fclib", Row._fields, rows, figure=False):
        if folder is None and seed is None:
            raise ValueError("give a folder of problems, or --generated SEED")
        problems = ([] if folder is None else in_folder(folder)) + ([] if seed is None else generated(seed))
        problems = [made for made in problems if only in made[0]]
        if not problems:
            raise ValueError(f"--only {only}: no problem has this in its name")
        solvers = solvers_here(names)
        if len(solvers) == 1 and names is None:
            line("Siconos is not installed here (Debian's python3-siconos): coulomb alone")
        line("contacts  rows of W  rank  friction  solver     seconds  residual  problem")
        for row in measure(problems, solvers, limit, within):
            rows.append(row)
            residual = "-" if row.residual is None else f"{row.residual:.1e}"
            rank = "-" if row.rank is None else str(row.rank)
            outcome = row.problem if row.solved else f"{row.problem}: not solved, {row.said or 'residual'}"
            line(
                f"{row.contacts:8d}  {row.rows:9d}  {rank:>4}  {row.friction:8.2f}  "
                f"{row.solver:7s}  {row.seconds:9.5f}  {residual:>8s}  {outcome}"
            )
    for solver in solvers:
        own = [row for row in rows if row.solver == solver]
        solved = [row for row in own if row.solved]
        times = [row.seconds for row in solved]
        line(
            f"{solver:7s} solved {len(solved)} of {len(own)}, the slowest in {max(times, default=0.0):.2f} s, "
            f"together {sum(times):.2f} s"
        )
    if rows:
        _profiles(directory, rows, solvers, within)


def _profiles(directory: Path | None, rows: Sequence[Row], solvers: Sequence[str], within: float) -> None:
    """Print and write the performance profiles by all times, and with times below a millisecond as a millisecond."""
    from ..benchmarks.fclib_collection import above, profile

    for floor, name in ((0.0, "fclib_profile"), (1e-3, "fclib_profile_1ms")):
        curve = profile(rows, floor, within)
        line(f"solved within a multiple of the quickest time, {'no time is too short' if not floor else _MILLISECOND}:")
        line("  ".join(["   ratio", *(f"{solver:>7}" for solver in solvers)]))
        for ratio, *shares in curve:
            if math.log10(ratio) in (0.0, 1.0, 2.0, 3.0, 4.0) or 1.9 < ratio < 2.1 or 4.9 < ratio < 5.1:
                line("  ".join([f"{ratio:8.0f}", *(f"{share:7.2f}" for share in shares)]))
        ahead = [
            f"{solver} up to {ratio:.3g}" for solver, ratio in zip(solvers[1:], above(curve), strict=True) if ratio
        ]
        line(f"above {solvers[0]}: {', '.join(ahead) or 'none'}")
        write_table(directory, name, ("ratio", *solvers), curve, figure=not floor)
