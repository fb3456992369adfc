"""`coulomb benchmark ...`: each prints a table and, with --output, writes it as CSV with a figure."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated

import typer

from .benchmark_cluster import cluster
from .benchmark_fclib import fclib
from .benchmark_output import (
    Repeats,
    Sizes,
    Tolerance,
    figures,
    line,
    measuring,
    one_of,
    print_verified,
    write_csv,
    write_table,
    writing,
)
from .benchmark_parts import parts
from .benchmark_peers import histories, peers
from .console import FAILED, bad_input, refuse_ranks

benchmark = typer.Typer(help="Benchmarks and verification.", no_args_is_help=True)
for command in (cluster, fclib, histories, parts, peers):
    benchmark.command()(command)


@benchmark.command()
def compliance(sizes: Sizes = None) -> None:
    """Three methods for the compliance A on one rank, seconds: the basis of the default."""
    from ..benchmarks.compliance_formation import measure

    refuse_ranks("this benchmark")
    line("  p  contact    Schur  many right-hand sides  product explicit  matrix-free  difference")
    for p in sizes or (6, 10, 16):
        row = measure(p)
        line(
            f"{row.p:3d}  {row.contact:7d}  {row.schur:7.2f}  {row.right_hand_sides:21.2f}  "
            f"{row.product_explicit:16.5f}  {row.product_matrix_free:11.5f}  {row.difference:10.1e}"
        )


@benchmark.command()
def table1(
    sizes: Sizes = None,
    solver: Annotated[list[str] | None, typer.Option("--solver", help="A column, as KPRGP; repeat.")] = None,
    directory: Annotated[Path | None, typer.Option("--output", help="For table1.csv and table1.png.")] = None,
) -> None:
    """Table 1 of the paper: PF and KPRGP on the Tresca block, to the same residual."""
    from ..benchmarks.table1 import PAPER, RESIDUAL, SIZES, Row, measure

    line(f"Tresca block to a residual of {RESIDUAL:g}; iterations/products (paper's)")
    rows: list[Row] = []
    with measuring(directory, "table1", Row._fields, rows):
        for row in measure(sizes or SIZES, solver):
            rows.append(row)
            theirs = PAPER.get((row.solver, row.p), "-")
            line(
                f"{row.n:7d}/{row.m:<6d} {row.solver:34s} {row.iterations:6d}/{row.products:<6d} ({theirs:>6s})  "
                f"{row.seconds:8.2f} s  residual {row.residual:.1e}"
            )


@benchmark.command()
def friction(
    sizes: Sizes = None,
    coefficients: Annotated[
        list[float] | None, typer.Option("--friction", min=0.0, help="Friction coefficient; repeat.")
    ] = None,
    tolerance: Tolerance = 1e-8,
    repeats: Repeats = 1,
    directory: Annotated[Path | None, typer.Option("--output", help="For friction.csv and friction.png.")] = None,
) -> None:
    """Methods for Coulomb friction on the block, compared with one Tresca problem solved as in the paper."""
    from ..benchmarks.friction import FRICTION, TRESCA, Row, measure

    line(f"Coulomb block to a residual of {tolerance:g}; time over that of one Tresca problem")
    rows: list[Row] = []
    with measuring(directory, "friction", Row._fields, rows):
        for row in measure(sizes or (10,), coefficients or FRICTION, tolerance, repeats):
            rows.append(row)
            tresca = next(r for r in reversed(rows) if r.method == TRESCA)
            line(
                f"p {row.p:3d}  F {row.friction:<5g} {row.method:20s} outer {row.outer:3d}  "
                f"steps {row.path_following:4d}  products {row.products:5d}  Krylov {row.krylov:5d}  "
                f"{row.seconds:7.2f} s ({row.seconds / tresca.seconds:5.2f})  residual {row.residual:.1e}  {row.status}"
            )


@benchmark.command()
def scaling(
    sizes: Sizes = None,
    ranks: Annotated[list[int] | None, typer.Option("--ranks", min=1, help="Ranks to run on; repeat.")] = None,
    coefficient: Annotated[float, typer.Option("--friction", min=0.0)] = 0.3,
    tolerance: Tolerance = 1e-8,
    method: Annotated[str, typer.Option("--method", help="auto, direct or iterative.")] = "auto",
    newton: Annotated[str, typer.Option("--newton", help="Newton systems: recycling or condensed.")] = "recycling",
    start: Annotated[str, typer.Option("--start", help="cold, or coarse: from half as many cells.")] = "cold",
    cell: Annotated[str, typer.Option("--cell", help="hexahedron or tetrahedron.")] = "hexahedron",
    degree: Annotated[int, typer.Option("--degree", min=1, max=2, help="Order of the elements.")] = 1,
    problem: Annotated[str, typer.Option("--problem", help="block, or two-blocks: aluminium on steel.")] = "block",
    directory: Annotated[Path | None, typer.Option("--output", help="For scaling.csv and scaling.png.")] = None,
) -> None:
    """Coulomb friction up to a million unknowns, compared with one linear solve on the same mesh (the yardstick)."""
    from ..benchmarks.scaling import METHODS, NEWTON, PROBLEMS, SIZES, STARTS, Row, exponent, measure

    refuse_ranks("this benchmark, which starts other ranks itself,")
    rows: list[Row] = []
    with measuring(directory, "scaling", Row._fields, rows):
        one_of("--method", method, METHODS)
        one_of("--newton", newton, NEWTON)
        one_of("--start", start, STARTS)
        one_of("--cell", cell, ("hexahedron", "tetrahedron"))
        one_of("--problem", problem, PROBLEMS)
        if problem != "block" and (newton, start, cell, degree) != ("recycling", "cold", "hexahedron", 1):
            raise ValueError("--newton, --start, --cell and --degree are for block")
        for row in measure(
            sizes or SIZES, ranks or (1,), coefficient, tolerance, method, newton, start, cell, degree, problem
        ):
            rows.append(row)
            line(
                f"p {row.p:3d}  unknowns {row.unknowns:8d}  contact {row.contact:6d}  ranks {row.ranks}  "
                f"steps {row.path_following:3d}  Krylov {row.krylov:4d}  {row.seconds:8.2f} s  yardstick "
                f"{row.yardstick_seconds:7.2f} s  ratio {row.seconds / row.yardstick_seconds:5.1f}  "
                f"(PETSc alone {row.petsc_seconds:.2f} s, {row.seconds / row.petsc_seconds:.1f})  "
                f"{f'(linear solve {row.linear_seconds:.2f} s)  ' if degree == 2 else ''}"
                f"{row.peak_memory_bytes / 2**30:5.2f} GiB  residual {row.residual:.1e}  "
                f"certificate {'passed' if row.certified else 'FAILED'}"
            )
        if len(rows) > 2:
            line(f"seconds grow like unknowns to the power {exponent(rows):.2f}")


@benchmark.command()
def estimates(sizes: Sizes = None) -> None:
    """Memory estimated by `coulomb check-case` for the block, compared with measurements."""
    from ..benchmarks.estimates import SIZES, measure

    refuse_ranks("this benchmark")
    line("  p  method                 unknowns  contact   GB expected  measured")
    with measuring():
        for row in measure(sizes or SIZES):
            line(
                f"{row.p:3d}  {row.method:21s}  {row.unknowns:8d}  {row.contact:7d}   "
                f"{row.memory_expected / 1e9:11.2f}  {row.memory_measured / 1e9:8.2f}"
            )


@benchmark.command()
def elements(
    sizes: Annotated[
        list[int] | None, typer.Option("--cells", min=1, help="Second-order cells on 1.2 contact radii; repeat.")
    ] = None,
    names: Annotated[list[str] | None, typer.Option("--element", help="P1, P2, Q1 or Q2; repeat.")] = None,
    directory: Annotated[Path | None, typer.Option("--output", help="For elements.csv and elements.png.")] = None,
) -> None:
    """Linear and quadratic tetrahedra (P1, P2) and hexahedra (Q1, Q2) on Hertz's problem: errors, unknowns, seconds."""
    from ..benchmarks.elements import SIZES, Row, measure
    from ..benchmarks.verification.hertz_elements import ELEMENTS

    refuse_ranks("this benchmark")
    rows: list[Row] = []
    with measuring(directory, "elements", Row._fields, rows):
        for name in names or ():
            one_of("--element", name, tuple(ELEMENTS))
        line("element  cells  unknowns  contact points  force error  centre error  processor s")
        for row in measure(sizes or SIZES, names or ELEMENTS):
            rows.append(row)
            line(
                f"{row.element:7s}  {row.cells:5d}  {row.unknowns:8d}  {row.contact_points:14d}  "
                f"{row.force_error:11.2%}  {row.centre_error:12.2%}  {row.seconds:11.2f}"
            )


