"""Large motions on several ranks, against formulas; run by mpirun, and on one rank with the others."""

import tomllib

import numpy as np
import pytest
from mpi4py import MPI
from rubber_blocks import DRAWN, RubberBlock, bolted_bar, stress
from scipy.optimize import brentq

import coulomb
from coulomb.case.case import Case
from coulomb.kinematics import LargeMotions, NeoHookean


def test_a_pressed_block_has_the_stress_of_the_formula():
    one = RubberBlock(
        lambda time, x: np.array([[0.0], [0.0], [-0.4 * time]]) + 0.0 * x, (4, 2, 2), components=(2,), rollers=True
    )
    (step,) = coulomb.LoadHistory([1.0]).steps(LargeMotions(one.body, coulomb.Contact("bottom", friction=0.0)))
    assert step.solution.valid
    assert step.solution.at_nodes.totals()["normal_force"] == pytest.approx(-stress(0.6), rel=1e-7)


@pytest.mark.ranks
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


@pytest.mark.ranks
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


@pytest.mark.ranks
def test_a_turned_bolt_follows_the_other_side_as_on_one_rank():
    def followed(comm):
        body = bolted_bar(comm)[0].elasticity
        u = np.sin(3.0 * body.x + body.x[:, [1, 2, 0]])
        u[body.members[1].nodes, 2] -= 0.1
        there = body.constraints.at_place(body.x + u, u)
        (bolt,), apart = there.bolts_at(u), there.reduction.apart(np.cos(5.0 * body.x))
        sums = comm.allreduce(np.array([np.sum(apart**2), np.sum(apart**3)]))
        return [*bolt.direction, *bolt.centre, bolt.shortening, *sums]

    assert followed(MPI.COMM_WORLD) == pytest.approx(followed(MPI.COMM_SELF), rel=1e-10)


def test_tied_halves_bend_onto_a_plane_as_one_mesh():
    """A tie moves with its faces: energies, forces and displacements are those of one mesh with the same nodes."""
    rubber, end = NeoHookean(1e6, 0.3), {"force": (0.0, 0.0, -6000.0), "amplitude": [(0.0, 0.0), (1.0, 1.0)]}
    plane = coulomb.Plane((0.0, 0.0, -0.2), (0.0, 0.0, 1.0))

    def half(comm, cells=2):
        return coulomb.box((1.0, 0.5, 0.5), (cells, 1, 1), comm=comm)

    def last(mesh, left, bottom, right, ties=()):
        contact, load = coulomb.Contact(bottom, friction=0.3, foundation=plane), coulomb.TotalForce(right, **end)
        given = mesh, rubber, [coulomb.Clamp(left)], contact, [load]
        problem = coulomb.ContactProblem(*given, kinematics="large", ties=ties)
        *_, step = coulomb.LoadHistory([0.5, 1.0]).steps(problem)
        assert step.solution.valid
        return step

    whole = coulomb.box((2.0, 0.5, 0.5), (4, 1, 1), comm=MPI.COMM_SELF)
    one = last(whole, "left", "bottom", "right")
    halves = coulomb.join(a=half(MPI.COMM_WORLD), b=coulomb.moved(half(MPI.COMM_WORLD), (1.0, 0.0, 0.0)))
    tied = last(halves, "a:left", "b:bottom", "b:right", [coulomb.Tied("b:left", "a:right")])
    force = np.array(one.solution.at_nodes.totals()["force"])
    assert np.array(tied.solution.at_nodes.totals()["force"]) == pytest.approx(force, abs=1e-6 * np.abs(force).max())
    for name in ("energy_loads", "energy_elastic", "energy_dissipated"):
        assert tied.row[name] == pytest.approx(one.row[name], rel=1e-6), name
    (tie,), (clamp,) = tied.solution.ties, one.solution.reactions
    assert np.array(tie.force) == pytest.approx(np.array(clamp.force), abs=1e-6 * np.abs(clamp.force).max())


