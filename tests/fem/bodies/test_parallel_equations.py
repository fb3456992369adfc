"""Linear equations between displacements of nodes, on any number of ranks: alone, or with mpirun."""

import numpy as np
import pytest
from mpi4py import MPI
from ranks import same_error

from coulomb import (
    Clamp,
    Contact,
    ContactProblem,
    Equation,
    LoadHistory,
    Material,
    NeoHookean,
    Plane,
    Pressure,
    RigidFace,
    SymmetryPlane,
    Tied,
    Traction,
    box,
    join,
    moved,
)

comm = MPI.COMM_WORLD
E, AREA, FORCE = 2e11, 0.01, 1e4
FAR = Plane((0.0, 10.0, 0.0), (0.0, -1.0, 0.0))
MOST = 1e-12


def bars(equations, **given):
    """Two bars along x without lateral strain, 1 m and 2 m long; a force pulls the first."""
    a, b = box((1.0, 0.1, 0.1), (4, 1, 1)), moved(box((2.0, 0.1, 0.1), (5, 1, 1)), (0.0, 1.0, 0.0))
    a, b = a.with_nodes("end", at=lambda x: x[0] > 1.0 - 1e-9), b.with_nodes("end", at=lambda x: x[0] > 2.0 - 1e-9)
    a = a.with_nodes("middle", at=lambda x: np.abs(x[0] - 0.5) < 1e-9)
    held = [SymmetryPlane(f"{body}:{face}") for body in "ab" for face in ("left", "front", "bottom")]
    load = Traction("a:right", (FORCE / AREA, 0.0, 0.0))
    law, contact = Material(E, 0.0), Contact("a:back", 0.3, foundation=FAR)
    return ContactProblem(join(a=a, b=b), law, held, contact, [load], ties=equations, **given)


def ends(solution):
    """Displacements of the ends of both bars along x: the largest."""
    nodes = [member.nodes for member in solution.problem.elasticity.members]
    u = solution.displacement[:, 0]
    return [comm.allreduce(float(np.max(u[here], initial=-np.inf)), op=MPI.MAX) for here in nodes]


STIFF = E * AREA, E * AREA / 2.0


@pytest.mark.parametrize("constant", [0.0, 1e-6])
@pytest.mark.parametrize("of_one", [False, True])
def test_two_bars_share_a_force_by_their_stiffnesses(constant, of_one):
    """u_b = 2 u_a + c at the ends: k_a u_a + 2 k_b (2 u_a + c) = F, and the force in the equation is k_b u_b."""
    terms = [("a:end", "x", -2.0), ("b:end", "x", 1.0)]
    solution = bars([Equation(terms if of_one else terms[::-1], constant)]).solve()
    u = (FORCE - 2.0 * STIFF[1] * constant) / (STIFF[0] + 4.0 * STIFF[1])
    assert solution.valid and solution.certificate["ties"].value <= MOST
    assert ends(solution) == pytest.approx([u, 2.0 * u + constant], rel=1e-10)
    (tie,) = solution.ties
    share = STIFF[1] * (2.0 * u + constant)
    assert tie.force == pytest.approx([-2.0 * share if of_one else share, 0.0, 0.0], rel=1e-9, abs=1e-6)
    assert solution.force_balance.balance <= 1e-10
    assert solution.reactions[0].force[0] == pytest.approx(-STIFF[0] * u, rel=1e-9)


def test_a_constant_in_time():
    """Its force does work: the energies of the steps add up."""
    given = Equation([("b:end", "x", 1.0), ("a:end", "x", -1.0)], 2e-6, amplitude=[[0.0, 0.0], [2.0, 1.0]])
    *_, last = LoadHistory([0.5, 1.0]).steps(bars([given]))
    u = (FORCE - STIFF[1] * 1e-6) / sum(STIFF)
    assert ends(last.solution) == pytest.approx([u, u + 1e-6], rel=1e-10)


def test_equations_that_follow_each_other():
    """The middle of a bar moves as the end of the other, and this as its own end: u at x = 1/2 is half of that at 1, so
    all stay, up to the strain between; eliminated in any order, or solved together."""
    one = Equation([("a:middle", "x", 1.0), ("b:end", "x", -1.0)])
    other = Equation([("b:end", "x", 1.0), ("a:end", "x", -0.7)])
    both = Equation([("b:end", "x", 1.0), ("a:middle", "x", -0.5), ("a:end", "x", -0.35)])
    answers = [ends(bars(given).solve()) for given in ([one, other], [other, one], [one, both])]
    for answer in answers:
        # k/2 = 2 E A on each half of a: forces by the middle m = 0.7 u and the end u, b at 0.7 u
        u = FORCE / (2 * STIFF[0] * (0.3**2 + 0.7**2) + 0.7**2 * STIFF[1])
        assert answer == pytest.approx([u, 0.7 * u], rel=1e-10)


