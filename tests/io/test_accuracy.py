"""Numbers below the accuracy of an answer are shown as 0: on the terminal, in the report, in pictures."""

import csv
import json
import re

import numpy as np
import pytest
from check_runs import read_grid
from conftest import ROOT, run_coulomb, with_report
from report_pages import words_of

from coulomb.cli.terminal import forces_in_a_step
from coulomb.io.accuracy import accuracy
from coulomb.pictures.report import picture
from coulomb.pictures.report.picture import plot
from coulomb.units import NARROW, quantity, rounded, vector, with_bar

STUCK = ("mesh.cells=[6,2,2]", "contact.friction=0.9", "traction.1.value=[0,0,0]", "output.picture=false")
"""A block that is pressed straight down and sticks: nothing acts across it, and nothing slips."""


@pytest.fixture(scope="module")
def stuck(tmp_path_factory):
    """Directory and output of such a run."""
    directory = tmp_path_factory.mktemp("accuracy") / "stuck"
    changes = [word for change in ("traction.0.value=[0,0,-4e7]", *STUCK) for word in ("--set", change)]
    done = run_coulomb("run", ROOT / "demos" / "block.toml", *changes, "--output", directory)
    return with_report(directory), done.stdout


def test_natural_scales_of_several_contacts():
    """Their forces have no sum: those of each count."""
    face = {"force": [0.0, 0.0, 0.0], "moment": [0.0, 0.0, 0.0]}
    one = {**face, "normal_force": 200.0, "centre_of_pressure": [0.0, 0.2, 0.1]}
    other = {**face, "normal_force": 100.0, "centre_of_pressure": None}
    summary = {"faces": [one, other], "totals": {}, "mean_compliance": 1e-6, "nodes": {"contact": 4}}
    found = accuracy(summary, 1e-8)
    assert found["N"] == pytest.approx(2e-6) and found["N m"] == pytest.approx(4e-7)
    assert found["m"] == pytest.approx(1e-8 * 1e-6 * 300.0 / 2.0)


def test_the_scale_of_moments_about_the_middle_of_a_contact():
    """Loads and contact act at the origin: their moments are rounding, beside the force at the edge of the contact."""
    moment = {"moment": [1e-15, 0.0, 0.0]}
    totals = {"centre_of_pressure": [1e-18, 0.0, 0.0], "contact_area": 0.01, **moment}
    found = accuracy({"totals": totals, "loads": [{"force": [0.0, 0.0, -1e3], **moment}]}, 1e-8)
    assert found["N m"] == pytest.approx(1e-8 * 1e3 * 0.1)
    found = accuracy({"faces": [{**totals, "force": [0.0, 0.0, 1e3], "normal_force": 1e3}]}, 1e-8)
    assert found["N m"] == pytest.approx(1e-8 * 1e3 * 0.1)


def test_the_prefix_of_a_value_with_an_error_bar_suits_the_larger_one():
    assert with_bar([1.04e8], [5.9e5], "N") == f"104.00 ± 0.59{NARROW}MN"
    both = f"(104.00, 1.20) ± (0.50, 0.60) (mesh) ± (2.1, 0) (inputs){NARROW}MN"
    assert with_bar([1.04e8, 1.2e6], [5e5, 6e5], "N", [2.1e6, 0.0]) == both
    assert with_bar([1e-20], [1.795e-6], "m") == f"0.0 ± 1.8{NARROW}µm"
    assert with_bar([0.0, 1e-3], None, "N") == f"(0, 1){NARROW}mN"


def test_steps_of_several_contacts():
    """With the normal force of each, and the force on the body if there is one."""
    row = {"a against b_normal_force": 3.0, "c_normal_force": 2e-9, "c_force_x": 7.0}
    row |= {"a against b_friction_force": 0.5, "c_friction_force": 0.0}

    def words(row):
        return forces_in_a_step(row, 1e-8).split()

    shown = "a against b: normal 3 N friction 500 mN c: normal 0 N friction 0 N"
    assert words(row) == shown.split()
    on_body = {"force_x": 5.0, "force_y": -1e-9, "force_z": -2.0}
    assert words({**row, **on_body}) == f"{shown} force (5, 0, -2) N".split()
    one = {**on_body, "normal_force": 1e-9, "friction_force": 4.0}
    assert words(one) == "normal 0 N friction 4 N force (5, 0, -2) N".split()
    bolts = {f"bolt_{k}_force": 1e3 for k in range(5)}
    assert forces_in_a_step({**one, **bolts}, 1e-8).endswith("bolt 2 1 kN     and 2 more")


def test_small_numbers_are_0():
    assert rounded([-1e-6, 2.0, -0.0], 1e-5) == [0.0, 2.0, 0.0]
    least = {"N": 1e-5}
    assert quantity(5.729e-14, "N", accuracy=least) == "0\u202fN"
    assert quantity(2e-5, "N", accuracy=least) == "20\u202fµN"
    assert quantity(5.729e-14, "N") != "0\u202fN"  # what is given in a case has no accuracy
    assert vector([1e-6, 2e-5, -3e-4], "N", accuracy=least) == "(0, 20, −300)\u202fµN"


def test_a_run_has_such_numbers(stuck):
    """Else the tests below could not fail."""
    summary = json.loads((stuck[0] / "summary.json").read_text())
    assert 0.0 < abs(summary["force_on_body"]["tangential"][1]) < 1e-8 * summary["force_on_body"]["normal"]
    assert 0.0 < summary["totals"]["greatest_slip"] < 1e-7 * summary["maximum"]["displacement"]


def test_on_the_terminal_and_in_the_report(stuck):
    (line,) = [line for line in stuck[1].splitlines() if line.startswith("force on the body")]
    assert re.search(r"force on the body \(-[\d.]+, 0, [\d.]+\) MN; normal [\d.]+ MN, friction ", line)
    words = words_of(stuck[0])
    assert "largest slip 0 m" in words and "energy dissipated by friction 0 J" in words


def test_in_a_picture(stuck, tmp_path, monkeypatch):
    made, drawn = [], picture.sheet
    monkeypatch.setattr(picture, "sheet", lambda *given: made.append(drawn(*given)) or made[-1])
    plot(stuck[0], "slip", None, None, tmp_path / "slip.png", None)
    assert "max 0" in [text.get_text() for text in made[0].texts]
    assert np.any(read_grid(stuck[0] / "contact.xdmf").fields["slip"])


def test_on_the_terminal_of_a_history(tmp_path):
    """The block is pressed, then pushed along x: nothing acts along y."""
    changes = ("mesh.cells=[4,4,2]", "history={end=2.0, steps=2}", "output.picture=false")
    given = [word for change in changes for word in ("--set", change)]
    done = run_coulomb("run", ROOT / "demos" / "history.toml", *given, "--output", tmp_path / "h", code=None)
    shown = [re.search(r"force \((.*?), (.*?), (.*?)\) N", line) for line in done.stdout.splitlines() if "open" in line]
    with (tmp_path / "h" / "history.csv").open() as file:
        written = [[float(row[f"force_{axis}"]) for axis in "xyz"] for row in csv.DictReader(file)]
    assert any(row[1] != 0.0 for row in written)
    for line, row in zip(shown, written, strict=True):
        assert line.group(2) == "0" and float(line.group(3)) == pytest.approx(row[2], rel=1e-3)
