"""Tied faces on any number of ranks: alone, or with mpirun."""

import numpy as np
import pytest
from mpi4py import MPI
from ranks import by_place, everywhere, same_error

from coulomb import (
    Clamp,
    Contact,
    ContactProblem,
    CyclicSymmetry,
    LoadHistory,
    Material,
    Plane,
    PointLoad,
    Pressure,
    Pretension,
    RigidFace,
    SymmetryPlane,
    Tied,
    Traction,
    box,
    join,
    moved,
)
from coulomb.solvers import DirectSolver, IterativeSolver

comm = MPI.COMM_WORLD


def stack(over, cell, degree, linear_solver=None, below="b:bottom"):
    """A small block on a larger one on a foundation, without supports, and a third block beside the larger."""
    a = box((1.0, 1.0, 1.0), (3, 2, 2), cell, comm=over, degree=degree)
    b = moved(box((0.6, 0.7, 0.5), (2, 3, 1), cell, comm=over, degree=degree), (0.2, 0.1, 1.0))
    c = moved(box((0.5, 1.0, 1.0), (1, 1, 3), cell, comm=over, degree=degree), (1.0, 0.0, 0.0))
    ties = [Tied("a:top", below), Tied("c:left", "a:right")]
    loads = [Pressure("b:top", 1e6), Traction("b:right", (-1e5, 2e4, 0.0))]
    contacts = [Contact("a:bottom", 0.3), Contact("c:bottom", 0.2, foundation=Plane((0, 0, -1e-7), (0, 0, 1)))]
    symmetric = [SymmetryPlane("a:front"), SymmetryPlane("c:front")]
    bodies = join(a=a, b=b, c=c)
    return ContactProblem(
        bodies, Material(2e11, 0.3), symmetric, contacts, loads, ties=ties, linear_solver=linear_solver
    )


def apart(body):
    """Places of nodes with those of tied faces, which coincide, apart."""
    x = body.x.copy()
    for number, member in enumerate(body.members):
        x[member.nodes, 0] += 10.0 * number
    return x


@pytest.mark.parametrize(
    ("cell", "degree", "solver"), [("hexahedron", 1, IterativeSolver), ("tetrahedron", 2, DirectSolver)]
)
@pytest.mark.ranks
def test_ranks_find_what_one_does(cell, degree, solver):
    tolerance = 1e-9  # of every contact's own force: of the body that touches nothing 1e-10 is left by rounding errors
    alone, together = (
        stack(*of).solve(tolerance) for of in ((MPI.COMM_SELF, cell, degree), (comm, cell, degree, solver))
    )
    assert together.certificate.passed and together.certificate["ties"].value <= 1e-10
    x, own = everywhere(apart(together.problem.elasticity)), apart(alone.problem.elasticity)
    scale = np.abs(alone.displacement).max()
    found, expected = by_place(x, everywhere(together.displacement)), by_place(own, alone.displacement)
    assert np.abs(found - expected).max() <= 1e-7 * scale
    for one, other in zip(together.ties, alone.ties, strict=True):
        assert np.abs(one.force - other.force).max() <= 1e-6 * 4e5
        assert np.abs(one.moment - other.moment).max() <= 1e-6 * 4e5
    of_ranks, of_one = together.forces_at_nodes, alone.forces_at_nodes
    for name in ("peel_stress", "shear_stress", "tie_force"):
        off = by_place(x, everywhere(of_ranks[name])) - by_place(own, of_one[name])
        assert np.abs(off).max() <= 1e-5 * np.abs(of_one[name]).max(), name


@pytest.mark.ranks
def test_a_sector_with_its_axis(linear_solver=IterativeSolver):
    """The quarter of `test_cyclic_symmetry` on ranks."""

    def quarter(over, solver=None):
        turn = Traction("top", lambda x: np.stack([-4e5 * x[1], 4e5 * x[0], -1e6 + 0.0 * x[0]]))
        contact = Contact("bottom", 0.3, foundation=Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)))
        ties = [CyclicSymmetry("left", "front", sectors=4)]
        mesh = box((0.5, 0.5, 0.5), (4, 3, 3), comm=over)
        return ContactProblem(mesh, Material(2e11, 0.3), [], contact, [turn], ties=ties, linear_solver=solver)

    alone, together = quarter(MPI.COMM_SELF).solve(1e-10), quarter(comm, linear_solver).solve(1e-10)
    assert together.certificate.passed
    x, own = everywhere(together.problem.elasticity.x), alone.problem.elasticity.x
    found, expected = by_place(x, everywhere(together.displacement)), by_place(own, alone.displacement)
    assert np.abs(found - expected).max() <= 1e-4 * np.abs(expected).max()  # contact points on both cuts share forces
    moments = [solution.at_nodes.totals(0)["moment"][2] for solution in (together, alone)]
    assert moments[0] == pytest.approx(moments[1], rel=1e-9)


@pytest.mark.ranks
def test_a_plate_that_turns():
    """A rigid face, whose motion is described by nodes of few ranks."""

    def pressed(over, solver=None):
        plate = RigidFace("top", translation=(0.0, 0.0, None), rotation=(0.0, None, 2e-3))
        mesh, rough = box((0.1, 0.1, 0.02), (5, 4, 2), comm=over), Contact("bottom", 0.3)
        load = PointLoad("top", (0.0, 0.0, -5e3), (1.0, 0.0, 0.0), point=(0.06, 0.05, 0.02))
        material = Material(1e9, 0.3)
        return ContactProblem(mesh, material, [], rough, [load], rigid_faces=[plate], linear_solver=solver)

    (one,) = pressed(MPI.COMM_SELF).solve(1e-10).rigid_faces
    for solver in (IterativeSolver, DirectSolver):
        together = pressed(comm, solver).solve(1e-10)
        (other,) = together.rigid_faces
        assert together.certificate.passed
        for name, scale in (("translation", 1e-5), ("rotation", 1e-3), ("force", 5e3), ("moment", 50.0)):
            assert np.abs(getattr(one, name) - getattr(other, name)).max() <= 1e-5 * scale, name


