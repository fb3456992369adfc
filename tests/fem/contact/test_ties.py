"""Tied faces: patch tests, one mesh cut in two, formulas, and what is refused."""

import numpy as np
import pytest
from shared_problems import ring_mesh

import coulomb
from coulomb import (
    Clamp,
    Contact,
    ContactProblem,
    LoadHistory,
    Material,
    Plane,
    Pressure,
    Spring,
    SymmetryPlane,
    Tied,
    Traction,
    box,
    join,
    moved,
)
from coulomb.fem.meshes import corners_of
from coulomb.solvers import IterativeSolver

E, NU = 2e11, 0.3
STEEL = Material(E, NU)
FAR = Contact("a:bottom", 0.3, foundation=Plane((0.0, 0.0, -1.0), (0.0, 0.0, 1.0)))
"""A foundation that is not reached."""


def uniaxial(x, stress):
    """Displacement under a stress along z; x and y from planes of symmetry."""
    return stress / E * x * np.array([-NU, -NU, 1.0])


def residual(problem, exact):
    """Forces of a displacement at free nodes, over the largest load, without those at z = 0, which a foundation takes;
    and the jump, over it."""
    body = problem.elasticity
    load = body.at(0.0).load
    forces = body.internal_force(exact) - load
    forces[np.abs(body.x[:, 2]) < 1e-9] = 0.0
    forces = body.reduction.along(forces)
    return np.abs(forces).max() / np.abs(load).max(), np.abs(
        body.reduction.left_apart(exact, body.at(0.0).apart)
    ).max() / np.abs(exact).max()


def skewed(amount):
    """Nodes moved within planes of constant z, and none on the sides."""

    def place(x):
        bubble = amount * np.sin(np.pi * x[0]) * np.sin(np.pi * x[1])
        return np.stack([x[0] + bubble * np.sin(3.0 * x[1] + 1.0), x[1] + bubble * np.cos(4.0 * x[0]), x[2]])

    return place


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
@pytest.mark.parametrize(("degree", "amount"), [(1, 0.05), (2, 0.0)])
@pytest.mark.parametrize("cells", [(2, 2), (3, 2), (2, 5)], ids=str)
def test_patch_of_uniform_stress(cell, degree, amount, cells):
    """Meshes that do not match, of cells of any shape: the uniform stress is exact, and the tie transmits it."""
    lower, upper = (
        box((1.0, 1.0, 1.0), (n, n, 2), cell, degree=degree, place=skewed(sign * amount))
        for n, sign in zip(cells, (1.0, -0.8), strict=True)
    )
    supports = [SymmetryPlane(f"{body}:{side}") for body in ("a", "b") for side in ("left", "front")]
    bodies = join(a=lower, b=moved(upper, (0.0, 0.0, 1.0)))
    problem = ContactProblem(
        bodies, STEEL, supports, Contact("a:bottom", 0.0), [Pressure("b:top", 1e6)], ties=[Tied("a:top", "b:bottom")]
    )
    left, jump = residual(problem, uniaxial(problem.elasticity.x, -1e6))
    assert left <= 1e-10 and jump <= 1e-14
    solution = problem.solve()
    assert solution.valid and solution.certificate["ties"].value <= 1e-12
    stress = solution.forces_at_nodes
    (tie,) = problem.elasticity.constraints.ties
    assert stress["peel_stress"][tie.nodes] == pytest.approx(-1e6, rel=1e-6)
    assert np.abs(stress["shear_stress"]).max() <= 1.0
    assert solution.ties[0].force[2] == pytest.approx(-1e6 if tie.face == "a:top" else 1e6, rel=1e-9)


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_edges_that_are_curved_within_the_face(cell):
    """Facets of second order whose edges bulge within the tie, otherwise on both sides: not exact, but nearly."""
    lower, upper = (
        box((1.0, 1.0, 1.0), (n, n, 2), cell, degree=2, place=skewed(amount)) for n, amount in ((2, 0.05), (4, -0.04))
    )
    supports = [SymmetryPlane(f"{body}:{side}") for body in ("a", "b") for side in ("left", "front")]
    problem = ContactProblem(
        join(a=lower, b=moved(upper, (0.0, 0.0, 1.0))),
        STEEL,
        supports,
        Contact("a:bottom", 0.0),
        [Pressure("b:top", 1e6)],
        ties=[Tied("a:top", "b:bottom")],
    )
    exact = uniaxial(problem.elasticity.x, -1e6)
    assert np.abs(problem.solve().displacement - exact).max() <= 1.5e-4 * np.abs(exact).max()


