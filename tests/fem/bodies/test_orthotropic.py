"""Orthotropic friction: sliding and forces against the ellipse, curved faces, methods, files, wrong inputs."""

import csv
import json
import math
import re

import numpy as np
import pytest
from conftest import PRESSED_CASE, STEEL, make_block, run_coulomb
from report_pages import page_without_pictures

import coulomb
from coulomb import Clamp, Contact, ContactProblem, LoadHistory, PrescribedDisplacement, Sphere
from coulomb.case.case import read_case
from coulomb.io.output import write
from coulomb.io.summary import summary
from coulomb.recheck import check
from coulomb.solvers import IterativeSolver

F1, F2 = 0.3, 0.1
TIMES = [1.0, 2.0, 6.0, 10.0, 11.0]
PRESSED = PrescribedDisplacement("top", (0.0, 0.0, -2e-4), "z", amplitude=[(0, 0), (1, 1)])


def unit(degrees):
    return np.array([math.cos(math.radians(degrees)), math.sin(math.radians(degrees))])


def force_for_slip(slip, N, direction=0.0):
    """T on a body that slides along `slip`, by the associated rule: where the ellipse's outward normal is -slip."""
    turn = np.column_stack([unit(direction), unit(direction + 90.0)])
    along = turn.T @ slip
    scaled = np.array([F1**2, F2**2]) * along * N
    return -turn @ scaled / math.sqrt(F1**2 * along[0] ** 2 + F2**2 * along[1] ** 2)


def drawn(angle, cell="hexahedron", direction=(1.0, 0.0, 0.0)):
    """A cube pressed on its foundation and drawn along an angle, until all of it slides by 5 mm a step."""
    way = PrescribedDisplacement("top", (*unit(angle), 0.0), "xy", amplitude=[(1, 0), (2, 1e-3), (11, 46e-3)])
    return ContactProblem(
        coulomb.box((1.0, 1.0, 1.0), (3, 3, 3), cell),
        STEEL,
        [PRESSED, way],
        Contact("bottom", (F1, F2), direction=direction),
    )


def sliding(problem):
    steps = list(LoadHistory(TIMES, tolerance=1e-11).steps(problem))
    assert all(step.solution.certificate.passed for step in steps), steps[-1].solution.certificate
    return steps


@pytest.mark.parametrize(
    ("cell", "direction", "angle"),
    [("hexahedron", 0.0, 20.0), ("hexahedron", 0.0, 90.0), ("tetrahedron", 30.0, 0.0), ("tetrahedron", 30.0, 70.0)],
)
def test_block_drawn_along_an_angle(cell, direction, angle):
    """T is the point of the ellipse whose normal is opposite to the given slip; |T| s is dissipated."""
    *_, before, last = sliding(drawn(angle, cell, (*unit(direction), 0.0)))
    total = last.solution.at_nodes.totals()
    expected = force_for_slip(unit(angle), total["normal_force"], direction)
    assert total["force"][:2] == pytest.approx(expected, abs=1e-7 * np.linalg.norm(expected))
    work = -expected @ unit(angle) * 5e-3
    assert last.state.energy.dissipated - before.state.energy.dissipated == pytest.approx(work, rel=1e-7)
    assert last.state.energy.prescribed - before.state.energy.prescribed == pytest.approx(work, rel=1e-7)
    fields = last.solution.at_nodes.fields()
    slip = fields["slip"][:, :2] / 5e-3
    assert np.allclose(slip, unit(angle), rtol=0.0, atol=1e-7) and np.allclose(fields["friction_use"], 1.0, atol=1e-9)
    sums = fields["friction_traction"] * fields["area"][:, None]
    assert sums.sum(axis=0) == pytest.approx([*total["force"][:2], 0.0], rel=1e-9, abs=1e-3)


AXES = {"friction": (F1, F2), "direction": (1.0, 0.5, 0.0)}