@benchmark.command()
def conditioning(
    p: Annotated[int, typer.Option("--p", min=1, max=5, help="Cells per metre of the block: dense algebra.")] = 3,
    directory: Annotated[Path | None, typer.Option("--output", help="For conditioning.csv and .png.")] = None,
) -> None:
    """Figure 1 of the paper: condition numbers of the Newton systems along a path-following run."""
    from ..benchmarks.block import block
    from ..benchmarks.conditioning import measure

    problem = block(p, friction=None)
    spectra = measure(problem.friction_problem)
    fields = ("iteration", "J_AM", "J_SC", "P_AM^-1 J_AM", "P_SC^-1 J_SC", "bound")
    rows = [
        (s.iteration, s.cond_J_AM, s.cond_J_SC, s.cond_preconditioned_AM, s.cond_preconditioned_SC, s.upper / s.lower)
        for s in spectra
    ]
    line("  ".join(f"{field:>12s}" for field in fields))
    for row in rows:
        line("  ".join([f"{row[0]:12d}", *(f"{value:12.3e}" for value in row[1:])]))
    write_table(directory, "conditioning", fields, rows)


@benchmark.command()
def verification(
    names: Annotated[list[str] | None, typer.Option("--case", help="A case, as hertz; repeat.")] = None,
    directory: Annotated[Path | None, typer.Option("--output", help="For verification.csv and the pictures.")] = None,
) -> None:
    """Verification: patch tests, SSNV128, Hertz, Cattaneo-Mindlin, a sliding block.  Exit code 1 if a tolerance is
    exceeded."""
    from ..benchmarks.verification import CASES

    refuse_ranks("this benchmark")
    with bad_input():
        for name in names or ():
            one_of("--case", name, tuple(CASES))
    found = {}
    for name in names or CASES:
        found[name] = CASES[name]()
        print_verified(name, found[name])
    lines = [
        (name, row.quantity, row.formula, row.ours, row.error, row.tolerance, row.passed, row.why)
        for name, verified in found.items()
        for row in verified.rows
    ]
    if directory is not None:
        fields = ("case", "quantity", "formula", "ours", "error", "tolerance", "passed", "why")
        write_csv(directory, "verification", fields, lines)
        drawn = ""
        with figures(), writing(directory):
            from ..benchmarks.verification.figures import draw

            for name, verified in found.items():
                draw(verified.panels, directory / f"{name}.png")
            drawn = f" and {len(found)} pictures"
        line(f"verification.csv{drawn} in {directory}{os.sep}")
    failed = sum(not row.passed for verified in found.values() for row in verified.rows)
    line(f"{len(lines) - failed} of {len(lines)} within their tolerance")
    if failed:
        raise typer.Exit(FAILED)
