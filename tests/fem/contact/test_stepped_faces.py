"""Masters with steps: what is beyond the edge of one does not count where there is a nearer part."""

import numpy as np
import pytest

import coulomb
from coulomb import Clamp, Contact, ContactProblem, PrescribedDisplacement

MATERIAL = coulomb.Material(2.1e11, 0.3)


def ledge(depth, cells=(20, 2, 4)):
    """A block of 2 x 0.2 x 0.5, lower by a depth where x > 1; "floor" is all of the top, "ledge" what is not lower."""
    domain = coulomb.box((2.0, 0.2, 0.5), cells).domain
    x = domain.geometry.x
    x[np.isclose(x[:, 0], 1.1), 0] = 1.0 + 0.02 * depth  # the step, too steep to be opposite to anything
    x[:, 2] *= np.where(x[:, 0] > 1.0 + 1e-9, 1.0 - depth / 0.5, 1.0)

    def at(places, low):
        return np.isclose(places[2], np.where(places[0] > 1.0 + 1e-9, 0.5 - depth, 0.5)) & (places[0] <= low)

    faces = {"floor": lambda x: at(x, 3.0), "ledge": lambda x: at(x, 1.0 + 1e-9), "base": lambda x: x[2] < 1e-9}
    return coulomb.NamedMesh(domain, faces=faces)


def pressed(against, depth, right, degree=1):
    upper = coulomb.moved(coulomb.box((right - 0.3, 0.2, 0.3), (13, 2, 2)), translate=(0.3, 0.0, 0.5))
    bodies, held = {"upper": upper, "lower": ledge(depth)}, PrescribedDisplacement("upper:top", (0.0, 0.0, -1e-5))
    contact = Contact("upper:bottom", 0.15, against=f"lower:{against}")
    supports = [Clamp("lower:base"), held, coulomb.SymmetryPlane("upper:front"), coulomb.SymmetryPlane("upper:back")]
    return ContactProblem(coulomb.join(**bodies), MATERIAL, supports, contact).solve()


@pytest.mark.parametrize("right", [1.6, 1.57])
@pytest.mark.parametrize("depth", [0.3, 0.02])
def test_a_face_with_a_step_is_touched_as_its_upper_part_alone(right, depth):
    """With nodes of the slave at the edge of the step, and between them."""
    whole, ledge = pressed("floor", depth, right), pressed("ledge", depth, right)
    assert whole.valid and ledge.certificate.passed
    assert whole.forces["normal_force"] == pytest.approx(ledge.forces["normal_force"], rel=1e-7)
    lower = whole.at_nodes.x[:, 0] > 1.0 + 1e-6
    assert np.any(lower) and whole.at_nodes.gap[lower] == pytest.approx(depth, rel=1e-9)
    assert np.all(np.abs(whole.at_nodes.gap[~lower]) < 1e-12)
