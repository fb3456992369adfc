"""The command line in a process of its own."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import typer.main
import typer.testing
from conftest import ROOT, SMALL_CASE, reference, run_coulomb, run_python
from test_standard_streams import CASE, HISTORY

from coulomb.case.case import read_case
from coulomb.cli import app as cli
from coulomb.io.fclib import read_fclib

BLOCK = ROOT / "demos" / "block.toml"
SMALL = ("--set", "mesh.cells=[12,4,4]", "--set", "output.picture=false")


@pytest.fixture
def small_cases(tmp_path, monkeypatch):
    """In the current directory."""
    monkeypatch.chdir(tmp_path)
    Path("case.toml").write_text(CASE)
    Path("history.toml").write_text(HISTORY)


def test_run(tmp_path):
    done = run_coulomb("run", BLOCK, "--set", "mesh.cells=[18,6,6]", "--output", tmp_path / "out", process=True)
    contents = json.loads((tmp_path / "out" / "summary.json").read_text())
    totals, _ = reference(6, "coulomb")
    assert contents["force_on_body"]["normal"] == pytest.approx(totals["total_normal_force_N"], rel=1e-6)
    assert contents["certificate"]["passed"]
    assert (tmp_path / "out" / "picture.png").exists()
    lines = done.stdout.splitlines()
    assert "2646 displacement and 378 contact unknowns, Coulomb friction 0.3" in lines[0]
    assert lines[1] == "body     3 m x 1 m x 1 m; 648 hexahedra, 931 nodes"
    assert [line.split()[0] for line in lines[2:6]] == ["load", "load", "support", "contact"]
    assert lines[6].startswith("path following   1  residual ")  # plain lines if the output is not a terminal
    assert any(line.startswith("converged (auto: interior point): residual ") for line in lines)
    assert "\x1b" not in done.stdout
    assert "certificate passed" in done.stdout
    assert any("open 18, stick 8, slip 100" in line for line in lines)


def test_not_converged_exits_1_and_keeps_the_answer(tmp_path):
    done = run_coulomb(
        "run", BLOCK, *SMALL, "--set", "solver={method='successive-tresca', max_outer=2}", "--output", tmp_path, code=1
    )
    assert "error: successive Tresca ended with a residual of" in done.stderr
    contents = json.loads((tmp_path / "summary.json").read_text())
    assert contents["status"] == "max_iterations" and not contents["certificate"]["passed"]
    assert (tmp_path / "solution.h5").exists()


def test_info():
    done = run_coulomb("info", process=True)
    for name in ("coulomb", "DOLFINx", "PETSc", "mumps", "numpy", "pyvista", "BLAS"):
        assert name in done.stdout


@pytest.mark.parametrize("error", ["RuntimeError", "ValueError"])
def test_an_unforeseen_error_on_one_rank_ends_all(tmp_path, error):
    """The other ranks must not wait for a rank that has failed, nor that for them, as in the writer of the results.

    A ValueError of all ranks is wrong input; of one it is a crash.
    """
    script, case = tmp_path / "die.py", tmp_path / "case.toml"
    case.write_text(SMALL_CASE + "[history]\ntimes = [1.0]\n" * (error == "ValueError"))
    script.write_text(
        "import sys\nfrom mpi4py import MPI\nfrom coulomb.cli import app as cli, console\n"
        "from coulomb.io import output\n"
        "console._TOGETHER = 2.0\nsummary = output.summary\n"
        "def failing(solution):\n"
        f"    if MPI.COMM_WORLD.rank == 1:\n        raise {error}('unforeseen')\n"
        "    return summary(solution)\n"
        f"output.summary = failing\nsys.argv = ['coulomb', 'run', {str(case)!r}, '--output', {str(tmp_path)!r}]\n"
        "cli.main()\n"
    )
    done = run_python(script, ranks=2, timeout=120, code=3)
    assert f"{error}: unforeseen" in done.stderr


# --- options and exports ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("command", "message"),
    [
        ("plot out --save there/file.png", "--save there/file.png: there is no folder there; create it first"),
        ("report out --save here.html", "--save here.html: is a folder; name the file in it"),
        ("plot out --save file.png --scale nan", "--scale must be from 0 to 1e12, but is "),
        ("plot out --save file.png --scale -1", "--scale must be from 0 to 1e12, but is "),
        ("export history.toml x.hdf5 --time 2", "--time 2: must be from 0 to the end of the history, 1.5"),
        ("export history.toml x.hdf5 --time nan", "--time nan: must be from 0 to the end of the history, 1.5"),
        ("export case.toml x.hdf5 --time 1", "--time is for load histories"),
        ("export case.toml there/x.hdf5", "there is no folder there"),
        ("fclib none.hdf5 --tolerance nan", "--tolerance"),
        ("fclib none.hdf5 --tolerance 2", "--tolerance"),
        ("run case.toml --output=", "--output should name a directory"),
        ("check-case case.toml --output=", "--output should name a directory"),
    ],
)
def test_wrong_options(command, message, small_cases):
    Path("here.html").mkdir()
    done = run_coulomb(*command.split(), code=2)
    assert message in done.stderr and "cannot be read" not in done.stderr
    assert not Path("x.hdf5").exists()


def test_an_export_reports_its_time(small_cases):
    exported = {}
    for time in (None, 0.5, 1.5):
        option = [] if time is None else ["--time", time]
        done = run_coulomb("export", "history.toml", f"{time}.hdf5", *option)
        assert done.stdout.endswith(f", in one step from rest to time {time or 1.5:g}\n")
        exported[time] = read_fclib(f"{time}.hdf5")
    problem = read_case("history.toml").problem()
    for time, file in exported.items():
        np.testing.assert_allclose(file.q, -problem.at(time or 1.5).b, rtol=1e-12, atol=1e-12 * np.abs(file.q).max())
    assert not np.allclose(exported[0.5].q, exported[1.5].q)
    assert not list(Path().glob(".*.partial"))
    done = run_coulomb("export", "case.toml", "x.hdf5")
    assert re.fullmatch(r"\d+ contacts in x\.hdf5\n", done.stdout)


# --- helps --------------------------------------------------------------------------------------------------------


def commands(command, path=()):
    yield path, command
    for name, inner in getattr(command, "commands", {}).items():
        yield from commands(inner, (*path, name))


def words(text):
    return re.findall(r"[^\s│╭╮╰╯─]+", re.sub(r"\x1b\[[0-9;]*m", "", text))


@pytest.mark.parametrize(
    ("path", "command"),
    [pytest.param(*found, id=" ".join(found[0]) or "coulomb") for found in commands(typer.main.get_command(cli.app))],
)
def test_help_texts_are_complete(path, command):
    """Text in brackets is shown as text, not taken as markup."""
    environment = {"COLUMNS": "400", "TERMINAL_WIDTH": "400", "TERM": "dumb"}
    done = typer.testing.CliRunner().invoke(cli.app, [*path, "--help"], env=environment)
    assert done.exit_code == 0
    shown = words(done.output)
    helps = [getattr(parameter, "help", None) or "" for parameter in command.params]
    for text in (command.help or "", command.epilog or "", *helps):
        lost = [word for word in words(text) if not any(word in whole for whole in shown)]
        assert not lost, (path, lost)
