"""`coulomb benchmark histories`: a load history beside other packages."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .benchmark_output import write_csv
from .console import BAD_INPUT, console, errors, refuse_ranks


def histories(
    sizes: Annotated[list[int] | None, typer.Option("--p", min=1, help="Cells per metre; repeat.")] = None,
    names: Annotated[list[str] | None, typer.Option("--peer", help="A peer, as GetFEM; repeat.")] = None,
    repeats: Annotated[int, typer.Option("--repeats", min=1, help="Runs of each; the minimum time counts.")] = 1,
    directory: Annotated[Path | None, typer.Option("--output", help="For histories.csv.")] = None,
) -> None:
    """The block pressed and dragged to and fro in 24 load steps, by coulomb and by other packages, on one thread.

    Forces are compared in all steps.  The first step counts from the mesh to its forces.
    """
    from ..benchmarks.peers import OURS, Row, Skipped, measure
    from ..benchmarks.peers.history import STEPS

    refuse_ranks("this benchmark")
    rows: list[Row] = []
    try:
        for row in measure(sizes or (10,), names, repeats, "history"):
            if isinstance(row, Skipped):
                console.print(f"p {row.p:3d}  {row.peer:16s} skipped: {row.reason}", markup=False, soft_wrap=True)
                continue
            rows.append(row)
            ours = next(r for r in rows if r.p == row.p)
            first, products = "", ""
            if row.first_seconds > 0.0:
                first = (
                    f"  first step {row.first_seconds:6.2f} s, all {row.seconds / row.first_seconds:5.2f} times that"
                )
            if row.peer == OURS:
                products = f"  products per step {row.products / STEPS:5.1f}"
            console.print(
                f"p {row.p:3d}  {row.peer:16s} {row.seconds:8.2f} s ({row.seconds / ours.seconds:5.1f}){first}  "
                f"Newton steps per load step {row.iterations / STEPS:5.2f}{products}  "
                f"{row.peak_memory_bytes / 2**30:5.2f} GiB  forces differ by {row.force_error:.0e}",
                markup=False,
                soft_wrap=True,
            )
    except (ValueError, RuntimeError) as error:
        errors.print(f"error: {error}", markup=False)
        raise typer.Exit(BAD_INPUT) from None
    if directory is not None:
        fields = [name for name in Row._fields if name != "figures"]
        write_csv(directory, "histories", fields, [[getattr(row, name) for name in fields] for row in rows])
        console.print(f"histories.csv in {directory}", soft_wrap=True)
