"""What the tolerance of the solver leaves of totals, beside answers of a tolerance of 1e-11."""

import numpy as np
import pytest

from coulomb import Clamp, Contact, ContactProblem, Material, Traction, box, join, moved, second_order
from coulomb.io.answer import answer_of
from verification import hertz

STEEL = Material(young=2.119e11, poisson=0.277)


def block(mesh):
    loads = [Traction("top", (0.0, 1.0e7, -4.0e7)), Traction("right", (2.0e7, 0.0, 0.0))]
    return ContactProblem(mesh, STEEL, [Clamp("left")], Contact("bottom", friction=0.3), loads)


def two_bodies():
    upper = moved(box((1.0, 0.8, 0.5), (5, 4, 2)), (0.1, 0.1, 0.5))
    mesh = join(lower=box((1.2, 1.0, 0.5), (6, 5, 3)), upper=upper)
    contact, load = Contact("upper:bottom", 0.3, against="lower:top"), Traction("upper:top", (2e6, 1e6, -1e7))
    return ContactProblem(mesh, STEEL, [Clamp("lower:bottom")], contact, [load])


def soft_and_hard():
    """A plate of steel on a pad of rubber and one of steel: A has entries of very different size."""
    rubber, pad = Material(young=2e8, poisson=0.4), box((0.6, 1.0, 0.2), (3, 4, 2))
    bodies = {
        "base": box((2.0, 1.0, 0.4), (6, 3, 2)),
        "soft": moved(pad, (0.1, 0.0, 0.4)),
        "hard": moved(pad, (1.3, 0.0, 0.4)),
        "plate": moved(box((2.0, 1.0, 0.4), (7, 4, 2)), (0.0, 0.0, 0.6)),
    }
    materials = {name: rubber if name == "soft" else STEEL for name in bodies}
    below = [Contact(f"{pad}:bottom", 0.3, against="base:top") for pad in ("soft", "hard")]
    above = [Contact(f"{pad}:top", 0.3, against="plate:bottom") for pad in ("soft", "hard")]
    held, load = [Clamp("base:bottom"), Clamp("plate:right", "xy")], Traction("plate:top", (0.0, 0.0, -1e7))
    return ContactProblem(join(**bodies), materials, held, [*below, *above], [load])


CASES = {
    "block": lambda: block(box((3.0, 1.0, 1.0), (12, 4, 4))),
    "second order": lambda: block(second_order(box((3.0, 1.0, 1.0), (9, 3, 3)))),
    "two bodies": two_bodies,
    "soft and hard": soft_and_hard,
    "Hertz": lambda: hertz.problem(3, 8.0 * hertz.A).at(1.0),
}


@pytest.mark.parametrize("case", CASES)
def test_the_algebraic_part_is_the_error_that_the_tolerance_leaves_at_most(case):
    """At 1e-3 and 1e-4 some nodes are neither open nor closed; from 1e-6 on it is not much more than the tolerance."""
    problem = CASES[case]()
    exact = answer_of(problem.solve(1e-11), 1e-11).totals
    for tolerance in (1e-3, 1e-4, 1e-6, 1e-8):
        answer = answer_of(problem.solve(tolerance), tolerance)
        assert answer.totals.keys() == exact.keys() == answer.algebraic.keys()
        for name, (value, unit) in answer.totals.items():
            error, size = (float(np.max(np.abs(one))) for one in (value - exact[name][0], value))
            assert error <= answer.algebraic[name], (tolerance, name, unit, error, answer.algebraic[name])
            wide = case == "soft and hard" or not name.endswith(("normal_force", "area", "maximum.displacement"))
            assert wide or tolerance > 1e-6 or answer.algebraic[name] <= 30.0 * tolerance * size, name


def test_the_residual_of_an_answer_counts_if_it_is_more_than_the_tolerance():
    """That of `Solution.error`, which knows no other than the default."""
    answer = block(box((3.0, 1.0, 1.0), (6, 2, 2))).solve(1e-3)
    assert answer.result.residual > 1e-5
    found, whole = answer_of(answer, 1e-8).algebraic, answer_of(answer, 1e-3).algebraic
    part = answer.result.residual / 1e-3
    assert found["totals.normal_force"] == pytest.approx(part * whole["totals.normal_force"], rel=1e-12)
