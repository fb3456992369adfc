"""Shared by the tests: the block of the benchmarks, and small dense problems."""

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OMPI_ALLOW_RUN_AS_ROOT", "1")
os.environ.setdefault("OMPI_ALLOW_RUN_AS_ROOT_CONFIRM", "1")

import compileall
import contextlib
import functools
import gc
import json
import runpy
import signal
import subprocess
import sys
import tempfile
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from unittest import mock

import numpy as np
import pytest
import scipy.sparse
import typer.main
from mpi4py import MPI
from petsc4py import PETSc
from skips import pytest_addoption, pytest_sessionfinish, pytest_terminal_summary  # noqa: F401  # hooks of pytest

import coulomb
from coulomb import units
from coulomb.linalg.compliance import MatrixCompliance

DATA = Path(__file__).with_name("data")
ROOT = Path(__file__).parents[1]
STEEL = coulomb.Material(young=2.119e11, poisson=0.277)


SLOW = [line for line in DATA.with_name("slow.txt").read_text().split("\n") if line.startswith("tests/")]


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config, items):
    """The tests of slow.txt, a function or one of its cases each, are marked so; those that compare several ranks with
    one are left out on one rank."""
    for item in items:
        if item.nodeid in SLOW or item.nodeid.partition("[")[0] in SLOW:
            item.add_marker("slow")
    if MPI.COMM_WORLD.size == 1:
        of_ranks = [item for item in items if item.get_closest_marker("ranks")]
        config.hook.pytest_deselected(items=of_ranks)
        items[:] = [item for item in items if item not in of_ranks]


@pytest.fixture(autouse=True)
def _metres_and_pascals():
    """Cases and decks state the units of the process; the next test has those of the start."""
    yield
    units.use()


SMALL_CASE = """\
[mesh]
box = [3.0, 1.0, 1.0]
cells = [3, 1, 1]
[material]
young = 2e11
poisson = 0.3
[[clamp]]
face = "left"
[[traction]]
face = "top"
value = [0.0, 0.0, -1e7]
[contact]
face = "bottom"
friction = 0.3
[output]
picture = false
"""
"""A small case."""

PRESSED_CASE = """\
[mesh]
box = [1.0, 1.0, 1.0]
cells = [3, 3, 3]
cell = "CELL"
[material]
young = 2.1e11
poisson = 0.3
[[prescribed_displacement]]
face = "top"
components = "z"
value = [0, 0, -2e-4]
amplitude = [[0, 0], [1, 1]]
"""
"""A cube of cells CELL whose top is pressed down in the first second."""


def make_block(p, friction=0.3, slip_stress=None, cells=None, foundation=None, cohesion=None, **options):
    """The block of the benchmarks with p cells per metre; options are of its mesh, its contact and the problem."""
    law = {"slip_stress": slip_stress} if slip_stress else {"friction": friction, "cohesion": cohesion}
    law |= {"direction": options.pop("direction")} if "direction" in options else {}
    mesh = {name: options.pop(name) for name in ("cell", "comm") if name in options}
    return coulomb.ContactProblem(
        coulomb.box((3.0, 1.0, 1.0), cells or (3 * p, p, p), **mesh),
        STEEL,
        clamps=[coulomb.Clamp("left")],
        tractions=[coulomb.Traction("top", (0.0, 1e7, -4e7)), coulomb.Traction("right", (2e7, 0.0, 0.0))],
        contact=coulomb.Contact("bottom", foundation=foundation, **law),
        **options,
    )


compileall.compile_dir(ROOT / "coulomb", quiet=2)  # once, not in every process that a test starts
gc.freeze()  # modules are no garbage, and take long to search; coulomb's runs find it done
gc.set_threshold(20_000)


@functools.cache
def solved_block(p, law="coulomb"):
    problem = make_block(p, slip_stress=1e7 if law == "tresca" else None)
    return problem.solve(tolerance=1e-8)


@functools.cache
def reference(p, law):
    """Totals and nodal forces of the independent solver (tests/data/README.md)."""
    results = json.loads((DATA / "block.json").read_text())["results"]
    totals = next(entry for entry in results if entry["p"] == p and entry["law"] == law)
    return totals, np.load(DATA / f"block_{law}_p{p}.npz") if p in (6, 10) else None


def dense_compliance(A):
    """A symmetric numpy matrix as a Compliance on one rank."""
    matrix = PETSc.Mat().createDense(A.shape, array=np.asfortranarray(A), comm=PETSc.COMM_SELF)
    matrix.assemble()
    return MatrixCompliance(matrix)


def to_csr(matrix):
    """The rows of a PETSc matrix that this rank has."""
    indptr, columns, values = matrix.getValuesCSR()
    return scipy.sparse.csr_matrix((values, columns, indptr), shape=(len(indptr) - 1, matrix.getSize()[1]))


