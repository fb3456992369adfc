"""Several bodies together: numbering over ranks, K, loads, pairs of faces in equilibrium.

Run alone, or as `mpirun -n 3 python -m pytest tests/model/test_parallel_bodies.py`.
"""

import numpy as np
import pytest
from mpi4py import MPI

from coulomb import Clamp, Contact, ContactProblem, Material, SymmetryPlane, Traction, box, join, moved
from coulomb.fem.bodies.elasticity import Elasticity
from coulomb.fem.bodies.joined_bodies import JoinedBodies
from coulomb.fem.contact.facet_patch import facet_patch
from coulomb.fem.contact.mortar import RINGS
from coulomb.fem.contact.near_facets import near_pair
from coulomb.fem.contact.pair import pair_of
from coulomb.io.output import write
from coulomb.linalg.compliance.stiffness import IterativeSolver
from coulomb.linalg.reductions import Reductions
from coulomb.recheck import check

STEEL, ALUMINIUM = Material(2.1e11, 0.3), Material(7e10, 0.33)


def two(lower=("hexahedron", 1), upper=("tetrahedron", 2), comm=MPI.COMM_WORLD):
    """A block on a block; their meshes do not match."""
    below = box((1.0, 1.0, 0.5), (3, 3, 2), lower[0], comm, degree=lower[1])
    above = box(
        (0.8, 0.8, 0.4), (2, 2, 1), upper[0], comm, lambda x: x + np.array([[0.1], [0.1], [0.5]]), degree=upper[1]
    )
    return {
        "lower": Elasticity(below, STEEL, [Clamp("bottom")]),
        "upper": Elasticity(above, ALUMINIUM, [Clamp("left")], [Traction("top", (0.0, 0.0, -1e7))]),
    }


def test_internal_forces_are_those_of_the_bodies():
    """K u of all bodies at free nodes is the internal force of each; nodes are numbered rank after rank."""
    bodies = two()
    joined = JoinedBodies(bodies)
    u = joined.held.free_part(np.sin(1.0 + joined.x @ np.array([[3.0, 1.0, 2.0], [2.0, 4.0, 1.0], [5.0, 1.0, 3.0]])))
    given, image = joined.K.createVecs()
    given.array[:] = u.ravel()
    joined.K.mult(given, image)
    forces = joined.held.free_part(image.array_r.reshape(-1, 3).copy())
    start = 0
    for member, body in zip(joined.members, bodies.values(), strict=True):
        assert member.nodes == slice(start, start + len(body.x))
        start = member.nodes.stop
        own = body.held.free_part(body.internal_force(u[member.nodes]))
        assert np.abs(forces[member.nodes] - own).max(initial=0.0) <= 1e-13 * np.abs(own).max(initial=1.0)
        numbers = body.numbering.first + np.arange(len(body.x))
        found = joined.numbers_of(member, numbers)
        assert np.array_equal(found, joined.numbering.first + np.arange(member.nodes.start, member.nodes.stop))
        everywhere = np.concatenate(joined.comm.allgather(numbers))
        whole = np.concatenate(joined.comm.allgather(found))
        assert np.array_equal(joined.numbers_of(member, everywhere), whole)
    loading = joined.at(0.0)
    assert joined.comm.allreduce(loading.load[:, 2].sum()) == pytest.approx(-6.4e6)


@pytest.mark.parametrize(
    "lower, upper", [(("hexahedron", 1), ("tetrahedron", 2)), (("tetrahedron", 1), ("hexahedron", 1))]
)
def test_a_pair_is_in_equilibrium(lower, upper):
    """The slave is on the upper body and on the lower one.

    Forces on both faces are equal and opposite, with moments; multigrid finds what the factorised K does.
    """
    bodies = two(lower, upper)
    answers = []
    for options in ({}, {"explicit": False, "linear_solver": IterativeSolver}):
        problem = ContactProblem(
            JoinedBodies(bodies), Contact("upper:bottom", against="lower:top", friction=0.3), **options
        )
        answers.append(problem.solve())
        assert answers[-1].certificate.passed
    solution = answers[0]
    comm, on_bodies = solution.problem.comm, -solution.problem.surface.at_nodes(solution.contact_force)
    sizes = comm.allreduce(np.linalg.norm(on_bodies, axis=1).sum())
    x = solution.problem.elasticity.x
    assert np.abs(comm.allreduce(on_bodies.sum(axis=0))).max() <= 1e-12 * sizes
    assert np.abs(comm.allreduce(np.cross(x, on_bodies).sum(axis=0))).max() <= 1e-12 * sizes
    for member in solution.problem.elasticity.members:
        total = comm.allreduce(on_bodies[member.nodes].sum(axis=0))
        ours = total if member.name == solution.problem.contacts[0].face.partition(":")[0] else -total
        assert ours == pytest.approx(solution.at_nodes.totals()["force"], rel=1e-10)
    assert solution.force_balance.balance <= 1e-10
    one, other = (np.array(answer.at_nodes.totals()["force"]) for answer in answers)
    assert np.linalg.norm(one - other) <= 1e-6 * np.linalg.norm(one)
    assert [one.name for one in solution.reactions] == ["clamp_lower:bottom", "clamp_upper:left"]


