"""The benchmark of real parts: one part by both methods, meshes made by a program, errors."""

import csv
import shutil

import pytest
from conftest import ROOT
from typer.testing import CliRunner

from benchmarks.__main__ import app
from benchmarks.real_parts import PARTS, Failure, Row, measure, over_better, parts_in, run

MESH = ROOT / "demos" / "foot.msh"


def invoke(*arguments):
    return CliRunner().invoke(app, ["parts", *map(str, arguments)])


def test_both_methods_find_the_same_contact():
    """The foot of the tutorial, on its mesh."""
    settings = [f'mesh.file="{MESH}"']
    rows = [run(PARTS / "foot.toml", settings, method, 1e-8) for method in ("direct", "iterative")]
    assert [row.path for row in rows] == ["direct", "iterative"]
    for row in rows:
        assert row.certified and row.residual <= 1e-8 and 0.0 < row.setup_processor_seconds < row.processor_seconds
        assert 3 * (row.open + row.stick + row.slip) == row.contact < row.unknowns
        assert row.entries > 27 * row.unknowns  # at least nine nodes are coupled with each, on average
    assert rows[0][2:8] == rows[1][2:8]
    assert rows[1].multigrid_iterations > rows[1].products > 0


def test_petscs_solvers_find_the_same_contact():
    case, cells = PARTS / "two-blocks.toml", ["body.0.cells=[6,3,2]", "body.1.cells=[5,3,2]"]
    ours, mumps, gamg = (run(case, cells, method, 1e-8) for method in ("direct", "mumps", "gamg"))
    assert ours[2:8] == mumps[2:8] == gamg[2:8] and mumps.certified and gamg.certified
    assert [row.method for row in (mumps, gamg)] == ["mumps", "gamg"]
    assert gamg.multigrid_iterations > gamg.products > 0 == mumps.multigrid_iterations


@pytest.mark.parametrize("method", ["direct", "iterative"])
def test_load_steps(method):
    """The work of all of them; their loads grow to those of the single problem in four, and on in the fifth."""
    case, cells = PARTS / "block.toml", ["mesh.cells=[6,2,2]"]
    one, four, five = (run(case, cells, method, 1e-8, steps) for steps in (1, 4, 5))
    assert four[4:8] == one[4:8] and four.certified and five.certified and (four.load_steps, one.load_steps) == (4, 1)
    assert one.products < four.products < five.products and one.path_following < four.path_following
    assert (one.multigrid_iterations < four.multigrid_iterations) == (method == "iterative")


def test_boxes_are_refined(monkeypatch):
    """Of one body or of several, without gmsh; at least one cell along each edge."""
    monkeypatch.setattr(shutil, "which", lambda _: None)
    parts = parts_in(None, ["block", "two-blocks"])
    block, two = (next(measure([part], [8.0], ["direct"])) for part in parts)
    assert isinstance(block, Row) and isinstance(two, Row)
    assert (block.part, block.clscale, block.unknowns, block.contact) == ("block", 8.0, 3 * 6 * 3 * 3, 3 * 6 * 3)
    assert (two.unknowns, two.contact) == (3 * (6 * 3 * 1 + 5 * 3 * 2), 3 * 5 * 3)
    (failure,) = measure(parts[:1], [8.0], ["direct"], limit=1e-3, steps=[2])
    assert failure == Failure("block", 8.0, 2, "direct", "it did not end within 0.001 s")


@pytest.fixture
def fake_gmsh(tmp_path, monkeypatch):
    """A program that copies a mesh to where gmsh would write it; mesh sizes above 10 make it fail."""
    program = tmp_path / "bin" / "gmsh"
    program.parent.mkdir()
    copy = f'[ "$1" = - ] && exit; [ "$4" = 20 ] && {{ echo no volume >&2; exit 1; }}; [ "$4" = 30 ] || cp {MESH} "$6"'
    program.write_text(f"#!/bin/sh\n{copy}\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(program.parent), prepend=":")


def test_command(tmp_path, fake_gmsh):
    parts = tmp_path / "mine"
    parts.mkdir()
    for name in ("foot.geo", "foot.toml"):
        shutil.copy(PARTS / name, parts)
    wanted = ("--clscale", 20, "--clscale", 0.9, "--method", "auto", "--output", tmp_path)
    done = invoke(parts, *wanted)
    assert done.exit_code == 1 and "no volume" in done.output and "True" in done.output, done.output
    with (tmp_path / "parts.csv").open() as file:
        (row,) = csv.DictReader(file)  # the one after the failure
    assert list(row) == [*Row._fields, "ratio"]
    assert (row["part"], row["clscale"], row["method"], row["path"]) == ("foot", "0.9", "auto", "direct")
    (parts / "foot.toml").write_text((parts / "foot.toml").read_text().replace('"seat"', '"bolt"'))
    done = invoke(parts, "--clscale", 30, "--clscale", 0.9, "--method", "direct")
    assert done.exit_code == 1 and "no mesh was made" in done.output and "bolt" in done.output, done.output


def test_wrong_inputs(tmp_path, monkeypatch):
    done = invoke(tmp_path)
    assert done.exit_code == 2 and "there is no part: a case NAME.toml with boxes" in done.output
    monkeypatch.setenv("PATH", str(tmp_path))
    done = invoke()
    assert done.exit_code == 2 and 'the program "gmsh"' in done.output


def test_the_ratio_is_to_the_faster_method():
    """With the same number of load steps; of the chosen method, run twice, the quicker run counts."""
    rows = [Row("a", 1.0, 1, *[0] * 5, m, m, 0, 0, 0, 0.0, s, 0.0, 0, 0, 0.0, True) for m, s in (("direct", 4.0),)]
    rows.append(rows[0]._replace(method="iterative", processor_seconds=2.0, path="iterative"))
    rows.append(rows[1]._replace(load_steps=8, processor_seconds=0.1))
    auto = rows[0]._replace(method="auto", processor_seconds=3.0)
    assert over_better(auto, [*rows, auto]) == 1.5
    assert over_better(auto._replace(processor_seconds=5.0), rows) == 2.0
    assert over_better(rows[0], rows) is None and over_better(auto, [rows[0], auto]) is None
    assert over_better(auto, [rows[0], Failure("a", 1.0, 1, "iterative", "it did not end"), auto]) == 1.0