def cut_bar(n, other, cell, degree, **options):
    """A cantilever of 2 x 1 x 1, of one mesh (other = 0), or of two halves."""
    load = (2e4, 1e5, -3e5)
    if not other:
        bodies, supports, face, ties = box((2.0, 1.0, 1.0), (2 * n, n, n), cell, degree=degree), "left", "bottom", []
    else:
        a, b = (box((1.0, 1.0, 1.0), (k, k, k), cell, degree=degree) for k in (n, other))
        bodies, supports, face = join(a=a, b=moved(b, (1.0, 0.0, 0.0))), "a:left", "b:bottom"
        ties = [Tied("a:right", "b:left")]
    foundation = Plane((0.0, 0.0, -1e-6), (0.0, 0.0, 1.0))
    end = "b:right" if other else "right"
    contact = Contact(face, 0.4, foundation=foundation)
    return ContactProblem(bodies, STEEL, [Clamp(supports)], contact, [Traction(end, load)], ties=ties, **options)


@pytest.mark.parametrize(("cell", "degree", "n"), [("hexahedron", 1, 4), ("tetrahedron", 2, 3)])
def test_matching_meshes_are_one_mesh(cell, degree, n):
    whole, tied = (cut_bar(n, other, cell, degree) for other in (0, n))
    u, v = (problem.displacement(np.zeros(problem.A.nodes * 3)) for problem in (whole, tied))
    x, y = whole.elasticity.x, tied.elasticity.x
    near = np.linalg.norm(y[:, None] - x, axis=2)
    assert near.min(axis=1).max() <= 1e-12
    assert np.abs(v - u[near.argmin(axis=1)]).max() <= 1e-10 * np.abs(u).max()
    one, two = whole.solve(tolerance=1e-12), tied.solve(tolerance=1e-12)
    assert two.valid
    assert np.abs(two.displacement - one.displacement[near.argmin(axis=1)]).max() <= 1e-8 * np.abs(u).max()


def test_multigrid_takes_as_many_steps_as_for_one_mesh():
    counts = []
    for other in (0, 6, 4):
        problem = cut_bar(6, other, "hexahedron", 1, linear_solver=IterativeSolver)
        u, solver = problem.elasticity.K.createVecRight(), problem.linear.stiffness.solver
        solver.solve(problem.linear.f, u)
        counts.append(solver.iterations)
    assert max(counts) <= 1.2 * counts[0], counts


def test_meshes_that_do_not_match_converge_to_the_whole():
    """The deflection of a cantilever of two halves, in second order, against a finer one."""
    tip = []
    for n, other in ((4, 0), (2, 1), (4, 2)):
        problem = cut_bar(n, other, "hexahedron", 2)
        u, x = problem.displacement(np.zeros(3 * problem.A.nodes)), problem.elasticity.x
        tip.append(u[np.argmin(np.linalg.norm(x - [2.0, 1.0, 1.0], axis=1))])
    off = [np.linalg.norm(one - tip[0]) / np.linalg.norm(tip[0]) for one in tip[1:]]
    assert off[0] <= 0.05 and off[1] <= 0.4 * off[0], off


def test_forces_and_moments_carried_by_a_section():
    """Statics: the tie carries the load at the end, and its moment about the origin."""
    problem = cut_bar(3, 2, "tetrahedron", 2)
    solution = problem.solve()
    contact, load = solution.at_nodes.totals(0), np.array([2e4, 1e5, -3e5])
    (tie,) = solution.ties
    sign = 1.0 if tie.face == "a:right" else -1.0  # the force is on the slave face
    acting = load + contact["force"]
    moment = np.cross([2.0, 0.5, 0.5], load) + contact["moment"]
    assert sign * tie.force == pytest.approx(acting, abs=1e-9 * 3e5)
    assert sign * tie.moment == pytest.approx(moment, abs=1e-9 * 6e5)
    row = next(iter(LoadHistory([1.0]).steps(problem))).row
    assert row[f"{tie.name}_force_z"] == pytest.approx(tie.force[2], rel=1e-6)


