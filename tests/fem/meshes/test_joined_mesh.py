"""Meshes of several bodies as one, and meshes at another place."""

import numpy as np
import pytest
from mpi4py import MPI

import coulomb
from coulomb import Rotation
from coulomb.fem.compat import fem, ufl
from coulomb.fem.meshes.named_mesh import volume


@pytest.fixture(scope="module")
def blocks():
    lower = coulomb.box((1.0, 1.0, 1.0), (2, 1, 1))
    upper = coulomb.box((1.0, 1.0, 1.0), (1, 1, 1), cell="tetrahedron")
    return coulomb.join(lower=lower, upper=coulomb.moved(upper, translate=(0.0, 0.0, 1.0)))


def test_faces_are_called_by_body_and_face(blocks):
    assert list(blocks.bodies) == ["lower", "upper"]
    assert set(blocks.faces) == {f"{b}:{f}" for b in blocks.bodies for f in blocks.bodies["lower"].faces}
    assert blocks.facets("lower:top", "contact") is blocks.bodies["lower"].faces["top"]
    assert blocks.split("upper:top", "contact") == ("upper", "top")
    assert MPI.Comm.Compare(blocks.comm, MPI.COMM_WORLD) in (MPI.IDENT, MPI.CONGRUENT)


@pytest.mark.parametrize(
    "face, said",
    [
        ("lower:tpo", "body 'lower' has no face 'lower:tpo' (did you mean 'lower:top'?); its faces are lower:left"),
        ("lowr:top", "there is no body 'lowr' (did you mean 'lower'?); the bodies are lower, upper"),
        ("top", "does not say of which body; name it as in 'lower:face' (did you mean 'lower:top' or 'upper:top'?)"),
        ("lower:", "'lower:' names a body, but none of its faces; its faces are lower:left"),
        ("lower", "does not say of which body"),
        ("", "does not say of which body"),
        (3, "does not say of which body"),
    ],
)
def test_a_misspelt_face_is_found(blocks, face, said):
    with pytest.raises(ValueError) as error:
        blocks.facets(face, "clamp")
    assert str(error.value).startswith("clamp: ") and said in str(error.value)


def test_cell_groups_of_bodies(blocks):
    lower = blocks.bodies["lower"]
    steel = coulomb.NamedMesh(lower.domain, lower.faces, {"steel": np.array([0], dtype=np.int32)})
    both = coulomb.join({"lower": steel}, upper=blocks.bodies["upper"])
    assert list(both.cells) == ["lower:steel"] and both.group("lower:steel", "material") is steel.cells["steel"]
    with pytest.raises(ValueError, match=r"no cell group 'upper:steel' .*; it has no cell groups"):
        both.group("upper:steel", "material")


def test_wrong_bodies(blocks):
    lower, upper = blocks.bodies.values()
    alone = coulomb.box((1.0, 1.0, 1.0), (1, 1, 1), comm=MPI.COMM_SELF)
    for named, said in (
        ({}, "at least one body"),
        ({"lower:a": lower}, "must be an identifier"),
        ({"": lower}, "must be an identifier"),
        ({1: lower}, "must be an identifier"),
        ({"all": blocks}, r"has several bodies \(lower, upper\) itself; join all of them at once"),
        ({"a": lower.domain}, "must be a mesh"),
        ({"a": lower, "b": lower}, "the same mesh at the same place"),
    ):
        with pytest.raises(ValueError, match=said):
            coulomb.join(named)
    with pytest.raises(ValueError, match="two bodies have the name 'a'"):
        coulomb.join({"a": lower}, a=upper)
    with pytest.raises(ValueError, match="a mapping of names"):
        coulomb.join(lower)
    if MPI.COMM_WORLD.size > 1:
        with pytest.raises(ValueError, match="on different ranks"):
            coulomb.join(a=lower, b=alone)


def curved(cell):
    bend = coulomb.box((1.0, 1.0, 2.0), (1, 1, 1), cell, degree=2, place=lambda x: x + 0.1 * np.sin(x[[2, 0, 1]]))
    return coulomb.NamedMesh(bend.domain, bend.faces, {"core": np.array([0], dtype=np.int32)})