def random_spd(size, condition, rng):
    """Symmetric positive definite with a given condition number and random eigenvectors."""
    Q, _ = np.linalg.qr(rng.standard_normal((size, size)))
    return (Q * np.geomspace(1.0, 1.0 / condition, size)) @ Q.T


def random_tresca(nodes, seed, condition=1e3):
    """A Tresca problem with open and closed, sticking and slipping nodes, in awkward units."""
    rng = np.random.default_rng(seed)
    A = 1e-9 * random_spd(3 * nodes, condition, rng)
    b = 1e-4 * rng.standard_normal(3 * nodes)
    slip_bound = 1e5 * rng.uniform(0.05, 2.0, nodes)
    return coulomb.solvers.FrictionProblem.tresca(dense_compliance(A), b, slip_bound), A


def objective(qp, x):
    """1/2 x^T A x - b^T x of a problem on one rank."""
    A_x = np.empty_like(x)
    qp.A.mult(x, A_x)
    return 0.5 * x @ A_x - qp.b @ x


def run_coulomb(*arguments, code=0, ranks=None, cwd=None, timeout=600, process=False):
    """Run the command line.

    Args:
        arguments: Of coulomb.
        code: Its exit code, else the test fails; None if any will do.
        ranks: Under mpirun, on so many ranks.
        cwd: Where; by default in the current directory.
        timeout: Of a process of its own, seconds.
        process: In a process of its own, for what depends on one, and once per command; otherwise without ranks in
            this one, which saves the second that it takes to start.

    Returns:
        Its returncode, and what it wrote as stdout and stderr.
    """
    if process or ranks is not None:
        return run_python("-m", "coulomb", *arguments, code=code, ranks=ranks, cwd=cwd, timeout=timeout)
    words = [*map(str, arguments)]
    return with_code(_in_this_process(["coulomb", *words], cwd, lambda: _exit_code(words)), code)


def run_script(file, cwd):
    """Run a Python script in this process, in a directory, without a picture: returncode, stdout and stderr."""

    def run():
        with without_pictures():
            runpy.run_path(str(file), run_name="__main__")
        return 0

    return _in_this_process([str(file)], cwd, run)


def _in_this_process(command, cwd, run):
    """What a function returns as exit code and writes, called as if with this command line in a directory."""
    with contextlib.ExitStack() as stack:
        out, errors = (stack.enter_context(tempfile.TemporaryFile("w+", encoding="utf-8")) for _ in range(2))
        stack.callback(os.chdir, os.getcwd())
        os.chdir(cwd or ".")
        stack.enter_context(mock.patch.object(sys, "argv", command))
        with _written_to(1, out), _written_to(2, errors), redirect_stdout(out), redirect_stderr(errors):
            code = run()
        for file in (out, errors):
            file.seek(0)
        return subprocess.CompletedProcess(command, code, out.read(), errors.read())


@functools.cache
def command_line():
    """The commands of coulomb.cli.app, which typer makes anew in every call of an app, in 50 ms."""
    from coulomb.cli.app import app  # here, since it takes time that most tests do not need

    return typer.main.get_command(app)


def _exit_code(arguments):
    try:
        command_line()(arguments)
    except SystemExit as end:
        return end.code or 0
    return 0


@contextlib.contextmanager
def _written_to(number, file):
    """What libraries write to a standard stream by its number goes to a file as well."""
    before = os.dup(number)
    os.dup2(file.fileno(), number)
    try:
        yield
    finally:
        file.flush()
        os.dup2(before, number)
        os.close(before)


@contextlib.contextmanager
def without_pictures():
    """`Solution.write` draws no picture, for which it starts a process of 1.5 s: for tests that do not look at it."""
    with mock.patch("coulomb.pictures.picture_of_run.draw", lambda *_: ""):
        yield


MPIEXEC = str(mpiexec) if (mpiexec := Path(sys.prefix, "bin", "mpiexec")).exists() else "mpirun"
"""Of the environment's MPI, which PyPI's DOLFINx brings along, or the system's."""

RANKS_ON_FEW_CORES = {
    "OMPI_MCA_mpi_yield_when_idle": "1",
    "OMPI_MCA_btl": "^tcp",  # all ranks are on this machine; Open MPI 5 complains of networks without routes
    "OMPI_MCA_hwloc_base_binding_policy": "none",  # Open MPI 4 binds two ranks to the first two cores, busy or not
    "OMPI_MCA_rmaps_base_oversubscribe": "1",
    "PRTE_MCA_rmaps_default_mapping_policy": ":oversubscribe",
}
"""Environment of Open MPI's mpirun."""


