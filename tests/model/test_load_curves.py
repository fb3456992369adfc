"""Load curves: what they do after their last row, in Python and in case files, from tables and CSV files."""

import json
import shutil

import numpy as np
import pytest
from conftest import STEEL, run_coulomb

import coulomb
from coulomb import Contact, ContactProblem, LoadCurve, LoadHistory, PrescribedDisplacement, Pressure
from coulomb.case.case import read_case
from coulomb.fem.geometry.user_values import evaluate_amplitude, evaluate_motion
from coulomb.recheck import check

ROWS = [(1.0, 0.5), (2.0, 1.5), (4.0, 0.5)]
TIMES, VALUES = zip(*ROWS, strict=True)


def test_the_curve_is_held():
    curve = LoadCurve(TIMES, VALUES)
    assert [curve.at(t)[0] for t in (0.0, 1.0, 1.5, 2.0, 3.0, 4.0, 9.0)] == [0.5, 0.5, 1.0, 1.5, 1.0, 0.5, 0.5]


def test_the_curve_ends_with_an_error():
    curve = LoadCurve(TIMES, VALUES, "error")
    assert curve.at(4.0 + 1e-13)[0] == 0.5  # rounding of the last time
    with pytest.raises(ValueError, match=r"the load curve ends at time 4, but its value at time 4\.1 is needed"):
        curve.at(4.1)


def test_the_curve_is_periodic():
    """From the first row on, with the duration of the table as period; before it constant."""
    curve = LoadCurve(TIMES, VALUES, "repeat")
    times = np.linspace(1.0, 4.0, 31)
    once = [float(np.interp(t, TIMES, VALUES)) for t in times]
    for period in range(4):
        assert [curve.at(t + 3.0 * period)[0] for t in times] == pytest.approx(once, abs=1e-12)
    assert curve.at(0.0)[0] == 0.5


def test_a_time_at_a_row_to_rounding_errors_is_that_of_the_row():
    """With 1e-16 in place of 0 all forces of the step would be rounding errors: it was halved twenty times."""
    curve = LoadCurve([0.0, 0.1, 0.3, 0.5], [0.0, 1.0, 0.0, 1.0])
    assert np.interp(3 * 0.1, curve.times, curve.values) != 0.0 and curve.at(3 * 0.1)[0] == 0.0
    assert curve.at(0.3 + 1e-9)[0] == pytest.approx(5e-9, rel=1e-6)
    repeated = LoadCurve([0.0, 0.1, 0.2], [0.0, 1.0, 0.0], "repeat")
    assert all(repeated.at(0.2 * period)[0] == 0.0 for period in range(1, 200))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([0, 1], [1.0]), "as many times as values"),
        (([0, 1], [0.0, np.nan]), "all of them finite"),
        (([0, 1, 1], [0.0, 1.0, 2.0]), r"the times must increase, but are \[0.0, 1.0, 1.0\]"),
        (([0, 1], [0.0, 1.0], "loop"), "after must be 'hold', 'error' or 'repeat', but is 'loop'"),
        (([0], [1.0], "repeat"), "a curve of one row cannot be repeated"),
    ],
)
def test_wrong_curves(arguments, message):
    with pytest.raises(ValueError, match=message):
        LoadCurve(*arguments)


def test_a_curve_has_the_columns_that_are_needed():
    way = LoadCurve([0, 1], [(0, 0, 0), (1, 2, 3)])
    assert evaluate_motion(way, 0.5, "foundation") == pytest.approx([0.5, 1.0, 1.5])
    assert evaluate_amplitude(LoadCurve(TIMES, VALUES), 1.5, "load") == 1.0
    with pytest.raises(ValueError, match="load: amplitude: the load curve must have 1 column, has 3"):
        evaluate_amplitude(way, 0.5, "load")
    with pytest.raises(ValueError, match="foundation: motion: the load curve must have 3 columns, has 1"):
        evaluate_motion(LoadCurve(TIMES, VALUES), 0.5, "foundation")


