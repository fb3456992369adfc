"""The list of loads, supports and contact pairs before the solution, against formulas."""

import json
import tomllib

import numpy as np
import pytest
from conftest import run_coulomb

import coulomb
from coulomb import Clamp, Contact, ContactProblem, Material, Plane, PrescribedDisplacement, Spring, Traction
from coulomb.case.case import Case
from coulomb.cli.terminal import changes_in_words
from coulomb.model.input_echo import contacts_of, loads_of

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
    "load     traction on 'top', largest at 2 s: force (0.2, 0, -4) MN, moment about the origin (-2, 4.1, -0.1) MN m",
    "support  clamp on 'left': x, z",
    "support  spring on 'right': stiffness (0, 1e+09, 0) N/m^3",
    "contact  'bottom': 12 nodes, Coulomb friction 0.3, gap 1 mm; plane, point (0, 0, -0.001), "
    "normal (0, 0, 1), moves by translation",
]
"""Force F = t A = 2 m^2 (1e5, 0, -2e6) N at the middle of the top x = (1, 0.5, 0.5): moment x times F."""


def listed(text):
    return [line for line in text.splitlines() if line.startswith(("load ", "support ", "contact  "))]


def test_check_case_on_ranks(tmp_path):
    """Resultants, supports and gaps, the method and the memory of all ranks."""
    (tmp_path / "case.toml").write_text(CASE.replace("CELL", "tetrahedron"))
    done = run_coulomb("check-case", tmp_path / "case.toml", ranks=2)
    assert listed(done.stdout) == EXPECTED
    assert "K direct (nested dissection, on the first rank), A explicit" in done.stdout
    assert "GB of memory on 2 ranks" in done.stdout


def test_a_run_lists_and_keeps_it(tmp_path):
    (tmp_path / "case.toml").write_text(CASE.replace("CELL", "hexahedron"))
    done = run_coulomb("run", tmp_path / "case.toml", "--output", tmp_path / "out", "--force", code=None)
    assert listed(done.stdout) == EXPECTED, done.stderr
    understood = json.loads((tmp_path / "out/steps/0001/summary.json").read_text())["understood"]
    assert [one["holds"] for one in understood["supports"]] == ["x, z", "stiffness (0, 1e+09, 0) N/m^3"]
    assert understood["contacts"][0]["gap"]["min"] == pytest.approx(
        1e-3 - 1e-3 / 3, rel=1e-12
    )  # at the end of the step
    quiet = run_coulomb("run", tmp_path / "case.toml", "--output", tmp_path / "quiet", "--quiet", "--force", code=None)
    assert quiet.stdout == ""


def test_what_a_load_step_changes():
    """With its value at the end of the step, at half of the amplitudes; what stays is not named."""
    half = [(0.0, 0.0), (1.0, 0.0), (3.0, 1.0)]
    tables = {
        "prescribed_displacement": [{"face": "left", "value": [0.0, 0.0, -2e-3]}],
        "prescribed_rotation": [{"face": "right", "point": [0, 0, 0], "axis": [1, 0, 0], "angle": 0.1}],
        "traction": [{"face": "top", "value": [2e6, 0, -4e6]}, {"face": "front", "value": ["x", 0, 0]}],
        "pressure": [{"face": "top", "value": 3e6}],
        "total_force": [{"face": "top", "force": [0, 5e3, 0]}],
        "point_load": [{"face": "back", "moment": [0, 0, 7.0]}],
    }
    case = tomllib.loads(CASE.replace("CELL", "hexahedron"))
    del case["clamp"], case["traction"]
    for kind, given in tables.items():
        case[kind] = [{**table, "amplitude": half} for table in given]
    case["gravity"], case["gravity_amplitude"] = [0, 0, -9.81], [(0, 1)]
    case["contact"]["rotation"] = {"point": [0, 0, 0], "axis": [0, 0, 1], "angle": [(0, 0), (2, np.pi)]}
    case["contact"]["motion"] = [(0, 0, 0, 0), (1, 0, 0, 0), (3, 0, 0, 2e-3)]

    def changes(kept, before=1.0):
        others = {key: value for key, value in case.items() if key not in tables or key == kept}
        others["contact"] = {k: v for k, v in case["contact"].items() if k not in ("motion", "rotation") or k == kept}
        return changes_in_words(Case.model_validate(others), before, 2.0)

    assert changes("prescribed_displacement") == "'left' z -1 mm"
    assert changes("prescribed_rotation") == "'right' turned 2.865 deg"
    assert changes("traction") == "traction on 'top' (1, 0, -2) MPa, traction on 'front' times 0.5"
    assert changes("pressure") == "pressure on 'top' 1.5 MPa" and changes("total_force") == "force on 'top' y 2.5 kN"
    assert changes("point_load") == "moment on 'back' z 3.5 N m"
    assert changes("motion") == "foundation of 'bottom' z 1 mm" and changes("rotation") == "foundation turned 180 deg"
    assert changes("", 2.0) == changes("gravity") == ""


def test_a_locked_bolt_changes_no_more():
    """Its curve may end there."""
    table = tomllib.loads(CASE.replace("CELL", "hexahedron"))
    curve = {"table": [[0, 0], [1, 1]], "after": "error"}
    table["mesh"] = {"file": "bolt.msh", "cut": ["s"]}
    table["pretension"] = [{"face": "s", "force": 1e4, "lock": 1.0, "amplitude": curve}]
    del table["traction"], table["contact"]["motion"]
    case = Case.model_validate(table)
    assert changes_in_words(case, 0.0, 0.5) == "bolt 's' 5 kN" and changes_in_words(case, 0.5, 1.0) == "bolt 's' 10 kN"
    assert changes_in_words(case, 1.0, 2.0) == ""


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
    assert [one["holds"] for one in problem.elasticity.support_entries()] == [
        "along the normal",
        "along (0, 1, 1): the part of (0, 0, 1) mm",
        "x = 1 mm, z = -2 mm",
        "y: a function of x",
        "stiffness 1e+09 N/m^3",
    ]
