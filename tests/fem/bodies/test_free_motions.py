"""Bodies that contact alone holds: their free rigid motions, and answers against formulas."""

from dataclasses import replace

import numpy as np
import pytest

import coulomb
from coulomb import Clamp, Contact, ContactProblem, Material, Plane, Spring, SymmetryPlane, TotalForce, Traction
from coulomb.fem.bodies.elasticity import Elasticity
from coulomb.io.summary import remarks
from coulomb.model.certificate import judge
from coulomb.model.equilibrium import NoEquilibrium, undetermined

STEEL = Material(young=2.1e11, poisson=0.3)

WEIGHT, FRICTION = 1e6, 0.3


def block(loads, cell="hexahedron", degree=1, friction=FRICTION, clamps=(), springs=()):
    """A block 2 x 1 x 1 m on a floor, pressed down by WEIGHT."""
    mesh = coulomb.box((2.0, 1.0, 1.0), (4, 2, 2), cell, degree=degree)
    pressed = TotalForce("top", (0.0, 0.0, -WEIGHT))
    return ContactProblem(mesh, STEEL, clamps, Contact("bottom", friction=friction), [pressed, *loads], springs=springs)


def push(ratio, face="bottom", along=(1.0, 0.0, 0.0)):
    return TotalForce(face, tuple(ratio * FRICTION * WEIGHT * np.array(along)))


@pytest.mark.parametrize(
    ("clamps", "springs", "named"),
    [
        (
            [],
            [],
            ["moves along x", "moves along y", "moves along z", *(f"spins about {axis} through" for axis in "xyz")],
        ),
        ([Clamp("bottom", "z")], [], ["moves along x", "moves along y", "spins about z through (1, 0.5, 0.5)"]),
        ([Clamp("left", "xy"), Clamp("right", "xy")], [], ["moves along z"]),
        ([SymmetryPlane("left"), SymmetryPlane("front")], [], ["moves along z"]),
        (
            [],
            [Spring("left", (1e9, 0.0, 0.0))],
            ["moves along y", "moves along z", "spins about x through (1, 0.5, 0.5)"],
        ),
        ([Clamp("left")], [], []),
        ([], [Spring("left", 1e3)], []),
    ],
)
def test_free_motions_are_found_and_named(clamps, springs, named):
    body = Elasticity(coulomb.box((2.0, 1.0, 1.0), (2, 2, 2)), STEEL, clamps, springs=springs)
    assert len(body.free) == len(named) == np.count_nonzero(body.anchoring)
    for motion, words in zip(body.free.motions, named, strict=True):
        assert str(motion).startswith(words)


@pytest.mark.parametrize("degree", [1, 2])
def test_the_anchored_stiffness_answers_loads_in_equilibrium_exactly(degree):
    """K u = f for loads whose resultants vanish, with the internal forces, which have no anchors."""
    body = Elasticity(coulomb.box((2.0, 1.0, 1.0), (2, 2, 2), "tetrahedron", degree=degree), STEEL, [])
    f = body.free.projected(np.sin(np.arange(body.x.size)).reshape(-1, 3), body.x)
    rhs, u = body.K.createVecs()
    rhs.array[:] = f.ravel()
    coulomb.solvers.DirectSolver(body.K).solve(rhs, u)
    moved = u.array.reshape(-1, 3)
    assert np.abs(body.internal_force(moved) - f).max() <= 1e-11 * np.abs(f).max()
    assert np.abs(moved[body.anchoring > 0.0]).max() <= 1e-11 * np.abs(moved).max()
    rigid = body.free.modes(body.x) @ np.array([1.0, -2.0, 3.0, 0.5, -0.2, 0.7])
    assert np.abs(body.internal_force(rigid)).max() <= 1e-12 * body.K.getDiagonal().max()[1]


