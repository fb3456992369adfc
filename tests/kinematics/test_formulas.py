"""Large motions against formulas of mechanics: belts, inclines, homogeneous strains; loads of rubber by themselves."""

import numpy as np
import pytest
from rubber_blocks import LAME, MU, RubberBlock
from scipy.optimize import brentq

import coulomb
from coulomb.fem.compat import fem, ufl
from coulomb.kinematics import LargeMotions, neo_hookean, st_venant_kirchhoff

DRUM = coulomb.Cylinder((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 1.0)
"""Of the belts: of radius 1, along y."""


def answers(body, contacts, times, **history):
    problem = LargeMotions(body, contacts)
    return [step.solution for step in coulomb.LoadHistory(times, **history).steps(problem)]


def turning(angle):
    """About the y axis, by an angle in degrees."""
    return coulomb.Rotation((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), lambda time: np.radians(angle(time)))


def bent(x):
    """A box on the drum: the first coordinate is the angle from its top, the third the height above it."""
    angle, radius = x[:, 0], 1.0 + x[:, 2]
    return np.column_stack([radius * np.sin(angle), x[:, 1], radius * np.cos(angle)])


def slid(one, friction):
    """The answer of a belt on a drum that turns under it until all of it slides, from where it has turned already."""
    rotation = turning(lambda time: 150.0 + max(time - 1.0, 0.0))
    contact = coulomb.Contact("bottom", friction=friction, foundation=DRUM, rotation=rotation)
    *_, last = answers(one.body, contact, [1.0, 2.0])
    force = last.contact_force.reshape(-1, 3)
    assert last.valid
    assert np.linalg.norm(force[:, 1:], axis=1) == pytest.approx(friction * force[:, 0], rel=1e-6)
    return last


def belt(friction, angle, cells, thickness=0.01):
    """T2/T1 of a belt of rubber: its end on the top of the drum is held along the belt, on the other there is a load.
    Soft springs hold what contact would have to hold first."""
    young, width = 1e6, 0.1
    load = 1e-3 * young * thickness * width * np.array([np.cos(angle), 0.0, -np.sin(angle)])
    one = RubberBlock(
        cells=(cells, 1, 1),
        size=(angle, width, thickness),
        shape=bent,
        held="left",
        components=(0,),
        also=[("front", 1)],
        loads={"right": lambda time: min(time, 1.0) * load},
        energy=lambda u: neo_hookean(u, 0.5 * young, 0.0) + 0.5e-5 * young * ufl.inner(u, u),
    )
    held = -(slid(one, friction).force_on_body.sum(axis=0) + load)
    return np.linalg.norm(held) / np.linalg.norm(load)


def membrane(u, n):
    """Half of the square of Green's strain in the plane with normals n."""
    P = ufl.Identity(3) - ufl.outer(n, n)
    F = (ufl.Identity(3) + ufl.grad(u)) * P
    strain = 0.5 * (F.T * F - P)
    return 0.5 * ufl.inner(strain, strain)


def of_thin(friction, thickness):
    """The exponent over the angle, for a belt whose tension T is in its middle, at r, friction F n per angle at 1, and
    the bending moment the same everywhere: r T' = F n and T' - Q = F n, T + Q' = n with the shear force Q."""
    r = 1.0 + 0.5 * thickness
    return brentq(lambda k: k * (1.0 + friction * (r - 1.0) / r * k) - friction / r, 0.0, friction)


def test_a_belt_on_a_drum_has_the_forces_of_the_formula():
    """T2 = T1 exp(F angle), but for the thickness; with it the error of the mesh is of second order."""
    angle, friction = 0.5 * np.pi, 0.5
    ratios = np.array([belt(friction, angle, cells) for cells in (8, 16)])
    assert ratios == pytest.approx(np.exp(friction * angle), rel=0.01)
    errors = ratios / np.exp(of_thin(friction, 0.01) * angle) - 1.0
    assert errors[1] < 2e-3 and errors[0] / errors[1] == pytest.approx(4.0, rel=0.15)


def test_a_string_on_a_drum_has_the_forces_of_the_formula():
    """A belt whose stiffness is in its lower face, over 90 degrees, with ends that are held along it: at each node two
    tensions along chords, a normal force and friction.  exp(F angle) follows to second order in a chord."""
    friction, errors = 0.5, []
    for cells in (5, 10):
        one = RubberBlock(
            way=lambda time, x: np.array([[0.0], [0.0], [-2e-3 * min(time, 1.0)]]) * (x[0] > 0.5),
            cells=(cells, 1, 1),
            size=(0.5 * np.pi, 0.1, 0.001),
            shape=bent,
            held="left",
            components=(0,),
            also=[("right", 2), ("front", 1)],
            energy=lambda u: neo_hookean(u, 20.0, 0.0) + 1e-3 * ufl.inner(u, u),
            skin=lambda u, n: 1e4 * membrane(u, n),
        )
        last = slid(one, friction)
        along, _, across = last.force_on_body.sum(axis=0)
        x = (one.body.reference + last.displacement)[last.problem.surface.nodes]
        place = np.unique(np.round(np.arctan2(x[:, 0], x[:, 2]), 9))
        half, beyond = 0.5 * np.diff(place), place[-1] - 0.5 * np.pi
        turn = friction * np.tan(half)
        formula = np.prod((1.0 + turn) / (1.0 - turn)) * (np.cos(beyond) - friction * np.sin(beyond))
        assert along / across == pytest.approx(formula, rel=1e-6)
        errors.append(along / across / np.exp(0.5 * np.pi * friction) - 1.0)
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.02)


