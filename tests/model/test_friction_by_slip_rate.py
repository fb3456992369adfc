"""Friction that depends on time and on the slip rate of the load step before."""

import json
import math
import shutil
from dataclasses import replace

import numpy as np
import pytest
from check_runs import edit
from conftest import run_coulomb
from mpi4py import MPI

import coulomb
from coulomb import (
    Clamp,
    Contact,
    ContactProblem,
    LoadHistory,
    Material,
    Plane,
    SlipRateFriction,
    VariableFriction,
)
from coulomb.case.case import read_case
from coulomb.recheck import check

RUBBER = Material(1e7, 0.3)
FLOOR = Plane((0, 0, 0), (0, 0, 1))
STATIC, KINETIC, DECAY = 0.5, 0.2, 0.1
LAW = SlipRateFriction(STATIC, KINETIC, DECAY)
SPEEDS = (0.02, 0.1, 0.3, 0.05)  # metres per second, for PHASE seconds each
PHASE, STEPS = 80.0, 8


def expected(speed):
    return KINETIC + (STATIC - KINETIC) * math.exp(-speed / DECAY)


def way():
    """Of the floor: up by 1 mm in the first second, then along x at each of the speeds in turn."""
    rows, x, t = [(0.0, 0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 1e-3)], 0.0, 1.0
    for speed in SPEEDS:
        x, t = x + PHASE * speed, t + PHASE
        rows.append((t, x, 0.0, 1e-3))
    return rows


TIMES = [1.0, *(1.0 + PHASE * (k + (j + 1) / STEPS) for k in range(len(SPEEDS)) for j in range(STEPS))]
ENDS = {1.0 + PHASE * (k + 1): speed for k, speed in enumerate(SPEEDS)}


def dragged(friction=LAW, amplitude=1.0, motion=None):
    contact = Contact("bottom", friction, foundation=FLOOR, motion=motion or way(), friction_amplitude=amplitude)
    return ContactProblem(coulomb.box((0.1, 0.1, 0.05), (3, 3, 2)), RUBBER, [Clamp("top")], contact)


def test_drag_falls_with_the_speed():
    """T = F(v) N in steady sliding at each of four speeds, up and down."""
    found = {}
    for step in LoadHistory(TIMES, tolerance=1e-11).steps(dragged()):
        assert step.solution.certificate.passed
        if step.state.time in ENDS:
            found[ENDS[step.state.time]] = step.row["force_x"] / step.row["force_z"]
            assert step.state.slip_rate == pytest.approx(ENDS[step.state.time], rel=1e-9)
    assert found == {speed: pytest.approx(expected(speed), rel=1e-9) for speed in SPEEDS}
    assert found[0.02] > 1.5 * found[0.3]


IN_CASE = [TIMES[0], *TIMES[4 : STEPS + 4 : 4], *TIMES[STEPS + 1 : STEPS + 4]]
"""The first speed, and the beginning of the second."""
LAST = len(IN_CASE)

CASE = f"""
mesh = {{ box = [0.1, 0.1, 0.05], cells = [3, 3, 2] }}
material = {{ young = 1e7, poisson = 0.3 }}
clamp = [{{ face = "top" }}]
solver = {{ tolerance = 1e-11 }}
output = {{ picture = false }}
[contact]
face = "bottom"
friction = {{ static = {STATIC}, kinetic = {KINETIC}, decay_speed = {DECAY} }}
foundation = {{ point = [0, 0, 0], normal = [0, 0, 1] }}
motion = {[list(row) for row in way()]}

[history]
times = {IN_CASE}
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A history from a case file, in whose files nothing is changed."""
    home = tmp_path_factory.mktemp("drag")
    (home / "case.toml").write_text(CASE)
    run_coulomb("run", home / "case.toml", "--output", home / "out")
    return home / "out"


def summary(folder, number):
    return json.loads((folder / "steps" / f"{number:04d}" / "summary.json").read_text())


def test_check_uses_the_slip_rate_of_the_step_before(run, tmp_path):
    """`coulomb check` takes the slip rates from the step before as it is written; another coefficient is refused."""
    found = check(run)
    assert found.passed, found
    assert check(run / "steps" / f"{LAST:04d}").passed
    copy = shutil.copytree(run, tmp_path / "run")
    edit(copy / "case.json", lambda case: case["contact"]["friction"].update(decay_speed=0.11))
    steps = check(copy).steps
    assert not any(step.passed for step in steps)  # each has recorded its case
    bad = [step.number for step in steps if any(fault.startswith("contact.xdmf: friction") for fault in step.faults)]
    assert bad[0] == 3 and len(bad) == LAST - 2  # all that follow a step with slip along the floor


def test_the_first_step_has_the_static_coefficient():
    problem = dragged()
    first, second = LoadHistory(TIMES[:2]).steps(problem)
    assert first.solution.problem.law.friction == pytest.approx(STATIC)
    slip = first.state.slip_rate
    assert second.solution.problem.law.friction == pytest.approx(expected_all(slip), rel=1e-12)
    assert problem.at(3.0).law.friction == pytest.approx(STATIC)  # without a step before there is no slip rate


def expected_all(rates):
    return np.array([expected(rate) for rate in rates])