@pytest.mark.parametrize(("cell", "degree", "ratio"), [("hexahedron", 1, 0.87), ("tetrahedron", 2, 0.5)])
def test_a_block_that_friction_alone_holds(cell, degree, ratio):
    """Contact carries exactly the loads; the same block on springs of vanishing stiffness has the same forces."""
    loads = [push(ratio)]
    answer = block(loads, cell, degree).solve()
    assert answer.certificate.passed and answer.result.newton_steps < 20
    force = np.array(answer.at_nodes.totals()["force"])
    assert force == pytest.approx([-ratio * FRICTION * WEIGHT, 0.0, WEIGHT], rel=1e-8, abs=1e-6 * WEIGHT)
    soft, softer = (block(loads, cell, degree, springs=[Spring("top", k)]).solve() for k in (2e6, 1e6))
    limit = 2.0 * softer.contact_force - soft.contact_force
    assert np.abs(answer.contact_force - limit).max() <= 1e-5 * np.abs(limit).max()


def test_too_large_a_push_is_refused_with_body_direction_and_amounts():
    said = r"loads push the body along \(0.6, 0.8, 0\) with 315 kN; friction holds at most 300 kN"
    problem = block([push(1.05, along=(0.6, 0.8, 0.0))])
    with pytest.raises(NoEquilibrium, match=said) as failure:
        problem.solve()
    assert failure.value.result.status is coulomb.Status.NO_EQUILIBRIUM
    assert remarks(problem.solution(failure.value.result)) == []  # nothing was solved: no advice about gaps


@pytest.mark.parametrize(
    ("loads", "friction", "said"),
    [
        ([TotalForce("top", (0.0, 0.0, 1.2e6))], 0.3, "nothing holds the body against loads of 200 kN along z"),
        (
            [Traction("top", lambda x: np.array([0 * x[0], 0.1 + x[1], 1e6 + 4e5 * x[1]]))],
            0.3,
            "against loads of .* along z$",
        ),
        ([TotalForce("top", (0.0, 5.1e5, 0.0))], 2.0, r"it spins about -x through \(1, 1, 0\), under 10 kN m"),
        ([TotalForce("bottom", (1e3, 0.0, 0.0))], 0.0, "loads push the body along x with 1 kN; no friction holds them"),
    ],
)
def test_loads_that_nothing_holds_are_named(loads, friction, said):
    """Lifted; lifted off its middle, which takes no centre of a rotation in words; tipped over the edge y = 1, where
    WEIGHT/2 per metre of height holds at most; without friction.
    """
    with pytest.raises(NoEquilibrium, match=said):
        block(loads, friction=friction).solve()


def test_a_body_that_is_tipped_against_its_weight():
    """By another one, which pushes at the height of 0.2 m or above it: a weight of 300 N, 0.05 m from the edge, holds
    75 N there."""
    ram = coulomb.moved(coulomb.box((0.1, 0.1, 0.1), (2, 2, 2)), (-0.1, 0.0, 0.2))
    mesh = coulomb.join({"post": coulomb.box((0.1, 0.1, 0.3), (2, 2, 3)), "ram": ram})
    rail = Contact("ram:bottom", 0.0, foundation=Plane((0.0, 0.0, 0.2), (0.0, 0.0, 1.0)))
    contacts = [Contact("post:bottom", 0.9), rail, Contact("ram:right", 0.0, against="post:left")]

    def pushed(force):
        load = Traction("ram:left", (force / 0.01, 0.0, 0.0))
        return ContactProblem(mesh, STEEL, [], contacts, [load], body_force=(0.0, 0.0, -1e5)).solve()

    assert pushed(74.0).valid
    said = r"\"post\": it spins about y through \(0.1, 0.05, 0\), against 15 N m; nor .* against loads of 76 N along x"
    with pytest.raises(NoEquilibrium, match=said):
        pushed(76.0)


@pytest.mark.parametrize(("cell", "young"), [("hexahedron", 1e2), ("tetrahedron", 2.1e11)])
def test_loads_in_balance_by_themselves(cell, young):
    """A body that is heated, or pulled from both sides, on a floor that nothing presses it onto: no stress, or the
    uniform one; no contact forces.  What is left of the loads' resultants is rounding errors of their assembly."""
    mesh, soft = coulomb.box((1.0, 1.0, 1.0), (3, 3, 3), cell), Material(young, 0.3, expansion=1e-5)
    contact, up = Contact("bottom", FRICTION), np.array([0.0, 0.0, 1e-4 * young])
    heated = ContactProblem(mesh, soft, [], contact, temperature=10.0)
    pulled = ContactProblem(mesh, soft, [], contact, [Traction("top", tuple(up)), Traction("bottom", tuple(-up))])
    for problem in (heated, pulled):
        answer = problem.solve()
        assert answer.certificate.passed and answer.valid and not np.any(answer.contact_force)
        stretched = np.ptp(answer.displacement, axis=0) / 1e-4
        assert stretched == pytest.approx([1.0, 1.0, 1.0] if problem is heated else [0.3, 0.3, 1.0], rel=1e-9)


