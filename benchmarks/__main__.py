"""`python -m benchmarks NAME`: a table is printed as it is measured and, with --output, written as NAME.csv."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .tables import FAILED, Fields, one_of, table

if TYPE_CHECKING:
    from .fclib import Row as FCLIBRow
    from .peers import Row as PeerRow
    from .peers import Skipped

app = typer.Typer(help="The tables of docs/measurements.md.", no_args_is_help=True, pretty_exceptions_enable=False)

Sizes = Annotated[list[int] | None, typer.Option("--p", min=1, help="Cells per metre of the block; repeat.")]
Names = Annotated[list[str] | None, typer.Option("--peer", help="A peer, as GetFEM; repeat.")]
Repeats = Annotated[int, typer.Option("--repeats", min=1, help="Runs of each; the minimum time counts.")]
Tolerance = Annotated[float, typer.Option("--tolerance", min=1e-12, help="Coulomb residual to stop at.")]
Output = Annotated[Path | None, typer.Option("--output", help="Directory of the CSV file.")]


@app.command()
def table1(
    sizes: Sizes = None,
    solver: Annotated[list[str] | None, typer.Option("--solver", help="A column, as KPRGP; repeat.")] = None,
    directory: Output = None,
) -> None:
    """Table 1 of the paper: PF and KPRGP on the Tresca block, to a residual of 1e-6; `paper`: its steps/products."""
    from .table1 import PAPER, SIZES, measure

    rows = measure(sizes or SIZES, solver)
    table("table1", (row._asdict() | {"paper": PAPER.get((row.solver, row.p), "-")} for row in rows), directory)


@app.command()
def friction(
    sizes: Sizes = None,
    coefficients: Annotated[
        list[float] | None, typer.Option("--friction", min=0.0, help="Friction coefficient; repeat.")
    ] = None,
    tolerance: Tolerance = 1e-8,
    repeats: Repeats = 1,
    directory: Output = None,
) -> None:
    """Methods for Coulomb friction on the block, compared with one Tresca problem solved as in the paper (`ratio`)."""
    from .friction import FRICTION, TRESCA, measure

    def rows() -> Iterator[Fields]:
        tresca = 0.0
        for row in measure(sizes or (10,), coefficients or FRICTION, tolerance, repeats):
            tresca = row.seconds if row.method == TRESCA else tresca
            yield row._asdict() | {"ratio": row.seconds / tresca}

    table("friction", rows(), directory)


@app.command()
def scaling(
    sizes: Sizes = None,
    ranks: Annotated[list[int] | None, typer.Option("--ranks", min=1, help="Ranks to run on; repeat.")] = None,
    coefficient: Annotated[float, typer.Option("--friction", min=0.0)] = 0.3,
    tolerance: Tolerance = 1e-8,
    method: Annotated[str, typer.Option("--method", help="auto, direct, iterative, mumps or gamg.")] = "auto",
    cell: Annotated[str, typer.Option("--cell", help="hexahedron or tetrahedron.")] = "hexahedron",
    degree: Annotated[int, typer.Option("--degree", min=1, max=2, help="Order of the elements.")] = 1,
    problem: Annotated[str, typer.Option("--problem", help="block, or two-blocks: aluminium on steel.")] = "block",
    directory: Output = None,
) -> None:
    """Coulomb friction up to a million unknowns; `ratio`: to one linear solve on the same mesh, the yardstick."""
    from .scaling import CELLS, METHODS, PROBLEMS, SIZES, exponent, measure

    one_of("--method", method, METHODS)
    one_of("--cell", cell, CELLS)
    if one_of("--problem", problem, PROBLEMS) != "block" and (cell, degree) != ("hexahedron", 1):
        raise typer.BadParameter("--cell and --degree are for block")
    found = []

    def rows() -> Iterator[Fields]:
        for row in measure(sizes or SIZES, ranks or (1,), coefficient, tolerance, method, cell, degree, problem):
            found.append(row)
            yield row._asdict() | {"ratio": row.seconds / row.yardstick_seconds}

    table("scaling", rows(), directory)
    if len(found) > 2:
        print(f"seconds grow like unknowns to the power {exponent(found):.2f}")


@app.command()
def estimates(sizes: Sizes = None, directory: Output = None) -> None:
    """Estimates of `coulomb check-case` for the block, compared with measurements."""
    from .estimates import SIZES, measure

    table("estimates", (row._asdict() for row in measure(sizes or SIZES)), directory)


@app.command()
def sensitivities(sizes: Sizes = None, directory: Output = None) -> None:
    """Exact derivatives of the block: `forward` of all inputs and `adjoint`, beside the `solve`, processor seconds."""
    from .sensitivities import SIZES, measure

    table("sensitivities", (row._asdict() for row in measure(sizes or SIZES)), directory)


@app.command()
def elements(
    sizes: Annotated[
        list[int] | None, typer.Option("--cells", min=1, help="Second-order cells on 1.2 contact radii; repeat.")
    ] = None,
    names: Annotated[list[str] | None, typer.Option("--element", help="P1, P2, Q1 or Q2; repeat.")] = None,
    directory: Output = None,
) -> None:
    """Linear and quadratic tetrahedra (P1, P2) and hexahedra (Q1, Q2) on Hertz's problem; also draws elements.png."""
    from verification.hertz_elements import ELEMENTS

    from .elements import SIZES, draw, measure

    for name in names or ():
        one_of("--element", name, tuple(ELEMENTS))
    found = []

    def rows() -> Iterator[Fields]:
        for row in measure(sizes or SIZES, names or tuple(ELEMENTS)):
            found.append(row)
            yield row._asdict()

    table("elements", rows(), directory)
    if directory is not None:
        draw(found, directory / "elements.png")


