"""Supports, springs and loads as users of the Python API get them wrong: a ValueError that says what would be right."""

import numpy as np
import pytest

import coulomb
from coulomb import (
    Clamp,
    Contact,
    Elasticity,
    Material,
    Plane,
    PrescribedDisplacement,
    PrescribedRotation,
    Rotation,
    Spring,
    SymmetryPlane,
    Traction,
)

ORIGIN, Z = (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)
TURN = PrescribedRotation("top", ORIGIN, Z, 0.1)


def body(clamps, cells=(1, 1, 1), **others):
    return Elasticity(coulomb.box((1.0, 1.0, 1.0), cells), Material(1e9, 0.3), clamps, **others)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (
            lambda: PrescribedRotation("top", ORIGIN, Z, "90deg"),
            "angle must be a finite number of radians, but is 90deg",
        ),
        (lambda: PrescribedRotation("top", ORIGIN, Z, None), "angle must be a finite number of radians, but is None"),
        (lambda: PrescribedRotation("top", ORIGIN, Z, [(0, 0), (1, 1)]), "angle must be a finite number of radians"),
        (lambda: PrescribedRotation("top", ORIGIN, Z, lambda t: t), "angle must be a finite number of radians"),
        (lambda: PrescribedRotation("top", ORIGIN, None, 0.1), "axis must be three finite numbers, but is None"),
        (lambda: PrescribedRotation("top", ORIGIN, "xyz", 0.1), "axis must be three finite numbers, but is xyz"),
        (lambda: PrescribedRotation("top", ("0", "0", "0"), Z, 0.1), "point must be three finite numbers"),
        (
            lambda: PrescribedRotation("top", ORIGIN, (0, 0, 1e200), 0.1),
            r"axis must have a length between 1e-100 and 1e\+100",
        ),
        (lambda: Rotation(ORIGIN, (0, 0, 1e-200), 0.1), "rotation: axis must have a length between 1e-100"),
        (lambda: Plane(ORIGIN, (0, 1e300, 0)), "plane: normal must have a length between 1e-100"),
        (lambda: Clamp("top", None), "components must be letters of 'xyz', .* but are None"),
        (lambda: Clamp("top", ["x", "y"]), "components must be letters of 'xyz'"),
        (lambda: PrescribedDisplacement("top", ORIGIN, 1), "components must be letters of 'xyz'"),
        (lambda: body([Clamp("top", direction=(0, 1e200, 1e200))]), "direction: must have a length between 1e-100"),
        (lambda: body([Clamp("top", direction=(0, 0, 1e-140))]), "direction: must have a length between 1e-100"),
        (lambda: body(Clamp("top")), r"clamps must be a list of Clamp, .*, but is Clamp\("),
        (lambda: body(["top"]), "clamps must be a list of Clamp, .*, but an entry is 'top'"),
        (lambda: body([Spring("top", 1e9)]), "clamps must be a list of Clamp, .*, but an entry is Spring"),
        (
            lambda: body([Rotation(ORIGIN, Z, 0.1)]),
            "clamps must be a list of .*PrescribedRotation .*an entry is Rotation",
        ),
        (lambda: body([Clamp("top")], springs=[Clamp("left")]), "springs must be a list of Spring, but an entry is Cl"),
        (lambda: body([Clamp("top")], tractions=[SymmetryPlane("left")]), "tractions must be a list of Traction, "),
        (lambda: body([Clamp("top")], tractions=Traction("left", Z)), "tractions must be a list of Traction, "),
        (
            lambda: Contact("top", 0.3, rotation=TURN),
            r"contact: rotation must be a Rotation\(point, axis, angle\), but",
        ),
        (lambda: Contact("top", 0.3, rotation=(ORIGIN, Z, 0.1)), "contact: rotation must be a Rotation"),
        (lambda: body([Clamp("top"), Clamp("bottom")]), "the supports hold every node of the body"),
    ],
)
def test_misuse_is_refused(make, message):
    with np.errstate(all="raise"), pytest.raises(ValueError, match=message):
        make()


def test_a_direction_may_have_any_reasonable_length():
    for length in (1e-90, 1.0, 1e90):
        oblique = body([Clamp("bottom"), Clamp("top", direction=(0.0, 3.0 * length, 4.0 * length))])
        H = oblique.held.projector_at(oblique.nodes("top", "test"))
        assert np.allclose(H, np.outer([0.0, 0.6, 0.8], [0.0, 0.6, 0.8]), rtol=0.0, atol=1e-15)
