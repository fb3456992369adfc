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
    Pressure,
    Rotation,
    Sphere,
    Spring,
    SymmetryPlane,
    Traction,
)

ORIGIN, Z = (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)
TURN = PrescribedRotation("top", ORIGIN, Z, 0.1)


def body(clamps, cells=(1, 1, 1), **others):
    return Elasticity(coulomb.box((1.0, 1.0, 1.0), cells), Material(1e9, 0.3), clamps, **others)


def contact(**options):
    return coulomb.ContactProblem(
        coulomb.box((1.0, 1.0, 1.0), (1, 1, 1)), Material(1e9, 0.3), [Clamp("top")], Contact("bottom", 0.3), **options
    )


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
        (lambda: Spring("top", "soft"), "stiffness must be a number or three .* but is 'soft'"),
        (lambda: Spring("top", lambda x: x[0]), "stiffness must be a number or three .* but is <function"),
        (lambda: Spring("top", 1e300), r"not all 0 and at most 1e\+30, but is 1e\+300"),
        (lambda: Spring("top", (1.0, None, 1.0)), "stiffness must be a number or three"),
        (lambda: body([Clamp(3)]), "clamp: a face is given by its name, text in quotation marks, but is 3"),
        (lambda: body([Clamp("top")], springs=[Spring(None, 1.0)]), "spring: a face is given by its name, .* is None"),
        (
            lambda: body([PrescribedDisplacement("top", "x")]),
            "on 'top': the value must have three components, numbers, or be a function of x, but is 'x'",
        ),
        (lambda: body([Clamp("top")], tractions=[Pressure("top", "x")]), "must be a number or a function of x, but is"),
        (lambda: Material("steel", 0.3), "young must be a positive number of pascals, but is 'steel'"),
        (lambda: Material(1e9, "0.3"), r"poisson must be a number in \(-1, 0.5\), but is '0.3'"),
        (lambda: Material(1e9, 0.3, "1e3"), "density must be a positive number of kg/m.3, but is '1e3'"),
        (lambda: Sphere(ORIGIN, "1"), "sphere: radius must be a positive number of metres, but is '1'"),
        (lambda: coulomb.box("abc", (1, 1, 1)), "box: lengths must be three positive numbers in metres"),
        (lambda: coulomb.LoadHistory("1"), "history: times must"),
        (
            lambda: contact(linear_solver="MUMPS"),
            'linear_solver must be "auto", "direct" or "iterative", or one of the classes',
        ),
        (lambda: contact().solve(solver="direct"), r"solver must be one for contact, as InteriorPoint\(\) .* 'direct'"),
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