def disc(x, radius=0.05, length=0.2):
    """A cube as a cylinder."""
    u, v = 2.0 * x[0] - 1.0, 2.0 * x[1] - 1.0
    return np.array([radius * u * np.sqrt(1.0 - v**2 / 2.0), radius * v * np.sqrt(1.0 - u**2 / 2.0), length * x[2]])


def pin(loads, friction=FRICTION):
    """A pin in a bore that is wider by 25 micrometres, pushed against its side by 10 kN."""
    mesh = coulomb.box((1.0, 1.0, 1.0), (4, 4, 4), place=disc)
    side = np.unique(np.concatenate([mesh.faces[name] for name in ("left", "right", "front", "back")]))
    mesh = coulomb.NamedMesh(mesh.domain, {**mesh.faces, "side": side})
    wide = coulomb.Cylinder((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0.050025, hollow=True)
    bore = Contact("side", friction, foundation=wide)
    pushed = [TotalForce("top", (1e4, 0.0, 0.0)), TotalForce("bottom", (1e4, 0.0, 0.0))]
    return ContactProblem(mesh, STEEL, [], bore, [*pushed, *loads], small_strain="warn")


def test_a_pin_in_a_bore():
    """Friction on the side holds it along its axis, up to F N; contact carries all loads."""
    answer = pin([TotalForce("top", (0.0, 0.0, 5e3))]).solve()
    assert answer.certificate.passed
    assert answer.at_nodes.totals()["force"] == pytest.approx([-2e4, 0.0, -5e3], rel=1e-8, abs=1e-4)
    named = undetermined(answer.problem, answer.contact_force)  # these facets are so coarse that one edge touches
    assert named == ("the body spins about z through (0.05, 0, 0.1)",)


def test_a_pin_that_slides_out_of_its_bore_is_said_to():
    """Wedged between both sides it could be held, but nothing presses it there: no solution obeys Coulomb's law."""
    said = r"no answer found: loads push the body along z with 8 kN, of which contact holds"
    with pytest.raises(coulomb.NotConverged, match=said):
        pin([TotalForce("top", (0.0, 0.0, 8e3))]).solve(solver=coulomb.InteriorPoint())


def test_a_ball_between_two_plates_is_free_to_spin():
    """Friction holds it but about the axis through both points of contact; the answer does not spin."""

    def ball(x):
        c = 2.0 * x - 1.0
        r = np.abs(c).max(axis=0)
        n = np.where(r > 0.0, np.linalg.norm(c, axis=0), 1.0)
        return 0.5 * c * ((1.0 - r) * 0.6 + r * r / n)

    mesh = coulomb.box((1.0, 1.0, 1.0), (4, 4, 4), place=ball)
    plates = [
        Contact(name, FRICTION, foundation=coulomb.Plane((0.0, 0.0, 0.49 * way), (0.0, 0.0, -float(way))))
        for name, way in (("bottom", -1), ("top", 1))
    ]
    answer = ContactProblem(mesh, Material(1e7, 0.3), [], plates, small_strain="warn").solve()
    below, above = (np.array(answer.at_nodes.totals(part)["force"]) for part in range(2))
    assert answer.certificate.passed and below[2] > 1e3
    assert below == pytest.approx(-above, abs=1e-7 * below[2])
    assert undetermined(answer.problem, answer.contact_force) == ("the body spins about z through (0, 0, 0)",)
    spin = answer.problem.elasticity.free.modes(answer.problem.elasticity.x)[:, :, 5]
    assert abs(np.sum(spin * answer.displacement)) <= 1e-6 * np.abs(answer.displacement).max() * np.sum(spin**2)


def test_each_body_must_be_balanced_by_itself():
    """Opposite errors of the loads on two bodies cancel in the sum of both; contact holds each of them."""
    lower, upper = (coulomb.box((1.0, 1.0, 1.0), (1, 1, 1)) for _ in range(2))
    pair = coulomb.join(lower=lower, upper=coulomb.moved(upper, translate=(0.0, 0.0, 1.0)))
    contacts = [Contact("lower:bottom", 0.3), Contact("upper:bottom", 0.3, against="lower:top")]
    problem = ContactProblem(pair, STEEL, [], contacts, [TotalForce("upper:top", (0.0, 0.0, -WEIGHT))])
    answer = problem.solve()
    evidence = problem.evidence(answer.contact_force, answer.displacement)
    error = np.zeros_like(evidence.load)
    error[0, 0], error[8, 0] = 1e-3 * WEIGHT, -1e-3 * WEIGHT
    assert evidence.component[0] == 0 and evidence.component[8] == 1
    assert judge(evidence).passed
    wrong = judge(replace(evidence, load=evidence.load + error))
    assert wrong["force balance"].value == pytest.approx(5e-4, rel=0.2)  # of the forces on both sides
    assert wrong["rigid motion"].value >= wrong["force balance"].value / 3.0


class Coarse(coulomb.solvers.IterativeSolver):
    """Multigrid to six digits only."""

    def __init__(self, K):
        super().__init__(K, 1e-6)


def test_displacements_of_loads_out_of_balance_are_refined():
    """The anchors carry what contact does not: with their forces, the residual is far below that of a solve."""
    load = TotalForce("top", (1e5, 0.0, -WEIGHT))
    mesh = coulomb.box((2.0, 1.0, 1.0), (4, 2, 2))
    problem = ContactProblem(mesh, STEEL, [], Contact("bottom", 0.3), [load], linear_solver=Coarse)
    u, body = problem.displacement(np.zeros(len(problem.b))), problem.elasticity
    left = problem.loading.load - body.internal_force(u) - body.anchoring * u
    assert np.abs(body.anchoring * u).max() > 0.1 * WEIGHT
    assert np.abs(left).max() <= 1e-10 * WEIGHT


def test_a_body_that_nothing_touches_is_refused():
    lower, upper = (coulomb.box((1.0, 1.0, 1.0), (1, 1, 1)) for _ in range(2))
    pair = coulomb.join(lower=lower, upper=coulomb.moved(upper, translate=(0.0, 0.0, 1.0)))
    said = 'nothing holds body "upper": it has no contact face; clamps and springs leave it free: it moves along x, '
    with pytest.raises(ValueError, match=said):
        ContactProblem(pair, STEEL, [], Contact("lower:bottom", 0.3))


def test_a_step_that_lifts_the_body_off_fails_at_once():
    """From 0 to 1 the load presses, from 1 to 2 it turns to lifting: at 1.5 there is no equilibrium any more."""
    mesh = coulomb.box((1.0, 1.0, 1.0), (2, 2, 2))
    load = TotalForce("top", (0.0, 0.0, -1e5), amplitude=[(0, 0), (1, 1), (2, -1)])
    problem = ContactProblem(mesh, STEEL, [], Contact("bottom", 0.3), [load])
    taken = []
    with pytest.raises(
        coulomb.StepFailed, match="failed: there is no equilibrium: nothing holds the body against"
    ) as e:
        for step in coulomb.LoadHistory([0.5, 1.0, 1.75]).steps(problem):
            taken.append(step.state.time)
    assert taken == [0.5, 1.0] and "halved" not in str(e.value)


def test_motions_that_nothing_resists_are_named_and_not_made():
    answer = block([], friction=0.0).solve()
    named = undetermined(answer.problem, answer.contact_force)
    assert [words.partition(" through")[0] for words in named] == [
        *("the body moves along x", "the body moves along y", "the body spins about z")
    ]
    assert np.abs(answer.result.rigid[[0, 1, 5]]).max() <= 1e-9 * np.abs(answer.displacement).max()