@pytest.mark.parametrize("cell", ["hexahedron", "tetrahedron"])
def test_a_moved_mesh_is_the_same_body_elsewhere(cell):
    """Every node where the motion takes it, faces and groups as before, the volume integrated there unchanged."""
    mesh = curved(cell)
    before = mesh.domain.geometry.x.copy()
    there = coulomb.moved(mesh, (1.0, -2.0, 3.0), Rotation((1.0, 0.0, 0.0), (0.0, 0.0, 2.0), np.pi / 2))
    x, y, z = before.T
    assert np.allclose(there.domain.geometry.x, np.stack([2.0 - y, x - 3.0, z + 3.0], axis=1), rtol=0, atol=1e-14)
    assert np.array_equal(mesh.domain.geometry.x, before), "the given mesh moves"
    assert there.degree == 2 and there.cells.keys() == mesh.cells.keys()
    one, two = (integral(m, lambda x: 1.0 + 0.0 * x[0]) for m in (mesh, there))
    assert two == pytest.approx(one, rel=1e-13) and volume(there) == pytest.approx(volume(mesh), rel=1e-13)
    along, across = integral(there, lambda x: x[0]), integral(mesh, lambda x: x[1])
    assert along == pytest.approx(2.0 * one - across, rel=1e-12)


def integral(mesh, value):
    dx = ufl.Measure("dx", mesh.domain, metadata={"quadrature_degree": 4})
    mine = fem.assemble_scalar(fem.form(value(ufl.SpatialCoordinate(mesh.domain)) * dx))
    return mesh.comm.allreduce(mine, op=MPI.SUM)


def test_moved_node_by_node():
    """Sheared, and a curved cell stays curved: volume and places by formula; not of a slice, nor with a rotation."""
    mesh = coulomb.box((1.0, 2.0, 3.0), (2, 2, 2), degree=2)
    there = coulomb.moved(mesh, lambda x: np.array([0.1 * x[2] ** 2, 0.0 * x[1], 0.5 * x[2]]))
    x = mesh.domain.geometry.x
    expected = x + np.column_stack([0.1 * x[:, 2] ** 2, 0.0 * x[:, 1], 0.5 * x[:, 2]])
    assert there.domain.geometry.x == pytest.approx(expected, abs=1e-14)
    assert set(there.faces) == set(mesh.faces)
    with pytest.raises(ValueError, match="without rotate"):
        coulomb.moved(mesh, lambda x: x, Rotation((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), 1.0))
    with pytest.raises(ValueError, match=r"moved: translate: the function must return shape \(3, "):
        coulomb.moved(mesh, lambda x: x[0])


def test_moved_twice_and_joined(blocks):
    part = blocks.bodies["lower"]
    three = coulomb.join({f"part_{k}": coulomb.moved(part, (0.0, 0.0, 2.0 * k)) for k in range(3)})
    aside = three.moved((5.0, 0.0, 0.0))
    for k, mesh in enumerate(aside.bodies.values()):
        shift = mesh.domain.geometry.x - part.domain.geometry.x
        assert np.allclose(shift, (5.0, 0.0, 2.0 * k), rtol=0, atol=1e-15)


@pytest.mark.parametrize(
    "translate, rotate, said",
    [
        ((1.0, 2.0), None, "translate must be three finite numbers"),
        ((1.0, 2.0, np.nan), None, "translate must be three finite numbers"),
        ((0.0, 0.0, 0.0), np.pi, "rotate must be a Rotation"),
        ((0.0, 0.0, 0.0), Rotation((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), lambda t: t), "one finite number in radians"),
    ],
)
def test_wrong_places(blocks, translate, rotate, said):
    with pytest.raises(ValueError, match=said):
        coulomb.moved(blocks.bodies["lower"], translate, rotate)


def test_bodies_of_forms_are_joined_likewise(blocks):
    lower, upper = (
        coulomb.Elasticity(mesh, coulomb.Material(1e9, 0.3), [coulomb.Clamp(face)])
        for mesh, face in zip(blocks.bodies.values(), ("bottom", "top"), strict=True)
    )
    both = coulomb.join(lower=lower, upper=upper)
    assert [member.name for member in both.members] == ["lower", "upper"] and both.members[1].body is upper
    for given, said in (
        ({"all": both}, r"has several bodies \(lower, upper\) itself"),
        ({"a": lower, "b": blocks.bodies["upper"]}, "'b' is a mesh, 'a' a body with its own loads"),
        ({"a b": lower}, "must be an identifier"),
    ):
        with pytest.raises(ValueError, match=said):
            coulomb.join(given)
