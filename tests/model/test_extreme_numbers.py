"""Numbers that overflow or vanish, and bodies without load: no certificate passes because of a division by them."""

from dataclasses import fields, replace

import numpy as np
import pytest
from synthetic_evidence import BODY, CASES, failed, synthetic_evidence

import coulomb
from coulomb import Clamp, Contact, ContactProblem, Material, PrescribedDisplacement, Traction, certify
from coulomb.model.certificate import SMALLEST, Evidence, judge
from coulomb.nearest import among

OTHERS = ("comm", "held", "compliance", "blocked", "averaged", "ground", "component", "bodies", "actions", "jump")
OTHERS += ("owner", "place", "part", "faces", "opposite", "pairs", "held_owner", "held_part", "layer")
ARRAYS = [field.name for field in fields(Evidence) if field.name not in OTHERS]


@pytest.mark.parametrize("bad", [np.nan, -np.inf])
@pytest.mark.parametrize("name", [*ARRAYS, "compliance", "ground", "jump"])
def test_values_that_are_not_finite_fail_and_are_named(name, bad):
    evidence, _ = synthetic_evidence()
    others = name in ("jump", "held_gap", "on_foundations")  # of problems with ties, held nodes, foundations under load
    given = np.zeros_like(evidence.x) if others else getattr(evidence, name)
    array = np.array(given, dtype=float)
    array.flat[7 % array.size] = bad
    certificate = judge(replace(evidence, **{name: array if array.ndim else float(array)}))
    assert "finite" in failed(certificate)
    contents = {"x": "coordinates", "on_body": "contact forces on the body", "force": "contact forces", "load": "loads"}
    contents |= {
        "ground": "forces of rigid motions",
        "spring": "springs",
        "internal": "internal forces",
        "gap": "gaps",
        "bound": "slip bounds",
        "jump": "jump of ties",
        "held_gap": "gaps of held nodes",
        "on_foundations": "work on foundations",
        "relative_displacement": "relative displacements",
    }
    assert contents.get(name, name) in certificate["finite"].meaning


@pytest.mark.parametrize(
    ("factor", "contents"),
    [
        ({"newtons": 1e-300}, "scale of contact forces is"),
        ({"newtons": 1e290}, "scale of contact forces is"),
        ({"metres": 1e-290}, "scale of displacements is"),
        ({"metres": 1e-300}, "scale of displacements is"),
        ({"metres": 1e295}, "scale of displacements is"),
        ({"newtons": 1e-200, "metres": 1e100}, "compliance is"),
    ],
)
def test_extreme_scales_fail_and_are_named(factor, contents):
    certificate = judge(in_units(synthetic_evidence()[0], **factor))
    assert "finite" in failed(certificate) and contents in certificate["finite"].meaning


def in_units(e, newtons=1.0, metres=1.0):
    """The same with other units: forces and lengths multiplied."""
    forces = {name: newtons * getattr(e, name) for name in ("internal", "load", "spring", "on_body", "force", "bound")}
    lengths = {
        name: metres * getattr(e, name) for name in ("displacement", "prescribed", "relative_displacement", "gap")
    }
    with np.errstate(over="ignore"):
        ground = newtons * (e.ground / metres)
        inverse = {"compliance": metres * (e.compliance / newtons), "stiffness": newtons * (e.stiffness / metres)}
    return replace(e, **forces, **lengths, ground=ground, **inverse)


@pytest.mark.parametrize(("name", "error", "options"), CASES)
@pytest.mark.parametrize("newtons, metres", [(1e-140, 1e-140), (1e140, 1e140), (1e-180, 1e80), (1e180, 1e-80)])
def test_no_product_of_scales_overflows(name, error, options, newtons, metres):
    """Squares and products of the scales would overflow; the measures are unchanged."""
    evidence, turnover = synthetic_evidence(**options)
    wrong = error(evidence, 1.05 * (0.1 if name == "slip angle" else 1e-6), turnover)
    usual, other = judge(wrong), judge(in_units(wrong, newtons, metres))
    assert failed(other) == failed(usual) and failed(usual) <= {name, "natural residual"} and name in failed(usual)
    assert other[name].value == pytest.approx(usual[name].value, rel=1e-3)


