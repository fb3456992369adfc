"""`coulomb check` of tied faces: their forces, stresses and jumps are computed anew from the case."""

import json

import pytest
from case_texts import body
from check_runs import change, copied, made

from coulomb.recheck import check

GLUED = """\
tie = [{ face = "lower:top", against = "upper:bottom" }]
clamp = [{ face = "upper:left" }]
traction = [{ face = "upper:top", value = [1e6, 2e5, -5e6] }]
contact = { face = "lower:bottom", friction = 0.3 }
history = { times = [1.0, 2.0] }
"""
GLUED += body("lower", (1.0, 0.8, 0.4), (4, 3, 2))
GLUED += body("upper", (1.0, 0.8, 0.3), (3, 2, 2), (0.0, 0.0, 0.4), 7e10, 0.34, "tetrahedron", 2)

SPRING = 'spring = [{ face = "plate:left", stiffness = 1e7 }]\n'
SPRUNG = f"""\
{SPRING}tie = [{{ face = "foot:top", against = "plate:bottom" }}]
traction = [{{ face = "plate:right", value = [2e4, 1e4, -3e4] }}]
contact = {{ face = "foot:bottom", friction = 0.3, gap = -1e-5, gap_amplitude = [[0.0, 0.0], [1.0, 1.0]] }}
history = {{ times = [0.5, 1.0] }}
[[rigid_face]]
face = "plate:top"
translation_stiffness = [1e5, 2e5, 5e6]
rotation_stiffness = [300.0, 200.0, 50.0]
"""
SPRUNG += body("foot", (0.1, 0.08, 0.02), (3, 3, 1), young=1e9)
SPRUNG += body("plate", (0.14, 0.12, 0.02), (4, 3, 1), (-0.02, -0.02, 0.02), 5e9)


def test_springs_of_a_rigid_face():
    last = json.loads((made(SPRUNG) / "steps/0002/summary.json").read_text())["reactions"][-1]
    assert last["name"] == "spring_plate:top" and abs(last["force"][2]) > 1.0


def largest(values):
    """The largest entry changed by a thousandth."""
    flat = values.reshape(-1)
    flat[abs(flat).argmax()] *= 1.001
    return values


def test_what_a_run_says_of_a_tie():
    assert "tied faces neither open nor slip" in str(check(made(GLUED) / "steps/0002").certificate)
    summary = json.loads((made(GLUED) / "steps/0002/summary.json").read_text())
    assert [tie["face"] for tie in summary["understood"]["ties"]] == ["lower:top"]
    assert max(body["balance"] for body in summary["bodies"]) <= 1e-10
    columns = (made(GLUED) / "history.csv").read_text().splitlines()[0]
    assert "tie_lower:top_force_z" in columns


def test_a_slave_node_that_has_left_its_master_is_noticed(tmp_path):
    folder = copied(GLUED, tmp_path / "run") / "steps/0001"
    change(folder / "solution.h5", "lower/displacement", largest)
    found = check(folder)
    assert not found.certificate.passed and found.faults


SCREWED = """\
clamp = [{ face = "low:bottom" }]
total_force = [{ face = "up:right", force = [0.0, 0.0, 1e4], amplitude = [[1.0, 0.0], [2.0, 1.0]] }]
contact = { face = "up:top", friction = 0.3 }
history = { times = [0.5, 1.0, 1.5, 2.0] }
[[pretension]]
face = "up:bottom"
against = "low:top"
force = -2e5
amplitude = [[0.0, 0.0], [1.0, 1.0]]
lock = 1.0
"""
SCREWED += body("low", (0.1, 0.1, 0.4), (2, 2, 3)) + body("up", (0.1, 0.1, 0.3), (3, 2, 2), (0.0, 0.0, 0.4))


def test_a_bolt_before_and_after_it_is_locked():
    last = json.loads((made(SCREWED) / "steps/0004/summary.json").read_text())
    first = json.loads((made(SCREWED) / "steps/0002/summary.json").read_text())
    assert first["bolts"][0]["force"] == pytest.approx(-2e5, rel=1e-8) and not first["bolts"][0]["locked"]
    assert last["bolts"][0]["locked"] and last["bolts"][0]["force"] != pytest.approx(-2e5, rel=1e-3)
    assert last["bolts"][0]["shortening"] == pytest.approx(first["bolts"][0]["shortening"], rel=1e-12)
