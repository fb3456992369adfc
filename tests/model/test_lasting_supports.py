"""Supports that begin and end: bars without friction by formulas, one or two bodies, tied or not, small and large."""

import numpy as np
import pytest

import coulomb
from coulomb import (
    Clamp,
    Contact,
    ContactProblem,
    LoadHistory,
    Material,
    PrescribedDisplacement,
    Pressure,
    SymmetryPlane,
    Tied,
    TotalForce,
)

AREA, LENGTH, YOUNG = 0.1 * 0.05, 0.1, 5e6
CORK = Material(YOUNG, 0.0)
PULL = 2.0  # newtons: a strain of 8e-5
STRETCH = PULL * LENGTH / (YOUNG * AREA)


def bar(ends, pull, kind="one body"):
    """A bar along x on a smooth floor, held at its left end, the other end ("right") pulled along x."""
    large = {"kinematics": "large"} if kind == "large" else {}
    if kind in ("one body", "large"):
        mesh, ties, left, right, floor = coulomb.box((LENGTH, 0.1, 0.05), (2, 2, 1)), [], "left", "right", ["bottom"]
    else:
        halves = [coulomb.box((LENGTH / 2, 0.1, 0.05), (1, n, 1)) for n in (2, 3)]
        mesh = coulomb.join(a=halves[0], b=coulomb.moved(halves[1], translate=(LENGTH / 2, 0.0, 0.0)))
        ties, left, right, floor = [Tied("b:left", "a:right")], "a:left", "b:right", ["a:bottom", "b:bottom"]
    supports = [SymmetryPlane(left), *(Clamp(side.replace("SIDE", "front"), "y") for side in sides(left))]
    loads = [TotalForce(right, (PULL, 0.0, 0.0), amplitude=pull)]
    loads += [Pressure(face.replace("bottom", "top"), 10.0) for face in floor]  # next to nothing
    contacts = [Contact(face, 0.0) for face in floor]
    return ContactProblem(mesh, CORK, [*supports, *ends(right)], contacts, loads, ties=ties, **large)


def sides(left):
    return [f"{body}SIDE" for body in (["a:", "b:"] if ":" in left else [""])]


KINDS = "one body", "large", "two bodies"


@pytest.mark.parametrize("kind", KINDS)
def test_an_end_releases(kind):
    """A stretched bar is let go: the reaction is gone, the bar as it was, and so are the energies."""

    def moved(right):
        return [PrescribedDisplacement(right, (STRETCH, 0.0, 0.0), "x", [(0.0, 0.0), (1.0, 1.0)], end=1.0)]

    first, second = LoadHistory([1.0, 2.0]).steps(bar(moved, 0.0, kind))
    name = next(name for name in first.row if name.startswith("prescribed_displacement") and name.endswith("force_x"))
    assert first.row[name] == pytest.approx(PULL, rel=2e-3) and second.row[name] == 0.0
    assert np.abs(first.solution.displacement[:, 0]).max() == pytest.approx(STRETCH, rel=1e-9)
    assert np.abs(second.solution.displacement[:, 0]).max() <= 1e-4 * STRETCH
    assert first.state.energy.elastic == pytest.approx(0.5 * PULL * STRETCH, rel=2e-3)
    after = second.state.energy  # the reaction falls to 0 as the bar goes back
    assert max(abs(after.elastic), abs(after.prescribed), abs(after.imbalance)) <= 2e-3 * first.state.energy.elastic
    assert first.solution.valid and second.solution.valid


@pytest.mark.parametrize("kind", KINDS)
def test_a_clamp_takes_nodes_where_they_are(kind):
    """A pulled bar is clamped; then the force goes, and the clamp has it; moved on, it counts from there."""

    def held(right):
        on = [(0.0, 3.0), (2.0, 3.0), (3.0, 5.0)]  # the change counts, not the value
        return [PrescribedDisplacement(right, (STRETCH, 0.0, 0.0), "x", on, begin=1.0)]

    pull = [(0.0, 0.0), (1.0, 1.0), (2.0, 0.0)]
    steps = list(LoadHistory([1.0, 1.5, 2.0, 2.5, 3.0]).steps(bar(held, pull, kind)))
    name = next(name for name in steps[0].row if "displacement" in name and name.endswith("force_x"))
    end = [np.abs(step.solution.displacement[:, 0]).max() / STRETCH for step in steps]
    assert end == pytest.approx([1.0, 1.0, 1.0, 2.0, 3.0], rel=1e-3)
    assert [step.row[name] / PULL for step in steps] == pytest.approx([0.0, 0.5, 1.0, 2.0, 3.0], rel=2e-3, abs=1e-6)
    assert all(step.solution.valid for step in steps)
    assert abs(steps[-1].state.energy.imbalance) <= 2e-3 * steps[-1].state.energy.elastic


