"""Template cases, and estimates of the memory of a case."""

import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import PurePath

import pytest
import typer.testing
from conftest import ROOT, make_block, run_coulomb, run_script

from benchmarks.estimates import measure
from coulomb.cli import app as cli
from coulomb.cli.preparation import gigabytes
from coulomb.linalg.compliance.predicted_cost import DIRECT_UP_TO, chosen
from coulomb.linalg.compliance.stiffness import DirectSolver, IterativeSolver
from coulomb.model.memory import free_memory, memory_needed

SMALL = {
    "block": "mesh.cells=[9,3,3]",
    "hertz": "output.report=false",
    "history": "mesh.cells=[4,4,2]",
    "pair": "output.report=false",
}


@pytest.mark.parametrize("kind", SMALL)
def test_a_new_case_runs_and_certifies(kind, tmp_path):
    done = run_coulomb("new", kind, cwd=tmp_path)
    assert done.stdout == f"{kind}.toml written; next: coulomb check-case {kind}.toml\n"
    assert (tmp_path / f"{kind}.toml").read_text().count("#") > 10
    done = run_coulomb(
        "run", f"{kind}.toml", "--set", SMALL[kind], "--set", "output.picture=false", "--quiet", cwd=tmp_path
    )
    assert done.stdout == done.stderr == ""
    assert json.loads((tmp_path / "results" / kind / "summary.json").read_text())["certificate"]["passed"]


def test_a_new_script_with_forms_runs(tmp_path):
    done = run_coulomb("new", "forms", "mine.py", cwd=tmp_path)
    assert done.stdout == "mine.py written; next: python mine.py\n"
    done = run_script(tmp_path / "mine.py", cwd=tmp_path)
    assert done.returncode == 0 and "certificate passed" in done.stdout, done.stderr
    assert (tmp_path / "results" / "forms" / "contact.xdmf").exists()


@pytest.mark.parametrize("kind", ["block", "history"])
def test_the_new_cases_are_the_demos(kind):
    template = tomllib.loads((ROOT / "coulomb" / "templates" / f"{kind}.toml").read_text())
    demo = tomllib.loads((ROOT / "demos" / f"{kind}.toml").read_text())
    for table, keys in demo.items():
        if isinstance(keys, dict):
            assert {key: template[table][key] for key in keys} == keys
        else:
            assert [{k: t[k] for k in d} for t, d in zip(template[table], keys, strict=True)] == keys


def test_new_replaces_a_file_only_with_force(tmp_path):
    (tmp_path / "mine.toml").write_text("mine")
    run_coulomb("new", "hertz", "mine.toml", cwd=tmp_path, process=True, code=2)
    assert (tmp_path / "mine.toml").read_text() == "mine"
    run_coulomb("new", "hertz", "mine.toml", "--force", cwd=tmp_path)
    assert "coulomb run mine.toml" in (tmp_path / "mine.toml").read_text()  # the comments name the file


def test_templates_are_in_the_package():
    described = tomllib.loads((ROOT / "pyproject.toml").read_text())
    patterns = described["tool"]["setuptools"]["package-data"]["coulomb"]
    assert any(PurePath("templates/block.toml").match(pattern) for pattern in patterns)


def test_check_case_solves_and_writes_nothing(tmp_path):
    done = run_coulomb("check-case", ROOT / "demos" / "history.toml", cwd=tmp_path, process=True)
    first, body, *others = done.stdout.splitlines()
    assert first.endswith("1815 displacement and 363 contact unknowns, Coulomb friction 0.5, 1 rank")
    assert body == "body     100 mm x 100 mm x 50 mm; 500 hexahedra, 726 nodes"
    assert [line[:8].strip() for line in others[:3]] == ["support", "support", "contact"]
    del others[:3]
    assert others[0] == "K direct (nested dissection), A explicit"
    assert others[1].startswith("24 load steps, each halved up to 6 times")
    assert re.match(r"about 0\.1\d GB of memory on one rank, accurate to a factor of two, and 0\.0\d+ GB on", others[2])
    assert not list(tmp_path.iterdir())


def test_memory_estimate_on_a_small_problem():
    """To a factor of two; docs/measurements.md has the larger ones."""
    row = next(measure([9]))
    assert 0.5 < row.memory_expected / row.memory_measured < 2.0, row


def test_estimates_against_measurements():
    """Peak memory of larger runs on one rank: the block at p = 24 and 46, and at p = 16 with 24 load steps, whose
    factors are in double precision."""
    for n, m, solver, explicit, double, memory in (
        (135_000, 5_400, DirectSolver, True, False, 1.59e9),
        (135_000, 5_400, DirectSolver, False, False, 1.19e9),
        (135_000, 5_400, IterativeSolver, False, False, 0.41e9),
        (914_526, 19_458, IterativeSolver, False, False, 1.81e9),
        (41_616, 2_448, DirectSolver, True, True, 0.74e9),
    ):
        assert 0.8 < memory_needed(n, m, 1, solver, explicit, double=double) / memory < 1.25