def in_a_bore(size, weight, moving, friction, history):
    """The steps of a cube with a weight in a bore of radius 1 that moves, with its nodes in contact as they are then.

    The weight is in the contact face, a pressure along the bore gives the strains a scale, and a dashpot holds the cube
    while nothing else does.
    """
    before = []

    def energy(u):
        before.append(fem.Function(u.function_space))
        slow = 0.5e-3 * weight / size**3 * ufl.inner(u - before[0], u - before[0])
        return neo_hookean(u, 0.5e6, 0.0) + slow

    one = RubberBlock(
        cells=(1, 1, 1),
        size=(size, size, size),
        at=(-0.5 * size, 0.0, -np.sqrt(1.0 - 0.25 * size**2)),
        held="front",
        components=(1,),
        loads={"bottom": lambda time: [0.0, 0.0, -weight], "back": lambda time: [0.0, -0.2 * weight, 0.0]},
        energy=energy,
    )
    bore = coulomb.Cylinder((0.0, 0.0, 0.0), (0.0, 1.0, 0.0), 1.0, hollow=True)
    problem = LargeMotions(one.body, coulomb.Contact("bottom", friction=friction, foundation=bore, **moving))
    for step in history.steps(problem):
        before[0].x.array[:] = one.u.x.array
        solution = step.solution
        assert solution.certificate.passed
        y = one.body.reference + solution.displacement
        yield solution, y[solution.problem.surface.nodes]


def test_a_small_body_in_a_turning_bore_rests_at_the_angle_of_friction():
    """The bore carries it up until it slides back: the formula of an incline, but for the square of the half angle of
    the face, which follows from the two lines on which it stands."""
    friction, size = 0.5, 1e-3
    moving = {"rotation": turning(lambda time: -20.0 * max(time - 1.0, 0.0))}
    history = coulomb.LoadHistory([1.0, 2.0, 3.0, 4.0, 5.0], tolerance=1e-10)
    found = [x.mean(axis=0) for _, x in in_a_bore(size, 0.1, moving, friction, history)]
    tangent = [-x / z for x, _, z in found]
    assert tangent[1] == pytest.approx(np.tan(np.radians(20.0)), rel=1e-4)  # carried
    assert tangent[-1] == pytest.approx(friction, rel=1e-6)
    assert tangent[-1] / friction - 1.0 == pytest.approx(0.25 * size**2 * (1.0 + friction**2), abs=1e-8)


