"""Materials, supports, springs and loads that users get wrong: a ValueError that says what would be right."""

import numpy as np
import pytest

import coulomb
from coulomb import (
    Clamp,
    Contact,
    Elasticity,
    Material,
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
HELD = [Clamp("top")]
STIFFNESS = (
    "on 'left': stiffness must be a number or three .along x, y, z., in N/m.3, >= 0, not all 0 and at most 1e.30"
)


def body(clamps, **others):
    return Elasticity(coulomb.box((1.0, 1.0, 1.0), (1, 1, 1)), Material(1e9, 0.3), clamps, **others)


def contact(**options):
    mesh = coulomb.box((1.0, 1.0, 1.0), (1, 1, 1))
    return coulomb.ContactProblem(mesh, Material(1e9, 0.3), HELD, Contact("bottom", 0.3), **options)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Material(0.0, 0.3), "young must be a positive number of pascals, but is 0.0"),
        (lambda: Material("steel", 0.3), "young must be a positive number of pascals, but is 'steel'"),
        (lambda: Material(float("nan"), 0.3), "young must be a positive"),
        (lambda: Material(1.0, 0.5), r"poisson must be a number in \(-1, 0.5\)"),
        (lambda: Material(1.0, -1.0), r"poisson must be a number in \(-1, 0.5\)"),
        (lambda: PrescribedRotation("top", ORIGIN, Z, "90deg"), "angle must be a finite number of radians, but is 90d"),
        (lambda: PrescribedRotation("top", ORIGIN, None, 0.1), "axis must be three finite numbers, but is None"),
        (lambda: PrescribedRotation("top", ("0", "0", "0"), Z, 0.1), "point must be three finite numbers"),
        (lambda: Rotation(ORIGIN, (0, 0, 1e-200), 0.1), r"axis must have a length between 1e-100 and 1e\+100"),
        (lambda: Sphere(ORIGIN, "1"), "sphere: radius must be a positive number of metres, but is '1'"),
        (lambda: Spring("left", "soft"), f"{STIFFNESS}, but is 'soft'"),
        (lambda: Spring("left", 1e300), STIFFNESS),
        (lambda: Spring("left", (1.0, 2.0)), STIFFNESS),
        (lambda: body(HELD, springs=[Spring("lfet", 1.0)]), "spring: there is no face 'lfet' on this mesh"),
        (lambda: body([Clamp(3)]), "clamp: a face is given by its name, text in quotation marks, but is 3"),
        (lambda: Clamp("top", None), "components must be letters of 'xyz', .* but are None"),
        (lambda: body([PrescribedDisplacement("top", "x")]), "must have three components, numbers, or be a"),
        (lambda: body([PrescribedDisplacement("top", lambda x: x[0])]), r"'top': .* must return shape \(3, "),
        (lambda: body([Clamp("top", direction=(0, 1e200, 1e200))]), "direction: must have a length between 1e-100"),
        (lambda: body(HELD, tractions=[Traction("top", (0.0, np.nan, 0.0))]), "traction on 'top': .* not finite"),
        (lambda: body(HELD, tractions=[Traction("top", (0.0, 1.0))]), "traction on 'top': .* three components"),
        (lambda: body(HELD, tractions=[Pressure("top", "x")]), "must be a number or a function of x, but is"),
        (lambda: body(Clamp("top")), r"clamps must be a list of Clamp, .*, but is Clamp\("),
        (lambda: body([Rotation(ORIGIN, Z, 0.1)]), "clamps must be .*PrescribedRotation .*an entry is Rotation"),
        (lambda: body(HELD, springs=[Clamp("left")]), "springs must be a list of Spring, but an entry is Clamp"),
        (lambda: body(HELD, tractions=[SymmetryPlane("left")]), "tractions must be a list of Traction, "),
        (lambda: body([*HELD, Clamp("bottom")]).K, "the supports hold every node: there is nothing to compute"),
        (lambda: coulomb.box("abc", (1, 1, 1)), "box: lengths must be three positive numbers in metres"),
        (lambda: coulomb.box((1.0, 1.0, 1.0), (1, 0, 1)), "cells must be three whole numbers"),
        (lambda: coulomb.box((1.0, 1.0, 1.0), (1, 1, 1), "prism"), "cell must be one of hexahedron, tetrahedron"),
        (lambda: Contact("top", 0.3, rotation=(ORIGIN, Z, 0.1)), r"rotation must be a Rotation\(point, axis, angle\)"),
        (lambda: contact(linear_solver="MUMPS"), 'linear_solver must be "auto", "direct" or "iterative", or one of'),
        (lambda: contact().solve(solver="direct"), r"solver must be one for contact, as InteriorPoint\(\) .* 'direct'"),
    ],
)
def test_misuse_is_refused(make, message):
    with np.errstate(all="raise"), pytest.raises(ValueError, match=message):
        make()


def test_a_direction_may_have_any_reasonable_length():
    for length in (1e-90, 1.0, 1e90):
        oblique = body([Clamp("bottom", "xy"), Clamp("top", direction=(0.0, 3.0 * length, 4.0 * length))])
        H = oblique.held.projector_at(oblique.nodes("top", "test"))
        assert np.allclose(H, np.outer([0.0, 0.6, 0.8], [0.0, 0.6, 0.8]), rtol=0.0, atol=1e-15)
