"""`coulomb benchmark peers` and `coulomb benchmark histories`: the same problem by coulomb and by other packages."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .benchmark_output import Peers, Repeats, Sizes, line, measuring
from .console import refuse_ranks

if TYPE_CHECKING:
    from ..benchmarks.peers import Row, Skipped


def peers(
    sizes: Sizes = None,
    names: Peers = None,
    repeats: Repeats = 1,
    problem: Annotated[
        str,
        typer.Option("--problem", help="block, two-blocks: aluminium on steel, or second-order: 10-node tetrahedra."),
    ] = "block",
    threads: Annotated[int, typer.Option("--threads", min=1, help="Of every package, at most.")] = 1,
    directory: Annotated[Path | None, typer.Option("--output", help="For peers.csv and peers.png.")] = None,
) -> None:
    """The block, or two blocks, by coulomb and by other packages, each in a separate process."""
    from ..benchmarks.peers import Row, measure
    from ..benchmarks.peers.answer import Figures

    refuse_ranks("this benchmark")
    fields = [name for name in Row._fields if name not in ("figures", "first_seconds", "products")]
    rows: list[list[object]] = []
    with measuring(directory, "peers", [*fields, *(Figures._fields if problem == "two-blocks" else ())], rows):
        if problem == "history":
            raise ValueError("the load history is another benchmark: coulomb benchmark histories")
        for row, ratio in _beside_ours(measure(sizes or (10,), names, repeats, problem, threads)):
            rows.append([getattr(row, name) for name in fields] + list(row.figures or ()))
            of_pair = row.figures and (
                f"  normal {row.figures.normal_force:.4e} N  friction {row.figures.tangential_force:.4e} N  "
                f"largest slip {row.figures.largest_slip:.4e} m  mean displacement {row.figures.displacement:.4e} m"
            )
            line(
                f"p {row.p:3d}  {row.peer:16s} {row.seconds:8.2f} s ({ratio:5.1f})  "
                f"{row.peak_memory_bytes / 2**30:5.2f} GiB  iterations {row.iterations:4d}  "
                f"forces differ by {row.force_error:.0e}{of_pair or ''}"
            )


def histories(
    sizes: Sizes = None,
    names: Peers = None,
    repeats: Repeats = 1,
    directory: Annotated[Path | None, typer.Option("--output", help="For histories.csv.")] = None,
) -> None:
    """The block pressed and dragged to and fro in 24 load steps, by coulomb and by other packages, on one thread.

    Forces are compared in all steps.  The first step counts from the mesh to its forces.
    """
    from ..benchmarks.peers import OURS, Row, measure
    from ..benchmarks.peers.history import STEPS

    refuse_ranks("this benchmark")
    fields = [name for name in Row._fields if name != "figures"]
    rows: list[list[object]] = []
    with measuring(directory, "histories", fields, rows, figure=False):
        for row, ratio in _beside_ours(measure(sizes or (10,), names, repeats, "history")):
            rows.append([getattr(row, name) for name in fields])
            first, products = "", ""
            if row.first_seconds > 0.0:
                first = (
                    f"  first step {row.first_seconds:6.2f} s, all {row.seconds / row.first_seconds:5.2f} times that"
                )
            if row.peer == OURS:
                products = f"  products per step {row.products / STEPS:5.1f}"
            line(
                f"p {row.p:3d}  {row.peer:16s} {row.seconds:8.2f} s ({ratio:5.1f}){first}  "
                f"Newton steps per load step {row.iterations / STEPS:5.2f}{products}  "
                f"{row.peak_memory_bytes / 2**30:5.2f} GiB  forces differ by {row.force_error:.0e}"
            )


def _beside_ours(measured: Iterable[Row | Skipped]) -> Iterator[tuple[Row, float]]:
    """The rows with their seconds over those of coulomb at the same p; prints the reasons of peers without a row."""
    from ..benchmarks.peers import OURS, Skipped

    ours = 0.0
    for row in measured:
        if isinstance(row, Skipped):
            line(f"p {row.p:3d}  {row.peer:16s} skipped: {row.reason}")
            continue
        if row.peer == OURS:
            ours = row.seconds
        yield row, row.seconds / ours
