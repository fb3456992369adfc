"""`python -m verification`: every row of its table, files, exit codes; and the formulas themselves."""

import csv
import math
import sys
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

from verification import CASES, COARSE
from verification.__main__ import app
from verification.cattaneo_mindlin import FRICTION, LOADED, Moment, PartialSlip, known
from verification.hertz import RADIUS, STEEL, Hertz, grading
from verification.hertz_pairs import CYLINDERS, SPHERES, A, Ellipse
from verification.table import order


@pytest.mark.parametrize("name", CASES)
def test_rows(name):
    """The rows say what is compared, and why the tolerance is what it is."""
    verified = COARSE.get(name, CASES[name])()
    failed = [f"{row.quantity}: {row.ours:g} for {row.formula:g}, {row.why}" for row in verified.rows if not row.passed]
    assert not failed
    assert all(row.why and 0.0 <= row.tolerance <= 0.5 for row in verified.rows)


def run(*arguments):
    return CliRunner().invoke(app, [*map(str, arguments)])


@pytest.fixture(scope="module")
def ssnv128():
    return CASES["ssnv128"]()


def test_table_pictures_and_csv(ssnv128, monkeypatch, tmp_path):
    monkeypatch.setitem(CASES, "ssnv128", lambda: ssnv128)
    done = run("--case", "ssnv128", "--output", tmp_path)
    assert done.exit_code == 0, done.output
    with (tmp_path / "verification.csv").open() as file:
        lines = list(csv.DictReader(file))
    assert len(lines) == 18 and all(line["passed"] == "True" and line["why"] for line in lines)
    assert float(lines[0]["formula"]) == 2.86e-5 and float(lines[0]["ours"]) == pytest.approx(2.86e-5, rel=0.05)
    assert (tmp_path / "ssnv128.png").stat().st_size > 10_000


def test_a_case_without_a_picture(ssnv128, monkeypatch, tmp_path):
    monkeypatch.setitem(CASES, "ssnv128", lambda: replace(ssnv128, panels=()))
    done = run("--case", "ssnv128", "--output", tmp_path)
    assert done.exit_code == 0, done.output
    assert [path.name for path in tmp_path.iterdir()] == ["verification.csv"]


def test_a_row_beyond_its_tolerance_is_a_failure(ssnv128, monkeypatch):
    wrong = replace(ssnv128.rows[0], error=0.051)
    monkeypatch.setitem(CASES, "ssnv128", lambda: replace(ssnv128, rows=(wrong, *ssnv128.rows[1:])))
    done = run("--case", "ssnv128")
    assert done.exit_code == 1
    assert "FAILED" in done.output and "17 of 18 within their tolerance" in done.output


def test_wrong_input_is_refused_before_anything_is_computed(tmp_path):
    done = run("--case", "herz")
    assert done.exit_code == 2 and "there is no case 'herz'; the cases are patch, " in done.output
    (tmp_path / "file").touch()
    done = run("--case", "hertz", "--output", tmp_path / "file" / "out")
    assert done.exit_code == 2 and "cannot be written" in done.output and "pressure" not in done.output


def test_a_table_without_pictures(ssnv128, monkeypatch, tmp_path):
    """Where matplotlib is not installed."""
    monkeypatch.setitem(CASES, "ssnv128", lambda: ssnv128)
    monkeypatch.delitem(sys.modules, "verification.figures", raising=False)
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    done = run("--case", "ssnv128", "--output", tmp_path)
    assert done.exit_code == 0 and "warning: no figure: matplotlib is not installed" in done.output
    assert [path.name for path in tmp_path.iterdir()] == ["verification.csv"]


def test_order():
    assert order([0.1, 0.2, 0.4], [3e-2, 12e-2, 48e-2]) == pytest.approx(2.0)


HERTZ = Hertz(3000.0, RADIUS, STEEL)


def area_under(y, x):
    return float(np.sum(0.5 * (y[1:] + y[:-1]) * np.diff(x)))


def integral(traction, a):
    """Over the disc of radius a."""
    r = np.linspace(0.0, a, 20001)
    return area_under(traction(r) * 2.0 * math.pi * r, r)


