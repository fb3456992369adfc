"""A face in contact with itself."""

from dataclasses import replace

import pytest
from mpi4py import MPI
from rubber_strips import pressed, strip

from coulomb import Clamp, Contact, ContactProblem, Material, box, join
from coulomb.io.output import write
from coulomb.model import arguments
from coulomb.recheck import check

ITSELF = Contact("skin", 0.3, against="skin")


def test_arms_that_slide_on_each_other_as_two_faces(tmp_path):
    """The whole skin, with the outer sides of both arms behind their walls."""
    mesh, times = strip(MPI.COMM_WORLD, 2, 16), (1.0, 1.3)
    skin, pair = (
        pressed(mesh, ITSELF, times)[1],
        pressed(mesh, Contact("low", 0.3, against="high", slave=True), times)[1],
    )
    totals = pair.at_nodes.totals()
    assert skin.valid and pair.valid and abs(totals["force"][0]) > 0.1 * totals["normal_force"] > 1e4
    assert skin.at_nodes.totals()["force"] == pytest.approx(totals["force"], rel=1e-6, abs=0.1)
    write(skin, tmp_path / "run")
    assert check(tmp_path / "run").passed


def test_forces_across_planes_of_symmetry_act_on_neither_face():
    """Of tetrahedra, whose normals are not in these planes, as faces are not symmetric there."""
    (answer,) = pressed(strip(MPI.COMM_WORLD, 2, 8, ("tetrahedron", 2)), ITSELF, (0.98,))
    assert answer.valid and answer.at_nodes.totals()["normal_force"] > 1e3
    assert answer.certificate["action and reaction"].value < 1e-9


def test_what_is_on_one_side_and_meets_makes_the_answer_invalid(monkeypatch):
    """With sides that are none: the inner sides of both arms on the first, their outer sides on the second."""
    mesh = strip(MPI.COMM_WORLD, 2, 16)
    sides = arguments.two_sides(mesh, mesh.faces["skin"], "")
    wrong = sides._replace(first=mesh.faces["top"], second=mesh.faces["bottom"])
    monkeypatch.setattr(arguments, "two_sides", lambda *_: wrong)
    (answer,) = pressed(mesh, ITSELF)
    assert not answer.valid and answer.certificate.passed
    assert answer.small_strain.overlap > 0.5


def test_a_face_that_is_nowhere_before_itself_is_refused():
    mesh = box((1.0, 1.0, 1.0), (2, 2, 2))
    flat = Contact("top", 0.3, against="top")
    with pytest.raises(ValueError, match="'top' against itself: no part of it is before another"):
        ContactProblem(mesh, Material(1e9, 0.3), [Clamp("bottom")], flat)
    both = replace(flat, face="one:top", against="one:top")
    with pytest.raises(ValueError, match="'one:top' against itself: no part of it is before another"):
        ContactProblem(join(one=mesh), Material(1e9, 0.3), [Clamp("one:bottom")], both)
    with pytest.raises(ValueError, match="no face 'lid'"):
        ContactProblem(mesh, Material(1e9, 0.3), [Clamp("bottom")], replace(flat, face="lid", against="lid"))
