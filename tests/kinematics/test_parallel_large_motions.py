"""Large motions on several ranks, against formulas; run by mpirun, and on one rank with the others."""

import tomllib

import numpy as np
import pytest
from mpi4py import MPI
from rubber_blocks import DRAWN, LAME, MU, RubberBlock
from scipy.optimize import brentq

import coulomb
from coulomb.case.case import Case
from coulomb.kinematics import LargeMotions


def test_a_pressed_block_has_the_stress_of_the_formula():
    one = RubberBlock(
        lambda time, x: np.array([[0.0], [0.0], [-0.4 * time]]) + 0.0 * x, (4, 2, 2), components=(2,), rollers=True
    )
    (step,) = coulomb.LoadHistory([1.0]).steps(LargeMotions(one.body, coulomb.Contact("bottom", friction=0.0)))
    side = brentq(lambda a: MU * (a - 1.0 / a) + LAME * np.log(a * a * 0.6) / a, 0.5, 2.0)
    stress = MU * (0.6 - 1.0 / 0.6) + LAME * np.log(side * side * 0.6) / 0.6
    assert step.solution.valid
    assert step.solution.at_nodes.totals()["normal_force"] == pytest.approx(-stress, rel=1e-7)


def test_two_bodies_slide_past_each_other_as_on_one_rank():
    def way(time, x):
        return np.array([[0.3 * max(time - 1.0, 0.0)], [0.0], [-0.05 * min(time, 1.0)]]) + 0.0 * x

    def force(comm):
        lower = RubberBlock(cells=(3, 1, 1), size=(1.2, 1.0, 0.5), held="bottom", comm=comm)
        upper = RubberBlock(way, cells=(1, 1, 1), size=(0.8, 0.8, 0.5), at=(0.1, 0.1, 0.5), comm=comm)
        both = coulomb.join(lower=lower.body, upper=upper.body)
        contact = coulomb.Contact("upper:bottom", against="lower:top", friction=0.2)
        *_, last = coulomb.LoadHistory([1.0, 1.5]).steps(LargeMotions(both, contact))
        assert last.solution.valid
        return np.array(last.solution.at_nodes.totals()["force"])

    along, _, across = force(MPI.COMM_WORLD)
    assert along == pytest.approx(-0.2 * across, rel=0.1)
    assert force(MPI.COMM_SELF) == pytest.approx([along, 0.0, across], rel=1e-7, abs=1e-3)


def test_a_case_has_the_rows_of_one_rank():
    """On a curved foundation, with facets so coarse that a warning is logged on one rank."""
    case = Case.model_validate(tomllib.loads(DRAWN))
    one, all_ranks = (
        [step.row for step in coulomb.LoadHistory([1.0, 1.5]).steps(case.problem(comm))]
        for comm in (MPI.COMM_SELF, MPI.COMM_WORLD)
    )
    for here, there in zip(one, all_ranks, strict=True):
        size = here["normal_force"]
        for name in here:
            if name.startswith(("force", "normal_force", "prescribed", "energy", "greatest_slip")):
                assert there[name] == pytest.approx(here[name], rel=1e-7, abs=1e-7 * size)