def test_hertz_pressure_carries_the_force():
    assert integral(HERTZ.pressure, HERTZ.a) == pytest.approx(HERTZ.P, rel=1e-5)
    assert HERTZ.approach == pytest.approx(HERTZ.a**2 / RADIUS)


def test_traction_of_partial_slip_carries_q():
    """On the first load and on the return; the displacement formulas join at the turn; the loop has its area."""
    theory, largest = PartialSlip(HERTZ), 0.8
    unit = FRICTION * HERTZ.p0 * HERTZ.a**2

    def moment(time, q):
        return Moment(time, q, 0.0, 0.0, np.empty((0, 2)), 0.0, 0.0)

    for time, q in ((LOADED, 0.3), (LOADED, 0.8), (2.5, 0.1), (3.5, -0.6), (5.0, 0.2)):
        carried = unit * integral(lambda r, m=moment(time, q): known(theory, m, r, largest).traction, 1.0)
        assert carried == pytest.approx(q * FRICTION * HERTZ.P, rel=1e-4)
    ends = [
        known(theory, moment(time, q), np.zeros(1), largest).travel for time, q in ((2.0, 0.8), (2.1, 0.8), (4.0, -0.8))
    ]
    assert ends == pytest.approx([ends[0], ends[0], -ends[0]])

    q = np.linspace(-largest, largest, 4001)
    back = np.array([known(theory, moment(3.0, v), np.zeros(1), largest).travel for v in q])
    forth = np.array([known(theory, moment(5.0, v), np.zeros(1), largest).travel for v in q])
    width = theory.d * FRICTION * HERTZ.P * (back - forth)
    assert theory.loop_energy(largest) == pytest.approx(abs(area_under(width, q)), rel=1e-4)


def test_grading_keeps_its_cells_and_fills_the_body():
    place = grading(6, 12, 0.016)
    assert np.diff(place(np.arange(7.0))) == pytest.approx(4e-3 / 3.0 / 6.0)
    assert place(np.array([-12.0, 0.0, 12.0])) == pytest.approx([-0.016, 0.0, 0.016])
    assert np.all(np.diff(place(np.arange(-12.0, 13.0))) > 0.0)


# --- elliptic contact: the pressure on a half space closes the gap of the two bodies ---------------------------------


def sunk(ellipse, x, y):
    """Sum of the normal displacements of both half spaces at a point inside: by Boussinesq, in polar coordinates
    around the point, where the singularity cancels."""
    phi = (np.arange(200) + 0.5) / 200 * 2.0 * np.pi
    s = (np.arange(100) + 0.5) / 100 * np.pi
    c, d = np.cos(phi), np.sin(phi)
    one = (c / ellipse.half_x) ** 2 + (d / ellipse.half_y) ** 2
    two = x * c / ellipse.half_x**2 + y * d / ellipse.half_y**2
    far = (np.sqrt(two**2 + one * (1.0 - (x / ellipse.half_x) ** 2 - (y / ellipse.half_y) ** 2)) - two) / one
    t, weight = np.outer(far, 0.5 - 0.5 * np.cos(s)), np.outer(far, 0.5 * np.sin(s) * np.pi / 100)
    pressure = ellipse.pressure(x + t * c[:, None], y + t * d[:, None])
    return np.sum(pressure * weight) * 2.0 * np.pi / 200 / (np.pi * ellipse.pair.E_star)


@pytest.mark.parametrize("pair", [SPHERES, CYLINDERS], ids=lambda pair: pair.name)
def test_the_pressure_closes_the_gap(pair):
    ellipse, (Rx, Ry) = Ellipse(pair, A), pair.radii
    for x, y in ((0.0, 0.0), (0.5, 0.0), (0.0, 0.5), (0.3, -0.6)):
        place = (x * ellipse.half_x, y * ellipse.half_y)
        gap = place[0] ** 2 / (2.0 * Rx) + place[1] ** 2 / (2.0 * Ry)
        assert sunk(ellipse, *place) == pytest.approx(ellipse.approach - gap, rel=1e-4)


def test_a_circle_is_hertz():
    ellipse = Ellipse(SPHERES, A)
    circle = Hertz(ellipse.P, SPHERES.radii[0], *SPHERES.materials)
    assert [circle.a, circle.p0, circle.approach] == pytest.approx([A, ellipse.p0, ellipse.approach])