def test_a_small_body_drawn_over_waves_has_the_force_of_the_incline_everywhere():
    """From a valley over the crest: the force of the foundation is at the angle of friction to the normal where its
    centre is, but for the square of the angle that the body spans, about 1e-7."""
    size, friction, weight = 1e-3, 0.3, 0.1

    def height(x):
        return 0.2 - 0.2 * np.cos(2.0 * x)

    def slope(x):
        return 0.4 * np.sin(2.0 * x)

    def way(time, x):
        return np.array([[0.2 * max(time - 1.0, 0.0)], [0.0], [0.0]]) + 0.0 * x

    one = RubberBlock(
        way,
        cells=(1, 1, 1),
        size=(size, size, 0.25 * size),
        at=(-0.5 * size, 0.0, height(0.5 * size)),
        components=(0,),
        also=[("front", 1)],
        loads={"top": lambda time: [0.0, 0.0, -weight]},
        energy=lambda u: neo_hookean(u, 0.5e6, 0.0),
    )
    waves = coulomb.SignedDistance(
        lambda x: x[2] - height(x[0]), lambda x: np.array([-slope(x[0]), 0.0 * x[0], 1.0 + 0.0 * x[0]])
    )
    contact = coulomb.Contact("bottom", friction=friction, foundation=waves)
    places = []
    for last in answers(one.body, contact, [1.0, 1.05, 3.0, 5.0, 7.0, 9.0, 11.0], tolerance=1e-10)[1:]:
        along, _, upward = last.force_on_body.sum(axis=0)
        y = (one.body.reference + last.displacement)[last.problem.surface.nodes]
        places.append(np.average(y[:, 0], weights=last.contact_force[0::3]))
        angle = np.arctan(slope(places[-1])) + np.arctan(friction)
        assert last.valid and np.arctan2(-along, upward) == pytest.approx(angle, abs=1e-6)
    assert slope(places[-1]) < -0.2 < 0.2 < max(map(slope, places))


def test_in_a_bore_that_moves_a_load_inside_the_friction_cone_does_not_creep():
    """The bore rocks by half the angle of friction, there and back, and moves: all nodes stay where they are in it."""

    def angle(time):
        return 13.0 * np.sin(0.08 * np.pi * (time - 1.0))

    def way(time):
        return np.array([0.01 * (time - 1.0), 0.0, 0.005 * (time - 1.0)])

    moving, places = {"rotation": turning(angle), "motion": way}, []
    history = coulomb.LoadHistory(np.arange(1.0, 15.0))  # 14 s: beyond half of the period
    for time, (solution, x) in enumerate(in_a_bore(0.2, 4e3, moving, 0.5, history), start=1):
        y = x - way(time)
        places.append(np.column_stack([np.arctan2(y[:, 0], -y[:, 2]) + np.radians(angle(time)), y[:, 1]]))
        friction = np.linalg.norm(solution.at_nodes.force[:, 1:], axis=1)
        assert np.all(friction < solution.at_nodes.bound)
    assert np.abs(np.array(places) - places[0]).max() < 1e-10


def test_a_dead_load_in_an_energy_presses_with_its_force():
    """Its part of the tangent is none."""
    one = RubberBlock(held="front", components=(1,), also=[("left", 0)], loads={"top": lambda time: [0.0, 0.0, -2e5]})
    (answer,) = answers(one.body, coulomb.Contact("bottom", friction=0.0), [1.0])
    assert answer.valid
    assert answer.at_nodes.totals()["force"] == pytest.approx([0.0, 0.0, 2e5], abs=1e-3)


def test_small_loads_have_the_answer_of_small_strains_to_second_order():
    """St. Venant-Kirchhoff under dead loads; some of the nodes stick, some slip."""

    def difference(size):
        load = size * np.array([0.7e5, 0.2e5, -2e5])
        one = RubberBlock(
            held="left",
            loads={"top": lambda time: load},
            energy=lambda u: st_venant_kirchhoff(u, MU, LAME),
        )
        (large,) = answers(one.body, coulomb.Contact("bottom", friction=0.3), [1.0], tolerance=1e-11)
        small = coulomb.ContactProblem(
            coulomb.box((1.0, 1.0, 1.0), (2, 2, 2)),
            coulomb.Material(1e6, 0.3),
            [coulomb.Clamp("left")],
            coulomb.Contact("bottom", friction=0.3),
            tractions=[coulomb.Traction("top", load)],
        ).solve(1e-11)
        assert large.valid
        part = large.at_nodes.slip_bound - np.linalg.norm(large.at_nodes.force[:, 1:], axis=1)
        assert np.any(part > 0.1 * part.max()) and np.any(part < 1e-6 * part.max())
        apart = large.at_nodes.force - small.at_nodes.force
        return np.linalg.norm(apart), np.linalg.norm(large.displacement - small.displacement)

    sizes = 0.04 * np.array([1.0, 0.5, 0.25])
    forces, displacements = np.array([difference(size) for size in sizes]).T
    for values in (forces, displacements):
        assert values[:-1] / values[1:] == pytest.approx([4.0, 4.0], rel=0.02)


