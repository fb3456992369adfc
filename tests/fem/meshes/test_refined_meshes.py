"""Other discretisations of a mesh: of first order, coarser and refined."""

from dataclasses import replace

import numpy as np
import pytest
from mesh_files import BoxFile, integral
from mpi4py import MPI
from scipy.spatial import cKDTree

import coulomb
from coulomb import Cylinder
from coulomb.fem import compat
from coulomb.fem.compat import mesh as dolfinx_mesh
from coulomb.fem.meshes import first_order, refined
from coulomb.fem.meshes.lagrange import corner_geometry, corners_to_nodes
from coulomb.fem.meshes.meshes import fewer

CELLS = ("hexahedron", "tetrahedron")


def bend(x):
    """Curved in all directions; of third degree, so that no mesh has the shape exactly."""
    return np.array([x[0], x[1] + 0.1 * x[0] ** 2, x[2] * (1.0 + 0.1 * x[0] ** 2) + 0.05 * x[1] ** 3])


def with_group(mesh, end=0.5):
    """The mesh with the group of cells below x = end."""
    left = corners(mesh)[..., 0].mean(axis=1) < end
    return replace(mesh, cells={"root": np.flatnonzero(left).astype(np.int32)})


def number_of_cells(mesh):
    return mesh.domain.topology.index_map(3).size_global


def corners(mesh):
    """Of this rank's own cells, shape (cells, corners, 3)."""
    return mesh.domain.geometry.x[corner_geometry(mesh.domain)[: mesh.domain.topology.index_map(3).size_local]]


def sizes(mesh):
    """The volume, those of the groups of cells and the areas of the faces."""
    groups = [integral(mesh, cells=name) for name in mesh.cells]
    return np.array([integral(mesh), *groups, *(integral(mesh, face) for face in mesh.faces)])


def unnamed_facets(mesh):
    """Facets that are on the boundary, in no face: a hanging node makes facets inside that no two cells share."""
    mesh.domain.topology.create_connectivity(2, 3)
    boundary = dolfinx_mesh.exterior_facet_indices(mesh.domain.topology)
    every = np.concatenate([*mesh.faces.values()])
    assert len(set(every)) == len(every), "a facet in two faces"
    return mesh.comm.allreduce(len(boundary) - len(every))


def near(mesh, place, distance):
    """This rank's own cells with their middle near a place."""
    return np.linalg.norm(corners(mesh).mean(axis=1) - place, axis=1) < distance


def nodes(mesh):
    return {tuple(x) for x in mesh.domain.geometry.x.round(12) + 0.0}


@pytest.mark.parametrize("cell", CELLS)
def test_first_order_mesh_has_the_corners_of_the_second(cell):
    """It is the first-order box with the same places, found independently."""
    second = with_group(coulomb.box((2.0, 1.0, 1.0), (4, 3, 2), cell, place=bend, degree=2))
    first = first_order(replace(second, refused={"hole": "is inside"}))
    straight = with_group(coulomb.box((2.0, 1.0, 1.0), (4, 3, 2), cell, place=bend))
    assert first.degree == 1 and number_of_cells(first) == number_of_cells(second)
    assert nodes(first) == nodes(straight) and first.refused == {"hole": "is inside"}
    assert integral(first) == pytest.approx(integral(straight), rel=1e-13)
    assert integral(first, cells="root") == pytest.approx(integral(straight, cells="root"), rel=1e-13)
    assert list(first.faces) == list(straight.faces)
    for face in first.faces:
        assert integral(first, face) == pytest.approx(integral(straight, face), rel=1e-13)
    with pytest.raises(ValueError, match="first-order cells already"):
        first_order(first)


@pytest.mark.parametrize("cell", CELLS)
def test_orders_there_and_back(cell):
    mesh = coulomb.box((2.0, 1.0, 1.0), (3, 2, 1), cell, place=bend)
    back = first_order(coulomb.second_order(mesh))
    assert nodes(back) == nodes(mesh)
    for face in mesh.faces:
        assert integral(back, face) == pytest.approx(integral(mesh, face), rel=1e-13)


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("degree", [1, 2])
def test_coarser_boxes(cell, degree):
    """Half as many cells along an edge, in proportion, down to one, by the same places."""
    mesh = coulomb.box((2.0, 1.0, 1.0), (5, 2, 1), cell, place=bend, degree=degree)
    for cells in ((3, 1, 1), (2, 1, 1), (1, 1, 1)):
        mesh = mesh.coarser()
        made = coulomb.box((2.0, 1.0, 1.0), cells, cell, place=bend, degree=degree)
        assert nodes(mesh) == nodes(made) and mesh.degree == degree
        assert integral(mesh, "top") == pytest.approx(integral(made, "top"), rel=1e-13)
    assert mesh.coarser is None


