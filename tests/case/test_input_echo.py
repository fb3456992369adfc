"""The list of loads, supports and contact pairs before the solution, against formulas."""

import json

import numpy as np
import pytest
from conftest import run_coulomb

import coulomb
from coulomb import Clamp, Contact, ContactProblem, Material, Plane, PrescribedDisplacement, Spring, Traction
from coulomb.model.input_echo import contacts_of, loads_of, supports_of

CASE = """
mesh = { box = [2.0, 1.0, 0.5], cells = [4, 2, 2], cell = "CELL" }
material = { young = 2e11, poisson = 0.3 }
clamp = [{ face = "left", components = "xz" }]
spring = [{ face = "right", stiffness = [0, 1e9, 0] }]
traction = [{ face = "top", value = [1e5, 0, -2e6], amplitude = [[0, 0], [1, -0.5], [2, 1], [3, 0.2]] }]
history = { times = [1, 2, 3] }
output = { picture = false }
[contact]
face = "bottom"
friction = 0.3
foundation = { point = [0, 0, -0.001], normal = [0.0, 0.0, 1.0] }
motion = [[0, 0, 0, 0], [3, 0, 0, 1e-3]]
"""
EXPECTED = [
    "load     traction on 'top', largest at 2 s: force (200000, 0, -4e+06) N, "
    "moment about the origin (-2e+06, 4.1e+06, -100000) N m",
    "support  clamp on 'left': x, z",
    "support  spring on 'right': stiffness (0, 1e+09, 0) N/m^3",
    "contact  'bottom': 12 nodes, Coulomb friction 0.3, gap 1 mm; plane, point (0, 0, -0.001), "
    "normal_vector (0, 0, 1), moves by translation",
]
"""Force F = t A = 2 m^2 (1e5, 0, -2e6) N at the middle of the top x = (1, 0.5, 0.5): moment x times F."""


def listed(text):
    return [line for line in text.splitlines() if line.startswith(("load ", "support ", "contact  "))]


def test_check_case_on_ranks(tmp_path):
    """Resultants, supports and gaps, the method and the memory of all ranks."""
    (tmp_path / "case.toml").write_text(CASE.replace("CELL", "tetrahedron"))
    done = run_coulomb("check-case", tmp_path / "case.toml", ranks=2)
    assert done.returncode == 0, done.stderr
    assert listed(done.stdout) == EXPECTED
    assert "K direct (nested dissection, on the first rank), A explicit" in done.stdout
    assert "GB of memory on 2 ranks" in done.stdout


def test_a_run_lists_and_keeps_it(tmp_path):
    (tmp_path / "case.toml").write_text(CASE.replace("CELL", "hexahedron"))
    done = run_coulomb("run", tmp_path / "case.toml", "--output", tmp_path / "out", "--force")
    assert listed(done.stdout) == EXPECTED, done.stderr
    understood = json.loads((tmp_path / "out/steps/0001/summary.json").read_text())["understood"]
    assert [one["holds"] for one in understood["supports"]] == ["x, z", "stiffness (0, 1e+09, 0) N/m^3"]
    assert understood["contacts"][0]["gap"]["min"] == pytest.approx(
        1e-3 - 1e-3 / 3, rel=1e-12
    )  # at the end of the step
    quiet = run_coulomb("run", tmp_path / "case.toml", "--output", tmp_path / "quiet", "--quiet", "--force")
    assert quiet.stdout == ""


def test_moments_of_a_traction_that_varies():
    """t = (0, 0, -p x y / m^2) on a unit square at z = 1: force -p/4, moment (-p/6, p/6, 0)."""
    p = 3e6
    traction = Traction("top", lambda x: np.outer([0.0, 0.0, -p], x[0] * x[1]))
    contact = Contact("bottom", 0.3, foundation=Plane((0, 0, -0.2), (0.0, 0.1, 1.0)))
    problem = ContactProblem(
        coulomb.box((1, 1, 1), (8, 8, 2)), Material(1e9, 0.3), [Clamp("left")], contact, [traction]
    )
    (load,) = loads_of(problem, [0.0])
    assert load.force == pytest.approx([0.0, 0.0, -p / 4], rel=1e-12)
    assert load.moment == pytest.approx([-p / 6, p / 6, 0.0], rel=1e-12)
    (pair,) = contacts_of(problem)  # along the normal (0, 0.1, 1): 0.2 at y = 0, 0.3 at y = 1, over its length
    assert [pair["gap"]["min"], pair["gap"]["max"]] == pytest.approx(np.array([0.2, 0.3]) / np.hypot(1, 0.1), rel=1e-12)


def test_what_supports_hold():
    turned = PrescribedDisplacement("left", (0, 0, 1e-3), direction=(0, 1.0, 1.0))
    supports = [Clamp("right", "normal"), turned, PrescribedDisplacement("top", (1e-3, 0, -2e-3), "xz")]
    supports += [PrescribedDisplacement("back", lambda x: 0.0 * x, "y")]
    springs, contact = [Spring("front", 1e9)], Contact("bottom", 0.3)
    problem = ContactProblem(coulomb.box((1, 1, 1), (2, 2, 2)), Material(1e9, 0.3), supports, contact, springs=springs)
    assert [one["holds"] for one in supports_of(problem)] == [
        "along the normal",
        "along (0, 1, 1): the part of (0, 0, 0.001) m",
        "x = 0.001 m, z = -0.002 m",
        "y: a function of x",
        "stiffness 1e+09 N/m^3",
    ]