def block(contact=AXES, **options):
    return make_block(3, **contact, **options)


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_friction_of_every_node_is_in_its_ellipse(cell, tmp_path):
    """From the written space vectors: T inside the ellipse, on it where there is slip, slip along its normal."""
    solution = block(cell=cell).solve(1e-10)
    assert solution.certificate.passed
    fields, surface = solution.at_nodes.fields(), solution.problem.surface
    axis = np.array([1.0, 0.5, 0.0]) / math.hypot(1.0, 0.5)
    across = np.array([-axis[1], axis[0], 0.0])
    N = fields["contact_force"][:, 2]
    T = fields["contact_force"] @ np.column_stack([axis, across])
    slip = fields["slip"] @ np.column_stack([axis, across])
    use = np.hypot(T[:, 0] / F1, T[:, 1] / F2)
    assert np.all(use <= N + 1e-7 * N.max())
    slips = fields["status"] == 2
    assert 5 < np.sum(slips) < len(N) and use[slips] == pytest.approx(N[slips], abs=2e-3 * N.max())
    assert np.allclose(fields["friction_use"][N > 0], (use / np.where(N > 0, N, 1.0))[N > 0], atol=1e-12)
    normal = -T / np.array([F1, F2]) ** 2
    sure = slips & (np.linalg.norm(slip, axis=1) > 1e-3 * np.abs(slip).max()) & (N > 1e-2 * N.max())
    turned = normal[:, 0] * slip[:, 1] - normal[:, 1] * slip[:, 0]
    assert np.sum(sure) > 5
    assert np.all(np.abs(turned[sure]) <= 1e-4 * (np.linalg.norm(normal, axis=1) * np.linalg.norm(slip, axis=1))[sure])
    assert solution.at_nodes.dissipated_energy == pytest.approx(-np.sum(T * slip), rel=1e-9)
    assert np.allclose(fields["slip"], solution.displacement[surface.nodes] * [1, 1, 0], atol=1e-15)
    write(solution, tmp_path)
    assert check(tmp_path).passed
    written = json.loads((tmp_path / "summary.json").read_text())
    force = written["force_on_body"]
    along = np.array(force["vector"]) @ np.column_stack([axis, np.cross([0.0, 0.0, -1.0], axis)])
    assert force["tangential"] == pytest.approx(along, rel=1e-9)
    assert (
        written["friction"] == F1
        and written["friction_along"] == F1
        and written["friction_across"] == pytest.approx(F2)
    )


def test_components_and_vectors_of_a_surface():
    """The conversions of forces and displacements are inverse to each other and preserve work."""
    surface, rng = block().surface, np.random.default_rng(3)
    force, way = rng.standard_normal((2, len(surface.nodes), 3))
    assert np.allclose(surface.force_components(surface.vectors(force)), force)
    assert np.allclose(surface.components(surface.displacements(way)), way)
    assert np.sum(surface.vectors(force) * surface.displacements(way)) == pytest.approx(np.sum(force * way))


def test_equivalent_descriptions():
    """F1 = F2 is one coefficient; axes may be exchanged; a direction may point to either side, and out of the plane."""
    one = block({"friction": 0.2}).solve(1e-10)
    same = block({"friction": (0.2, 0.2), "direction": (1.0, 0.5, 0.0)}).solve(1e-10)
    assert np.array_equal(one.contact_force, same.contact_force)
    assert summary(same)["friction_along"] is None
    known = block().solve(1e-10).force_on_body
    for other in (
        {"friction": (F2, F1), "direction": (-0.5, 1.0, 0.0)},
        {"friction": (F1, F2), "direction": (-2.0, -1.0, 0.0)},
        {"friction": (F1, F2), "direction": (1.0, 0.5, -3.0)},
        {"friction": (lambda x: F1 + 0.0 * x[0], F2), "direction": lambda x: np.outer([1.0, 0.5, 0.0], 1.0 + x[0])},
    ):
        assert np.linalg.norm(block(other).solve(1e-10).force_on_body - known) <= 1e-8 * np.linalg.norm(known)