def test_coarser_boxes_are_similar():
    """About half as many cells along each edge: of all such numbers those with the most equal ratios, and then nearest
    to 2.  Edges of one cell keep it."""
    assert fewer([10, 10, 5]) == [6, 6, 3] and fewer([6, 6, 3]) == [4, 4, 2] and fewer([4, 4, 2]) == [2, 2, 1]
    assert fewer([30, 10, 10]) == [15, 5, 5] and fewer([15, 5, 5]) == [9, 3, 3] and fewer([9, 3, 3]) == [6, 2, 2]
    assert fewer([60, 1, 2]) == [30, 1, 1] and fewer([7, 1, 1]) == [4, 1, 1]
    for n in range(2, 30):
        assert fewer([n, n, n]) == [(n + 1) // 2] * 3
    for cells in ((7, 5, 3), (12, 9, 2), (40, 6, 4), (11, 13, 8)):
        found = np.array(fewer(cells))
        ratios = np.array(cells) / found
        assert np.all((found >= 1) & (ratios >= 1.3) & (ratios <= 3.0))
        halved = np.array(cells) / np.ceil(np.array(cells) / 2.0)
        assert ratios.max() / ratios.min() <= halved.max() / halved.min() + 1e-9


def test_coarser_boxes_of_other_order_and_at_other_places():
    box = coulomb.box((2.0, 1.0, 1.0), (4, 2, 2), place=bend)
    rotation = coulomb.Rotation((1.0, 0.0, 0.0), (0.0, 0.0, 1.0), 0.3)
    half = coulomb.box((2.0, 1.0, 1.0), (2, 1, 1), place=bend)
    moved = coulomb.moved(box, (0.0, 0.0, 3.0), rotation)
    assert nodes(moved.coarser()) == nodes(coulomb.moved(half, (0.0, 0.0, 3.0), rotation))
    assert number_of_cells(moved.coarser().coarser()) == 1 and moved.coarser().coarser().coarser is None
    raised = coulomb.second_order(box).coarser()
    assert raised.degree == 2 and nodes(raised) == nodes(coulomb.second_order(half))
    lowered = first_order(coulomb.box((2.0, 1.0, 1.0), (4, 2, 2), place=bend, degree=2)).coarser()
    assert lowered.degree == 1 and nodes(lowered) == nodes(half)
    assert first_order(coulomb.second_order(half)).coarser().coarser is None


KINDS = (("hexahedron", 1), ("hexahedron", 2), ("tetrahedron", 1), ("tetrahedron", 2))


@pytest.mark.parametrize(("cell", "degree"), KINDS)
def test_uniform_refinement(cell, degree):
    """Eight cells for one; the curved ones keep their shape, too."""
    mesh = with_group(coulomb.box((2.0, 1.0, 1.0), (4, 3, 2), cell, place=bend, degree=degree))
    fine = refined(replace(mesh, refused={"hole": "is inside"}))
    assert fine.degree == degree and fine.refused == {"hole": "is inside"} and fine.coarser().domain is mesh.domain
    assert number_of_cells(fine) == 8 * number_of_cells(mesh)
    assert list(fine.faces) == list(mesh.faces) and len(fine.cells["root"]) == 8 * len(mesh.cells["root"])
    for face in mesh.faces:
        assert len(fine.faces[face]) == 4 * len(mesh.faces[face])
    assert np.abs(sizes(fine) / sizes(mesh) - 1.0).max() < 1e-12
    assert nodes(fine) >= nodes(mesh) and unnamed_facets(fine) == 0


def aspects(mesh):
    """Longest over shortest extent of the cells along their principal axes."""
    from_middle = corners(mesh) - corners(mesh).mean(axis=1, keepdims=True)
    squares = np.linalg.eigvalsh(np.einsum("kvi,kvj->kij", from_middle, from_middle))
    return np.sqrt(squares[:, 2] / squares[:, 0])


@pytest.mark.parametrize("degree", [1, 2])
def test_local_refinement(degree):
    """Four times round a point, with shapes as before: cells are not longer, and no node hangs."""
    mesh = with_group(coulomb.box((2.0, 1.0, 1.0), (4, 3, 2), "tetrahedron", place=bend, degree=degree))
    expected, longest, place = sizes(mesh), aspects(mesh).max(), np.array([0.0, 0.5, 0.5])
    size = 0.5
    for _ in range(4):
        marked, before = near(mesh, place, size), number_of_cells(mesh)
        mesh, size = refined(mesh, marked if size > 0.2 else np.flatnonzero(marked)), size / 2.0
        assert before + 7 * marked.sum() <= number_of_cells(mesh) < before + 7 * marked.sum() + 900
        assert unnamed_facets(mesh) == 0 and aspects(mesh).max() < 1.3 * longest
        assert np.abs(sizes(mesh) / expected - 1.0).max() < 1e-12
    extent = np.ptp(corners(mesh), axis=1).max(axis=1)
    assert extent[near(mesh, place, 0.05)].max() < 0.05 and extent.max() > 0.4
    assert number_of_cells(refined(mesh, np.empty(0, dtype=np.int32))) == number_of_cells(mesh)


@pytest.mark.parametrize(("cell", "local"), [("hexahedron", False), ("tetrahedron", False), ("tetrahedron", True)])
def test_new_nodes_are_on_the_quadratic_map_of_their_parents(cell, local):
    """Where the place is a quadratic function of the regular box, its inverse makes cells straight."""
    bent = coulomb.box(
        (2.0, 1.0, 1.0),
        (2, 1, 1),
        cell,
        place=lambda x: np.array([x[0], x[1] + 0.1 * x[0] ** 2, x[2] + 0.2 * x[0] * x[2]]),
        degree=2,
    )
    for _ in range(2):
        bent = refined(bent, near(bent, (0.0, 0.0, 0.0), 0.7) if local else None)
    x, y, z = bent.domain.geometry.x.T
    flat = np.column_stack([x, y - 0.1 * x**2, z / (1.0 + 0.2 * x)])
    assert np.abs(8.0 * flat - np.round(8.0 * flat)).max() < 1e-14
    cells = flat[compat.cell_geometry(bent.domain)]
    straight = corners_to_nodes(bent.domain.topology.cell_type) @ cells[:, : 8 if cell == "hexahedron" else 4]
    assert np.abs(cells - straight).max() < 1e-14


@pytest.mark.parametrize("cell", CELLS)
@pytest.mark.parametrize("degree", [1, 2])
def test_new_nodes_are_on_the_surface_that_is_known(cell, degree):
    """The top is a cylinder, and the front cuts it obliquely: volume and area converge with the square of the size, in
    second order with its fourth power, and other faces stay."""

    def top(x):
        return np.array([x[0], x[1], 1.0 + np.sqrt(4.0 - (x[0] - 1.0) ** 2) - np.sqrt(3.0)])

    def raised(x):
        z = x[2] * top(x)[2]
        return np.array([x[0], x[1] + 0.3 * z, z])

    mesh = coulomb.box((2.0, 1.0, 1.0), (4, 2, 2), cell, place=raised, degree=degree)
    axis, across = (1.0, 0.0, 1.0 - np.sqrt(3.0)), (0.0, 1.0, 0.0)
    mesh = replace(mesh, surfaces={"top": Cylinder(axis, across, 2.0)})
    exact = 2.0 * np.pi / 3.0, 2.0 - np.sqrt(3.0) + 2.0 * np.pi / 3.0
    finer = refined(mesh)
    finest = refined(finer)
    errors = np.array([(integral(one, "top"), integral(one)) for one in (mesh, finer, finest)]) - exact
    assert np.abs(errors[:-1] / errors[1:] - (4.0 if degree == 1 else 16.0)).max() < 0.1 * degree**4
    for one in (finer, finest):
        assert integral(one, "bottom") == pytest.approx(2.0, rel=1e-12) and unnamed_facets(one) == 0
        x, n = one.domain.geometry.x, (2 if one is finer else 4) * degree
        assert np.sum(np.abs(x[:, 1] - 0.3 * x[:, 2]) < 1e-12) == (4 * n + 1) * (2 * n + 1)
        radius = np.hypot(x[:, 0] - axis[0], x[:, 2] - axis[2])
        above = radius > 2.0 - 1e-3
        assert above.sum() > 40 and np.abs(radius[above] - 2.0).max() < 1e-12
    with pytest.raises(ValueError, match=r"refined: the surface of top makes the cell at x = .* flat"):
        refined(replace(mesh, surfaces={"top": Cylinder(axis, across, 0.5)}))


@pytest.mark.parametrize(("cell", "degree"), KINDS)
def test_both_sides_of_a_cut_are_refined(cell, degree, tmp_path):
    """Nodes at one place stay two, and facets of the two faces are not confused."""
    file = BoxFile(cells=(2, 2, 2), cell=cell)
    file.faces["middle"] = file.interface
    if degree == 2:
        file.second_order(lambda x: x + 0.05 * np.sin(2.0 * x[:, [1, 2, 0]]))
    mesh = coulomb.read_mesh(file.write(tmp_path / "box.msh"), cuts=["middle"])
    fine = refined(mesh)
    assert np.abs(sizes(fine) / sizes(mesh) - 1.0).max() < 1e-12
    fine.domain.topology.create_connectivity(2, 3)
    cell_of = fine.domain.topology.connectivity(2, 3).links
    beside = [
        {name for name, cells in fine.cells.items() for facet in fine.faces[face] if cell_of(facet)[0] in cells}
        for face in ("middle", "middle_opposite")
    ]
    assert beside in ([{"soft"}, {"stiff"}], [{"stiff"}, {"soft"}])
    x = fine.domain.geometry.x
    twins = cKDTree(x).query_pairs(1e-6, output_type="ndarray")
    assert len(twins) == (81 if degree == 2 else 25)
    assert np.linalg.norm(x[twins[:, 0]] - x[twins[:, 1]], axis=1).max() < 1e-14
    assert (fine.components, len(mesh.touching), len(fine.touching)) == (2, 9, 25)


def test_what_cannot_be_refined():
    tetrahedra, number = (
        coulomb.box((1.0, 1.0, 1.0), (1, 1, 1), "tetrahedron", MPI.COMM_SELF),
        "must be numbers of cells",
    )
    for given, fault in (
        ({"marked": np.array([6])}, "marked: must be this rank's own cells, with numbers from 0 to 5"),
        ({"marked": np.array([-1])}, "marked: must be this rank's own cells"),
        ({"marked": np.ones(5, dtype=bool)}, f"marked: {number}, or True and False for each of this rank's 6"),
        ({"marked": np.array([1.0])}, f"marked: {number}"),
    ):
        with pytest.raises(ValueError, match=f"refined: {fault}"):
            refined(tetrahedra, **given)
    hexahedra = coulomb.box((1.0, 1.0, 1.0), (1, 1, 1))
    with pytest.raises(ValueError, match="hexahedra cannot be marked"):
        refined(hexahedra, np.array([0]))


def test_local_refinement_is_that_of_dolfinx():
    """The same cells, found there in C++."""
    mesh = coulomb.box((2.0, 1.0, 1.0), (4, 3, 2), "tetrahedron", MPI.COMM_SELF, bend)
    marked = near(mesh, (1.0, 0.5, 0.5), 0.4)
    mesh.domain.topology.create_entities(1)
    mesh.domain.topology.create_connectivity(3, 1)
    edges = np.unique(mesh.domain.topology.connectivity(3, 1).array.reshape(-1, 6)[marked])
    found = dolfinx_mesh.refine(mesh.domain, edges)
    expected = coulomb.NamedMesh(found[0] if isinstance(found, tuple) else found, {})  # until 0.8
    middles = [
        cells[np.lexsort(cells.round(9).T)]
        for cells in (corners(m).mean(axis=1) for m in (refined(mesh, marked), expected))
    ]
    assert len(middles[0]) > 144 + 7 * marked.sum() and np.abs(middles[0] - middles[1]).max() < 1e-12