def run_python(*arguments, code=0, ranks=None, cwd=None, timeout=600):
    """Run Python in a process of its own, without the MPI environment of this one; arguments as of `run_coulomb`."""
    launcher = ("OMPI_COMM", "OMPI_MCA", "OMPI_UNIVERSE", "PMIX", "PRTE", "PMI_", "HYDI_", "HYDRA_", "MPI_LOCAL")
    clean = {key: value for key, value in os.environ.items() if not key.startswith(launcher)}
    clean |= RANKS_ON_FEW_CORES
    command = [sys.executable, *map(str, arguments)]
    if ranks is not None:
        command = [MPIEXEC, "-n", str(ranks), *command]
    for _ in range(2):
        done = subprocess.run(command, env=clean, cwd=cwd, capture_output=True, text=True, timeout=timeout, check=False)
        if not (ranks is not None and done.returncode == signal.SIGKILL and "(signal 9)" in done.stdout):
            break  # MPICH's launcher: a rank was killed from outside, as where memory is short
    return with_code(done, code)


def with_code(done, code):
    """A command that is done, if it has this exit code, or if any will do."""
    said = f"{done.args} ended with {done.returncode}:\n{done.stdout[-3000:]}{done.stderr[-3000:]}"
    assert code is None or done.returncode == code, said
    return done


@pytest.fixture(scope="session")
def block6():
    return solved_block(6)


SMALL_BLOCK = ("--set", "mesh.cells=[12,4,4]", "--set", "output.picture=false")


@pytest.fixture(scope="session")
def block(tmp_path_factory):
    """Directory of a small block's run, with its report."""
    directory = tmp_path_factory.mktemp("runs") / "block"
    run_coulomb("run", ROOT / "demos" / "block.toml", *SMALL_BLOCK, "--report", "--output", directory, process=True)
    return directory


@pytest.fixture(scope="session")
def failed(tmp_path_factory):
    """The same of a solver that stopped at its maximum number of steps; its report without pictures."""
    directory = tmp_path_factory.mktemp("runs") / "failed"
    given = ("--set", "solver={method='successive-tresca', max_outer=3}")
    run_coulomb("run", ROOT / "demos" / "block.toml", *SMALL_BLOCK, *given, "--output", directory, code=1)
    return with_report(directory)


@pytest.fixture(scope="session")
def history(tmp_path_factory):
    """Directory of a load history of six steps, with its report without pictures."""
    directory = tmp_path_factory.mktemp("runs") / "history"
    small = ("--set", "mesh.cells=[4,4,2]", "--set", "history={end=6.0, steps=6}", "--set", "output.picture=false")
    run_coulomb("run", ROOT / "demos" / "history.toml", *small, "--output", directory)
    return with_report(directory)


def with_report(directory):
    """The directory of a run, with its report without pictures, which take most of the time."""
    from report_pages import page_without_pictures

    (directory / "report.html").write_text(page_without_pictures(directory, charts=True), encoding="utf-8")
    return directory


def indentation(turn=None, order=(0, 1, 2), metre=1.0, newton=1.0, mirror=False, cell="hexahedron", **options):
    """A rigid ball pressed into a steel block and dragged along it, by a history of four steps.

    The same physics in different descriptions.

    Args:
        turn: Rotation of the whole in space.
        order: Which axis of the body each axis of the regular box becomes: another numbering of the mesh.
        metre: What a metre is in the unit of length.
        newton: What a newton is in the unit of force.
        mirror: Of the whole in the plane half way along y.
        cell: Of the mesh.
        options: ContactProblem's, and comm.

    Returns:
        The problem, and its history.
    """
    turn, order = np.eye(3) if turn is None else turn, list(order)
    lengths, cells, radius = metre * np.array([1.6, 1.0, 0.8]), np.array([8, 5, 4]), 3.0 * metre
    faces = (("left", "right"), ("front", "back"), ("bottom", "top"))
    bottom, top = faces[order.index(2)]
    across = -1.0 if mirror else 1.0

    def place(x):
        body = np.empty_like(x)
        body[order] = x
        return turn @ body

    def ball(x, y, z):
        return turn @ (metre * np.array([x, across * y, z]))

    centre = np.array([0.7, 0.5, 0.0]) * metre - [0.0, 0.0, radius]
    way = [(0, ball(0, 0, 0)), (1, ball(0, 0, 0.04)), (2, ball(0.01, 0.006, 0.04)), (3, ball(-0.004, 0.02, 0.03))]
    problem = coulomb.ContactProblem(
        coulomb.box(lengths[order], cells[order], cell, place=place, comm=options.pop("comm", MPI.COMM_WORLD)),
        coulomb.Material(STEEL.young * newton / metre**2, STEEL.poisson),
        [coulomb.Clamp(top)],
        coulomb.Contact(
            bottom,
            0.3,
            foundation=coulomb.Sphere(tuple(turn @ centre), radius),
            motion=[(time, *where) for time, where in way],
        ),
        **options,
    )
    return problem, coulomb.LoadHistory([1.0, 1.5, 2.0, 3.0], tolerance=1e-10)
