"""The benchmark of real parts: one part by both methods, meshes made by a program, errors."""

import csv
import shutil

import pytest
from conftest import ROOT, run_coulomb

from coulomb.benchmarks.real_parts import PARTS, Failure, Row, over_better, parts_in, run

MESH = ROOT / "demos" / "foot.msh"


def test_both_methods_find_the_same_contact():
    """The foot of the tutorial, on its mesh."""
    rows = [run(PARTS / "foot.toml", MESH, method, 1e-8) for method in ("direct", "iterative")]
    assert [row.path for row in rows] == ["direct", "iterative"]
    for row in rows:
        assert row.certified and row.residual <= 1e-8 and 0.0 < row.setup_processor_seconds < row.processor_seconds
        assert 3 * (row.open + row.stick + row.slip) == row.contact < row.unknowns
        assert row.entries > 27 * row.unknowns  # at least nine nodes are coupled with each, on average
    assert rows[0][2:7] == rows[1][2:7]
    assert rows[1].multigrid_iterations > rows[1].products > 0


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
    done = run_coulomb("benchmark", "parts", parts, *wanted)
    assert done.returncode == 1 and "no volume" in done.stderr and "certificate passed" in done.stdout, done.stderr
    with (tmp_path / "parts.csv").open() as file:
        (row,) = csv.DictReader(file)  # the one after the failure
    assert list(row) == list(Row._fields)
    assert (row["part"], row["clscale"], row["method"], row["path"]) == ("foot", "0.9", "auto", "direct")
    (parts / "foot.toml").write_text((parts / "foot.toml").read_text().replace('"seat"', '"bolt"'))
    done = run_coulomb("benchmark", "parts", parts, "--clscale", 30, "--clscale", 0.9, "--method", "direct")
    assert done.returncode == 1 and "no mesh was made" in done.stderr and "bolt" in done.stderr, done.stderr


def test_every_part_has_a_case_and_a_geometry():
    assert [path.stem for path in parts_in(None)] == ["clip", "foot", "hook", "plate", "ring", "wedge"]
    assert len(list(PARTS.iterdir())) == 12


def test_wrong_inputs(tmp_path, monkeypatch):
    for arguments, message in (
        (("--part", "wheel"), "there is no part 'wheel'"),
        (("--method", "magic"), "--method is direct, iterative or auto, not 'magic'"),
        ((tmp_path,), "there is no part: a geometry NAME.geo"),
    ):
        done = run_coulomb("benchmark", "parts", *arguments)
        assert done.returncode == 2 and message in done.stderr, done.stderr
    monkeypatch.setenv("PATH", str(tmp_path))
    done = run_coulomb("benchmark", "parts")
    assert done.returncode == 2 and 'the program "gmsh"' in done.stderr


def test_the_ratio_is_to_the_faster_method():
    rows = [Row("a", 1.0, *[0] * 5, m, "", 0, 0, 0, 0.0, s, 0.0, 0, 0, 0.0, True) for m, s in (("direct", 4.0),)]
    rows.append(rows[0]._replace(method="iterative", processor_seconds=2.0))
    auto = rows[0]._replace(method="auto", processor_seconds=3.0)
    assert over_better(auto, [*rows, auto]) == 1.5
    assert over_better(rows[0], rows) is None and over_better(auto, [rows[0], auto]) is None
    assert over_better(auto, [rows[0], Failure("a", 1.0, "iterative", "it did not end"), auto]) == 0.75