def rings(over):
    """Quarters of two rings in each other, whose meshes do not match, the outer one partly beside the inner one."""

    def place(x, inner, shift):
        r, angle = inner + 0.1 * x[0], 0.5 * np.pi * x[1]
        return np.stack([r * np.cos(angle), r * np.sin(angle), 0.1 * (x[2] + shift)])

    inside = box((1, 1, 1), (1, 9, 3), "hexahedron", over, lambda x: place(x, 0.1, 0.0), degree=2)
    outside = box((1, 1, 1), (1, 7, 4), "tetrahedron", over, lambda x: place(x, 0.2, 0.29), degree=1)
    return JoinedBodies(
        {"in": Elasticity(inside, STEEL, [Clamp("bottom")]), "out": Elasticity(outside, ALUMINIUM, [Clamp("top")])}
    )


def contact_points(bodies, pair, over):
    """Place, normal, gap, area and relative displacement in a given field of the contact points of all ranks."""
    u = np.sin(1.0 + bodies.x @ np.array([[3.0, 1.0, 2.0], [2.0, 4.0, 1.0], [5.0, 1.0, 3.0]]))
    relative = pair.points.average(u) - pair.points.opposite_average(u)
    rows = np.concatenate(over.allgather(np.column_stack([pair.x, pair.n, pair.gap, pair.points.area, relative])))
    return rows[np.lexsort(np.round(rows[:, :3].T, 9))]


@pytest.mark.parametrize(
    ("bodies", "face", "against"),
    [
        (rings, "out:left", "in:right"),
        (rings, "in:right", "out:left"),
        (lambda over: JoinedBodies(two(comm=over)), "upper:bottom", "lower:top"),
    ],
)
@pytest.mark.ranks
def test_contact_points_are_those_of_one_rank(bodies, face, against):
    """Each rank has the facets near its own nodes only."""
    alone, together = bodies(MPI.COMM_SELF), bodies(MPI.COMM_WORLD)
    one, other = pair_of(alone, face, against), pair_of(together, face, against)
    expected, found = contact_points(alone, one, MPI.COMM_SELF), contact_points(together, other, MPI.COMM_WORLD)
    assert found.shape == expected.shape and np.allclose(found, expected, rtol=0.0, atol=1e-12)
    assert other.remarks == one.remarks and (bodies is not rings or one.remarks)


def test_facets_far_away_stay_on_their_ranks():
    """Of two long bars on each other a rank gets its part and what is beside it."""
    comm = MPI.COMM_WORLD
    lower, upper = (Elasticity(box((20.0, 1.0, 1.0), (n, 2, 1)), STEEL, [Clamp("left")]) for n in (80, 60))
    patches = facet_patch(upper, upper.mesh.faces["bottom"]), facet_patch(lower, lower.mesh.faces["top"])
    near = near_pair(*patches, (upper.numbering.local, lower.numbering.local), comm)
    for every, face in ((120, near.slave), (160, near.master)):
        assert len(face.patch) <= every / comm.size + (0 if comm.size == 1 else 0.35 * every)


def nodes_of(patch):
    """The corners of facets, rounded, as tuples."""
    return [frozenset(map(tuple, np.round(corners, 9))) for corners in patch.x]


