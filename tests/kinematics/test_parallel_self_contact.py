"""A face in contact with itself, on several ranks; run by mpirun, and on one rank with the others."""

import numpy as np
import pytest
from mpi4py import MPI
from rubber_strips import RADIUS, THICKNESS, folded, open_strip, pressed, strip

from coulomb import Contact, LoadHistory
from coulomb.fem.bodies import DisplacementSpace
from coulomb.fem.compat import functionspace
from coulomb.fem.contact import facets_of, two_sides


def test_arms_pressed_shut_as_two_faces_on_one_rank():
    (skin,) = pressed(strip(MPI.COMM_WORLD, 2, 16), Contact("skin", 0.3, against="skin"))
    (pair,) = pressed(strip(MPI.COMM_SELF, 2, 16), Contact("low", 0.3, against="high", slave=True))
    assert skin.valid and pair.valid and pair.at_nodes.totals()["normal_force"] > 1e5
    assert skin.at_nodes.totals()["force"] == pytest.approx(pair.at_nodes.totals()["force"], rel=1e-6, abs=0.1)


def test_a_fold_that_is_not_there_before_deformation_as_two_faces_on_one_rank():
    skin = folded(open_strip(MPI.COMM_WORLD, 16), Contact("skin", 0.3, against="skin"))
    pair = folded(open_strip(MPI.COMM_SELF, 16), Contact("low", 0.3, against="high", slave=True))
    (*_, one), (*_, other) = (LoadHistory((0.4, 0.7, 1.0, 1.5, 2.0)).steps(problem) for problem in (skin, pair))
    assert one.solution.valid and one.solution.at_nodes.totals()["normal_force"] > 1e5
    assert one.solution.at_nodes.totals()["force"] == pytest.approx(
        other.solution.at_nodes.totals()["force"], rel=1e-6, abs=0.1
    )


def test_both_sides_of_an_arm_are_on_one_side_and_the_next_arm_on_the_other():
    mesh = strip(MPI.COMM_WORLD, 4, 48)
    sides, space = two_sides(mesh, mesh.faces["skin"]), DisplacementSpace(functionspace(mesh.domain, 1, (3,)))
    arms = []
    for facets in sides[:2]:
        x, z = facets_of(space, facets)[0].middle.T[[0, 2]]
        arms.append(set(np.round(z[(x > 0.5) & (x < 5.5)] / (2.0 * RADIUS)).tolist()))
    assert arms == [{1.0, 3.0}, {0.0, 2.0}]
    assert sides.depth == pytest.approx(0.5 * THICKNESS, rel=0.1)