@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_a_block_stretched_along_both_sides_between_plates_has_the_stress_of_the_formula(friction):
    """Smooth and rough plates alike: the strain is the same everywhere, and nothing slips once the sides are held.
    Soft springs hold the block until both plates do, and vanish in the middle."""
    stretch, thickness = 1.2, 0.6

    def way(time, x):
        return (stretch - 1.0) * min(time, 1.0) * x * [[1.0], [1.0], [0.0]]

    def plate(face, side):
        way = lambda time: (0.0, 0.0, side * 0.5 * (1.0 - thickness) * max(time - 1.0, 0.0))  # noqa: E731
        return coulomb.Contact(face, friction=friction, motion=way)

    one = RubberBlock(
        way,
        held="left",
        components=(0,),
        also=[("right", 0), ("front", 1), ("back", 1)],
        energy=lambda u: neo_hookean(u, MU, LAME) + 0.5 * u[2] ** 2,
    )
    *_, last = answers(one.body, [plate("bottom", 1.0), plate("top", -1.0)], [1.0, 1.5, 2.0], tolerance=1e-11)
    stress = MU * (thickness - 1.0 / thickness) + LAME * np.log(stretch**2 * thickness) / thickness
    assert last.valid
    for part, sign in enumerate((-1.0, 1.0)):
        force = last.force_on_body[last.at_nodes.part == part].sum(axis=0)
        # the springs in half of the block, of 1 N/m^3, have up to 0.2 m x 0.36 m^3 of force
        assert force == pytest.approx([0.0, 0.0, sign * stress], rel=1e-8, abs=0.08)


