"""Cohesion, a limit, F by pressure, |x_t| <= min(c a + F x_n, q a): a block that slides, faces with several laws."""

import csv
import json

import numpy as np
import pytest
from conftest import PRESSED_CASE, make_block, run_coulomb

import coulomb
from coulomb import (
    Contact,
    ContactProblem,
    LoadHistory,
    Material,
    Plane,
    PrescribedDisplacement,
    PressureFriction,
    Spring,
)
from coulomb.case.case import read_case
from coulomb.io.output import write
from coulomb.io.summary import summary
from coulomb.linalg.reductions import Reductions
from coulomb.recheck import check

FRICTION, COHESION = 0.3, 4e6
CUBE = Material(2.1e11, 0.3)
TIMES = [float(time) for time in range(1, 10)]
PRESSED = PrescribedDisplacement("top", (0.0, 0.0, -2e-4), "z", amplitude=[(0, 0), (1, 1)])
DRAWN = PrescribedDisplacement("top", (1.0, 0.0, 0.0), "xy", amplitude=[(1, 0), (2, 1e-3), (9, 36e-3)])


def drawn(contact, cell="hexahedron", cells=(3, 3, 3), **options):
    """A cube of 1 m pressed on its foundation and drawn along x until all of it slides by 5 mm a step."""
    return ContactProblem(coulomb.box((1.0, 1.0, 1.0), cells, cell), CUBE, [PRESSED, DRAWN], contact, **options)


def sliding(problem, times=TIMES):
    """The steps of it."""
    steps = list(LoadHistory(times, tolerance=1e-11).steps(problem))
    assert all(step.solution.certificate.passed for step in steps)
    return steps


@pytest.mark.parametrize(
    ("cell", "law"),
    [
        ("hexahedron", {"friction": FRICTION}),
        ("tetrahedron", {"slip_stress": COHESION}),
        ("tetrahedron", {"friction": FRICTION, "cohesion": COHESION}),
        ("hexahedron", {"friction": FRICTION, "cohesion": COHESION, "friction_limit": 8e6}),
        ("tetrahedron", {"friction": PressureFriction((1e6, 1e8), (0.4, 0.2))}),
    ],
    ids=["coulomb", "tresca", "mohr-coulomb", "limit", "by pressure"],
)
def test_force_and_energy_of_steady_sliding(cell, law):
    """T = c A + F N, A = 1 m^2; sliding by s dissipates T s, and the clamp does that work."""
    *_, before, last = sliding(drawn(Contact("bottom", **law), cell))
    total = last.solution.at_nodes.totals()
    cohesion = law.get("cohesion", law.get("slip_stress", 0.0))
    at = last.solution.at_nodes
    F = law.get("friction", 0.0)
    F = np.interp(at.pressure, F.pressures, F.coefficients) if isinstance(F, PressureFriction) else F
    bounds = np.minimum(cohesion + F * at.pressure, law.get("friction_limit", np.inf))
    T = at.area @ bounds if len(law) > 2 or np.ndim(F) else cohesion * 1.0 + F * total["normal_force"]
    assert total["force"][0] == pytest.approx(-T, rel=1e-9)
    assert total["force"][1] == pytest.approx(0.0, abs=1e-5 * T)  # of the beginning, falls in each step
    assert last.state.energy.dissipated - before.state.energy.dissipated == pytest.approx(5e-3 * T, rel=1e-9)
    assert last.state.energy.prescribed - before.state.energy.prescribed == pytest.approx(5e-3 * T, rel=1e-8)
    assert abs(last.state.energy.imbalance - before.state.energy.imbalance) <= 1e-8 * 5e-3 * T
    counts = summary(last.solution)["nodes"]
    assert counts["slip"] == counts["contact"] == 16


CORK = Material(1e7, 0.0)
CLOSING = [(0.0, 0.0, 0.0, 0.0), (1.0, 0.0, 0.0, -1e-3), (3.0, 0.02, 0.0, -1e-3)]
RUBBING = [(1.0, 0.0, 0.0, 0.0), (3.0, 0.02, 0.0, 0.0)]


