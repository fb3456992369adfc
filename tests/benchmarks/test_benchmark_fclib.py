"""The benchmark of rigid contact problems: readers, rows, performance profile, and both on the command line."""

import csv

import numpy as np
import pytest
from typer.testing import CliRunner

from benchmarks import fclib
from benchmarks.__main__ import app
from benchmarks.fclib import Row, above, measure, profile, solvers_here
from benchmarks.rigid_bodies import collection, stack
from coulomb.io.fclib import read_fclib, write_fclib


def save_npz(path, problem, **changes):
    W = problem.W.tocsr()
    arrays = {
        "W_data": W.data,
        "W_indices": W.indices,
        "W_indptr": W.indptr,
        "q": problem.q,
        "mu": problem.mu,
    } | changes
    np.savez(path, **{key: value for key, value in arrays.items() if value is not None})


def test_npz_files_are_read(tmp_path):
    problem = stack(3, 0.5, 1)
    save_npz(tmp_path / "stack.npz", problem)
    again = read_fclib(tmp_path / "stack.npz")
    assert abs(again.W - problem.W).max() == 0.0 and np.array_equal(again.q, problem.q) and again.title == "stack"
    save_npz(tmp_path / "without.npz", problem, mu=None)
    save_npz(tmp_path / "broken.npz", problem, W_indices=problem.W.indices + 1000)
    save_npz(tmp_path / "infinite.npz", problem, W_data=problem.W.tocsr().data * np.inf)
    save_npz(tmp_path / "crooked.npz", problem, W_data=np.arange(1.0, 1.0 + problem.W.nnz))
    save_npz(tmp_path / "empty.npz", problem, W_data=[], W_indices=[], W_indptr=[0], q=[], mu=[])
    for name, message in (
        ("without.npz", "is not complete"),
        ("broken.npz", "cannot be read as numpy arrays"),
        ("infinite.npz", "W has entries that are not finite"),
        ("crooked.npz", "W is not symmetric"),
        ("empty.npz", "has no contacts"),
    ):
        with pytest.raises(ValueError, match=message):
            read_fclib(tmp_path / name)


def test_the_collection_has_half_rank_and_less():
    names = [name for name, _ in collection()]
    assert len(names) == len(set(names)) == 55
    made = dict(collection(1))
    for name in ("stack-5-F0.7", "wall-3x3-F0.3", "tower-3-F0.3", "walled-10-F0.3", "random-10x15-F0.3", "arch-5-F0.5"):
        problem = made[name]()
        W = problem.W.toarray()
        assert np.linalg.matrix_rank(W, hermitian=True) <= 0.5 * len(W), name
        assert np.linalg.eigvalsh(W)[0] >= -1e-12 * np.trace(W)


def row(problem, solver, seconds, solved=True):
    return Row(problem, 1, 3, 3, 0.5, solver, seconds, 1e-9, solved, "")


def test_profile_by_hand():
    """a solves p alone, q in four times the time of b, r in a tenth; nothing solves s."""
    rows = [row("p", "a", 1.0), row("p", "b", 9.0, solved=False), row("q", "a", 4.0), row("q", "b", 1.0)]
    rows += [row("r", "a", 1e-4), row("r", "b", 1e-3), row("s", "a", 1.0, False), row("s", "b", 1.0, False)]
    curve = profile(rows)
    assert curve[0] == (1.0, 0.5, 0.25) and curve[-1] == (1e4, 0.75, 0.5)
    assert {line[1] for line in curve if line[0] < 3.98} == {0.5}
    assert {line[2] for line in curve if line[0] < 9.9} == {0.25} and above(curve) == [0.0]
    with_floor = profile(rows, floor=2e-3, within=6.0)
    assert with_floor[0] == (1.0, 0.5, 0.5) and with_floor[-1][1:] == (0.75, 0.5) and with_floor[-1][0] < 6.0
    swapped = [(ratio, b, a) for ratio, a, b in curve]
    assert above(swapped) == [1e4]


def test_a_solver_is_ended_after_a_multiple_of_the_quickest(monkeypatch):
    """2 s, not solved, then 0.5 s: limits of 60 s, 60 s and 10 x 0.5 s; of 0.01 s at least one second."""
    limits, seconds = [], iter([2.0, 0.5, 0.01, 9.0])

    def run(solver, file, limit):
        limits.append(limit)
        return next(seconds), 1e-9 if len(limits) > 1 else 1.0, True, ""

    monkeypatch.setattr(fclib, "_in_process", run)
    rows = measure([("p", lambda: stack(2, 0.5, 1))], ["coulomb", "a", "b", "c"], 60.0, 10.0)
    assert [row.solved for row in rows] == [False, True, True, True]
    assert limits == [60.0, 60.0, 5.0, 1.0]


def test_a_solver_that_takes_too_long_is_ended(tmp_path, monkeypatch):
    """Its process has a limit of processor time of its own."""
    save_npz(tmp_path / "p.npz", stack(3, 0.5, 1))
    endless = "import resource; resource.setrlimit(resource.RLIMIT_CPU, (1, 1))\nwhile True: pass\n"
    (tmp_path / "sitecustomize.py").write_text(endless)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    found = fclib._in_process("coulomb", tmp_path / "p.npz", 1.0)
    assert found == (1.0, None, False, "limit of 1 s")


def test_siconos_agrees_where_it_is_installed():
    if len(solvers_here()) == 1:
        pytest.skip("not installed: siconos comes with Debian's python3-siconos")
    problem = stack(2, 0.5, 1)
    found = fclib.solve(problem, "ADMM")
    assert found["claimed"] and found["residual"] <= 1e-6


def test_command(tmp_path):
    write_fclib(tmp_path / "stack.hdf5", stack(3, 0.5, 1))
    arguments = ["fclib", str(tmp_path), "--solver", "coulomb", "--output", str(tmp_path / "out")]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 0 and "coulomb solved 1 of 1" in done.output, done.output
    (line,) = csv.DictReader((tmp_path / "out" / "fclib.csv").open())
    assert (line["contacts"], line["rank"], line["solved"]) == ("12", "18", "True")
    assert float(line["residual"]) <= 1e-8
    assert (tmp_path / "out" / "fclib_profile.csv").read_text().startswith("ratio,coulomb")
    assert "above coulomb: none" in done.output and (tmp_path / "out" / "fclib_profile_1ms.csv").is_file()
    done = CliRunner().invoke(app, ["fclib", str(tmp_path / "out")])
    assert done.exit_code == 2 and "there are no FCLIB problems there" in done.output
