"""Ties that begin and end: columns by formulas, superposition, and what contact follows."""

import numpy as np
import pytest
from conftest import run_coulomb
from history_runs import ENDING_TIES

import coulomb
from coulomb import (
    Clamp,
    Contact,
    ContactProblem,
    LoadHistory,
    Material,
    NeoHookean,
    PrescribedDisplacement,
    Pressure,
    Tied,
    TotalForce,
)

YOUNG, CORK = 1e6, Material(1e6, 0.0)
PAIR = "b:bottom", "a:top"


def column(ties, top, friction=0.2, held="z", cells=(2, 3), **more):
    """Two cubes of 1 m on each other, without lateral contraction; the top of the upper one moves along z and x."""
    lower = coulomb.box((1.0, 1.0, 1.0), (2, 2, cells[0]))
    upper = coulomb.moved(coulomb.box((1.0, 1.0, 1.0), (cells[1], cells[1], 2)), translate=(0.0, 0.0, 1.0))
    material = more.pop("material", CORK)
    sides = [Clamp(f"{body}:{side}", "y") for body in "ab" for side in ("front", "back")]
    clamps = [Clamp("a:bottom", held), *sides, *top]
    contact = more.pop("contact", Contact(PAIR[0], friction, against=PAIR[1]))
    return ContactProblem(coulomb.join(a=lower, b=upper), material, clamps, contact, ties=ties, **more)


def moved(way, rows, components="xz"):
    return [PrescribedDisplacement("b:top", way, components, rows)]