@app.command()
def refinement(
    problems: Annotated[
        list[str] | None, typer.Option("--problem", help="block, hertz or two-blocks; also -tetrahedra; repeat.")
    ] = None,
    unknowns: Annotated[int, typer.Option("--unknowns", min=300, help="Of refined meshes, at most.")] = 60_000,
    directory: Output = None,
) -> None:
    """Meshes that refine themselves, beside uniform ones: unknowns and processor time for the same error."""
    from .refinement import PROBLEMS, measure

    for name in problems or ():
        one_of("--problem", name, tuple(PROBLEMS))
    rows = (row._asdict() for name in problems or PROBLEMS for row in measure(name, unknowns))
    table("refinement", rows, directory)


@app.command()
def conditioning(
    p: Annotated[int, typer.Option("--p", min=1, max=5, help="Cells per metre of the block: dense algebra.")] = 3,
    directory: Output = None,
) -> None:
    """Figure 1 of the paper: condition numbers of the Newton systems along a path-following run."""
    from .block import block
    from .conditioning import measure

    def rows() -> Iterator[Fields]:
        for s in measure(block(p, friction=None).friction_problem):
            yield {
                "iteration": s.iteration,
                "J_AM": s.cond_J_AM,
                "J_SC": s.cond_J_SC,
                "P_AM^-1 J_AM": s.cond_preconditioned_AM,
                "P_SC^-1 J_SC": s.cond_preconditioned_SC,
                "bound": s.upper / s.lower,
            }

    table("conditioning", rows(), directory)


@app.command()
def cluster(
    ranks: Annotated[list[int] | None, typer.Option("--ranks", min=1, help="Ranks; repeat.  1, 2, 4, 8.")] = None,
    per_rank: Annotated[
        int, typer.Option("--unknowns", min=500, help="Displacement unknowns of the block, per rank.")
    ] = 10_000,
    fixed: Annotated[int, typer.Option("--p", min=0, help="Cells per metre, the same on any ranks.")] = 0,
    directory: Output = None,
) -> None:
    """Messages, reductions and memory of a rank, per Newton step and multigrid iteration; needs mpicc and mpirun."""
    from .cluster import RANKS, cells_per_metre, measure

    runs = [(count, fixed or cells_per_metre(count * per_rank)) for count in ranks or RANKS]
    table("cluster", (row._asdict() for row in measure(runs)), directory)