def test_the_limits_of_the_scales():
    """Just inside and just outside."""
    evidence, _ = synthetic_evidence()

    def of(compliance):
        return np.full_like(evidence.compliance, compliance)

    assert judge(replace(evidence, compliance=of(1.1 * SMALLEST)))["finite"].passed
    assert not judge(replace(evidence, compliance=of(0.9 * SMALLEST)))["finite"].passed
    assert judge(replace(evidence, compliance=of(0.9 / SMALLEST)))["finite"].passed
    assert not judge(replace(evidence, compliance=of(1.1 / SMALLEST)))["finite"].passed
    for compliance in (0.0, -1.0):
        assert not judge(replace(evidence, compliance=of(compliance)))["finite"].passed


# --- no load -----------------------------------------------------------------------------------------------


def nothing():
    """No load, no displacement, no force."""
    evidence, _ = synthetic_evidence()
    zero = {name: np.zeros_like(getattr(evidence, name)) for name in ARRAYS if name != "x"}
    return replace(evidence, **zero)


def test_zero_load_passes():
    assert judge(nothing()).passed


@pytest.mark.parametrize(
    ("name", "field", "index", "value"),
    [
        ("penetration", "gap", 3, -1e-12),
        ("clamps", "prescribed", (156, 2), 1e-12),
        ("equilibrium", "load", (120, 0), 1e-12),
        ("natural residual", "gap", 3, -1e-12),
    ],
)
def test_zero_load_with_small_errors_fails(name, field, index, value):
    """Errors of 1e-12 m and 1e-12 N, which an absolute scale of 1 m and 1 N would accept."""
    evidence = nothing()
    array = getattr(evidence, field).copy()
    array[index] = value
    assert name in failed(judge(replace(evidence, **{field: array})))


def test_the_smallest_scale_is_that_of_rounding():
    """A body in rigid motion: forces up to a hundred times the rounding error pass, larger ones fail."""
    evidence = nothing()
    rng = np.random.default_rng(2)
    moved = {"displacement": np.ones((BODY, 3)), "prescribed": 1.0 * evidence.held.components}
    rounding = 1e-6 * rng.uniform(-1.0, 1.0, (BODY, 3))
    resting = replace(evidence, **moved, spring=np.zeros((BODY, 3)), rounding=rounding)
    internal = np.where(evidence.held.components, 0.0, rng.uniform(-1.0, 1.0, (BODY, 3)))
    internal *= np.linalg.norm(rounding) / np.linalg.norm(internal)
    assert judge(replace(resting, internal=95.0 * internal))["equilibrium"].passed
    assert not judge(replace(resting, internal=105.0 * internal))["equilibrium"].passed


# --- runs --------------------------------------------------------------------------------------------------------


def block(young=2e11, load=1e7, clamp=None, foundation=None):
    return ContactProblem(
        coulomb.box((3.0, 1.0, 1.0), (6, 2, 2)),
        Material(young, 0.3),
        [clamp or Clamp("left")],
        Contact("bottom", 0.3, foundation=foundation),
        [Traction("top", (0.0, load, -4.0 * load))] if load else [],
    )


@pytest.mark.parametrize("young", [1e-300, 1e-304, 1e292, 1e300])
def test_a_run_whose_numbers_overflow_is_not_certified(young):
    """Pressed by a clamp: displacements are as usual, forces and compliances beyond all bounds."""
    problem = block(young, load=0.0, clamp=PrescribedDisplacement("top", (1e-4, 0.0, -1e-4)))
    try:
        solution = problem.solve()
    except coulomb.NotConverged as failure:
        solution = problem.solution(failure.result)
    assert "finite" in failed(solution.certificate)


@pytest.mark.parametrize("way", [1e-6, 1e-3, 1.0])
@pytest.mark.parametrize("along", [(0.0, 0.0, 1.0), (0.3, -0.7, 1.0)])
def test_a_body_that_is_lifted_off_passes(way, along):
    """Nothing touches, and the only forces are those of rounding."""
    lift = PrescribedDisplacement("top", tuple(way * c for c in along))
    certificate = block(load=0.0, clamp=lift).solve().certificate
    assert certificate.passed, certificate


def test_a_lifted_body_that_is_wrong_fails():
    """The smallest scales are small: a deformation of 1e-7 of the displacement is detected."""
    problem = block(load=0.0, clamp=PrescribedDisplacement("top", (0.0, 0.0, 1e-3)))
    solution = problem.solve()
    u = solution.displacement.copy()
    u[:, 0] += 1e-10 * np.sin(3.0 * problem.elasticity.x[:, 0]) * (~problem.elasticity.held.components[:, 0])
    assert "equilibrium" in failed(certify(problem, solution.contact_force, u))


def test_places_are_found_beside_a_point_at_the_origin():
    x, origin = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), np.array([[1e-20, 0.0, 0.0]])
    assert among(x, origin).tolist() == [True, False]