def test_a_displacement_is_reached():
    """As a boundary of CalculiX: from where the nodes are, linearly to the value, and along the amplitude from then."""

    def to(right):
        on = [(0.0, -1.0), (2.0, -1.0), (3.0, -2.0)]
        return [PrescribedDisplacement(right, (STRETCH, 0.0, 0.0), "x", on, begin=1.0, reaches=2.0)]

    steps = LoadHistory([1.0, 1.25, 1.5, 2.0, 3.0]).steps(bar(to, [(0.0, 0.0), (1.0, 1.0)]))
    ends = [step.solution.displacement[:, 0].sum() for step in steps]
    assert np.array(ends) / ends[0] == pytest.approx([1.0, 0.5, 0.0, -1.0, -2.0], abs=1e-7)


def test_what_slides_along_held_nodes_rubs():
    """Edges of a face that are prescribed to move along nodes that are held are in no plane of symmetry: F N."""
    mesh = coulomb.join(
        lower=coulomb.box((0.3, 0.3, 0.1), (3, 3, 1)),
        upper=coulomb.moved(coulomb.box((0.1, 0.1, 0.1), (1, 1, 1)), translate=(0.1, 0.1, 0.1)),
    )
    moved = PrescribedDisplacement("upper:bottom", (0.0, 1e-5, 0.0), "y")
    clamps = [Clamp("lower:bottom"), Clamp("lower:top"), Clamp("upper:top", "x"), moved]
    contact = Contact("upper:bottom", 0.2, against="lower:top", slave=True)
    solution = ContactProblem(mesh, CORK, clamps, contact, [Pressure("upper:top", 1e3)]).solve()
    assert solution.valid
    assert solution.force_on_body.sum(axis=0)[1:] == pytest.approx([-0.2 * 10.0, 10.0], rel=1e-8)


@pytest.mark.parametrize(
    ("times", "limits", "said"),
    [
        ([2.0], {"begin": 1.0}, "at time 1 a support or a tie begins or ends"),
        ([1.0, 2.0], {"begin": 1.0, "end": 1.0}, "end = 1 must be after begin = 1"),
        ([1.0, 2.0], {"reaches": 1.0}, "reaches goes with a begin"),
        ([1.0, 2.0], {"end": "soon"}, "end must be a time"),
    ],
)
def test_times_that_cannot_be(times, limits, said):
    with pytest.raises(ValueError, match=said):
        next(LoadHistory(times).steps(bar(lambda right: [Clamp(right, "x", **limits)], 1.0)))


def test_a_history_is_needed():
    """At a time after it has begun, only load steps say where its nodes are."""
    for kind in KINDS[:2]:
        problem = bar(lambda right: [Clamp(right, "x", begin=1.0)], 1.0, kind)
        with pytest.raises(ValueError, match=r"clamp on 'right': at time 2 .* \(begin = 1\)"):
            problem.at(2.0).solve()


def test_a_clamp_takes_the_force_of_contact_points():
    """Nodes of the contact face that a clamp holds are contact points before and after: what they bore is its."""
    problem = bar(lambda right: [Clamp(right, begin=1.0, end=2.0)], 0.0)
    steps = list(LoadHistory([1.0, 2.0, 3.0]).steps(problem))
    name = next(name for name in steps[0].row if name.startswith("clamp_right") and name.endswith("force_z"))
    borne = [step.row["force_z"] for step in steps]
    at_edge = [step.solution.force_on_body[step.solution.problem.surface.x[:, 0] > 0.99 * LENGTH, 2] for step in steps]
    assert [len(forces) for forces in at_edge] == [3, 0, 3]
    assert borne == pytest.approx([0.1, 0.1 - at_edge[0].sum(), 0.1], rel=1e-6)
    assert [step.row[name] for step in steps] == pytest.approx([0.0, at_edge[0].sum(), 0.0], rel=1e-6, abs=1e-12)
    assert all(step.solution.valid for step in steps)