@app.command()
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
        list[str] | None,
        typer.Option("--method", help="direct, iterative, auto, mumps or gamg; repeat; by default the first three."),
    ] = None,
    steps: Annotated[
        list[int] | None, typer.Option("--steps", min=1, max=1000, help="Number of load steps; repeat; by default 1.")
    ] = None,
    tolerance: Tolerance = 1e-8,
    limit: Annotated[float, typer.Option("--limit", min=1.0, help="Seconds after which a run is ended.")] = 120.0,
    peers: Names = None,
    directory: Output = None,
) -> None:
    """Parts with K factorised, by multigrid, and as chosen; with --peer others, beside CalculiX and GetFEM.

    `ratio`: processor seconds over those of the faster method, or of coulomb."""
    if peers:
        from .beside import draw, fields

        draw(table("beside", fields(names, peers, limit, scales or (1.0,)), directory), directory)
        return
    from .petsc_solvers import PETSC
    from .real_parts import METHODS, SCALES, Failure, Row, measure, over_better, parts_in

    for method in methods or ():
        one_of("--method", method, (*METHODS, *PETSC))
    results: list[Row | Failure] = []

    def rows() -> Iterator[Fields | str]:
        cases = parts_in(folder, names)
        for row in measure(cases, scales or SCALES, methods or METHODS, tolerance, limit, steps or (1,)):
            results.append(row)
            if isinstance(row, Failure):
                yield f"{row.part} x {row.clscale:g}, load steps {row.load_steps} {row.method}: {row.reason}"
            else:
                yield row._asdict() | {"ratio": over_better(row, results)}

    table("parts", rows(), directory)
    if any(isinstance(row, Failure) for row in results):
        raise typer.Exit(FAILED)


@app.command()
def peers(
    sizes: Sizes = None,
    names: Names = None,
    repeats: Repeats = 1,
    problem: Annotated[
        str,
        typer.Option("--problem", help="block, two-blocks: aluminium on steel, or second-order: 10-node tetrahedra."),
    ] = "block",
    threads: Annotated[int, typer.Option("--threads", min=1, help="Of every package, at most.")] = 1,
    directory: Output = None,
) -> None:
    """The block, or two blocks, by coulomb and by other packages, each in a separate process.

    `ratio`: seconds over those of coulomb.
    """
    from .peers import measure

    one_of("--problem", problem, ("block", "two-blocks", "second-order"))
    rows = measure(sizes or (10,), names, repeats, problem, threads)
    table("peers", _over_ours(rows, lambda row: row.figures._asdict() if row.figures else {}), directory)


@app.command()
def rubber_cylinder(
    size: Annotated[float, typer.Option("--size", min=0.2, max=5.0, help="Of the tetrahedra, millimetres.")] = 1.0,
    repeats: Repeats = 1,
    directory: Output = None,
) -> None:
    """A rubber cylinder pressed to 60 % of its height, by coulomb's large motions, CalculiX and GetFEM."""
    from .rubber_cylinder import measure

    table("rubber-cylinder", (row._asdict() for row in measure(size, repeats)), directory)


@app.command()
def slices(
    layers: Annotated[list[int] | None, typer.Option("--layers", min=2, help="Of a quarter; repeat.")] = None,
    directory: Output = None,
) -> None:
    """An O-ring pressed by a lid, large motions: a slice of one degree beside quarters in 3D."""
    from .slices import measure

    table("slices", (row._asdict() for row in (measure(layers) if layers else measure())), directory)


@app.command()
def ironing(
    p: Annotated[int, typer.Option("--p", min=1, help="Cells of the slab per millimetre.")] = 2,
    drawing: Annotated[int, typer.Option("--steps", min=0, help="Load steps of drawing; 0: two steps in all.")] = 12,
    program: Annotated[list[str] | None, typer.Option("--program", help="coulomb, GetFEM, CalculiX; repeat.")] = None,
    repeats: Repeats = 1,
    directory: Output = None,
) -> None:
    """A die pressed into a soft slab and drawn along it, by coulomb, GetFEM and CalculiX; forces per mm of width."""
    from .ironing import Run, histories, measure

    found: dict[str, Run] = {}

    def rows() -> Iterator[Fields | str]:
        for one in measure(p, drawing, program, repeats):
            if isinstance(one, str):
                yield one
                continue
            found[one[0].program] = one[1]
            yield one[0]._asdict()

    table("ironing", rows(), directory)
    table("ironing-forces", histories(found, drawing) if found else (), directory)


