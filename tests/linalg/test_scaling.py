"""Products that are linear solves: only as accurate as needed, and the same answer."""

import csv

import numpy as np
import pytest
from conftest import make_block, run_coulomb, solved_block

import coulomb
from coulomb import InteriorPoint, IterativeSolver, SuccessiveTresca
from coulomb.benchmarks.scaling import Row, exponent

MULTIGRID = {"linear_solver": IterativeSolver, "explicit": False}


@pytest.mark.parametrize(
    ("law", "solver"),
    [
        ("coulomb", InteriorPoint(1e-8)),
        ("coulomb", SuccessiveTresca(1e-8)),
        ("tresca", InteriorPoint(1e-8)),
        ("tresca", InteriorPoint(1e-8, newton=coulomb.SchurComplementSystem(rank=0))),
    ],
    ids=["interior point", "successive Tresca", "path following", "path following, P_SC"],
)
def test_inexact_products_same_answer(law, solver):
    exact = solved_block(6, law)
    problem = make_block(6, slip_stress=1e7 if law == "tresca" else None, **MULTIGRID)
    solution = problem.solve(solver=solver)
    assert not problem.A.exact and solution.certificate.passed
    assert np.linalg.norm(solution.contact_force - exact.contact_force) <= 1e-6 * np.linalg.norm(exact.contact_force)


def test_multigrid_iterations_of_the_whole_problem():
    """A solve to 1e-11 takes 24; the products of the interior-point method take about 4 each on average."""
    problem = make_block(8, **MULTIGRID)
    result = problem.solve(1e-7).result
    assert result.newton_steps <= 24 and result.products <= 110
    assert problem.body.stiffness_solver.iterations <= 4.5 * result.products  # 3.7 to 4.1 for p = 8 to 20


def test_incremental_products_do_not_accumulate_errors():
    """After a hundred small increments, each accurate to 10 %, the error is that of one."""
    problem = make_block(4, **MULTIGRID)
    A, n = problem.A, 3 * len(problem.surface.nodes)
    rng = np.random.default_rng(91)
    x, y, exact = rng.standard_normal(n), np.empty(n), np.empty(n)
    A.mult_incremental(x, y)
    for _ in range(100):
        move = 1e-3 * rng.standard_normal(n)
        x = x + move
        A.mult_incremental(x, y, 0.1)
    A.mult(x, exact)
    A.mult(move, step := np.empty(n))
    assert np.linalg.norm(y - exact) <= 0.5 * np.linalg.norm(step)
    A.mult_incremental(x, y)
    assert np.linalg.norm(y - exact) <= 1e-8 * np.linalg.norm(exact)


def test_a_loose_product_costs_less():
    problem = make_block(4, **MULTIGRID)
    A, solver = problem.A, problem.body.stiffness_solver
    rng, y = np.random.default_rng(92), np.empty(3 * len(problem.surface.nodes))
    counts = []
    for tolerance in (0.1, 1e-3, 0.0):  # of a new vector each time: a solve starts from the last ones
        x = rng.standard_normal(len(y))
        before = solver.iterations
        A.mult(x, y, tolerance)
        counts.append(solver.iterations - before)
    assert counts[0] < counts[1] < counts[2] and counts[0] <= counts[2] / 3


def test_exponent():
    rows = [Row(1, n, 0, 1, 0, 0, 1e-5 * n**1.25, 0.0, 0, 0.0, 0.0, 0, True) for n in (10, 100, 1000)]
    assert exponent(rows) == pytest.approx(1.25)


def test_benchmark_scaling(tmp_path):
    arguments = ("--p", 4, "--p", 5, "--ranks", 1, "--ranks", 2, "--method", "iterative", "--output", tmp_path)
    done = run_coulomb("benchmark", "scaling", *arguments, process=True)
    assert done.returncode == 0, done.stderr
    with (tmp_path / "scaling.csv").open() as file:
        rows = list(csv.DictReader(file))
    wanted = "p,unknowns,contact,ranks,path_following,krylov,seconds,yardstick_seconds,peak_memory_bytes,residual"
    assert ",".join(rows[0]).startswith(wanted)
    assert [(row["p"], row["ranks"]) for row in rows] == [("4", "1"), ("4", "2"), ("5", "1"), ("5", "2")]
    assert rows[0]["unknowns"] == str(12 * 3 * 25) and rows[0]["contact"] == str(12 * 3 * 5)
    for row in rows:
        assert float(row["residual"]) <= 1e-7 and row["certified"] == "True"
        assert 5e7 < int(row["peak_memory_bytes"]) < 1e9 and float(row["yardstick_seconds"]) > 0.0
        assert float(row["petsc_seconds"]) > 0.0
    assert (tmp_path / "scaling.png").stat().st_size > 10_000
    done = run_coulomb("benchmark", "scaling", "--method", "magic")
    assert done.returncode == 2 and "--method is auto, direct or iterative" in done.stderr


def test_benchmark_scaling_of_condensed_systems(tmp_path):
    done = run_coulomb("benchmark", "scaling", "--p", 3, "--newton", "condensed", "--output", tmp_path)
    assert done.returncode == 0, done.stderr
    with (tmp_path / "scaling.csv").open() as file:
        (row,) = csv.DictReader(file)
    assert row["newton"] == "condensed" and row["certified"] == "True" and float(row["residual"]) <= 1e-7
    assert int(row["krylov"]) > 5 * int(row["path_following"])  # whole multigrid cycles, not products by A
    done = run_coulomb("benchmark", "scaling", "--newton", "magic")
    assert done.returncode == 2 and "--newton is recycling or condensed" in done.stderr


def test_benchmark_scaling_of_two_blocks(tmp_path):
    arguments = ("--problem", "two-blocks", "--p", 3, "--tolerance", 1e-8, "--output", tmp_path)
    done = run_coulomb("benchmark", "scaling", *arguments)
    assert done.returncode == 0, done.stderr
    with (tmp_path / "scaling.csv").open() as file:
        (row,) = csv.DictReader(file)
    assert row["problem"] == "two-blocks" and row["certified"] == "True" and float(row["yardstick_seconds"]) > 0.0
    upper = [round(1.25 * 3 * length) for length in (1.9, 0.9, 0.5)]
    nodes = 10 * 4 * 2 + np.prod(np.add(upper, 1)), (upper[0] + 1) * (upper[1] + 1)  # free, and of the contact face
    assert [int(row["unknowns"]), int(row["contact"])] == [3 * count for count in nodes]
    done = run_coulomb("benchmark", "scaling", "--problem", "two-blocks", "--degree", 2)
    assert done.returncode == 2 and "--degree are for block" in done.stderr
