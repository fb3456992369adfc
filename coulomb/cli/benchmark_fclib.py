"""`coulomb benchmark fclib`: rigid contact problems by coulomb and by Siconos."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .benchmark_output import line, measuring, write_table
from .console import refuse_ranks


def fclib(
    folder: Annotated[
        Path | None, typer.Argument(help="Folder of problems in FCLIB's format, .hdf5 and .npz.", metavar="[DIRECTORY]")
    ] = None,
    seed: Annotated[
        int | None, typer.Option("--generated", min=0, help="Also 47 generated problems; the seed of their numbers.")
    ] = None,
    names: Annotated[list[str] | None, typer.Option("--solver", help="NSGS, NSN_AC, ADMM or DSFP; repeat.")] = None,
    only: Annotated[str, typer.Option("--only", help="Problems with this in their name.")] = "",
    limit: Annotated[float, typer.Option("--limit", min=1.0, help="Seconds of processor time for each.")] = 60.0,
    directory: Annotated[Path | None, typer.Option("--output", help="For fclib.csv, fclib_profile.csv, .png.")] = None,
) -> None:
    """Friction problems of rigid bodies by coulomb and by Siconos' solvers: seconds, residual, performance profile."""
    from ..benchmarks.fclib_collection import Row, generated, in_folder, measure, profile, solvers_here

    refuse_ranks("this benchmark")
    rows: list[Row] = []
    with measuring(directory, "fclib", Row._fields, rows, figure=False):
        if folder is None and seed is None:
            raise ValueError("give a folder of problems, or --generated SEED")
        problems = ([] if folder is None else in_folder(folder)) + ([] if seed is None else generated(seed))
        problems = [made for made in problems if only in made[0]]
        solvers = solvers_here(names)
        if len(solvers) == 1:
            line("Siconos is not installed here (Debian's python3-siconos): coulomb alone")
        line("contacts  rows of W  rank  friction  solver   seconds  residual  problem")
        for row in measure(problems, solvers, limit):
            rows.append(row)
            residual = "-" if row.residual is None else f"{row.residual:.1e}"
            rank = "-" if row.rank is None else str(row.rank)
            outcome = row.problem if row.solved else f"{row.problem}: not solved, {row.said or 'residual'}"
            line(
                f"{row.contacts:8d}  {row.rows:9d}  {rank:>4}  {row.friction:8.2f}  "
                f"{row.solver:7s}  {row.seconds:7.3f}  {residual:>8s}  {outcome}"
            )
    for solver in solvers:
        own = [row for row in rows if row.solver == solver]
        solved = [row for row in own if row.solved]
        slowest = max((row.seconds for row in solved), default=0.0)
        line(f"{solver:7s} solved {len(solved)} of {len(own)}, the slowest in {slowest:.2f} s")
    if rows:
        write_table(directory, "fclib_profile", ("ratio", *solvers), profile(rows))
