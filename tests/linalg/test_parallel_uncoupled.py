"""Bodies that K does not couple have residuals of their own, on any number of ranks: run alone, or by mpirun."""

import numpy as np

import coulomb
from coulomb.linalg.compliance.stiffness import IterativeSolver
from coulomb.linalg.reductions import Reductions
from coulomb.linalg.uncoupled import parts_of

STEEL = coulomb.Material(2e11, 0.3)


def beside(place, height=0.0):
    box = coulomb.box((1.0, 1.0, 1.0), (4, 3, 3))
    return coulomb.moved(box, translate=(2.0 * place, 0.0, height))


def two_of_three():
    """The second is tied to the third, and the first has a rigid face, with unknowns of its own."""
    return coulomb.ContactProblem(
        coulomb.join(a=beside(0), b=beside(1), c=beside(1, 1.0)),
        STEEL,
        [coulomb.Clamp("a:left"), coulomb.Clamp("b:left")],
        coulomb.Contact("b:bottom", friction=0.3),
        rigid_faces=[coulomb.RigidFace("a:top")],
        ties=[coulomb.Tied("c:bottom", "b:top")],
    ).elasticity


def test_parts_are_bodies_that_nothing_couples():
    body = two_of_three()
    parts, v = parts_of(body.K), body.K.createVecRight()
    v.array[:] = np.sin(np.arange(*v.getOwnershipRange()))
    first = np.repeat(body.reduction.points[:, 0] < 1.5, 3)  # the own unknowns are at the middle of the face
    over = Reductions(body.comm)
    by_place = [over.norm(v.array[first]), over.norm(v.array[~first])]
    assert parts.count == 2 and np.allclose(parts.norms(v.array), by_place, rtol=1e-14)


def test_a_single_body_and_one_that_springs_couple_have_one_part():
    one = coulomb.ContactProblem(beside(0), STEEL, [coulomb.Clamp("left")], coulomb.Contact("bottom", friction=0.3))
    assert parts_of(one.elasticity.K).count == 1
    held = [coulomb.Clamp("a:left"), coulomb.Clamp("b:left")]
    two = {"mesh": coulomb.join(a=beside(0), b=beside(1)), "material": STEEL, "clamps": held}
    spring = coulomb.Equation([((1.0, 1.0, 1.0), "x", 1.0), ((3.0, 1.0, 1.0), "x", -1.0)], stiffness=1e6)
    for ties, count in ([], 2), ([spring], 1):
        problem = coulomb.ContactProblem(**two, contact=coulomb.Contact("a:bottom", friction=0.3), ties=ties)
        assert parts_of(problem.elasticity.K).count == count


def test_each_part_is_solved_to_its_own_forces():
    """Also where these are 1e-14 of the others', and with starts from earlier solutions that were of like size."""
    body = two_of_three()
    K, parts = body.K, parts_of(body.K)
    solver = IterativeSolver(K)
    f, u, left = (K.createVecRight() for _ in range(3))
    for number, small in enumerate([1.0, 1e-3, 1e-14, 0.0, 1e-14]):
        f.array[:] = np.cos((1.0 + 0.1 * number) * np.arange(*f.getOwnershipRange()))
        f.array[:] = parts.scaled(f.array_r, np.array([small, 1.0]))
        for tolerance in (1e-2, 1e-9):
            solver.solve(f, u, tolerance)
            solver.multiply(u, left)
            left.aypx(-1.0, f)
            assert np.all(parts.norms(left.array_r) <= 1.5 * tolerance * parts.norms(f.array_r))
    solver.destroy()