@pytest.mark.ranks
def test_a_slice_whose_back_stays_plane():
    def slice_of(over, degree, solver=None):
        back, load = RigidFace("back", along="free"), PointLoad("top", (0.0, 2e3, -1e4), (0.0, 200.0, 0.0))
        mesh = box((0.4, 0.1, 0.3), (5, 1, 3), comm=over, degree=degree)
        supports, contact = [SymmetryPlane("front")], Contact("bottom", 0.3)
        return ContactProblem(
            mesh, Material(1e9, 0.3), supports, contact, [load], rigid_faces=[back], linear_solver=solver
        )

    for degree, solver in ((1, IterativeSolver), (2, DirectSolver)):
        alone, together = slice_of(MPI.COMM_SELF, degree).solve(1e-10), slice_of(comm, degree, solver).solve(1e-10)
        assert together.certificate.passed
        x, own = everywhere(together.problem.elasticity.x), alone.problem.elasticity.x
        found, expected = by_place(x, everywhere(together.displacement)), by_place(own, alone.displacement)
        assert np.abs(found - expected).max() <= 1e-5 * np.abs(expected).max()
        (one,), (other,) = alone.rigid_faces, together.rigid_faces
        assert np.abs(one.translation - other.translation).max() <= 1e-6 * abs(one.translation[1])
        assert np.abs(one.rotation - other.rotation).max() <= 1e-6 * np.abs(one.rotation).max()


@pytest.mark.ranks
def test_a_block_that_a_spring_alone_holds():
    def held(over, solver=None):
        face = RigidFace("left", translation_stiffness=(1e6, 2e6, 4e6), rotation_stiffness=(2e4, 3e4, 1e4))
        mesh, load = box((0.4, 0.1, 0.3), (5, 3, 4), "tetrahedron", comm=over), PointLoad("right", (100.0, 0.0, -2e3))
        contact = Contact("bottom", 0.2, foundation=Plane((0.0, 0.0, -1e-4), (0.0, 0.0, 1.0)))
        return ContactProblem(mesh, Material(1e9, 0.3), [], contact, [load], rigid_faces=[face], linear_solver=solver)

    alone = held(MPI.COMM_SELF).solve(1e-10)
    for solver in (IterativeSolver, DirectSolver):
        together = held(comm, solver).solve(1e-10)
        assert together.certificate.passed and together.force_balance.balance <= 1e-8
        assert alone.at_nodes.totals()["normal_force"] > 100.0
        for one, other in (
            (alone.reactions[0], together.reactions[0]),
            (alone.rigid_faces[0], together.rigid_faces[0]),
        ):
            for name in ("force", "moment"):
                assert np.abs(getattr(one, name) - getattr(other, name)).max() <= 1e-6 * 2e3, name


def test_wrong_ties_are_errors_on_all_ranks():
    assert "must face each other" in same_error(lambda: stack(comm, "hexahedron", 1, below="b:top"))


def screwed(over, **given):
    """A cap on a base, screwed together by a shank whose lower part is tied to the base; tightened, locked, pulled."""
    base = box((1.0, 1.0, 0.5), (3, 3, 1), comm=over)
    cap = moved(box((1.0, 1.0, 0.3), (4, 2, 1), comm=over), (0.0, 0.0, 0.5))
    low = moved(box((0.2, 0.2, 0.6), (1, 1, 3), comm=over), (1.1, 0.4, 0.0))
    up = moved(box((0.2, 0.2, 0.2), (2, 1, 2), comm=over), (1.1, 0.4, 0.6))
    head = moved(box((0.6, 0.4, 0.2), (3, 2, 1), comm=over), (0.7, 0.3, 0.8))
    foot = moved(box((0.3, 0.4, 0.2), (2, 2, 1), comm=over), (1.0, 0.3, -0.2))
    bodies = join(base=base, cap=cap, low=low, up=up, head=head, foot=foot)
    contacts = [Contact("cap:bottom", 0.2, against="base:top"), Contact("head:bottom", 0.2, against="cap:top")]
    loads = [Traction("cap:left", (0.0, 0.0, 1e6), amplitude=lambda t: max(t - 1.0, 0.0))]
    ties = [
        Pretension("up:bottom", "low:top", force=1e5, amplitude=lambda t: min(t, 1.0), lock=1.0),
        *(Tied("low:bottom", "foot:top"), Tied("up:top", "head:bottom")),
    ]
    clamps = [Clamp("base:bottom"), Clamp("foot:bottom")]
    return ContactProblem(bodies, Material(2e11, 0.3), clamps, contacts, loads, ties=ties, **given)


def tightened(over, solver):
    return [
        (step.row["bolt_up:bottom_force"], step.row["bolt_up:bottom_shortening"], step.solution.certificate.passed)
        for step in LoadHistory([1.0, 2.0], tolerance=1e-10).steps(screwed(over, linear_solver=solver))
    ]


@pytest.mark.ranks
def test_ranks_tighten_and_lock_as_one_does():
    one, *several = (
        tightened(over, solver)
        for over, solver in ((MPI.COMM_SELF, DirectSolver), (comm, DirectSolver), (comm, IterativeSolver))
    )
    assert one[0][0] == pytest.approx(1e5, rel=1e-8) and one[1][0] > 1.01e5
    for together in several:
        assert all(passed for *_, passed in (*one, *together))
        assert np.array(together)[:, :2] == pytest.approx(np.array(one)[:, :2], rel=1e-6)
