"""Meshes cut along facets inside them."""

import numpy as np
import pytest
from mesh_files import BoxFile, integral
from scipy.spatial import cKDTree

from coulomb import Clamp, Contact, ContactProblem, Material, Plane, Tied, Traction, read_mesh
from coulomb.fem.meshes.cuts import cut
from coulomb.fem.meshes.mesh_file import MeshFile


def written(folder, cell="hexahedron", degree=1):
    file = BoxFile(cells=(4, 3, 2), cell=cell)
    file.faces["middle"] = file.interface
    if degree == 2:
        file.second_order(lambda x: x + 0.05 * np.sin(2.0 * x[:, [1, 2, 0]]))
    return file.write(folder / "box.msh")


@pytest.mark.parametrize(
    ("cell", "degree"), [("hexahedron", 1), ("hexahedron", 2), ("tetrahedron", 1), ("tetrahedron", 2)]
)
def test_a_cut_has_two_faces(cell, degree, tmp_path):
    path = written(tmp_path, cell, degree)
    whole, parts = read_mesh(path), read_mesh(path, cuts=["middle"])
    assert "middle" in whole.refused and parts.components == 2 and not parts.refused
    assert integral(parts, "middle") == pytest.approx(integral(parts, "middle_opposite"), rel=1e-7)
    if degree == 1:
        assert integral(parts, "middle") == pytest.approx(1.0, rel=1e-7)
    for name in ("left", "right", "front", "back", "bottom", "top"):
        assert integral(parts, name) == pytest.approx(integral(whole, name), rel=1e-7)
    for name in ("soft", "stiff"):
        assert integral(parts, cells=name) == pytest.approx(integral(whole, cells=name), rel=1e-7)
    far = Contact("bottom", 0.3, foundation=Plane((0.0, 0.0, -1.0), (0.0, 0.0, 1.0)))
    given = (Material(2e11, 0.3), [Clamp("left")], far, [Traction("right", (1e7, 2e6, 3e6))])
    tied = ContactProblem(parts, *given, ties=[Tied("middle", "middle_opposite")]).solve()
    expected = ContactProblem(whole, *given).solve()
    assert tied.valid and expected.valid
    near = cKDTree(expected.problem.elasticity.x).query(tied.problem.elasticity.x)[1]
    error = np.abs(tied.displacement - expected.displacement[near]).max()
    assert error <= (1e-6 if degree == 1 else 1e-4) * np.abs(expected.displacement).max()


def as_file(file, **groups):
    groups = {**file.faces, **groups}
    return MeshFile("box", file.points, file.cells, file.cell_groups, groups)


def test_cuts_that_cannot_be(tmp_path):
    file = BoxFile(cells=(4, 4, 2))
    for name, rows, fault in (
        ("left", file.faces["left"], "8 of its 8 facets are not between two cells"),
        ("triangles", file.interface[:, :3], "it has no facets of 4 corners"),
        ("half", file.interface[:4], "its two sides are connected near"),
    ):
        with pytest.raises(ValueError, match=f"box: cut '{name}': {fault}"):
            cut(as_file(file, **{name: rows}), [name])
    with pytest.raises(ValueError, match="cut 'no': there is no such group of facets; there are back, bottom"):
        cut(as_file(file), ["no"])
    with pytest.raises(ValueError, match="cuts are not for XDMF"):
        read_mesh(tmp_path / "box.xdmf", cuts=["middle"])


def test_two_cuts_and_nodes_of_a_set():
    """A box in three parts; a set of nodes on both sides of a cut has those of both."""
    file = BoxFile(lengths=(3.0, 1.0, 1.0), cells=(6, 2, 2), interface=1.0)
    other = BoxFile(lengths=(3.0, 1.0, 1.0), cells=(6, 2, 2), interface=2.0).interface
    on_top = np.flatnonzero(file.points[:, 2] == 1.0)
    given = MeshFile("box", file.points, file.cells, {}, {"a": file.interface, "b": other}, {"top": on_top})
    found = cut(given, ["a", "b"])
    assert set(found.face_groups) == {"a", "a_opposite", "b", "b_opposite"}
    assert len(found.points) == len(file.points) + 2 * 9 and len(found.node_groups["top"]) == len(on_top) + 2 * 3
    distance = cKDTree(found.points).query(found.points, 2)[0][:, 1]
    assert distance.min() == 0.0
    volumes = [np.unique(found.points[found.cells[k]], axis=0) for k in range(len(found.cells))]
    assert all(len(corners) == 8 for corners in volumes)