@app.command()
def histories(sizes: Sizes = None, names: Names = None, repeats: Repeats = 1, directory: Output = None) -> None:
    """The block pressed and dragged to and fro in 24 load steps, by coulomb and by other packages, on one thread.

    Forces are compared in all steps.  The first step counts from the mesh to its forces.
    """
    from .peers import measure

    rows = measure(sizes or (10,), names, repeats, "history")
    more = ("first_seconds", "products")
    table("histories", _over_ours(rows, lambda row: {name: getattr(row, name) for name in more}), directory)


def _over_ours(
    measured: Iterable[PeerRow | Skipped], more: Callable[[PeerRow], Fields]
) -> Iterator[dict[str, object] | str]:
    """Columns of the rows with their seconds over those of coulomb at the same p, and more; a text for a peer without a
    row."""
    from .peers import OURS, Skipped

    ours = 0.0
    for row in measured:
        if isinstance(row, Skipped):
            yield f"p {row.p:3d}  {row.peer}  skipped: {row.reason}"
            continue
        ours = row.seconds if row.peer == OURS else ours
        columns = dict(islice(row._asdict().items(), row._fields.index("figures")))
        yield {**columns, "ratio": row.seconds / ours, **more(row)}


@app.command()
def incompressible(directory: Output = None) -> None:
    """Elements near incompressibility: forces over those of Q2, and large motions at Poisson's ratio 0.4999."""
    from .incompressible import large, small

    table("incompressible", small(), directory)
    table("incompressible-large", large(), directory)


@app.command()
def decks(
    folder: Annotated[
        Path | None, typer.Argument(help="Folder of input files of CalculiX; default: three in finer and finer cells.")
    ] = None,
    limit: Annotated[float, typer.Option("--limit", min=1.0, help="Seconds for each run.")] = 300.0,
    directory: Output = None,
) -> None:
    """Decks by coulomb, by CalculiX, and by CalculiX with penalties 100 times stiffer: differences of displacements at
    the nodes over the largest one, and cpu seconds."""
    from .decks import rows
    from .refined_decks import write

    with tempfile.TemporaryDirectory() as temporary:
        if folder is None:
            folder = Path(temporary)
            write(folder)
        table("decks", rows(folder, limit), directory)


@app.command()
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
    directory: Output = None,
) -> None:
    """Friction problems of rigid bodies by coulomb and by Siconos' solvers: seconds, residual, performance profile."""
    from .fclib import in_folder, measure, solvers_here
    from .rigid_bodies import collection

    found: list[FCLIBRow] = []

    def rows() -> Iterator[Fields | str]:
        if folder is None and seed is None:
            raise ValueError("give a folder of problems, or --generated SEED")
        problems = ([] if folder is None else in_folder(folder)) + ([] if seed is None else list(collection(seed)))
        problems = [made for made in problems if only in made[0]]
        if not problems:
            raise ValueError(f"--only {only}: no problem has this in its name")
        solvers = solvers_here(names)
        if len(solvers) == 1 and names is None:
            yield "Siconos is not installed here (Debian's python3-siconos): coulomb alone"
        for row in measure(problems, solvers, limit, within):
            found.append(row)
            yield row._asdict()

    table("fclib", rows(), directory)
    for solver in dict.fromkeys(row.solver for row in found):
        own = [row for row in found if row.solver == solver]
        times = [row.seconds for row in own if row.solved]
        slowest = max(times, default=0.0)
        print(f"{solver:7s} solved {len(times)} of {len(own)}, slowest {slowest:.2f} s, together {sum(times):.2f} s")
    _profiles(directory, found, within)


def _profiles(directory: Path | None, rows: Sequence[FCLIBRow], within: float) -> None:
    """The performance profiles by all times, and with times below a millisecond as a millisecond."""
    from .fclib import above, profile

    first, *others = dict.fromkeys(row.solver for row in rows)
    for floor, name in ((0.0, "fclib_profile"), (1e-3, "fclib_profile_1ms")):
        curve = profile(rows, floor, within)
        print(f"\nsolved within a multiple of the quickest time{', at least 1 ms' if floor else ''}")
        table(name, (dict(zip(("ratio", first, *others), line, strict=True)) for line in curve), directory)
        ahead = [f"{solver} up to {ratio:.3g}" for solver, ratio in zip(others, above(curve), strict=True) if ratio]
        print(f"above {first}: {', '.join(ahead) or 'none'}")


if __name__ == "__main__":
    app()
