"""Friction that varies over the contact face."""

import json

import numpy as np
import pytest
from conftest import ROOT, make_block, run_coulomb

import coulomb
from coulomb.case.case import read_case

BLOCK = ROOT / "demos" / "block.toml"


def test_a_constant_function_is_the_constant():
    constant, function = make_block(3, 0.3).solve(), make_block(3, lambda x: np.full(x.shape[1], 0.3)).solve()
    assert np.array_equal(constant.contact_force, function.contact_force)


def test_every_node_has_its_own_coefficient():
    problem = make_block(3, lambda x: 0.1 + 0.2 * x[0] * x[1])
    x = problem.surface.x
    assert problem.law.friction == pytest.approx(0.1 + 0.2 * x[:, 0] * x[:, 1])
    solution = problem.solve()
    force = solution.contact_force.reshape(-1, 3)
    friction, bound = np.hypot(force[:, 1], force[:, 2]), problem.law.friction * force[:, 0]
    assert np.all(friction <= bound + 1e-6 * force.max())
    assert np.sum(friction > 0.999 * bound) > 10 and solution.certificate.passed


@pytest.mark.parametrize(
    "solver", [coulomb.InteriorPoint(), coulomb.SuccessiveTresca()], ids=["interior point", "successive Tresca"]
)
def test_no_friction_on_a_part(solver):
    problem = make_block(3, lambda x: np.where(x[0] > 1.5, 0.0, 0.4))
    solution = problem.solve(solver=solver)
    force = solution.contact_force.reshape(-1, 3)
    smooth = problem.surface.x[:, 0] > 1.5
    assert np.all(force[smooth, 1:] == 0.0) and force[smooth, 0].max() > 0.0
    assert np.hypot(*force[~smooth, 1:].T).max() > 0.0 and solution.certificate.passed


def test_slip_stress_as_a_function():
    problem = make_block(3, slip_stress=lambda x: 1e7 * x[0])
    assert problem.slip_bound(problem.b) == pytest.approx(1e7 * problem.surface.x[:, 0] * problem.surface.area)
    assert problem.solve().certificate.passed


@pytest.mark.parametrize(
    ("function", "message"),
    [
        (lambda x: np.nan * x[0], r"friction: must be >= 0 everywhere, but is nan at x = "),
        (lambda x: x, r"friction: the function must return \d+ numbers, but returned shape \(3, \d+\)"),
        (lambda x: x[7], r"friction: .*out of bounds"),
    ],
)
def test_wrong_functions(function, message):
    with pytest.raises(ValueError, match=message):
        make_block(3, function)


def test_regions_of_a_case(tmp_path):
    """Tables by region, of which the last counts: the summary has the range, the answer is that of the function."""
    left = "{box=[[0,0,0],[1.0,1,0]], friction=0.0}"
    strip = "{box=[[0,0,0],[3.0,0.5,0]], friction=0.5}"
    changes = ["mesh.cells=[9,3,3]", f"contact.region=[{left}, {strip}]"]
    problem = read_case(BLOCK, changes).problem()
    x = problem.surface.x
    expected = np.where(x[:, 1] <= 0.5, 0.5, np.where(x[:, 0] <= 1.0 + 1e-9, 0.0, 0.3))
    assert np.array_equal(problem.law.friction, expected)
    arguments = [part for change in changes for part in ("--set", change)]
    done = run_coulomb("run", BLOCK, *arguments, "--set", "output.picture=false", "--output", tmp_path)
    assert "Coulomb friction 0 to 0.5" in done.stdout
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["friction"] == {"min": 0.0, "max": 0.5}
    same = make_block(3, lambda x: np.where(x[1] <= 0.5, 0.5, np.where(x[0] <= 1.0 + 1e-9, 0.0, 0.3))).solve()
    assert summary["force_on_body"]["normal"] == pytest.approx(same.contact_force[0::3].sum(), rel=1e-7)


@pytest.mark.parametrize(
    ("region", "message"),
    [
        ("{box=[[0,0,0],[1,1,0]], slip_stress=1.0}", r"region.0 must give friction, as the contact does"),
        ("{box=[[0,0,0],[1,1,0]]}", r"region.0 must give friction"),
        ("{box=[[0,0,0],[1,1,0]], friction=-1}", r"contact.region.0.friction = -1: should be greater"),
    ],
)
def test_wrong_regions(region, message):
    with pytest.raises(ValueError, match=message):
        read_case(BLOCK, ["mesh.cells=[3,1,1]", f"contact.region=[{region}]"]).problem()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (["solver.max_outer=3"], r'max_outer counts Tresca problems: it needs method = "successive-tresca"'),
        (["solver.method='interior-point'", "solver.newton='schur'"], r'newton = "schur" is for Tresca problems'),
        (
            ["solver.method='interior-point'", "contact={face='bottom', slip_stress=1.0}"],
            r"solver.method is for Coulomb",
        ),
        (["solver.method='newton'"], r"solver.method = 'newton': should be 'auto', 'interior-point' or 'succ"),
    ],
)
def test_incompatible_methods(changes, message):
    with pytest.raises(ValueError, match=message):
        read_case(BLOCK, changes)


def test_every_method_of_a_case_gives_the_same_forces():
    answer = make_block(3).solve().contact_force
    one, other = "method='interior-point'", "method='successive-tresca'"
    for table in (one, other, "newton='dense'", "newton='augmented'", "newton='schur'", f"{other}, newton='dense'"):
        case = read_case(BLOCK, ["mesh.cells=[9,3,3]", f"solver={{{table}}}"])
        solution = case.problem().solve(solver=case.contact_solver())
        assert np.linalg.norm(solution.contact_force - answer) <= 1e-6 * np.linalg.norm(answer), table
