"""`coulomb benchmark parts`: real parts by both methods for K."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from .benchmark_output import Tolerance, line, measuring, one_of
from .console import FAILED, errors, refuse_ranks


def parts(
    folder: Annotated[
        Path | None,
        typer.Argument(
            help="Folder of your own parts: NAME.geo and NAME.toml of each, or NAME.toml with boxes.",
            metavar="[DIRECTORY]",
        ),
    ] = None,
    names: Annotated[list[str] | None, typer.Option("--part", help="A part, as hook; repeat.")] = None,
    scales: Annotated[
        list[float] | None, typer.Option("--clscale", min=0.01, max=100.0, help="Factor of all mesh sizes; repeat.")
    ] = None,
    methods: Annotated[
        list[str] | None, typer.Option("--method", help="direct, iterative or auto; repeat; by default all.")
    ] = None,
    steps: Annotated[
        list[int] | None, typer.Option("--steps", min=1, max=1000, help="Number of load steps; repeat; by default 1.")
    ] = None,
    tolerance: Tolerance = 1e-8,
    limit: Annotated[float, typer.Option("--limit", min=1.0, help="Seconds after which a run is ended.")] = 120.0,
    directory: Annotated[Path | None, typer.Option("--output", help="For parts.csv.")] = None,
) -> None:
    """Parts with bores and open faces, and blocks: K factorised, by multigrid, and as chosen; one thread."""
    from ..benchmarks.real_parts import METHODS, SCALES, Failure, Row, measure, over_better, parts_in

    refuse_ranks("this benchmark")
    rows: list[Row] = []
    failures: list[Failure] = []
    with measuring(directory, "parts", Row._fields, rows, figure=False):
        for method in methods or ():
            one_of("--method", method, METHODS)
        for row in measure(
            parts_in(folder, names), scales or SCALES, methods or METHODS, tolerance, limit, steps or (1,)
        ):
            if isinstance(row, Failure):
                failures.append(row)
                what = f"{row.part} x {row.clscale:g}, load steps {row.load_steps} {row.method}: {row.reason}"
                errors.print(what, markup=False, soft_wrap=True)
                continue
            rows.append(row)
            ratio = over_better(row, [*rows, *failures])
            compared = "" if ratio is None else f" (chosen over faster {ratio:.2f})"
            line(
                f"{row.part:20s} x {row.clscale:<5g} load steps {row.load_steps:2d}  unknowns {row.unknowns:7d}  "
                f"contact {row.contact:6d}  open {row.open:5d} stick {row.stick:5d} slip {row.slip:5d}  "
                f"{row.method if row.method == row.path else f'{row.method}: {row.path}':15s}  "
                f"steps {row.path_following:3d}  products {row.products:5d}  {row.seconds:8.2f} s, of the processor "
                f"{row.processor_seconds:8.2f} s{compared}; predicted direct {row.predicted_direct:.2f} s, iterative "
                f"{row.predicted_multigrid:.2f} s  "
                f"residual {row.residual:.1e}  certificate {'passed' if row.certified else 'FAILED'}"
            )
    if failures:
        raise typer.Exit(FAILED)