@pytest.mark.parametrize("kind", ["small", "large"])
def test_a_tie_ends_and_contact_follows(kind):
    """Stretched by d, F = E d / 2 in the tie; let go, nothing; pressed by d, contact has it.  The energies add up."""
    large = {"material": NeoHookean(YOUNG, 0.0), "kinematics": "large"} if kind == "large" else {}
    d = 0.2 if large else 1e-3
    rows = [(0.0, 0.0), (1.0, 1.0), (2.0, 1.0), (3.0, 0.0), (4.0, -1.0)]
    clamps = [*moved((0.0, 0.0, d), rows, "z"), *(Clamp(f"{body}:left", "x") for body in "ab")]
    problem = column([Tied(*PAIR, end=1.0)], clamps, held="z", **large)
    steps = list(LoadHistory([1.0, 2.0, 3.0, 4.0]).steps(problem))
    stretch = np.array([1.0 + 0.5 * d, 1.0 - 0.5 * d])
    pull, press = 0.5 * YOUNG * (stretch - 1.0 / stretch) if large else np.array([0.5, -0.5]) * YOUNG * d
    tied = [step.row["tie_b:bottom_force_z"] for step in steps]
    assert tied == pytest.approx([-pull, 0.0, 0.0, 0.0], rel=1e-6, abs=1e-9 * pull)
    assert [step.row["normal_force"] for step in steps] == pytest.approx([0, 0, 0, -press], rel=1e-6, abs=1e-6 * pull)
    assert [len(step.solution.contact_force) // 3 for step in steps] == [0, 16, 16, 16]
    assert all(step.solution.valid for step in steps)
    if not large:
        assert [step.state.energy.imbalance for step in steps] == pytest.approx([0.0] * 4, abs=1e-8 * pull * d)


def test_a_tie_holds_what_has_slipped():
    """Without friction the upper cube has slid; once tied, forces are those of tied cubes by the changes since then."""
    rows = [(0.0, 0.0), (1.0, 1.0), (2.0, -1.0), (3.0, 0.5)]
    way, times = (1e-3, 0.0, -1e-3), [1.0, 2.0, 3.0]
    slid, cut, pulled = LoadHistory(times).steps(column([Tied(*PAIR, begin=1.0)], moved(way, rows), 0.0, "xyz"))
    far = Contact("a:top", 0.0, foundation=coulomb.Plane((0.0, 0.0, 9.0), (0.0, 0.0, -1.0)))
    other = column(
        [Tied(*PAIR, slave=True)], moved(way, [(1.0, 0.0), (2.0, -2.0), (3.0, -0.5)]), 0.0, "xyz", contact=far
    )
    name = "prescribed_displacement_b:top_force_"
    assert slid.row[name + "x"] == pytest.approx(0.0, abs=1e-9)
    assert slid.row["normal_force"] == pytest.approx(0.5 * YOUNG * 1e-3, rel=1e-8)
    for step, change in zip((cut, pulled), list(LoadHistory(times).steps(other))[1:], strict=True):
        for axis in "xz":
            expected = slid.row[name + axis] + change.row[name + axis]
            assert step.row[name + axis] == pytest.approx(expected, rel=1e-6, abs=1e-6)
        assert step.solution.valid and step.solution.certificate["ties"].value <= 1e-9
    assert abs(pulled.state.energy.imbalance) <= 1e-8 * pulled.state.energy.elastic


def test_a_tie_pulls_shut():
    """Faces that are 1 mm apart are together again at `reaches`: half of it at half of the time, F = E gap / 2."""
    rows = [(0.0, 0.0), (1.0, 1.0)]
    tie = Tied(*PAIR, begin=1.0, reaches=3.0)
    clamps = [*moved((0.0, 0.0, 1e-3), rows, "z"), *(Clamp(f"{body}:left", "x") for body in "ab")]
    steps = LoadHistory([1.0, 2.0, 3.0, 4.0]).steps(column([tie], clamps))
    pull = [-step.row["tie_b:bottom_force_z"] for step in steps]
    assert pull == pytest.approx([0.0, 250.0, 500.0, 500.0], rel=1e-8, abs=1e-9)


def test_what_a_tie_has_held_rests_on_contact():
    """The upper cube, held by the tie alone, hangs; let go and pressed, it rests, and friction holds it."""
    mesh = coulomb.join(
        a=coulomb.box((1.0, 1.0, 1.0), (2, 2, 1)),
        b=coulomb.moved(coulomb.box((1.0, 1.0, 1.0), (3, 3, 1)), translate=(0.0, 0.0, 1.0)),
    )
    loads = [Pressure("b:top", 100.0, amplitude=[(0.0, -1.0), (1.0, -1.0), (2.0, 1.0)])]
    loads += [TotalForce("b:top", (10.0, 0.0, 0.0))]
    contact = Contact(PAIR[1], 0.3, against=PAIR[0])
    problem = ContactProblem(mesh, CORK, [Clamp("a:bottom")], contact, loads, ties=[Tied(*PAIR, end=1.0, slave=True)])
    hung, rests = LoadHistory([1.0, 2.0]).steps(problem)
    assert hung.row["tie_b:bottom_force_z"] == pytest.approx(-100.0, rel=1e-8)
    assert rests.row["normal_force"] == pytest.approx(100.0, rel=1e-6)
    assert rests.row["friction_force"] == pytest.approx(10.0, rel=1e-6)
    assert hung.solution.valid and rests.solution.valid


@pytest.mark.parametrize(
    ("tie", "more", "said"),
    [
        ({"end": 0.5}, {}, "at time 0.5 a support or a tie begins or ends"),
        ({"begin": 1.0, "end": 1.0}, {}, "tie of 'b:bottom' to 'a:top': end = 1 must be after begin = 1"),
        ({"reaches": 1.0}, {}, "reaches goes with a begin"),
        (
            {"begin": 1.0},
            {"material": NeoHookean(YOUNG, 0.0), "kinematics": "large"},
            "in large motions ties act from the start",
        ),
    ],
)
def test_times_of_ties_that_cannot_be(tie, more, said):
    with pytest.raises(ValueError, match=said):
        next(LoadHistory([1.0, 2.0]).steps(column([Tied(*PAIR, **tie)], moved((0.0, 0.0, 1e-3), 1.0), **more)))


def test_slaves_of_tie_and_contact():
    """The contact has the tie's slave; others than the faces themselves are refused."""
    tie = Tied(*PAIR[::-1], slave=True, end=1.0)
    problem = column([tie], moved((0.0, 0.0, 1e-3), 1.0))
    assert problem.contacts[0].face == "a:top"
    given = {**problem.given, "contact": Contact(PAIR[0], 0.2, against=PAIR[1], slave=True)}
    with pytest.raises(ValueError, match="their tie has 'a:top' as the slave: give all the same"):
        ContactProblem(**given)
    with pytest.raises(ValueError, match=r"tie of 'b:bottom' to 'a:top': at time 2 .* \(begin = 1\)"):
        column([Tied(*PAIR, begin=1.0)], moved((0.0, 0.0, 1e-3), 1.0)).at(2.0)


def test_a_tie_has_the_same_slave_on_another_mesh_before_it_begins():
    """Also where the other face is the finer one there."""
    problem = column([Tied(*PAIR, begin=1.0)], moved((0.0, 0.0, 1e-3), 1.0))
    other = problem.on(column([], [], cells=(2, 1)).made_of)
    assert [tie.face for one in (problem, other) for tie in one.elasticity.constraints.every] == [PAIR[0]] * 2


def test_a_case_of_ties(tmp_path):
    (tmp_path / "case.toml").write_text(ENDING_TIES)
    done = run_coulomb("run", "case.toml", cwd=tmp_path)
    assert "'b:bottom': no contact points now; the face 'a:top'" in done.stdout
    assert "tie of 'b:bottom' to 'a:top': 16 nodes, 1 m², until 1 s" in done.stdout.replace("m^2", "m²")
    checked = run_coulomb("check", "run", cwd=tmp_path)
    assert "4 of 4 load steps passed" in checked.stdout
    run_coulomb("report", "run", cwd=tmp_path)
    run_coulomb("plot", "run", "--step", "1", "--save", "x.png", cwd=tmp_path)