def test_a_halved_step_keeps_the_rate():
    """The rate is over the duration of the step that was taken."""
    *_, step = LoadHistory([1.0, 2.0, 2.5, 3.0]).steps(dragged())
    *_, finer = LoadHistory([1.0, 2.0, 2.5, 2.75]).steps(dragged())
    assert step.state.slip_rate == pytest.approx(finer.state.slip_rate, rel=2e-2)


def test_amplitude_in_time():
    """T = A(t) F N, and a certificate with the same factor."""
    motion = [(0.0, 0.0, 0.0, 1e-3), (20.0, 2.0, 0.0, 1e-3)]
    problem = dragged(0.4, [(0.0, 1.0), (10.0, 0.5)], motion)
    for step in LoadHistory([4.0, 8.0, 12.0, 16.0, 20.0], tolerance=1e-11).steps(problem):
        assert step.solution.certificate.passed
        factor = max(1.0 - 0.05 * step.state.time, 0.5)
        assert step.solution.problem.law.friction == pytest.approx(0.4 * factor)
    assert step.row["force_x"] / step.row["force_z"] == pytest.approx(0.2, rel=1e-9)


def test_any_function_of_place_time_and_rate():
    """F grows with the rate on one half and falls with time on the other; steady sliding, node by node."""

    def friction(x, time, rate):
        return np.where(x[0] < 0.05, 0.2 + rate, 0.6 - 0.02 * time)

    motion = [(0.0, 0.0, 0.0, 1e-3), (20.0, 2.0, 0.0, 1e-3)]
    problem = dragged(VariableFriction(friction), motion=motion)
    *_, step = LoadHistory([float(k) for k in range(1, 11)], tolerance=1e-11).steps(problem)
    surface, force = step.solution.problem.surface, step.solution.contact_force.reshape(-1, 3)
    ratio = np.hypot(force[:, 1], force[:, 2]) / force[:, 0]
    assert ratio == pytest.approx(np.where(surface.x[:, 0] < 0.05, 0.3, 0.4), rel=1e-3)
    assert step.solution.certificate.passed


def test_a_missing_slip_rate_fails(monkeypatch):
    """An answer with another coefficient than that of the slip rate before is not certified."""
    problem = dragged()
    *_, before, _ = LoadHistory(TIMES[:6]).steps(problem)
    still = replace(before.state, slip_rate=np.zeros_like(before.state.slip_rate))
    answer = problem.at(TIMES[5], still).solve()
    assert answer.certificate.passed
    judged = coulomb.certify(answer.problem, answer.contact_force, answer.displacement, before.state)
    assert not judged.passed


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda: SlipRateFriction(-0.1, 0.2, 0.1), "static must be a number >= 0, but is -0.1"),
        (lambda: SlipRateFriction(0.1, float("nan"), 0.1), "kinetic must be a number >= 0, but is nan"),
        (lambda: SlipRateFriction(0.1, 0.2, 0.0), "decay_speed must be a number > 0 .m/s., but is 0.0"),
        (lambda: SlipRateFriction((0.3, 0.1), 0.2, 0.1), "static must be a number >= 0, but is .0.3, 0.1."),
        (lambda: SlipRateFriction("rough", 0.2, 0.1), "static must be a number >= 0, but is rough"),
        (lambda: SlipRateFriction(0.3, 0.2, (0.1, 0.1)), "decay_speed must be a number > 0 .m/s., but is .0.1, 0.1."),
        (
            lambda: Contact("bottom", (LAW, LAW), direction=(1, 0, 0)),
            "contact: friction that depends on slip rate or pressure",
        ),
        (lambda: Contact("bottom", LAW, direction=(1, 0, 0)), "is the same in all directions: give it alone"),
        (lambda: Contact("bottom", (None, 0.3), direction=(1, 0, 0)), "friction must be a number >= 0, but is None"),
        (lambda: Contact("bottom", slip_stress=LAW), "slip_stress must be a number >= 0, but is SlipRateFriction"),
        (lambda: Contact("bottom", 0.3, cohesion=LAW), "cohesion must be a number >= 0, but is SlipRateFriction"),
        (lambda: dragged(amplitude=lambda t: -1.0), "friction_amplitude must be >= 0, but is -1 at time 0"),
    ],
)
def test_wrong_laws_are_refused(wrong, message):
    with pytest.raises(ValueError, match=message):
        wrong()


def test_regions_by_slip_rate(tmp_path):
    """A region may have a constant, or other numbers of the law."""
    text = CASE.replace(
        "[history]",
        "[[contact.region]]\nbox = [[0, 0, 0], [0.04, 1, 1]]\nfriction = 0.7\n\n[[contact.region]]\n"
        "box = [[0.06, 0, 0], [1, 1, 1]]\nfriction = { static = 0.9, kinetic = 0.8, decay_speed = 0.2 }\n\n[history]",
    )
    (tmp_path / "case.toml").write_text(text)
    contact = read_case(tmp_path / "case.toml").contacts["contact"].contact()
    x = np.array([[0.02, 0.0, 0.0], [0.05, 0.0, 0.0], [0.08, 0.0, 0.0]])
    law = contact.law(x, np.ones(3), 0.0, np.full(3, 0.1), MPI.COMM_SELF)
    assert law.friction == pytest.approx([0.7, expected(0.1), 0.8 + 0.1 * math.exp(-0.5)])