def test_methods_agree():
    """Factorised, formed and matrix-free; interior point, successive Tresca and condensed."""
    given = {**AXES, "cohesion": 3e6}
    known = block(given).solve(1e-10).force_on_body
    free = {"linear_solver": IterativeSolver, "explicit": False}
    formed = {"linear_solver": coulomb.solvers.DirectSolver, "explicit": True}
    for options, solver in (
        ({}, coulomb.SuccessiveTresca(1e-10)),
        (free, None),
        (formed, None),
        (free, coulomb.InteriorPoint(1e-10, newton=coulomb.solvers.CondensedSystem())),
    ):
        solution = block(given, **options).solve(1e-10, solver)
        assert solution.certificate.passed
        assert np.linalg.norm(solution.force_on_body - known) <= 1e-7 * np.linalg.norm(known)


def ball(**options):
    """A block of steel on a ball that moves along x and y: normals, and with them the tangents, turn in each step."""
    path = [(0, 0, 0, 0), (1, 0, 0, 2e-3), (2, 6e-3, 3e-3, 2e-3), (3, 0, 8e-3, 2e-3)]
    contact = Contact(
        "bottom", (0.4, 0.1), direction=(1.0, 1.0, 0.3), foundation=Sphere((0.5, 0.5, -2), 2), motion=path
    )
    return ContactProblem(coulomb.box((1.0, 1.0, 0.5), (4, 4, 2)), STEEL, [Clamp("top")], contact, **options)


def test_frames_that_turn():
    """The direction is projected at each node; every step is certified, with the same forces by each method."""
    history = LoadHistory([1.0, 2.0, 3.0], tolerance=1e-10)
    known = [step.solution.force_on_body for step in history.steps(ball())]
    first = None
    for step, expected in zip(history.steps(ball(linear_solver=IterativeSolver)), known, strict=True):
        solution = step.solution
        assert solution.certificate.passed
        assert np.linalg.norm(solution.force_on_body - expected) <= 1e-7 * np.linalg.norm(expected)
        n, t1, t2 = (solution.problem.surface.frames[:, k] for k in range(3))
        along = np.array([1.0, 1.0, 0.3]) - n * (n @ [1.0, 1.0, 0.3])[:, None]
        assert np.allclose(t1, along / np.linalg.norm(along, axis=1)[:, None], atol=1e-12)
        assert np.allclose(t2, 0.25 * np.cross(n, t1), atol=1e-12)
        first = n if first is None else first
    assert np.abs(n - first).max() > 1e-3


CASE = (
    PRESSED_CASE
    + """\
[[prescribed_displacement]]
face = "top"
components = "xy"
value = [0.8, 0.6, 0]
amplitude = [[1, 0], [2, 1e-3], [8, 31e-3]]
[contact]
face = "bottom"
friction = [0.3, 0.1]
direction = [1, 0.5, 0]
[history]
times = [1, 2, 7, 8]
[solver]
tolerance = 1e-10
[output]
picture = false
"""
)


def test_case_file(tmp_path, factor=0.5):
    """The force, the check, the report, and faults in the case."""
    amplitude = f"friction_amplitude = [[2, 1], [7, {factor}]]"
    text = CASE.replace("CELL", "tetrahedron").replace("[history]", f"{amplitude}\n[history]")
    (tmp_path / "case.toml").write_text(text)
    done = run_coulomb("run", "case.toml", "--output", "out", cwd=tmp_path)
    assert "Coulomb friction 0.3 along and 0.1 across" in done.stdout
    with (tmp_path / "out" / "history.csv").open() as file:
        last = list(csv.DictReader(file))[-1]
    slip = np.array([0.8, 0.6])
    expected = factor * force_for_slip(slip, float(last["normal_force"]), math.degrees(math.atan2(0.5, 1.0)))
    T = np.array([float(last["force_x"]), float(last["force_y"])])
    assert np.linalg.norm(T - expected) <= 1e-6 * np.linalg.norm(expected)
    assert check(tmp_path / "out").passed
    report = page_without_pictures(tmp_path / "out").replace("\u202f", " ")
    assert "Coulomb friction 0.15 along and 0.05 across" in report
    assert f"friction_amplitude = [[2.0, 1.0], [7.0, {factor}]]" in report
    written = (tmp_path / "out" / "case.json").read_text()
    for changes in (
        {"friction": [0.3, 0.10001]},
        {"direction": [1, 0.50001, 0]},
        {"friction": [0.1, 0.3]},
        {"friction_amplitude": [[2, 1], [7, 0.99 * factor]]},
    ):
        changed = json.loads(written)
        changed["contact"].update(changes)
        (tmp_path / "out" / "case.json").write_text(json.dumps(changed))
        assert not check(tmp_path / "out" / "steps" / "0004").passed