@pytest.mark.parametrize("solver", ["direct", "iterative"])
def test_equations_on_matching_nodes_are_a_tie(solver):
    low, up = box((1.0, 1.0, 0.5), (3, 2, 2)), moved(box((1.0, 1.0, 0.5), (3, 2, 2)), (0.0, 0.0, 0.5))
    low = low.with_nodes("joint", at=lambda x: x[2] > 0.5 - 1e-9)
    up = up.with_nodes("joint", at=lambda x: x[2] < 0.5 + 1e-9)
    loads = [Traction("up:top", (2e5, 1e5, -1e6))]

    def answer(ties):
        contact = Contact("low:bottom", 0.3, foundation=Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)))
        bodies, law = join(low=low, up=up), Material(E, 0.3)
        return ContactProblem(bodies, law, [], contact, loads, ties=ties, linear_solver=solver).solve(1e-10)

    tied = answer([Tied("up:bottom", "low:top", slave=True)])
    equations = answer([Equation([("up:joint", c, 1.0), ("low:joint", c, -1.0)]) for c in "xyz"])
    assert equations.valid and len(equations.problem.elasticity.free) == 6
    assert abs(tied.result.newton_steps - equations.result.newton_steps) <= 1
    size = np.max(comm.allgather(np.max(np.abs(tied.displacement), initial=0.0)))
    assert np.max(np.abs(tied.displacement - equations.displacement), initial=0.0) <= 1e-8 * size
    assert equations.ties[0].force == pytest.approx(tied.ties[0].force, abs=1e-2)


def test_a_body_that_an_equation_and_contact_hold():
    """It may lift and tilt, which contact prevents; the equation alone holds it against what pulls it."""
    a = box((0.5, 0.5, 0.5), (1, 1, 1)).with_nodes("hook", at=(0.5, 0.0, 0.0))
    b = moved(box((1.0, 0.5, 0.5), (3, 2, 2)), (1.0, 0.0, 0.0)).with_nodes("hook", at=(1.0, 0.0, 0.0))
    contact = Contact("b:bottom", 0.0, foundation=Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)))
    loads = [Traction("b:right", (4e3, 0.0, 0.0)), Pressure("b:top", 1e5)]
    held, joint = [Clamp("a:left"), SymmetryPlane("b:front")], Equation([("b:hook", "x", 1.0), ("a:hook", "x", -1.0)])
    solution = ContactProblem(join(a=a, b=b), Material(E, 0.3), held, contact, loads, ties=[joint]).solve()
    assert solution.valid and len(solution.problem.elasticity.free) == 2
    assert solution.ties[0].force == pytest.approx([-1e3, 0.0, 0.0], rel=1e-7, abs=1e-3)
    assert solution.force_balance.reactions[0].force[0] == pytest.approx(-1e3, rel=1e-7)
    lonely = ContactProblem(join(a=a, b=b), Material(E, 0.3), held[:1], contact, loads, ties=[joint])
    assert len(lonely.elasticity.free) == 5


@pytest.mark.parametrize("kinematics", ["small", "large"])
def test_contact_nodes_in_equations(kinematics):
    """A block on a smooth floor: its contact nodes may be made to sink alike, and its top to stay level."""
    block = box((1.0, 1.0, 1.0), (2, 2, 2)).with_nodes("base", at=lambda x: (x[2] < 1e-9) & (x[0] + x[1] > 1e-9))
    block = block.with_nodes("corner", at=(0.0, 0.0, 0.0))
    law = Material(1e7, 0.3) if kinematics == "small" else NeoHookean(1e7, 0.3)
    loads, held = [Pressure("top", 1e4)], [SymmetryPlane("left"), SymmetryPlane("front")]
    level = Equation([("base", "z", 1.0), ("corner", "z", -1.0)])

    def answer(ties):
        problem = ContactProblem(block, law, held, Contact("bottom", 0.0), loads, ties=ties, kinematics=kinematics)
        return [*LoadHistory([1.0]).steps(problem)][-1].solution

    free, equal = answer([]), answer([level])
    assert equal.certificate.passed
    size = np.max(comm.allgather(np.max(np.abs(free.displacement), initial=0.0)))
    assert np.max(np.abs(free.displacement - equal.displacement), initial=0.0) <= 1e-7 * size
    assert equal.at_nodes.totals(0)["force"][2] == pytest.approx(free.at_nodes.totals(0)["force"][2], rel=1e-7)


def test_wrong_equations():
    def error(*equations, **given):
        return same_error(lambda: bars(list(equations), **given))

    end, other = ("a:end", "x", 1.0), ("b:end", "x", -1.0)
    assert "there is no set of nodes 'a:and'; those of the mesh are: end" in error(Equation([("a:and", "x", 1)]))
    assert "there is no body 'c'" in error(Equation([("c:end", "x", 1.0)]))
    assert "has 8 nodes, the first term 4" in error(
        Equation([end, ([(0.25 * k, 0.1 * j, 0.1 * i) for i in (0, 1) for j in (0, 1) for k in (1, 3)], "x", 1.0)])
    )
    assert "no nodes are at x = 9, 0, 0" in error(Equation([end, ((9.0, 0.0, 0.0), "x", 1.0)]))
    assert "the mesh is not from a file" in error(Equation([end, (["a:3"], "x", 1.0)]))
    assert "the coefficient of its first term is 0" in error(Equation([("a:end", "x", 0.0), other]))
    assert "another equation eliminates" in error(Equation([end, other]), Equation([end, ("a:middle", "x", 1.0)]))
    circle = Equation([end, other]), Equation([other, end])
    assert "in a circle" in error(*circle)
    assert "a support holds this displacement" in error(Equation([("a:end", "y", 1.0), ("b:end", "y", -1.0)]))
    plate = RigidFace("a:right")
    assert "in a tie or rigid face already" in error(Equation([end, other]), rigid_faces=[plate])
    for terms, message in (
        ([], "must be a list of"),
        ([("a:end", "u", 1.0)], 'must be \\(nodes, "x", "y" or "z", coefficient\\)'),
        ([("a:end", "x", np.inf)], "a coefficient must be a finite number"),
    ):
        with pytest.raises(ValueError, match=message):
            Equation(terms)
    with pytest.raises(ValueError, match="the constant must be a finite number"):
        Equation([end], np.nan)
    assert "ties must be a list" in error("a:end")