def test_a_block_slides_over_the_edge_of_another_and_both_are_in_balance():
    """By three quarters of its length, with nodes that are dropped on the way.  Internal forces at the nodes that no
    condition holds are those of contact: without resultants, taken of both bodies."""

    def way(time, x):
        return np.array([[0.7 * max(time - 1.0, 0.0)], [0.0], [-0.05 * min(time, 1.0)]]) + 0.0 * x

    lower = RubberBlock(cells=(4, 2, 1), size=(1.2, 1.0, 0.5), held="bottom")
    upper = RubberBlock(way, cells=(2, 1, 1), size=(0.8, 0.8, 0.5), at=(0.3, 0.1, 0.5))
    both = coulomb.join(lower=lower.body, upper=upper.body)
    contact = coulomb.Contact("upper:bottom", against="lower:top", friction=0.2)
    points = []
    for step in coulomb.LoadHistory([1.0, 1.35, 1.7, 2.0]).steps(LargeMotions(both, contact)):
        assert step.solution.certificate.passed and step.halvings == 0
        points.append(len(step.solution.contact_force) // 3)
        (below, at_lower), (above, at_upper) = lower.free_forces(), upper.free_forces()
        size = np.linalg.norm(above.sum(axis=0))
        assert step.solution.force_on_body.sum(axis=0) == pytest.approx(above.sum(axis=0), abs=1e-7 * size)
        assert np.abs(below.sum(axis=0) + above.sum(axis=0)).max() < 1e-7 * size
        moment = np.cross(at_lower, below).sum(axis=0) + np.cross(at_upper, above).sum(axis=0)
        assert np.abs(moment).max() < 1e-5 * size  # of a mortar method: exact where gaps are closed everywhere
    assert points[-1] < points[0] and above[:, 2].sum() > 0.0


def test_a_problem_that_is_turned_as_a_whole_has_the_forces_turned():
    """A block with a dead load, drawn over a cylinder."""
    axis, angle = np.array([1.0, 2.0, -2.0]) / 3.0, 2.0
    cross = np.cross(np.eye(3), -axis)
    Q = np.eye(3) + np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
    shift = np.array([0.3, -0.2, 0.5])

    def drawn(Q, shift):
        def way(time, x):
            return (Q @ [0.4 * max(time - 1.0, 0.0), 0.1 * max(time - 1.0, 0.0), -0.2 * min(time, 1.0)])[
                :, None
            ] + 0.0 * x

        one = RubberBlock(way, shape=lambda x: x @ Q.T + shift, loads={"left": lambda time: Q @ [2e4, 1e4, 0.0]})
        hill = coulomb.Cylinder(Q @ [0.5, 0.0, -2.0] + shift, Q @ [0.0, 1.0, 0.0], 2.0)
        contact = coulomb.Contact("bottom", friction=0.3, foundation=hill)
        *_, last = answers(one.body, contact, [1.0, 2.0], tolerance=1e-11)
        assert last.certificate.passed and np.linalg.norm(last.at_nodes.slip, axis=1).max() > 0.1
        return last.force_on_body, last.displacement

    for before, after in zip(drawn(np.eye(3), np.zeros(3)), drawn(Q, shift), strict=True):
        assert np.abs(after - before @ Q.T).max() < 1e-9 * np.abs(before).max()


@pytest.mark.parametrize("hollow", [False, True])
def test_friction_work_of_a_press_fit_is_torque_times_angle(hollow):
    """A quarter of a rubber tube on a rigid pin, or in a rigid hole, with an interference of a tenth of the pin's
    radius: when all of it slips, torque times angle goes into friction, at the radius where the tube is."""
    inner, outer = 0.01, 0.016

    def place(x):
        angle, r = 0.5 * np.pi * x[0], inner + (outer - inner) * x[2]
        return np.array([r * np.cos(angle), r * np.sin(angle), 0.01 * x[1]])

    face, held = ("top", "bottom") if hollow else ("bottom", "top")
    axis = (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)
    problem = coulomb.ContactProblem(
        coulomb.box((1.0, 1.0, 1.0), (4, 1, 1), place=place),
        coulomb.NeoHookean(5e6, 0.45),
        [coulomb.Clamp("front", "z"), coulomb.Clamp("back", "z")],
        coulomb.Contact(
            face,
            0.3,
            foundation=coulomb.Cylinder(*axis, outer if hollow else inner, hollow=hollow),
            gap=-1e-3,
            gap_amplitude=[(0, 0), (1, 1)],
            rotation=coulomb.Rotation(*axis, [(0, 0), (1, 0), (2, 0.6), (3, 0.7)]),
        ),
        ties=[coulomb.CyclicSymmetry("left", "right", sectors=4)],
        springs=[coulomb.Spring(held, 2e8)],
        kinematics="large",
    )
    *_, before, after = coulomb.LoadHistory([1.0, 2.0, 3.0]).steps(problem)
    totals = after.solution.at_nodes.totals(0)
    torque, radius = abs(totals["moment"][2]), 0.015 if hollow else 0.011
    assert after.solution.valid and torque == pytest.approx(0.3 * totals["normal_force"] * radius, rel=1e-6)
    assert after.state.energy.dissipated - before.state.energy.dissipated == pytest.approx(0.1 * torque, rel=1e-6)


@pytest.mark.parametrize(
    "foundation",
    [coulomb.Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)), coulomb.Cylinder((0.2, 0.0, -0.3), (0.0, 1.0, 0.0), 0.3)],
    ids=["disc", "drum"],
)
def test_friction_of_whole_turns_is_against_the_velocity_and_works_along_the_arc(foundation):
    """A pad on a disc or a drum that turns by a turn, and by more than two: all of it slips, where nothing changes any
    more torque times angle goes into friction."""
    disc = isinstance(foundation, coulomb.Plane)
    axis = (0.0, 0.0, 1.0) if disc else (0.0, 1.0, 0.0)
    rotation = coulomb.Rotation((0.2, 0.0, -0.3), axis, [(1.0, 0.0), (2.0, 2.0 * np.pi), (3.0, -9.0), (4.0, -24.0)])
    problem = coulomb.ContactProblem(
        coulomb.moved(coulomb.box((0.02, 0.02, 0.02), (1, 1, 1)), (0.0 if disc else 0.19, 0.0, 0.0)),
        coulomb.NeoHookean(1e6, 0.3),
        [coulomb.PrescribedDisplacement("top", (0.0, 0.0, -1e-3), amplitude=[(0.0, 0.0), (1.0, 1.0)])],
        coulomb.Contact("bottom", 0.3, foundation=foundation, rotation=rotation),
        kinematics="large",
    )
    *_, before, after = coulomb.LoadHistory([1.0, 2.0, 3.0, 4.0]).steps(problem)
    answer = after.solution
    from_axis = answer.problem.surface.x - rotation.point
    torque = 0.3 * answer.contact_force[0::3] @ np.linalg.norm(np.cross(from_axis, axis), axis=1)
    assert answer.valid
    assert -np.cross(from_axis, answer.force_on_body).sum(axis=0) @ axis == pytest.approx(torque, rel=1e-6)
    assert after.state.energy.dissipated - before.state.energy.dissipated == pytest.approx(15.0 * torque, rel=1e-6)