def test_tied_halves_turn_without_stress():
    """By 90 degrees, with meshes that do not match; the plane is far below."""
    turn = coulomb.PrescribedRotation("a:left", (0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 0.5 * np.pi)
    b = coulomb.moved(coulomb.box((1.0, 0.5, 0.5), (2, 3, 2)), (1.0, 0.0, 0.0))
    plane = coulomb.Plane((0.0, 0.0, -9.0), (0.0, 0.0, 1.0))

    def tied(b):
        return coulomb.ContactProblem(
            coulomb.join(a=coulomb.box((1.0, 0.5, 0.5), (2, 1, 1)), b=b),
            NeoHookean(1e6, 0.3),
            [turn],
            coulomb.Contact("b:bottom", friction=0.3, foundation=plane),
            ties=[coulomb.Tied("b:left", "a:right")],
            kinematics="large",
        )

    with pytest.raises(ValueError, match=r"faces are up to 1 mm apart, 0.5% of a facet's length"):
        tied(coulomb.moved(b, (1e-3, 0.0, 0.0)))  # would be left behind by 1 mm
    problem = tied(b)
    (step,) = coulomb.LoadHistory([1.0]).steps(problem)
    x = problem.elasticity.reference
    turned = np.column_stack([x[:, 2], x[:, 1], -x[:, 0]])
    assert step.solution.valid and x + step.solution.displacement == pytest.approx(turned, abs=1e-7)


def test_a_constant_of_an_equation_compresses_as_the_formula_says():
    """Two blocks on a smooth floor, the second twice as stiff, whose tops sink by 0.6 m together, then come up by 0.3
    m: both bear the same force, and the constant does the work."""
    block = coulomb.box((1.0, 1.0, 1.0), (2, 2, 2)).with_nodes("ends", at=lambda x: x[2] > 1.0 - 1e-9)
    other = coulomb.moved(block, (2.0, 0.0, 0.0))
    both, law = coulomb.join(a=block, b=other), {"a": NeoHookean(1e6, 0.3), "b": NeoHookean(2e6, 0.3)}
    held = [coulomb.SymmetryPlane(f"{name}:{face}") for name in "ab" for face in ("left", "front")]
    floor = coulomb.Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    contacts = [coulomb.Contact(f"{name}:bottom", friction=0.0, foundation=floor) for name in "ab"]
    path = [(0.0, 0.0), (1.0, 1.0), (2.0, 0.5)]
    sunk = coulomb.Equation([("a:ends", "z", 1.0), ("b:ends", "z", 1.0)], -0.6, path)
    problem = coulomb.ContactProblem(both, law, held, contacts, ties=[sunk], kinematics="large")
    force, work = 0.0, 0.0
    for step, share in zip(coulomb.LoadHistory([0.5, 1.0, 2.0]).steps(problem), (0.5, 1.0, 0.5), strict=True):
        stretch = brentq(lambda a, b: stress(a) - 2.0 * stress(b - a), 0.3, 1.0, (2.0 - 0.6 * share,))
        before, force = force, -stress(stretch)
        work += 0.5 * (before + force) * (-0.3 if step.state.number == 3 else 0.3)
        assert step.solution.valid and step.solution.certificate["ties"].value <= 1e-12
        for number in range(2):
            assert step.solution.at_nodes.totals(number)["normal_force"] == pytest.approx(force, rel=1e-7)
        assert step.row["energy_prescribed"] == pytest.approx(work, rel=1e-7)


@pytest.mark.ranks
def test_a_rigid_face_turned_by_a_moment_is_the_same_on_one_rank():
    """In a plane, against its spring: the moment is the spring's, k times the angle, and friction's."""

    def motion(comm):
        ramp = ((0.0, 0.0), (1.0, 1.0))
        top = coulomb.RigidFace("top", None, (0.0, 0.0, -0.02), (0.0, 0.0, None), ramp, rotation_stiffness=(0, 0, 2e4))
        problem = coulomb.ContactProblem(
            coulomb.box((1.0, 1.0, 0.5), (2, 2, 2), comm=comm),
            NeoHookean(1e6, 0.3),
            [],
            coulomb.Contact("bottom", friction=0.2, foundation=coulomb.Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))),
            [coulomb.PointLoad("top", moment=(0.0, 0.0, 1e4), amplitude=ramp)],
            kinematics="large",
            rigid_faces=[top],
        )
        *_, last = coulomb.LoadHistory([0.5, 1.0]).steps(problem)
        (face,) = last.solution.rigid_faces
        assert last.solution.valid
        friction = np.array(last.solution.at_nodes.totals()["moment"])[2]
        assert 2e4 * face.rotation[2] - friction == pytest.approx(1e4, rel=1e-6)
        return np.concatenate([face.rotation, face.force / 1e4, [last.state.energy.elastic / 1e4]])

    assert motion(MPI.COMM_WORLD) == pytest.approx(motion(MPI.COMM_SELF), rel=1e-6, abs=1e-6)