def pressed(amplitude, motion, friction):
    mesh = coulomb.box((1.0, 1.0, 0.5), (3, 3, 2), "tetrahedron")
    press = PrescribedDisplacement("top", (0.0, 0.0, -1e-4), amplitude=[(0, 0), (1, 1)])
    contact = Contact("bottom", 0.3, motion=motion, friction_amplitude=friction)
    return ContactProblem(mesh, STEEL, [press], contact, [Pressure("left", 2e6, amplitude)])


def test_an_ended_curve_is_refused_before_the_first_step():
    ending = LoadCurve([0, 1], [0.0, 1.0], "error")
    for given, what in (
        ((ending, None, 1.0), "pressure on 'left': amplitude"),
        ((1.0, None, ending), "contact face 'bottom': friction: amplitude"),
        ((1.0, LoadCurve([0, 1], np.zeros((2, 3)), "error"), 1.0), "motion"),
    ):
        steps = LoadHistory([0.5, 2.0]).steps(pressed(*given))
        with pytest.raises(ValueError, match=f"{what}: the load curve ends at time 1, but its value at time 2 is"):
            next(steps)


# --- case files ---------------------------------------------------------------------------------------------------

CASE = """\
gravity = [0, 0, -9.81]
gravity_amplitude = [[0, 0], [1, 1]]
mesh = { box = [1.0, 1.0, 0.5], cells = [3, 2, 2], cell = "tetrahedron" }
material = { young = 2e11, poisson = 0.3, density = 7850.0 }
clamp = [{ face = "left" }]
pressure = [{ face = "top", value = "1e6*(1 + where(x > 0.5, y, 0))", amplitude = LOAD }]
total_force = [{ face = "right", force = [1e4, 0, 0] }]
contact = { face = "bottom", friction = "0.3 + 0.1*x", motion = WAY }
history = { times = [0.5, 1.0, 1.5, 2.5, 3.5] }
output = { picture = false, directory = "out" }
"""
LOAD = ([[0, 0], [1, 1], [2, 0]], "time,factor\n0, 0\n1, 1\n2, 0\n")
WAY = ([[0, 0, 0, 0], [1, 2e-6, 0, 0]], "# no header\n0 0 0 0\n1 2e-6 0 0\n\n")


def write(folder, load, way):
    text = CASE.replace("LOAD", load).replace("WAY", way)
    (folder / "case.toml").write_text(text)
    (folder / "load.csv").write_text(LOAD[1])
    (folder / "way.csv").write_text(WAY[1])
    return folder / "case.toml"


FILES = ('{ file = "load.csv", after = "repeat" }', '{ file = "way.csv" }')


def run(folder, load, way):
    case = write(folder, load, way)
    run_coulomb("run", case, "--output", folder / "out")
    return folder / "out"


@pytest.fixture(scope="module")
def from_csv(tmp_path_factory):
    """A history whose curves are CSV files; the files are removed afterwards."""
    home = tmp_path_factory.mktemp("csv")
    out = run(home, *FILES)
    (home / "load.csv").unlink()
    (home / "way.csv").write_text("0 0 0 0\n1 0 0 5\n")
    return out


def rows(out):
    steps = sorted((out / "steps").iterdir())
    return [json.loads((step / "summary.json").read_text())["step"]["row"] for step in steps]


def test_csv_files_are_the_same_as_tables(from_csv, tmp_path):
    load = f'{{ table = {LOAD[0]}, after = "repeat" }}'
    same = run(tmp_path, load, str(WAY[0]))
    for a, b in zip(rows(from_csv), rows(same), strict=True):
        assert a["force_z"] == pytest.approx(b["force_z"], rel=1e-6)
    ours, theirs = (json.loads((folder / "case.json").read_text()) for folder in (from_csv, same))
    amplitude = ours["pressure"][0]["amplitude"]
    assert amplitude.pop("file").endswith("load.csv") and amplitude == theirs["pressure"][0]["amplitude"]
    assert ours["contact"]["motion"]["table"] == theirs["contact"]["motion"]


