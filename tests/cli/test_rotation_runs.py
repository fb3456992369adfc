"""Runs with a rotating foundation: on ranks, resumed, killed, and checked from the files."""

import pytest
from check_runs import copied, edit, made
from conftest import run_coulomb
from history_runs import SHOE, TURNTABLE
from report_pages import page_without_pictures
from resumed_rows import rows_of

from coulomb.recheck import check

RUNS = {"drum": SHOE, "turntable": TURNTABLE}


@pytest.mark.parametrize("text", RUNS.values(), ids=RUNS)
def test_the_files_agree(text):
    found = check(made(text))
    assert found.passed and found.recorded, found
    row = rows_of(made(text))[-1]
    assert float(row["bottom_angle"]) == 0.4 and abs(float(row["bottom_torque"])) > 1.0
    assert float(row["bottom_power"]) == pytest.approx(float(row["bottom_torque"]) * 0.4 / 3.0, rel=1e-12)


OTHER_CASES = {
    "angle": lambda c: c["contact"]["rotation"]["angle"][2].__setitem__(1, 0.4000004),
    "axis": lambda c: c["contact"]["rotation"].update(point=[0.0610001, 0.02, -0.5]),
    "no rotation": lambda c: c["contact"].pop("rotation"),
}


@pytest.mark.parametrize("other", OTHER_CASES.values(), ids=OTHER_CASES)
def test_another_rotation_in_the_case(other, tmp_path):
    folder = copied(SHOE, tmp_path / "run")
    edit(folder / "case.json", other)
    failing = [step.number for step in check(folder).steps if not step.passed]
    assert {2, 3, 4} <= set(failing)


def test_on_ranks(tmp_path):
    """Torque, power and energies of one rank, of tetrahedra on a turntable; only one of the ranks prints."""
    (tmp_path / "case.toml").write_text(TURNTABLE)
    done = run_coulomb("run", tmp_path / "case.toml", "--output", tmp_path / "out", ranks=2)
    assert done.stdout.count("all 4 load steps certified") == 1, done.stderr
    for ours, expected in zip(rows_of(tmp_path / "out"), rows_of(made(TURNTABLE)), strict=True):
        for column in ("bottom_torque", "bottom_power", "energy_foundation", "energy_dissipated", "normal_force"):
            scale = abs(float(rows_of(made(TURNTABLE))[-1][column]))
            assert float(ours[column]) == pytest.approx(float(expected[column]), rel=1e-6, abs=1e-6 * scale), column
    assert check(tmp_path / "out").passed


def test_a_case_with_another_rotation_is_not_continued(tmp_path):
    (tmp_path / "case.toml").write_text(SHOE)
    folder = tmp_path / "run"
    run_coulomb("run", tmp_path / "case.toml", "--output", folder)
    edit(folder / "case.json", lambda case: case["contact"]["rotation"]["angle"][2].__setitem__(1, 0.5))
    assert "contact.rotation" in run_coulomb("resume", folder, code=2).stderr


def test_the_report_shows_torque_and_power():
    page = page_without_pictures(made(SHOE), charts=True)
    assert "moves by translation and rotation" in page and "angle = [[0.0, 0.0], [1.0, 0.0], [4.0, 0.4]]" in page
    assert "torque of the contact on the foundation" in page and "power of the contact on the foundation" in page
    assert "Torque of the contact against the angle" in page
