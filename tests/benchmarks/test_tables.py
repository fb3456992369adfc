"""`python -m benchmarks`: every table on a small problem, its CSV file, and what happens when a run fails."""

import csv
import re
import shutil

import numpy as np
import pytest
import typer
from conftest import ROOT
from typer.testing import CliRunner

from benchmarks import peers, refinement
from benchmarks.__main__ import app
from benchmarks.cluster import cells_per_metre
from benchmarks.peers import OURS, Row, Skipped
from benchmarks.peers.answer import Figures
from benchmarks.refinement import Row as RefinedRow
from benchmarks.refinement import beside
from benchmarks.scaling import Row as ScalingRow
from benchmarks.scaling import exponent
from benchmarks.tables import table

MEASURED = ROOT / "benchmarks" / "measured"


@pytest.mark.parametrize("file", sorted(MEASURED.iterdir()), ids=lambda file: file.stem)
def test_a_measured_table_names_the_commands_that_made_it(file):
    comments, rows = [], []
    for line in file.read_text().splitlines():
        (comments if line.startswith("# ") else rows).append(line)
    header, *values = csv.reader(rows)
    assert values and len(set(header)) == len(header) and {len(row) for row in values} == {len(header)}
    names = typer.main.get_command(app).commands
    for command in comments[1:]:
        name = re.fullmatch(
            r"# (?:python -m benchmarks (\S+)|python -m verification|coulomb run|\(by a script).*", command
        )
        assert name and (name[1] is None or name[1] in names), command
    assert len(comments) > 1


def test_the_page_names_tables_that_there_are():
    named = re.findall(r"`([a-z0-9-*]+\.csv)`", (ROOT / "docs" / "measurements.md").read_text())
    assert named and all(any(MEASURED.glob(name)) for name in named)


@pytest.fixture
def benchmark(tmp_path):
    """Run a table: its outcome, and the rows of its file."""

    def run(name, *arguments, code=0):
        done = CliRunner().invoke(app, [name, *map(str, arguments), "--output", str(tmp_path)])
        assert done.exit_code == code, done.output
        file = tmp_path / f"{name}.csv"
        return done.output, list(csv.DictReader(file.open())) if file.exists() else []

    return run


def test_sensitivities(benchmark):
    _, (row,) = benchmark("sensitivities", "--p", 2)
    assert (row["unknowns"], row["inputs"]) == ("162", "4") and float(row["forward"]) > 0.0


def test_table1(benchmark):
    _, rows = benchmark("table1", "--p", 4)
    names = ["PF(0.3,0.99)", "PF(0.1,0.9)", "PF(0.01,0.99)", "PF(0.1,0.9) estimated diag(A)"]
    assert [row["solver"] for row in rows] == names + [f"{name} P_AM alone" for name in names[:3]] + ["KPRGP"]
    assert {(row["n"], row["m"]) for row in rows} == {("900", "180")}  # 9 p (p + 1)^2, 9 p (p + 1)
    assert all(float(row["residual"]) <= 1e-6 for row in rows)
    products = [int(row["products"]) for row in rows]
    assert products[7] > 3.1 * max(products[:7])
    assert all(ours < alone for ours, alone in zip(products[:3], products[4:7], strict=True))


def test_friction(benchmark):
    _, rows = benchmark("friction", "--p", 3, "--friction", 1.5)
    assert all(float(row["residual"]) <= 1e-8 and row["status"] == "converged" for row in rows)
    products = {row["method"]: int(row["products"]) for row in rows}
    assert products["interior-point"] < products["inexact"] < products["plain"]
    assert products["interior-point"] < products["one Tresca problem"] and float(rows[0]["ratio"]) == 1.0


def test_scaling(benchmark):
    _, rows = benchmark("scaling", "--p", 2, "--ranks", 1, "--ranks", 2, "--method", "iterative")
    assert [row["ranks"] for row in rows] == ["1", "2"]
    for row in rows:
        assert row["unknowns"] == str(6 * 3 * 9) and row["contact"] == str(6 * 3 * 3)
        assert float(row["residual"]) <= 1e-7 and row["certified"] == "True"
        assert 5e7 < int(row["peak_memory_bytes"]) < 1e9 and float(row["petsc_seconds"]) > 0.0
        assert float(row["ratio"]) == pytest.approx(float(row["seconds"]) / float(row["yardstick_seconds"]))