def turned(face, point, axis, angles):
    """Supports of a pad, and a rigid face: that a rotation of its top is prescribed by, and 1 mm downwards before."""
    down = [(0.0, 0.0), (1.0, 1.0)]
    if face == "support":
        held = coulomb.PrescribedRotation("top", point, axis, 1.0, angles, axial="free")
        return [held, coulomb.PrescribedDisplacement("top", (0.0, 0.0, -1e-3), "z", amplitude=down)], []
    rotation = tuple(2.0 * np.array(axis))
    half = [(time, 0.5 * angle) for time, angle in angles]
    amplitudes = [1.0, 1.0, down, half, half, half]
    return [], [coulomb.RigidFace("top", point, (0.0, 0.0, -1e-3), rotation, amplitudes=amplitudes)]


@pytest.mark.parametrize("held", ["support", "rigid face"])
def test_friction_under_a_body_that_is_turned_is_along_the_arc(held):
    """A pad is turned on a plane at rest about an axis beside it, by 90 degrees, and by a whole turn: friction is
    against the velocity, and works by torque times angle."""
    axis, point = (0.0, 0.0, 1.0), (0.03, 0.0, 0.0)
    angles = [(1.0, 0.0), (2.0, 0.5 * np.pi), (3.0, np.pi), (4.0, 3.0 * np.pi), (5.0, 5.0 * np.pi)]
    supports, rigid = turned(held, point, axis, angles)
    problem = coulomb.ContactProblem(
        coulomb.box((0.02, 0.02, 0.02), (1, 1, 1)),
        coulomb.NeoHookean(1e6, 0.3),
        supports,
        coulomb.Contact("bottom", 0.3, foundation=coulomb.Plane((0.0, 0.0, 0.0), axis)),
        rigid_faces=rigid,
        kinematics="large",
    )
    *_, before, after = coulomb.LoadHistory([1.0, 2.0, 3.0, 4.0, 5.0], halvings=0).steps(problem)
    answer = after.solution
    from_axis = answer.problem.surface.x - point
    torque = 0.3 * answer.contact_force[0::3] @ np.linalg.norm(np.cross(from_axis, axis), axis=1)
    assert answer.valid
    assert -np.cross(from_axis, answer.force_on_body).sum(axis=0) @ axis == pytest.approx(torque, rel=1e-6)
    work = after.state.energy.dissipated - before.state.energy.dissipated
    assert work == pytest.approx(2.0 * np.pi * torque, rel=1e-6)


def test_friction_under_a_body_that_is_drawn_and_turned_at_once():
    """By 0.2 of its width and 0.5 radians about an axis that moves with it, in one step: friction is against the
    velocity, but for what this turns in a part of the step."""
    width, way, angle = 0.02, 0.004, 0.5
    drawn, turned, down = [(1.0, 0.0), (2.0, way)], [(1.0, 0.0), (2.0, angle)], [(0.0, 0.0), (1.0, 1.0)]
    amplitudes = [drawn, 1.0, down, 1.0, 1.0, turned]
    problem = coulomb.ContactProblem(
        coulomb.box((width, width, 0.01), (3, 3, 1)),
        coulomb.NeoHookean(1e6, 0.0),
        [],
        coulomb.Contact("bottom", 0.3, foundation=coulomb.Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0))),
        rigid_faces=[coulomb.RigidFace("top", None, (1.0, 0.0, -1e-4), (0.0, 0.0, 1.0), amplitudes=amplitudes)],
        kinematics="large",
    )
    *_, last = coulomb.LoadHistory([1.0, 2.0], halvings=0).steps(problem)
    answer = last.solution
    from_axis = answer.problem.surface.x - np.array([0.5 * width + way, 0.5 * width, 0.0])
    velocity = angle * np.cross((0.0, 0.0, 1.0), from_axis) + (way, 0.0, 0.0)
    friction = -0.3 * answer.contact_force[0::3, None] * velocity / np.linalg.norm(velocity, axis=1)[:, None]
    off, size = answer.force_on_body - friction, np.abs(friction).sum()
    assert answer.valid
    assert np.abs(off[:, :2].sum(axis=0)).max() <= 0.05 * size
    assert abs(np.cross(from_axis, off)[:, 2].sum()) <= 0.05 * width * size