@pytest.mark.parametrize(
    ("cell", "laws"),
    [
        ("hexahedron", ({"slip_stress": 2e4}, {"friction": 0.2})),
        ("tetrahedron", ({"friction": 0.1}, {"slip_stress": 3e4})),
        ("tetrahedron", ({"friction": 0.1, "cohesion": 1e4}, {"friction": 0.2})),
    ],
    ids=["tresca and coulomb", "coulomb and tresca", "mohr-coulomb and coulomb"],
)
def test_two_faces_with_different_laws(laws, cell, tmp_path):
    """A block held by springs between two plates, both dragged along x: c A + F N on each, A = 0.01 m^2."""
    problem = ContactProblem(
        coulomb.box((0.1, 0.1, 0.05), (3, 3, 2), cell),
        CORK,
        [],
        [
            Contact("bottom", **laws[0], motion=RUBBING),
            Contact("top", **laws[1], foundation=Plane((0, 0, 0.05), (0, 0, -1)), motion=CLOSING),
        ],
        springs=[Spring("left", 1e8), Spring("right", 1e8)],
    )
    *_, last = sliding(problem, [1.0, 1.5, 2.0, 2.5, 3.0])
    for part, law in enumerate(laws):
        total = last.solution.at_nodes.totals(part)
        expected = law.get("cohesion", law.get("slip_stress", 0.0)) * 0.01
        expected += law.get("friction", 0.0) * total["normal_force"]
        assert total["force"][0] == pytest.approx(expected, rel=1e-9)
    write(last.solution, tmp_path)
    contents = json.loads((tmp_path / "summary.json").read_text())
    assert contents["law"] == "mohr-coulomb" and check(tmp_path).passed
    for face, law in zip(contents["faces"], laws, strict=True):
        assert face["friction"] == law.get("friction")
        assert face["cohesion"] == law.get("cohesion", law.get("slip_stress", 0.0))
        assert face["slip_stress"] == law.get("slip_stress")


def test_both_limits():
    """No cohesion is Coulomb's law; no friction is Tresca's with the cohesion for slip stress, by the same solver."""

    for one, other in (
        ({"friction": 0.3, "cohesion": 0.0}, {"friction": 0.3}),
        ({"friction": 0.0, "cohesion": 1e7}, {"slip_stress": 1e7}),
    ):
        a, b = make_block(3, **one).solve(1e-10), make_block(3, **other).solve(1e-10)
        assert np.array_equal(a.contact_force, b.contact_force) and type(a.result) is type(b.result)
        assert summary(a)["law"] == summary(b)["law"]


def test_cohesion_as_a_function():
    """Each node has its own law."""
    problem = make_block(3, friction=0.2, cohesion=lambda x: 3e6 * (1.0 + x[0]))
    solution = problem.solve(1e-10)
    assert solution.certificate.passed
    x, surface = solution.contact_force.reshape(-1, 3), problem.surface
    bound, friction = 3e6 * (1.0 + surface.x[:, 0]) * surface.area + 0.2 * x[:, 0], np.hypot(x[:, 1], x[:, 2])
    assert np.all(friction <= bound + 1e-7 * np.max(bound))
    slips = solution.at_nodes.status == 2
    assert np.any(slips) and friction[slips] == pytest.approx(bound[slips], rel=2e-3)
    assert set(summary(solution)["cohesion"]) == {"min", "max"} and summary(solution)["friction"] == 0.2


def test_cohesion_acts_on_open_nodes():
    """As Tresca's slip stress does: a block that is lifted by 1 um and drawn aside is held back by c A alone."""
    lifted = PrescribedDisplacement("top", (5e-3, 0.0, 1e-6))
    mesh = coulomb.box((1.0, 1.0, 1.0), (2, 2, 2))
    solution = ContactProblem(mesh, CUBE, [lifted], Contact("bottom", 0.3, cohesion=1e3)).solve(1e-10)
    assert solution.certificate.passed
    total, counts = solution.at_nodes.totals(), summary(solution)["nodes"]
    assert total["normal_force"] == 0.0 and total["force"][0] == pytest.approx(-1e3, rel=1e-9)
    assert counts["open"] == counts["slip"] == counts["contact"] == 9
    assert total["dissipated_energy"] == pytest.approx(1e3 * 5e-3, rel=1e-3)  # less what the cube shears by