def test_scaling_of_two_blocks(benchmark):
    _, (row,) = benchmark("scaling", "--problem", "two-blocks", "--p", 3)
    upper = [round(1.25 * 3 * length) for length in (1.9, 0.9, 0.5)]
    nodes = 10 * 4 * 2 + np.prod(np.add(upper, 1)), (upper[0] + 1) * (upper[1] + 1)  # free, and of the contact face
    assert [int(row["unknowns"]), int(row["contact"])] == [3 * count for count in nodes] and row["certified"] == "True"


def test_exponent():
    rows = [ScalingRow(1, n, 0, 1, 0, 0, 1e-5 * n**1.25, 0.0, 0, 0.0, 0.0, 0, True) for n in (10, 100, 1000)]
    assert exponent(rows) == pytest.approx(1.25)


def test_conditioning(benchmark):
    _, rows = benchmark("conditioning", "--p", 2)
    assert float(rows[-1]["J_AM"]) > 1e8 > 1e4 > float(rows[-1]["P_AM^-1 J_AM"])
    assert all(float(row["P_SC^-1 J_SC"]) <= float(row["bound"]) for row in rows)


def test_refinement(monkeypatch):
    """The first mesh is a uniform one: as many unknowns.  Later ones have fewer, and times that add up."""
    monkeypatch.setattr("benchmarks.refinement.REFERENCE", 4000)
    rows = [row for row in refinement.measure("block", 1200, (2, 3, 4, 6)) if row.total == "totals.normal_force"]
    uniform, refined = ([row for row in rows if row.mesh == mesh] for mesh in ("uniform", "refined"))
    assert [row.unknowns for row in uniform] == [9 * p * (p + 1) ** 2 for p in (2, 3, 4, 6)]
    assert refined[0].error == uniform[0].error and refined[0].fewer == pytest.approx(1.0)
    assert len(refined) == 3 and 1.0 < refined[1].fewer < refined[2].fewer < 6.0
    assert refined[2].all_seconds > sum(row.seconds for row in refined)


def test_same_error_on_a_uniform_mesh():
    """Errors 1/n and seconds 1e-3 n of n unknowns: 1e-3 needs 1000; beyond the finest mesh it is extrapolated."""
    uniform = [RefinedRow("", "uniform", n, 1e-3 * n, 1e-3 * n, "", 1.0 / n) for n in (10, 100, 5000)]
    found = [beside(uniform, RefinedRow("", "refined", 50, 0.1, 0.2, "", 1.0 / n)) for n in (1000, 50_000)]
    assert [row.fewer for row in found] == pytest.approx([20.0, 1000.0])
    assert [row.faster for row in found] == pytest.approx([5.0, 250.0])
    assert [row.extrapolated for row in found] == [False, True]


def test_elements(benchmark, tmp_path):
    """Quadratic tetrahedra have a smaller error of the force than linear ones with the same unknowns."""
    _, (linear, quadratic) = benchmark("elements", "--cells", 4, "--element", "P1", "--element", "P2")
    assert [linear["element"], quadratic["element"]] == ["P1", "P2"] and linear["unknowns"] == quadratic["unknowns"]
    assert float(quadratic["force_error"]) < 0.5 * float(linear["force_error"]) < 0.1
    assert (tmp_path / "elements.png").stat().st_size > 10_000