def test_regions():
    """A region has one coefficient or two, in the direction of the face."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("coulomb.case.case.read_text", lambda *given: CASE.replace("CELL", "hexahedron"))
        regions = "{box=[[0,0,0],[0.4,1,1]], friction=0.2}, {box=[[0.9,0,0],[1,1,1]], friction=[0.05, 0.2]}"
        problem = read_case("case.toml", [f"contact.region=[{regions}]"]).problem()
    x, surface = problem.surface.x[:, 0], problem.surface
    pair = problem.law.friction[:, None] * np.linalg.norm(surface.frames[:, 1:], axis=2)
    assert np.allclose(pair[x < 0.4], 0.2) and np.allclose(pair[x > 0.9], [0.05, 0.2])
    assert np.allclose(pair[(x > 0.4) & (x < 0.9)], [0.3, 0.1])


@pytest.mark.parametrize(
    ("contact", "message"),
    [
        ({"friction": (0.3, 0.1)}, "two coefficients of friction, (along, across), need a direction"),
        ({"friction": 0.3, "direction": (1, 0, 0)}, "a direction needs two coefficients of friction, (along, across)"),
        (
            {"slip_stress": 1e6, "direction": (1, 0, 0)},
            "a direction needs two coefficients of friction, (along, across)",
        ),
        ({"friction": (0.3, 0.2, 0.1), "direction": (1, 0, 0)}, "friction must be one number or two"),
        ({"friction": (0.3, -0.1), "direction": (1, 0, 0)}, "friction must be a number >= 0, but is -0.1"),
        (
            {"friction": (0.3, 0.0), "direction": (1, 0, 0)},
            "the smaller coefficient must be at least 0.001 of the larger",
        ),
        ({"friction": (0.3, 1e-4), "direction": (1, 0, 0)}, "friction (0.3, 0.0001) at x = "),
        ({"friction": (0.3, 0.1), "direction": (0, 0, 0)}, "the direction of friction must not be zero"),
        ({"friction": (0.3, 0.1), "direction": (1, 0)}, "direction: the value must have three components"),
        ({"friction": 0.3, "cohesion": -1.0}, "cohesion must be a number >= 0, but is -1.0"),
        (
            {"friction": 0.3, "cohesion": lambda x: -1.0 - x[0]},
            "contact face 'bottom': cohesion: must be >= 0 everywhere",
        ),
    ],
)
def test_wrong_inputs(contact, message):
    with pytest.raises(ValueError, match=re.escape(message)):
        block(contact)


def test_a_clamp_along_a_tangent():
    """Held across a tangent or obliquely to both: friction along what is held, where there is no slip, is zero."""

    def held(direction):
        side = [Clamp("front", "y"), PrescribedDisplacement("top", (2e-3, 0.0, -1e-3), "xz"), Clamp("top", "y")]
        contact = Contact("bottom", (0.3, 0.1), direction=direction)
        return ContactProblem(coulomb.box((1.0, 1.0, 1.0), (3, 3, 3)), STEEL, side, contact)

    for direction in ((1.0, 0.0, 0.0), (1.0, 1.0, 0.0)):
        solution = held(direction).solve(1e-10)
        surface = solution.problem.surface
        assert solution.certificate.passed
        edge = surface.x[:, 1] < 1e-9
        force, slip = solution.contact_force.reshape(-1, 3)[edge], solution.at_nodes.relative_displacement[edge, 1:]
        bound = solution.problem.slip_bound(solution.contact_force)[edge]
        way = np.linalg.norm(slip, axis=1)
        assert np.all(way > 1e-4)  # the edge slips along x: friction is along the slip in the scaled tangents
        assert np.allclose(force[:, 1:], bound[:, None] * slip / way[:, None], atol=1e-8 * bound.max())