def test_stresses_of_a_bond_add_up_to_its_force():
    """Of a lap in shear: the shear stress times area is the force, and the normal of the slave gives the sign."""
    a, b = box((1.0, 1.0, 0.2), (4, 4, 1)), moved(box((1.0, 1.0, 0.2), (6, 6, 1)), (0.0, 0.0, 0.2))
    contact = Contact("a:bottom", 0.3, foundation=Plane((0.0, 0.0, -1.0), (0.0, 0.0, 1.0)))
    problem = ContactProblem(
        join(a=a, b=b),
        STEEL,
        [Clamp("a:left")],
        contact,
        [Traction("b:top", (0.0, 0.0, 2e5))],
        (0.0, 0.0, 0.0),
        ties=[Tied("b:bottom", "a:top", slave=True)],
    )
    solution = problem.solve()
    (tie,), stresses = problem.elasticity.constraints.ties, solution.forces_at_nodes
    assert tie.face == "b:bottom" and tie.area.sum() == pytest.approx(1.0)
    pulled = tie.area @ stresses["peel_stress"][tie.nodes]
    assert pulled == pytest.approx(2e5, rel=1e-9)
    assert solution.ties[0].force == pytest.approx([0.0, 0.0, -2e5], abs=1e-3)


def test_bimetal_strip():
    """Timoshenko 1925: two layers of equal thickness and stiffness bend with 3/2 (a2 - a1) dT/h."""
    length, h, heated, difference = 0.1, 2e-3, 50.0, 1e-5
    upper = moved(box((length, h, h / 2), (30, 1, 1), degree=2), (0.0, 0.0, h / 2))
    bodies = join(a=box((length, h, h / 2), (40, 1, 1), degree=2), b=upper)
    materials = {
        "a": Material(E, NU, expansion=1e-5),
        "b": Material(E, NU, expansion=1e-5 + difference),
    }
    problem = ContactProblem(
        bodies,
        materials,
        [SymmetryPlane("a:left"), SymmetryPlane("b:left"), Clamp("a:left", "yz")],
        FAR,
        temperature=heated,
        ties=[Tied("a:top", "b:bottom")],
        small_strain="warn",
    )
    u, x = problem.displacement(np.zeros(3 * problem.A.nodes)), problem.elasticity.x
    at = [np.argmin(np.linalg.norm(x - [s * length, h / 2, 0.0], axis=1)) for s in (0.3, 0.5, 0.7)]
    first, middle, last = u[at, 2]
    curvature = -(first - 2.0 * middle + last) / (0.2 * length) ** 2
    assert curvature == pytest.approx(1.5 * difference * heated / h, rel=0.01)