def test_what_a_rank_needs_of_a_pair():
    """On curved faces, of which one rank has the largest bulge and another the least distance: as one rank has it."""

    def found(comm):
        def place(x):
            return x + np.array([0.0 * x[0], 0.0 * x[0], 0.02 * x[0] ** 4])

        lower = Elasticity(box((2.0, 1.0, 0.5), (18, 3, 1), comm=comm, place=place), STEEL, [Clamp("left")])
        upper = box(
            (2.0, 1.0, 0.3), (40, 14, 1), comm=comm, place=lambda x: place(0.99 * x) + np.array([[0.0], [0.0], [0.6]])
        )
        upper = Elasticity(upper, STEEL, [Clamp("left")])
        patches = facet_patch(upper, upper.mesh.faces["bottom"]), facet_patch(lower, lower.mesh.faces["top"])
        return near_pair(*patches, (upper.numbering.local, lower.numbering.local), comm)

    one, mine = found(MPI.COMM_SELF), found(MPI.COMM_WORLD)
    for whole, near in ((one.slave, mine.slave), (one.master, mine.master)):
        assert near.largest_bulge == pytest.approx(whole.largest_bulge, rel=1e-9) and whole.largest_bulge > 1e-4
        bulges = dict(zip(nodes_of(whole.patch), whole.bulges, strict=True))
        for facet, bulge in zip(nodes_of(near.patch), near.bulges, strict=True):
            assert bulge == pytest.approx(bulges[facet], abs=1e-12)
    assert mine.search.reach == pytest.approx(one.search.reach) and mine.search.depth == pytest.approx(one.search.depth)
    assert (mine.size, mine.extent) == pytest.approx((one.size, one.extent))
    first, last = mine.owned
    patch = mine.slave.patch
    wanted = {tuple(x) for x in np.round(patch.x[(patch.nodes >= first) & (patch.nodes < last)], 9)}
    every, facets = set(nodes_of(one.slave.patch)), set()
    for _ in range(1 + RINGS):
        facets = {facet for facet in every if facet & wanted}
        wanted = wanted.union(*facets)
    assert set(nodes_of(patch)) == facets
    assert len(nodes_of(patch)) == len(facets)


def test_faces_that_are_not_opposite_are_refused():
    with pytest.raises(ValueError, match="opposite"):
        ContactProblem(JoinedBodies(two()), Contact("upper:top", against="lower:bottom", friction=0.3))


def test_a_body_held_by_contact_alone_where_ranks_have_no_contact_points():
    """A small block on the end of a long one."""
    lower = box((8.0, 1.0, 1.0), (16, 2, 2))
    upper = moved(box((0.5, 0.5, 0.5), (2, 2, 2)), (0.2, 0.2, 1.0))
    loads = [Traction("upper:top", (2e5, 0.0, -1e6))]
    contact = Contact("upper:bottom", against="lower:top", friction=0.3)
    solution = ContactProblem(join(lower=lower, upper=upper), STEEL, [Clamp("lower:bottom")], contact, loads).solve()
    assert solution.certificate.passed
    assert solution.at_nodes.totals()["normal_force"] == pytest.approx(2.5e5, rel=1e-9)


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_nodes_opposite_to_two_masters_count_at_one(cell, tmp_path):
    """A pad across the joint of two bases, pressed without lateral strain: on all ranks together every node once, in
    the answer and in its files."""
    bases = {name: moved(box((1.0, 1.0, 0.5), (2, 2, 1)), (x, 0.0, -0.5)) for name, x in (("one", 0.0), ("two", 1.0))}
    pad = box((2.0, 1.0, 0.5), (8, 4, 1), cell)
    planes = [SymmetryPlane(f"{name}:{face}") for name in ("pad", *bases) for face in ("front", "back")]
    planes += [SymmetryPlane(face) for face in ("pad:left", "pad:right", "one:left", "two:right")]
    supports = [*planes, SymmetryPlane("one:bottom"), SymmetryPlane("two:bottom")]
    contacts = [Contact("pad:bottom", 0.3, against=f"{name}:top") for name in bases]
    load = [Traction("pad:top", (0.0, 0.0, -1e7))]
    problem = ContactProblem(join(pad=pad, **bases), Material(2e11, 0.0), supports, contacts, load)
    solution = problem.solve(1e-10)
    assert problem.unknowns["contact"] == 3 * 9 * 5
    assert np.allclose(solution.at_nodes.fields()["pressure"], 1e7, rtol=1e-8)
    forces = [solution.at_nodes.totals(part)["force"][2] for part in (0, 1)]
    assert forces == pytest.approx([1e7, 1e7], rel=1e-8)
    folder = problem.comm.bcast(tmp_path)
    write(solution, folder)
    assert not check(folder, problem).faults


def test_a_pair_at_the_ends_of_two_bars():
    """Ranks far from it have no contact point, and nothing opposite."""

    def found(comm):
        one = box((4.0, 0.5, 0.5), (16, 2, 2), comm=comm)
        other = moved(box((4.0, 0.5, 0.5), (17, 3, 3), comm=comm), translate=(4.0, 0.0, 0.0))
        pair, load = Contact("one:right", 0.3, against="other:left"), Traction("other:right", (-1e7, 1e5, 0.0))
        bars = join(one=one, other=other)
        solution = ContactProblem(bars, STEEL, [Clamp("one:left"), Clamp("other:right", "yz")], pair, [load]).solve()
        force = Reductions(comm).total(solution.force_on_body.sum(axis=0))
        return force, solution.small_strain.chord

    (together, chord), (alone, expected) = found(MPI.COMM_WORLD), found(MPI.COMM_SELF)
    assert together == pytest.approx(alone, rel=1e-8, abs=1e-3) and chord == pytest.approx(expected, abs=1e-12)