def test_loads_of_the_case_at_its_times(from_csv):
    """The factor of the pressure is 0.5 at time 2.5, a quarter of the second period; weight rho V g, force as given."""
    loads = json.loads((from_csv / "steps" / "0004" / "summary.json").read_text())["loads"]
    found = {load["kind"]: load["force"] for load in loads}
    assert found["gravity"] == pytest.approx([0, 0, -7850.0 * 0.5 * 9.81], abs=1e-6)
    assert found["total_force"] == pytest.approx([1e4, 0, 0], abs=1e-6)
    assert found["pressure"][:2] == pytest.approx([0.0, 0.0], abs=1e-3)
    cell_third = -0.5e6 * (1.0 + (1.0 / 6.0 + 1.0 / 3.0) * 0.5)  # y from the node x = 2/3 on, linear from x = 1/3
    assert found["pressure"][2] == pytest.approx(cell_third, rel=0.02)


def test_check_needs_no_csv_file_and_notices_changes(from_csv, tmp_path):
    found = check(from_csv)
    assert found.passed, found
    changes = (
        lambda case: case["pressure"][0].update(value="1e6*(1 + where(x > 0.5, y, 1e-6))"),
        lambda case: case["pressure"][0]["amplitude"].update(after="hold"),
        lambda case: case.update(gravity=[0, 0, -9.82]),
        lambda case: case["total_force"][0].update(force=[1e4, 0.1, 0]),
        lambda case: case["contact"].update(friction="0.3 + 0.1001*x"),
    )
    copy = shutil.copytree(from_csv, tmp_path / "run")
    for spoil in changes:
        contents = json.loads((from_csv / "case.json").read_text())
        spoil(contents)
        (copy / "case.json").write_text(json.dumps(contents))
        assert not check(copy / "steps" / "0004").passed


def test_resume_needs_no_csv_file(from_csv, tmp_path):
    """The last two steps are computed again, from the rows in case.json."""
    shutil.copytree(from_csv, tmp_path / "run")
    for number in (4, 5):
        shutil.rmtree(tmp_path / "run" / "steps" / f"{number:04d}")
    run_coulomb("resume", tmp_path / "run")
    for a, b in zip(rows(from_csv), rows(tmp_path / "run"), strict=True):
        assert a["force_z"] == pytest.approx(b["force_z"], rel=1e-6)
    assert check(tmp_path / "run").passed


CSV = {
    "time;factor\r\n0;0\r\n1;2.5\r\n": [[0.0, 0.0], [1.0, 2.5]],
    '\ufeff"t [s]"\t"f"\n0\t0\n1e0\t-2\n': [[0.0, 0.0], [1.0, -2.0]],
    "  0   0\n# later\n\n 1   2": [[0.0, 0.0], [1.0, 2.0]],
    "0,0\n1,2\n": [[0.0, 0.0], [1.0, 2.0]],
}


@pytest.mark.parametrize("text", CSV)
def test_csv_files_of_many_kinds(text, tmp_path):
    case = write(tmp_path, '{ file = "load.csv" }', str(WAY[0]))
    (tmp_path / "load.csv").write_text(text, encoding="utf-8", newline="")
    amplitude = read_case(case).pressure[0].amplitude
    assert [list(row) for row in amplitude.table] == CSV[text]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "has no rows of numbers"),
        ("0,0\n1;1,5\n", r"line 2: '1;1,5' should be 2 finite numbers, time, factor; a decimal sign must"),
        ("t;f\n0;0\n1,0;1,x\n", r"line 3: '1,0;1,x' is no row of numbers; a decimal sign must be a point"),
        ("0, nan\n", "line 1: '0, nan' should be 2 finite numbers"),
        ("0, 1, 2\n", "line 1: '0, 1, 2' should be 2 finite numbers, time, factor"),
        ("1, 1\n0, 2\n", r"pressure\.0\.amplitude = .*: load curve: the times must increase"),
    ],
)
def test_wrong_csv_files(text, message, tmp_path):
    case = write(tmp_path, '{ file = "load.csv" }', str(WAY[0]))
    (tmp_path / "load.csv").write_text(text)
    with pytest.raises(ValueError, match=message):
        read_case(case)