def test_curved_faces_that_are_apart_follow_rigid_motions():
    """A shaft in a hub of other facets: chords leave gaps, and rigid motions of both together cause no forces."""
    bodies = join(a=ring_mesh(0.1, 0.15, (2, 7, 2), height=0.05), b=ring_mesh(0.05, 0.1, (2, 4, 3), height=0.05))
    problem = ContactProblem(
        bodies,
        STEEL,
        [Clamp("a:right")],
        Contact("b:left", 0.2, foundation=coulomb.Cylinder((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0.049)),
        ties=[Tied("a:left", "b:right")],
    )
    body = problem.elasticity
    rigid = np.array([1e-3, 2e-3, -3e-3]) + np.cross([0.3, -0.2, 0.5], body.x)
    assert np.abs(body.reduction.left_apart(rigid, body.at(0.0).apart)).max() <= 1e-13
    left = body.reduction.transferred(np.random.default_rng(0).standard_normal(body.x.shape))
    assert np.abs(left[body.constraints.ties[0].nodes]).max() == 0.0
    forces = np.random.default_rng(1).standard_normal(body.x.shape)
    moved_forces = body.reduction.transferred(forces)
    assert moved_forces.sum(axis=0) == pytest.approx(forces.sum(axis=0), abs=1e-10)
    assert np.cross(body.x, moved_forces).sum(axis=0) == pytest.approx(np.cross(body.x, forces).sum(axis=0), abs=1e-10)


def test_a_face_that_is_clamped_in_part_does_not_follow():
    """Three quarters of a hub on a shaft whose end is clamped, twisted: the clamped nodes of the shaft hold the hub as
    well.  As the slave the shaft leaves the hub free there, which is said; forces are those of the load in both."""
    angles, around = [], 1.5 * np.pi
    for slave in (None, "shaft:right"):
        names = ("shaft:right", "hub:left")
        bodies = join(hub=ring_mesh(0.03, 0.05, (2, 12, 4), around), shaft=ring_mesh(0.01, 0.03, (2, 16, 6), around))
        force = [Traction("hub:right", lambda x: np.stack([-x[1], x[0], 0.0 * x[0]]) * 4e7)]
        foundation = Plane((0.0, 0.0, -1.0), (0.0, 0.0, 1.0))
        contact = Contact("hub:bottom", 0.2, foundation=foundation)
        problem = ContactProblem(
            bodies, STEEL, [Clamp("shaft:bottom")], contact, force, ties=[Tied(*names, slave=slave is not None)]
        )
        solution, x = problem.solve(), problem.elasticity.x
        load, (tie,) = solution.loads[0], solution.ties
        sign = -1.0 if tie.face == "hub:left" else 1.0
        assert sign * tie.moment[2] == pytest.approx(load.moment[2], rel=1e-9)
        assert tie.face == (slave or "hub:left")
        assert any("give that as the slave" in text for text in problem.body.remarks) == (slave is not None)
        top = (x[:, 2] > 0.0999) & (np.hypot(x[:, 0], x[:, 1]) > 0.045)
        u = solution.displacement
        angles.append(np.mean((x[:, 0] * u[:, 1] - x[:, 1] * u[:, 0])[top] / np.sum(x[top, :2] ** 2, axis=1)))
    assert angles[0] < angles[1]


@pytest.mark.parametrize("degree", [1, 2])
def test_three_blocks_that_meet_at_a_line(degree):
    """Ties that share nodes: a beam on two blocks that are tied to each other; the patch test holds."""
    cell = "tetrahedron" if degree == 2 else "hexahedron"
    a = box((1.0, 1.0, 1.0), (3, 2, 2), cell, degree=degree)
    b = moved(box((1.0, 1.0, 1.0), (2, 2, 3), cell, degree=degree), (1.0, 0.0, 0.0))
    c = moved(box((2.0, 1.0, 1.0), (5, 3, 2), cell, degree=degree), (0.0, 0.0, 1.0))
    supports = [SymmetryPlane(f"{name}:front") for name in "abc"] + [SymmetryPlane("a:left"), SymmetryPlane("c:left")]
    for slave in (True, False):
        ties = [Tied("a:top", "c:bottom", slave), Tied("b:top", "c:bottom", slave), Tied("a:right", "b:left", slave)]
        contacts = [Contact("a:bottom", 0.0), Contact("b:bottom", 0.0)]
        problem = ContactProblem(join(a=a, b=b, c=c), STEEL, supports, contacts, [Pressure("c:top", 1e6)], ties=ties)
        left, jump = residual(problem, uniaxial(problem.elasticity.x, -1e6))
        assert jump <= 1e-13 and left <= 1e-10, (slave, left)
        assert problem.solve().valid


def test_what_is_tied_moves_together():
    """Bodies without supports: the free motions are those of the whole; contact and friction hold it."""
    a, b = box((1.0, 1.0, 1.0), (3, 3, 2)), moved(box((0.6, 0.7, 1.0), (4, 4, 3)), (0.2, 0.1, 1.0))
    push = [Pressure("b:top", 1e6), Traction("b:right", (-1e5, 0.0, 0.0))]
    problem = ContactProblem(
        join(a=a, b=b), STEEL, [], Contact("a:bottom", 0.3), push, ties=[Tied("b:bottom", "a:top")]
    )
    assert len(problem.elasticity.free) == 6
    assert problem.elasticity.free.bodies == ('body "a" with body "b"',)
    solution = problem.solve()
    assert solution.valid
    assert -np.array(solution.at_nodes.totals(0)["force"]) == pytest.approx([-7e4, 0.0, -4.2e5], abs=1.0)


def test_a_load_history_of_tied_bodies():
    """A load history of a prescribed foundation: forces are linear in its way, and the energies add up."""
    bodies = join(a=box((1.0, 1.0, 1.0), (2, 2, 2)), b=moved(box((1.0, 1.0, 1.0), (3, 3, 3)), (0.0, 0.0, 1.0)))
    problem = ContactProblem(
        bodies,
        STEEL,
        [Clamp("a:bottom")],
        Contact(
            "b:top",
            0.0,
            foundation=Plane((0, 0, 2.0), (0, 0, -1.0)),
            motion=[(0.0, 0.0, 0.0, 0.0), (2.0, 0.0, 0.0, -2e-4)],
        ),
        ties=[Tied("a:top", "b:bottom")],
    )
    steps = list(LoadHistory([1.0, 2.0]).steps(problem))
    first, last = [step.solution.at_nodes.totals(0)["force"][2] for step in steps]
    assert last == pytest.approx(2.0 * first, rel=0.02) and first != 0.0
    assert abs(steps[-1].state.energy.imbalance) <= 1e-6 * steps[-1].state.energy.elastic


def test_names_of_ties():
    bodies = join(a=box((1.0, 1.0, 1.0), (2, 2, 2)), b=moved(box((1.0, 1.0, 1.0), (2, 2, 2)), (0.0, 0.0, 1.0)))
    with pytest.raises(ValueError, match="tie: body 'b' has no face"):
        ContactProblem(bodies, STEEL, [Clamp("a:bottom")], FAR, ties=[Tied("a:top", "b:middle")])
    with pytest.raises(ValueError, match="cannot be tied to itself"):
        Tied("a:top", "a:top")
    with pytest.raises(ValueError, match="by its name"):
        Tied("a:top", 3)


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
@pytest.mark.parametrize("sides", [("a", "b"), ("b", "a")])
def test_contact_of_tied_faces(cell, sides):
    """Refused with the names where no contact point can move: on the same faces and on parts of them, whichever is the
    slave of the tie; where only some are tied, the others are in contact."""
    low = box((1.0, 1.0, 0.5), (4, 2, 1), cell)
    up = moved(box((1.0, 1.0, 0.5), (4, 2, 1), cell), (0.0, 0.0, 0.5))
    for mesh, face in ((low, "top"), (up, "bottom")):
        facets = mesh.faces[face]
        mesh.faces["whole"] = facets
        mesh.faces["part"] = facets[mesh.domain.geometry.x[corners_of(mesh.domain, facets)].mean(axis=1)[:, 0] < 0.5]

    def posed(contact, tie):
        tied = Tied(*(f"{side}:{tie}" for side in sides), slave=True)
        pair = Contact(f"b:{contact}", 0.3, against=f"a:{contact}", slave=True)
        load = Traction("b:top", (1e5, 0.0, -1e6))
        return ContactProblem(join(a=low, b=up), STEEL, [Clamp("a:bottom")], pair, [load], ties=[tied])

    for contact, tie in (("whole", "whole"), ("part", "whole")):
        said = (
            f"contact of 'b:{contact}' with 'a:{contact}': the tie of '{sides[0]}:{tie}' and '{sides[1]}:{tie}' holds"
        )
        with pytest.raises(ValueError, match=said):
            posed(contact, tie)
    assert posed("whole", "part").solve().valid


def test_corners_of_untied_edges():
    """Of 6-node triangles that the master covers in part, the corners of an edge whose middle is not tied are not tied,
    either: they would follow it, and it them."""
    low = box((0.55, 1.0, 0.5), (3, 3, 1), "tetrahedron", degree=2)
    up = moved(box((1.0, 1.0, 0.5), (2, 2, 1), "tetrahedron", degree=2), (0.0, 0.0, 0.5))
    roof = Contact("b:top", 0.3, foundation=Plane((0.0, 0.0, 2.0), (0.0, 0.0, -1.0)))
    tied = Tied("b:bottom", "a:top", slave=True)
    body = ContactProblem(join(a=low, b=up), STEEL, [Clamp("a:bottom")], roof, ties=[tied]).elasticity
    places = np.round(4.0 * body.x[body.constraints.ties[0].nodes, :2]).astype(int)
    assert len(places) > 0
    middles = {tuple(at) for at in places.tolist() if at[0] % 2 or at[1] % 2}
    for x, y in places.tolist():
        if x % 2 == y % 2 == 0:  # a corner: the middles of the edges along the axes
            beside = [(x + i, y + j) for i, j in ((1, 0), (-1, 0), (0, 1), (0, -1))]
            assert all(at in middles for at in beside if 0 <= min(at) and max(at) <= 4)


def test_springs_that_are_too_soft_for_a_body_alone_are_not_for_a_tied_one():
    """What the tie holds needs no spring; without the tie the message names the body."""
    bodies = join(a=box((1.0, 1.0, 1.0), (2, 2, 2)), b=moved(box((1.0, 1.0, 1.0), (2, 2, 2)), (0.0, 0.0, 1.0)))
    given = bodies, STEEL, [Clamp("a:left")], Contact("a:bottom", 0.0)
    soft = [Spring("b:top", 1e-6)]
    assert len(ContactProblem(*given, springs=soft, ties=[Tied("a:top", "b:bottom")]).elasticity.free) == 0
    with pytest.raises(ValueError, match=r'^body "b": the springs are too soft in comparison .* moves along x'):
        ContactProblem(*given, springs=soft)
