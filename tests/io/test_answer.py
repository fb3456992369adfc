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


CASES = {
    "block": lambda: block(box((3.0, 1.0, 1.0), (12, 4, 4))),
    "second order": lambda: block(second_order(box((3.0, 1.0, 1.0), (9, 3, 3)))),
    "two bodies": two_bodies,
    "Hertz": lambda: hertz.problem(3, 8.0 * hertz.A).at(1.0),
}


@pytest.mark.parametrize("case", CASES)
def test_the_algebraic_part_is_the_error_that_the_tolerance_leaves_at_most(case):
    """At 1e-3 and 1e-4 some nodes are neither open nor closed; at 1e-6 and less it is beyond the fourth digit."""
    problem = CASES[case]()
    exact = answer_of(problem.solve(1e-11), 1e-11).totals
    for tolerance in (1e-3, 1e-4, 1e-6, 1e-8):
        answer = answer_of(problem.solve(tolerance), tolerance)
        assert answer.totals.keys() == exact.keys() == answer.algebraic.keys()
        for name, (value, unit) in answer.totals.items():
            error, size = (float(np.max(np.abs(one))) for one in (value - exact[name][0], value))
            assert error <= answer.algebraic[name], (tolerance, name, unit, error, answer.algebraic[name])
            if tolerance <= 1e-6 and name.endswith(("normal_force", "strain_energy", "area", "maximum.displacement")):
                assert answer.algebraic[name] <= 300.0 * tolerance * size


def test_the_residual_of_an_answer_counts_if_it_is_more_than_the_tolerance():
    """That of `Solution.error`, which knows no other than the default."""
    answer = block(box((3.0, 1.0, 1.0), (6, 2, 2))).solve(1e-3)
    assert answer.result.residual > 1e-5
    found, whole = answer_of(answer, 1e-8).algebraic, answer_of(answer, 1e-3).algebraic
    part = answer.result.residual / 1e-3
    assert found["totals.normal_force"] == pytest.approx(part * whole["totals.normal_force"], rel=1e-12)