@pytest.mark.parametrize(
    ("held", "way", "angle"),
    [
        ("support", (0.2, 0.2, 0.0), -0.5),
        ("support", (0.0, 0.3, 0.0), -0.5),
        ("rigid face", (0.2, 0.1, 0.0), 0.5),
    ],
)
def test_friction_under_a_body_that_is_drawn_over_a_disc_that_turns(held, way, angle):
    """About an axis through its face, in one step: friction is against the velocity at its end."""
    down, ramp, axis = [(0.0, 0.0), (1.0, 1.0)], [(1.0, 0.0), (2.0, 1.0)], (0.0, 0.0, 1.0)
    supports, rigid = [], []
    if held == "support":
        supports.append(coulomb.PrescribedDisplacement("top", (0.0, 0.0, -1e-3), "z", amplitude=down))
        supports.append(coulomb.PrescribedDisplacement("top", way, "xy", amplitude=ramp))
    else:
        pressed = way[0], way[1], -1e-3
        rigid.append(
            coulomb.RigidFace("top", None, pressed, (0.0, 0.0, 0.0), amplitudes=[ramp, ramp, down, *[1.0] * 3])
        )
    problem = coulomb.ContactProblem(
        coulomb.moved(coulomb.box((0.4, 0.4, 0.2), (3, 3, 1)), (-0.2, -0.2, 0.0)),
        coulomb.NeoHookean(1e6, 0.0),
        supports,
        coulomb.Contact(
            "bottom",
            0.3,
            foundation=coulomb.Plane((0.0, 0.0, 0.0), axis),
            rotation=coulomb.Rotation((0.0, 0.0, 0.0), axis, [(1.0, 0.0), (2.0, angle)]),
        ),
        rigid_faces=rigid,
        kinematics="large",
    )
    *_, last = coulomb.LoadHistory([1.0, 2.0], halvings=0).steps(problem)
    answer = last.solution
    velocity = way - angle * np.cross(axis, answer.problem.surface.x)
    friction = -0.3 * answer.contact_force[0::3, None] * velocity / np.linalg.norm(velocity, axis=1)[:, None]
    off = answer.force_on_body[:, :2] - friction[:, :2]
    assert answer.valid
    assert np.linalg.norm(off.sum(axis=0)) <= 0.02 * np.linalg.norm(friction.sum(axis=0))


def test_a_body_that_is_drawn_along_with_a_disc_sticks():
    """By as much as the disc turns in the middle of its face, in one step: no point that sticks has slipped."""
    angle, axis = 0.1, (0.0, 0.0, 1.0)
    way = (np.cos(angle) - 1.0, np.sin(angle), -1e-2)
    amplitude = [(0.0, 0.0), (1.0, 0.0), (2.0, 1.0)]
    problem = coulomb.ContactProblem(
        coulomb.moved(coulomb.box((0.4, 0.4, 0.2), (3, 3, 1)), (0.8, -0.2, 0.0)),
        coulomb.NeoHookean(1e6, 0.0),
        [
            coulomb.PrescribedDisplacement("top", way, "xy", amplitude=amplitude),
            coulomb.PrescribedDisplacement("top", way, "z", amplitude=[(0.0, 0.0), (1.0, 1.0)]),
        ],
        coulomb.Contact(
            "bottom",
            9.0,
            foundation=coulomb.Plane((0.0, 0.0, 0.0), axis),
            rotation=coulomb.Rotation((0.0, 0.0, 0.0), axis, [(1.0, 0.0), (2.0, angle)]),
        ),
        kinematics="large",
    )
    first, last = (step.solution for step in coulomb.LoadHistory([1.0, 2.0], halvings=0).steps(problem))
    c, s, x = np.cos(angle), np.sin(angle), first.problem.surface.x
    with_disc = np.column_stack([c * x[:, 0] - s * x[:, 1], s * x[:, 0] + c * x[:, 1]])
    assert last.valid
    assert last.problem.surface.x[:, :2] == pytest.approx(with_disc, abs=1e-9)
