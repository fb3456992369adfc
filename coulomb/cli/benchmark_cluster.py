"""`coulomb benchmark cluster`: what a run asks of MPI on several ranks."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .benchmark_output import line, measuring
from .console import refuse_ranks


def cluster(
    ranks: Annotated[list[int] | None, typer.Option("--ranks", min=1, help="Ranks; repeat.  1, 2, 4, 8.")] = None,
    per_rank: Annotated[
        int, typer.Option("--unknowns", min=500, help="Displacement unknowns of the block, per rank.")
    ] = 10_000,
    fixed: Annotated[int, typer.Option("--p", min=0, help="Cells per metre, the same on any ranks.")] = 0,
    directory: Annotated[Path | None, typer.Option("--output", help="For cluster.csv.")] = None,
) -> None:
    """Messages, reductions and memory of a rank, per Newton step and multigrid iteration; needs mpicc and mpirun."""
    from ..benchmarks.cluster import RANKS, Row, cells_per_metre, measure

    refuse_ranks("this benchmark")
    rows: list[Row] = []
    runs = [(count, fixed or cells_per_metre(count * per_rank)) for count in ranks or RANKS]
    with measuring(directory, "cluster", Row._fields, rows, figure=False):
        for row in measure(runs):
            rows.append(row)
            iteration = (
                f"{row.messages_per_multigrid_iteration:5.1f} messages, "
                f"{row.kilobytes_per_multigrid_iteration:6.1f} kB, "
                f"{row.collectives_per_multigrid_iteration:4.1f} reductions each"
            )
            line(
                f"ranks {row.ranks:3d}  p {row.p:3d}  unknowns {row.unknowns:8d}  contact {row.contact:6d}  steps "
                f"{row.newton_steps:3d}  Krylov {row.krylov:4d}  multigrid {row.multigrid_iterations:5d}: "
                f"{iteration}  other collectives per step "
                f"{row.collectives_per_newton_step:5.1f}, largest {row.largest_collective_bytes / 1000:.0f} kB  "
                f"most over mean: unknowns {row.unknowns_imbalance:.2f}, contact nodes {row.contact_imbalance:.2f}  "
                f"{row.peak_memory_bytes / 1e6:.0f} MB"
            )
