"""Rigid foundations from STL files: distances and normals of a box, contact as with a plane, files that are refused."""

import struct

import numpy as np
import pytest
from conftest import run_coulomb

import coulomb
from coulomb import Contact, ContactProblem, Material, Plane, PrescribedDisplacement, SignedDistance
from coulomb.case.case import read_case
from coulomb.recheck import check

CASE = """\
[mesh]
box = [1.0, 1.0, 0.5]
cells = [2, 2, 1]
[material]
young = 1e6
poisson = 0.3
[[prescribed_displacement]]
face = "bottom"
value = [0.0, 0.0, 0.001]
[contact]
face = "top"
friction = 0.2
foundation = { shape = "stl", file = "box.stl", scale = 1e-3 }
[output]
picture = false
"""

LOW, HIGH = np.array([-1.0, -2.0, 0.5]), np.array([2.0, 2.5, 1.5])


def box_triangles():
    """Of a box, two for each face, right-handed about the outward normal."""
    found = []
    for axis in range(3):
        for end in (0, 1):
            corners = np.zeros((4, 3))
            corners[:, axis] = end
            corners[:, (axis + 1) % 3], corners[:, (axis + 2) % 3] = [0, 1, 1, 0], [0, 0, 1, 1]
            corners = corners if end else corners[::-1]
            found += [corners[[0, 1, 2]], corners[[0, 2, 3]]]
    return LOW + np.array(found) * (HIGH - LOW)


def as_binary(x):
    rows = [struct.pack("<12fH", 0.0, 0.0, 0.0, *one.ravel(), 0) for one in x]
    return b"solid is no word of text here".ljust(80) + struct.pack("<I", len(x)) + b"".join(rows)


def as_text(x):
    loops = "".join(
        "facet normal 0 0 0\nouter loop\n"
        + "".join(f"vertex {a} {b} {c:e}\n" for a, b, c in one)
        + "endloop\nendfacet\n"
        for one in x.tolist()
    )
    return f"solid tool\n{loops}endsolid tool\n".encode()


@pytest.mark.parametrize("written", [as_binary, as_text])
def test_distances_and_normals_of_a_box(tmp_path, written):
    """Outside and inside, beside faces, edges and corners, by the formula of a box; in millimetres."""
    (tmp_path / "box.stl").write_bytes(written(1e3 * box_triangles()))
    tool = SignedDistance.of_stl(tmp_path / "box.stl", scale=1e-3)
    x = np.random.default_rng(3).uniform(LOW - 1.0, HIGH + 1.0, (400, 3))
    beyond = np.maximum(LOW - x, x - HIGH)
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=1)
    exact = np.where(outside > 0.0, outside, beyond.max(axis=1))
    assert tool.signed_distance(x) == pytest.approx(exact, abs=1e-6)  # single precision of the file
    step = 1e-4
    slopes = [
        (tool.signed_distance(x + step * e) - tool.signed_distance(x - step * e)) / (2.0 * step) for e in np.eye(3)
    ]
    near = np.abs(np.diff(np.sort(beyond, axis=1)[:, 1:], axis=1)[:, 0]) > 1e-3  # not beside two faces inside
    assert np.abs(tool.normal(x) - np.transpose(slopes))[near | (outside > 1e-3)].max() < 1e-3
    on_edge = np.array([[LOW[0], LOW[1], 1.0], [LOW[0], 0.1, 1.0]])
    assert tool.normal(on_edge) == pytest.approx(np.array([[-np.sqrt(0.5), -np.sqrt(0.5), 0.0], [-1.0, 0.0, 0.0]]))


def test_a_tool_presses_as_a_plane_does(tmp_path):
    (tmp_path / "box.stl").write_bytes(as_binary(box_triangles()))
    forces = []
    for foundation in (SignedDistance.of_stl(tmp_path / "box.stl"), Plane((0.0, 0.0, 0.5), (0.0, 0.0, -1.0))):
        press = [PrescribedDisplacement("bottom", (1e-3, 0.0, 2e-3))]
        contact = Contact("top", 0.2, foundation=foundation)
        solution = ContactProblem(coulomb.box((1.0, 1.0, 0.5), (3, 3, 2)), Material(1e6, 0.3), press, contact).solve()
        assert solution.certificate.passed
        forces.append(solution.contact_force)
    assert forces[0] == pytest.approx(forces[1], abs=1e-6 * np.abs(forces[1]).max())


def test_a_case_with_a_tool(tmp_path):
    """The file is found beside the case, and its run is checked."""
    (tmp_path / "box.stl").write_bytes(as_binary(1e3 * box_triangles()))
    (tmp_path / "case.toml").write_text(CASE)
    run_coulomb("run", tmp_path / "case.toml", "--output", tmp_path / "run")
    assert check(tmp_path / "run").passed
    with pytest.raises(ValueError, match='a foundation of shape "stl" needs file'):
        read_case(tmp_path / "case.toml", ["contact.foundation={ shape = 'stl' }"])


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (None, "cannot be read"),
        (b"mesh", "is no STL file"),
        (as_text(box_triangles())[:-100], "the file is incomplete"),
        (as_binary(box_triangles()[1:]), "is not closed: 3 of its 18 edges have one triangle"),
        (as_binary(box_triangles()[:, ::-1]), "normals point into the solid"),
        (as_binary(np.concatenate([box_triangles()[:1, ::-1], box_triangles()[1:]])), "opposite normals"),
        (as_binary(box_triangles()[:0]), "has no triangles"),
    ],
)
def test_files_that_are_refused(tmp_path, content, says):
    if content is not None:
        (tmp_path / "tool.stl").write_bytes(content)
    with pytest.raises(ValueError, match=says):
        SignedDistance.of_stl(tmp_path / "tool.stl")