@pytest.mark.skipif(shutil.which("mpicc") is None, reason="needs mpicc")
def test_counts_of_two_ranks(benchmark):
    """Conjugate gradients take two products of vectors and a norm per iteration; ranks exchange their boundaries."""
    _, (row,) = benchmark("cluster", "--ranks", 2, "--p", 3)
    count = {name: float(value) for name, value in row.items()}
    assert (count["unknowns"], count["contact"], count["ranks_without_contact"]) == (480, 108, 0)
    assert 2.0 <= count["collectives_per_multigrid_iteration"] < 8.0  # with those at the start of a solve
    assert count["messages_per_multigrid_iteration"] >= 1.0 and count["kilobytes_per_multigrid_iteration"] > 0.1
    # semismooth steps have a system of 10 to 20 iterations each
    assert 10.0 < count["collectives_per_newton_step"] < 250.0 and 1.0 <= count["contact_imbalance"] <= 2.0
    assert cells_per_metre(10_000) == 10 and cells_per_metre(41_616) == 16


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("table1", "--p", 4, "--solver", "PF"), "there is no solver 'PF' in the table; it has PF(0.3,0.99)"),
        (("scaling", "--method", "magic"), "--method is auto, direct, iterative, mumps or gamg, not 'magic'"),
        (("scaling", "--problem", "two-blocks", "--degree", 2), "--degree are for block"),
        (("elements", "--element", "P3"), "--element is P1, P2, Q1 or Q2, not 'P3'"),
        (("peers", "--problem", "history"), "--problem is block, two-blocks or second-order, not 'history'"),
        (("parts", "--method", "magic"), "--method is direct, iterative, auto, mumps or gamg, not 'magic'"),
        (("parts", "--part", "wheel"), "there is no part 'wheel'"),
        (("fclib",), "give a folder of problems, or --generated SEED"),
        (("fclib", "--generated", 0, "--only", "zzz"), "--only zzz: no problem has this in its name"),
        (("fclib", "--generated", 0, "--solver", "magic"), "there is no solver 'magic'"),
        (("fclib", "missing"), "missing: there is no such directory"),
    ],
)
def test_wrong_input(benchmark, arguments, message):
    said, rows = benchmark(*arguments, code=2)
    assert message in " ".join(said.replace("│", " ").split()) and not rows


@pytest.fixture
def measured(monkeypatch):
    """Replace the measurement by given rows; an exception among them is raised."""

    def rows(*given):
        def measure(*_):
            for one in given:
                if isinstance(one, BaseException):
                    raise one
                yield one

        monkeypatch.setattr(peers, "measure", measure)

    return rows


def test_rows_until_a_failure_are_written(benchmark, measured):
    ours = Row(OURS, 4, 2.0, 2**30, 5, 0.0, Figures(1.0, 2.0, 3.0, 4.0))
    other = ours._replace(peer="GetFEM", seconds=6.0)
    measured(ours, Skipped("CalculiX", 4, "not installed"), other, RuntimeError("p = 8: no memory"))
    said, rows = benchmark("peers", "--problem", "two-blocks", code=1)
    assert "error: p = 8: no memory\n" in said and "CalculiX  skipped: not installed" in said
    assert [(row["peer"], float(row["ratio"])) for row in rows] == [(OURS, 1.0), ("GetFEM", 3.0)]
    assert list(rows[0])[-4:] == list(Figures._fields) and rows[0]["displacement"] == "4.0"


def test_rows_until_an_interruption_are_written(benchmark, measured):
    measured(Row(OURS, 4, 2.0, 2**30, 48, 0.0, None, 1.0, 240), KeyboardInterrupt())
    _, (row,) = benchmark("histories", code=130)
    assert list(row)[-2:] == ["first_seconds", "products"] and row["products"] == "240"


def test_the_directory_is_checked_before_anything_is_measured(tmp_path):
    (tmp_path / "file").touch()
    arguments = ["friction", "--p", "2", "--output", str(tmp_path / "file" / "out")]
    done = CliRunner().invoke(app, arguments)
    assert done.exit_code == 2 and "cannot be written" in done.output and "plain" not in done.output


def test_a_full_disk_is_reported(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("csv.DictWriter.writerows", lambda *_: (_ for _ in ()).throw(OSError(28, "No space left")))
    with pytest.raises(Exception) as end:
        table("x", [{"a": 1}], tmp_path)
    assert end.value.exit_code == 1 and "cannot be written: No space left" in capsys.readouterr().err
