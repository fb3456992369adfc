"""Supports that meet: the later one counts, and different displacements are reported before the solve."""

import logging
import re

import numpy as np
import pytest

import coulomb
from coulomb import (
    Clamp,
    Contact,
    ContactProblem,
    Elasticity,
    LoadCurve,
    Material,
    PrescribedDisplacement,
    PrescribedRotation,
    SymmetryPlane,
)
from coulomb.fem.bodies.constraints import prescribed_rows

RAMP = [(0.0, 0.0), (1.0, 1.0)]
CURVE = LoadCurve([0.0, 1.0], [0.0, 1.0])
UP = (0.0, 0.0, 1e-3)
SOFT = Material(1e9, 0.3)


def messages(*supports, cell="hexahedron"):
    return Elasticity(coulomb.box((1.0, 1.0, 1.0), (2, 2, 2), cell), SOFT, supports).contradictions


def moved(face, value, components="xyz", amplitude=1.0, direction=None):
    return PrescribedDisplacement(face, value, components, amplitude, direction)


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_a_face_that_is_pressed_beside_a_clamp(cell):
    (message,) = messages(Clamp("left"), moved("top", (0, 0, -1e-3), "z"), cell=cell)
    assert message == (
        "clamp on 'left' is overridden at 3 nodes by prescribed displacement on 'top', which prescribes a different "
        "displacement there (first seen at x = 0, 0, 1): of two supports the later one counts"
    )


@pytest.mark.parametrize(
    ("supports", "nodes"),
    [
        ([moved("top", (0, 0, 1e-3)), moved("top", (0, 0, 2e-3), "z")], "9 nodes"),
        ([Clamp("top", "xy"), moved("top", UP, "z", RAMP), moved("top", UP, "z", [(0, 0), (2, 1)])], "9 nodes"),
        ([PrescribedRotation("left", (0, 0, 0), (1, 0, 0), 1e-3), SymmetryPlane("bottom")], "2 nodes"),
    ],
    ids=["a face twice", "different amplitudes", "a rotation out of a plane of symmetry"],
)
def test_what_is_overridden(supports, nodes):
    (message,) = messages(*supports)
    assert re.search(rf"is overridden at {nodes} by", message)


@pytest.mark.parametrize(
    "supports",
    [
        [Clamp("left"), SymmetryPlane("bottom"), Clamp("front", "normal")],
        [moved("top", (0, 0, 1e-3), "z", RAMP), moved("top", (1e-3, 0, 0), "x", [(1, 0), (2, 1)]), Clamp("top", "y")],
        [moved("top", (0, 0, 1e-3), "z", RAMP), moved("right", (5, 5, 1e-3), "z", list(RAMP)), Clamp("left", "xy")],
        [Clamp("left"), moved("top", lambda x: np.array([0 * x[0], 0 * x[0], 1e-3 * x[0]]), "z", CURVE)],
        [Clamp("top"), moved("top", (1e-3, 0, 0), "x")],
        [moved("left", (0, 0, 2e-3)), moved("top", (0, 0, 1e-3), "z", 2.0)],
        [PrescribedRotation(face, (3, 1, 0), (1, 2, 0.5), 0.1) for face in ("left", "top", "front")],
        [SymmetryPlane("bottom"), Clamp("left"), moved("left", (0, 0, 0), direction=(0, 0.02, 1))],
    ],
    ids=[
        *("zero", "across", "same amplitude", "same at the edge", "a face in layers", "number as amplitude"),
        *("one rotation", "nearly along"),
    ],
)
def test_supports_that_agree(supports):
    assert messages(*supports) == ()


def test_only_the_support_that_overrides_is_named():
    """Where three faces meet, the one that holds another direction is not involved."""
    pulled = moved("right", (1e-3, 0, 0), "x")
    fixed = Clamp("back", "x"), SymmetryPlane("bottom"), SymmetryPlane("front")
    (message,) = messages(*fixed, moved("top", (0, 0, -1e-3), "z"), pulled)
    assert message.startswith(f"clamp on 'back' is overridden at 3 nodes by {pulled.what}, which")


def test_different_displacements_along_nearly_the_same_direction():
    """u_z = 0 and cos(a) u_z + sin(a) u_y = v: the edge moves by v/sin(a)."""
    a = np.radians(2.0)
    oblique = moved("right", (0, 0, 1e-3), direction=(0, np.sin(a), np.cos(a)))
    (message,) = messages(Clamp("left"), Clamp("top", "z"), oblique)
    ratio = np.cos(a) * 1e-3 / np.sin(a) / (np.cos(a) * 1e-3)
    assert f"clamp on 'top' and {oblique.what} prescribe different displacements along nearly the same" in message
    assert f"up to {ratio:.3g} times what each prescribes (first seen at x = 1, 0, 1)" in message


def test_they_are_logged_before_the_solve(caplog):
    supports = [Clamp("left"), moved("top", (0, 0, -1e-3), "z")]
    with caplog.at_level(logging.WARNING, "coulomb"):
        ContactProblem(coulomb.box((1.0, 1.0, 1.0), (2, 2, 2)), SOFT, supports, Contact("bottom", 0.3))
    assert [record.message for record in caplog.records] == list(messages(*supports))


# --- rows of supports that meet at a node ---

Z = np.zeros(3)
X, Y = np.eye(3)[:2]
TILTED = np.array([0.6, 0.8, 0.0])


def rows(*directions):
    """Directions of one node."""
    return np.array([[*directions, *[Z] * (3 - len(directions))]])


def at_one_node(*supports):
    return prescribed_rows(2, [(np.array([1]), given) for given in supports])


def projector(*directions):
    q, _ = np.linalg.qr(np.array(directions).T)
    return q @ q.T


@pytest.mark.parametrize(
    ("supports", "owners", "span"),
    [
        ([rows(X)], [0], [X]),
        ([rows(X, Y), rows(X)], [0, 1], [X, Y]),
        ([rows(X), rows(X, Y)], [1, 1], [X, Y]),
        ([rows(X), rows(TILTED)], [0, 1], [X, Y]),
        ([rows(X, Y), rows(TILTED)], [0, 1], [X, Y]),
        ([rows(*np.eye(3)), rows(TILTED)], [0, 0, 1], np.eye(3)),
        ([rows(TILTED), rows(*np.eye(3))], [1, 1, 1], np.eye(3)),
        ([rows(TILTED), rows(TILTED + 1e-7 * X)], [1], [TILTED]),
        ([rows(X), rows(TILTED), rows(Y)], [1, 2], [X, Y]),
    ],
)
def test_the_later_support_applies_where_directions_depend(supports, owners, span):
    found = at_one_node(*supports)
    assert sorted(found.support) == owners and np.all(found.node == 1)
    assert np.allclose(found.held.projector[0], projector(*span), atol=1e-6)
    assert found.held.number == len(span) and list(found.held.nodes) == [1]
    assert np.allclose(np.linalg.norm(found.direction, axis=1), 1.0)


def test_an_earlier_support_keeps_what_is_orthogonal_to_the_later():
    """Held along x and y to go by (1, 2), then along a tilted direction by 0: what remains is the part across it."""
    found = at_one_node(rows(X, Y), rows(TILTED))
    values = np.where(found.support == 0, found.direction @ [1.0, 2.0, 0.0], 0.0)
    across = np.array([-0.8, 0.6, 0.0])
    assert np.allclose(found.displacement(values)[1], across * (across @ [1.0, 2.0, 0.0]))