def test_small_cohesion_of_open_nodes_is_not_set_to_zero():
    """c a on every open node, however small beside the forces of the others."""
    solution = make_block(3, friction=0.3, cohesion=10.0).solve(1e-12)
    x, area = solution.contact_force.reshape(-1, 3), solution.problem.surface.area
    opened = x[:, 0] == 0.0
    assert np.any(opened) and np.hypot(x[opened, 1], x[opened, 2]) == pytest.approx(10.0 * area[opened], rel=1e-2)


CASE = f"""\
contact = {{ face = "bottom", friction = 0.3, cohesion = 4e6 }}
history = {{ times = [1, 2, 3, 4, 5] }}
solver = {{ tolerance = 1e-11 }}
output = {{ picture = false }}
{PRESSED_CASE}
[[prescribed_displacement]]
face = "top"
components = "xy"
value = [1.0, 0, 0]
amplitude = [[1, 0], [2, 1e-3], [5, 16e-3]]
"""


def test_case_file(tmp_path):
    """`coulomb check` computes it again."""
    (tmp_path / "case.toml").write_text(CASE.replace("CELL", "tetrahedron"))
    done = run_coulomb("run", "case.toml", "--output", "out", cwd=tmp_path)
    assert "Mohr-Coulomb friction 0.3, cohesion 4 MPa" in done.stdout
    with (tmp_path / "out" / "history.csv").open() as file:
        last = list(csv.DictReader(file))[-1]
    assert float(last["force_x"]) == pytest.approx(-(4e6 + 0.3 * float(last["normal_force"])), rel=1e-9)
    found = check(tmp_path / "out")
    assert found.passed, found
    changed = json.loads((tmp_path / "out" / "case.json").read_text())
    changed["contact"]["cohesion"] = 4.00001e6
    (tmp_path / "out" / "case.json").write_text(json.dumps(changed))
    assert not check(tmp_path / "out" / "steps" / "0005").passed


def test_regions_and_tables(tmp_path):
    """Friction or cohesion by region; the keys that a region omits are those of the face."""
    (tmp_path / "case.toml").write_text(CASE.replace("CELL", "hexahedron"))
    left = "{box=[[0,0,0],[0.4,1,1]], cohesion=1e6}, {box=[[0.9,0,0],[1,1,1]], friction=0.1}"
    problem = read_case(tmp_path / "case.toml", [f"contact.region=[{left}]"]).problem()
    x, area = problem.surface.x[:, 0], problem.surface.area
    assert np.allclose(problem.law.friction, np.where(x > 0.9, 0.1, 0.3))
    assert np.allclose(problem.law.cohesion, np.where(x < 0.4, 1e6, 4e6) * area)
    assert Reductions(problem.comm).sum(problem.law.cohesion) == pytest.approx(4e6 - 3e6 * 0.5)


@pytest.mark.parametrize("limit", [4e6, lambda x: 2e6 + 4e6 * x[0]], ids=["a number", "by place"])
def test_a_limit_is_judged_from_the_files_alone(tmp_path, limit):
    """The run of a script has no case: the summary has the limit, and one that is changed is noticed."""
    problem = drawn(Contact("bottom", friction=FRICTION, friction_limit=limit), cells=(2, 2, 2)).at(2.0)
    write(problem.solve(), tmp_path)
    found = check(tmp_path)
    assert found.passed, found
    contents = json.loads((tmp_path / "summary.json").read_text())
    contents["faces"][0]["friction_limit"] = 1e6
    (tmp_path / "summary.json").write_text(json.dumps(contents))
    assert not check(tmp_path).passed
