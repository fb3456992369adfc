"""Expressions of place in case files: values, and what is refused."""

import numpy as np
import pytest
from conftest import SMALL_CASE

from coulomb.case.case import read_case
from coulomb.case.expression import Expression

X = np.random.default_rng(5).uniform(0.1, 2.0, (3, 40))
x, y, z = X

VALUES = {
    "0": 0.0 * x,
    "-1e6*(1 + x/2)": -1e6 * (1 + x / 2),
    "x**2 - y*z + 3": x**2 - y * z + 3,
    "-x**2": -(x**2),
    "2**-y": 2**-y,
    "sqrt(x) + abs(y - 1) + exp(-z) + log(x)": np.sqrt(x) + abs(y - 1) + np.exp(-z) + np.log(x),
    "sin(pi*x)*cos(pi*y) + tan(z/2) + tanh(x)": np.sin(np.pi * x) * np.cos(np.pi * y) + np.tan(z / 2) + np.tanh(x),
    "min(x, y, 1)": np.minimum(np.minimum(x, y), 1),
    "max(x, 1.5)": np.maximum(x, 1.5),
    "atan2(y, x)": np.arctan2(y, x),
    "where(x > 1, y, z)": np.where(x > 1, y, z),
    "where(0.5 < x <= 1 and not y > z, 1, 0)": np.where((x > 0.5) & (x <= 1) & ~(y > z), 1, 0),
    "where(x < 0.5 or y < 0.5, 1, 0)": np.where((x < 0.5) | (y < 0.5), 1, 0),
    "(x > 1) + (y > 1)": 1.0 * (x > 1) + 1.0 * (y > 1),
    "-(x > 1)": -1.0 * (x > 1),
    " 1e3 ": 1e3 + 0 * x,
}


@pytest.mark.parametrize("text", VALUES)
def test_values(text):
    assert Expression(text)(X) == pytest.approx(VALUES[text], rel=1e-14, abs=1e-14)
    assert Expression(text)(X).shape == (40,)
    assert Expression(text)(X[:, :0]).shape == (0,)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("sinh(x)", "'sinh' is not a known function"),
        ("where(x > 1, 2)", "where needs 3 values, but has 2"),
        ("sqrt()", "sqrt needs 1 values, but has 0"),
        ("1 +", "is not an expression"),
        ("", "is not an expression"),
        ("x == 1", "is not allowed"),
        ("True", "is not allowed"),
        ("'a'*9", "is not allowed"),
        ("x.tofile('f')", "is not allowed"),
        ("(lambda: 1)()", "is not allowed"),
        ("[c for c in ().__class__.__base__.__subclasses__()]", "is not allowed"),
        ("__import__('os').system('true')", "is not allowed"),
        ("open('/etc/passwd')", "'open' is not a known function"),
        ("f'{x}'", "is not allowed"),
        ("(y := x)", "is not allowed"),
        ("x\0", "is not an expression"),
        ("-" * 200 + "x", "at most 100 operations inside each other"),
        ("(" * 300 + "x" + ")" * 300, "is not an expression"),
        ("x" + "+x" * 600, "at most 1000 characters"),
    ],
)
def test_what_is_refused(text, message):
    with pytest.raises(ValueError, match=message):
        Expression(text)


@pytest.mark.parametrize("text", ["sqrt(x - 1)", "1/(x - x)", "log(0*x)", "9**9**9**9", "exp(1e4*x)"])
def test_values_that_are_not_finite(text):
    with pytest.raises(ValueError, match=r"the expression '.*' is (nan|inf|-inf) at \("):
        Expression(text)(X)


PLACES = """\
body_force = ["10*x", 0, "-5"]
""" + SMALL_CASE.replace("friction = 0.3", 'friction = "0.3 + x/10"\ncohesion = "1e4*(3 - x)"').replace(
    "[contact]",
    """\
[[prescribed_displacement]]
face = "right"
value = ["1e-6*y", 0, "-1e-6*z"]
components = "x"
[[pressure]]
face = "front"
value = "1e5*x"
[contact]""",
)


def test_every_place_where_an_expression_may_stand(tmp_path):
    """Friction and cohesion, prescribed displacement, body force and pressure, as the functions in Python."""
    (tmp_path / "case.toml").write_text(PLACES)
    problem = read_case(tmp_path / "case.toml").problem()
    at, area = problem.surface.x, problem.surface.area
    assert problem.law.friction == pytest.approx(0.3 + at[:, 0] / 10, rel=1e-12)
    assert problem.law.cohesion == pytest.approx(1e4 * (3 - at[:, 0]) * area, rel=1e-12)
    body = problem.elasticity
    right = np.isclose(body.x[:, 0], 3.0)
    assert problem.loading.prescribed[right, 0] == pytest.approx(1e-6 * body.x[right, 1], abs=1e-18)
    found = {applied.load.kind: applied.nodal_force.sum(axis=0) for applied in body.loads}
    assert found["body_force"] == pytest.approx([10 * 4.5, 0, -15], abs=1e-9)
    assert found["pressure"] == pytest.approx([0, 1e5 * 4.5, 0], abs=1e-6)


def test_expressions_by_region_and_direction(tmp_path):
    law = 'friction = ["0.3 + x/10", 0.1]\ndirection = [1, "x", 0]\n[[contact.region]]\n'
    law += 'box = [[0, 0, 0], [1, 1, 1]]\nfriction = ["y", 0.5]'
    (tmp_path / "case.toml").write_text(SMALL_CASE.replace("friction = 0.3", law))
    case = read_case(tmp_path / "case.toml")
    axes = case.contacts["contact"].contact().axes
    assert axes.along(X) == pytest.approx(np.where(np.all(X <= 1.0, axis=0), y, 0.3 + x / 10))
    assert axes.direction(X) == pytest.approx(np.array([1 + 0 * x, x, 0 * x]))