def test_estimates_follow_the_method():
    direct, iterative = make_block(4), make_block(4, linear_solver=IterativeSolver)
    before = direct.body.memory()
    assert before > iterative.body.memory()
    direct.body.stiffness.expect_load_steps(24)
    assert direct.body.memory() > before
    assert gigabytes(2.34e8) == "0.23 GB" and gigabytes(1.234e11) == "123 GB"


def test_the_choice_by_size():
    assert chosen(DIRECT_UP_TO, 10_000, 1, None, None) == (DirectSolver, True)
    assert chosen(DIRECT_UP_TO, 10_001, 1, None, None) == (DirectSolver, False)
    assert chosen(DIRECT_UP_TO + 1, 10_000, 1, None, None) == (IterativeSolver, False)
    assert chosen(DIRECT_UP_TO, 10_000, 2, None, None) == (DirectSolver, True)
    assert chosen(DIRECT_UP_TO, 10_001, 2, None, None) == (IterativeSolver, False)
    assert chosen(100, 30, 2, None, False) == (IterativeSolver, False)
    assert chosen(100, 30, 2, DirectSolver, False) == (DirectSolver, False)
    assert chosen(DIRECT_UP_TO + 1, 10, 1, None, True) == (DirectSolver, True)


def system(root, available, groups):
    """A /proc and a /sys/fs/cgroup: kB available, and lines and files of control groups."""
    lines, files = groups
    (root / "self").mkdir()
    (root / "meminfo").write_text(f"MemTotal: 99999999 kB\nMemAvailable: {available} kB\n")
    (root / "self" / "cgroup").write_text(lines)
    for name, text in files.items():
        path = root / "cgroup" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return free_memory(root, root / "cgroup")


OF_VERSION_2 = {
    "a/memory.max": "900000000\n",
    "a/memory.current": "500000000\n",
    "a/memory.stat": "anon 1\ninactive_file 100000000\n",
}
OF_VERSION_1 = {
    "memory/job/memory.limit_in_bytes": "300000000\n",
    "memory/job/memory.usage_in_bytes": "100000000\n",
    "memory/memory.limit_in_bytes": "9223372036854771712\n",
    "memory/memory.usage_in_bytes": "1\n",
}


@pytest.mark.parametrize(
    ("groups", "free"),
    [
        (("0::/\n", {}), 1024e6),
        (("0::/a/b\n", {"a/b/memory.max": "max\n", "a/b/memory.current": "5\n"}), 1024e6),
        (("0::/a/b\n", OF_VERSION_2), 5e8),
        (("4:cpu,memory:/job\n0::/\n", OF_VERSION_1), 2e8),
    ],
    ids=["none", "no limit", "version 2", "version 1"],
)
def test_free_memory(tmp_path, groups, free):
    assert system(tmp_path, 1_000_000, groups) == free


def test_unknown_free_memory(tmp_path):
    assert free_memory(tmp_path, tmp_path) is None
    here = free_memory()
    assert here is None or here > 1e7


def test_force_runs_where_memory_seems_too_small(tmp_path, monkeypatch):
    """That it is refused otherwise is in data/wrong_inputs.json."""
    monkeypatch.setattr("coulomb.model.memory.free_memory", lambda: 1e6)
    given = ("--set", "mesh.cells=[3,1,1]", "--set", "output.picture=false", "--output", tmp_path / "out", "--force")
    run_coulomb("run", ROOT / "demos" / "block.toml", *given)


@pytest.mark.parametrize("shell", ["bash", "zsh"])
def test_completion(shell):
    """The completion script of a shell, and its completions: a command, an option, a value."""
    runner = typer.testing.CliRunner()
    for command, line in (("check-case", "coulomb ch"), ("--log", "coulomb run x --lo"), ("hertz", "coulomb new h")):
        environment = {"COMP_WORDS": line, "COMP_CWORD": str(len(line.split()) - 1), "_TYPER_COMPLETE_ARGS": line}
        environment["_COULOMB_COMPLETE"] = f"complete_{shell}"
        answered = runner.invoke(cli.app, [], prog_name="coulomb", env=environment)
        assert command in answered.output, answered.output


def test_a_shell_gets_its_script():
    environment = os.environ | {"_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"}
    for shell in ("bash", "zsh"):
        command = [sys.executable, "-m", "coulomb", "--show-completion", shell]
        done = subprocess.run(command, capture_output=True, text=True, env=environment, check=False)
        assert done.returncode == 0 and f"=complete_{shell}" in done.stdout


def test_exit_codes_are_documented():
    contents = " ".join(run_coulomb("--help").stdout.split())
    page = (ROOT / "docs" / "commands.md").read_text()
    for code in ("0", "1", "2", "3", "130"):
        assert re.search(rf"Exit codes:.* {code} [a-z]", contents)
        assert re.search(rf"^\| {code} \|", page, re.MULTILINE)
