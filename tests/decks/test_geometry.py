"""The geometry of decks: cards, sets, instances, and cells of several kinds as cells of one."""

import numpy as np
import pytest

import coulomb
from coulomb.decks.cards import number_of, read_cards
from coulomb.decks.geometry import Geometry
from coulomb.fem.bodies import Clamp, Elasticity, Material
from coulomb.fem.meshes import abaqus_format

STEEL = Material(2.1e11, 0.3)

POINTS = np.array(list(np.ndindex(4, 2, 2)), dtype=float)  # node 1 + 4 x + 2 y + z


def node(x, y, z):
    return 1 + 4 * x + 2 * y + z


HEXAHEDRON = [node(0, 0, 0), node(1, 0, 0), node(1, 1, 0), node(0, 1, 0)]
HEXAHEDRON += [number + 1 for number in HEXAHEDRON]
WEDGES = [
    [node(1, 0, 0), node(2, 0, 0), node(1, 1, 0), node(1, 0, 1), node(2, 0, 1), node(1, 1, 1)],
    [node(2, 0, 0), node(2, 1, 0), node(1, 1, 0), node(2, 0, 1), node(2, 1, 1), node(1, 1, 1)],
]
PYRAMIDS = [  # around node 17, in the middle of the third cube
    [node(*corner) for corner in face] + [17]
    for face in (
        ((2, 0, 0), (2, 0, 1), (2, 1, 1), (2, 1, 0)),
        ((3, 0, 0), (3, 1, 0), (3, 1, 1), (3, 0, 1)),
        ((2, 0, 0), (3, 0, 0), (3, 0, 1), (2, 0, 1)),
        ((2, 1, 0), (2, 1, 1), (3, 1, 1), (3, 1, 0)),
        ((2, 0, 0), (2, 1, 0), (3, 1, 0), (3, 0, 0)),
        ((2, 0, 1), (3, 0, 1), (3, 1, 1), (2, 1, 1)),
    )
]
_EDGES = {
    8: ((0, 1), (1, 2), (2, 3), (3, 0), (4, 5), (5, 6), (6, 7), (7, 4), (0, 4), (1, 5), (2, 6), (3, 7)),
    6: ((0, 1), (1, 2), (2, 0), (3, 4), (4, 5), (5, 3), (0, 3), (1, 4), (2, 5)),
    5: ((0, 1), (1, 2), (2, 3), (3, 0), (0, 4), (1, 4), (2, 4), (3, 4)),
}


def mixed_deck(second, place=lambda x: x):
    """A hexahedron, two prisms and six pyramids: three cubes in a row along x."""
    points = [*POINTS, np.array([2.5, 0.5, 0.5])]
    middles = {}

    def cell(corners):
        extra = []
        for edge in _EDGES[len(corners)] if second else ():
            key = tuple(sorted(corners[k] for k in edge))
            if key not in middles:
                points.append((points[key[0] - 1] + points[key[1] - 1]) / 2)
                middles[key] = len(points)
            extra.append(middles[key])
        return [*corners, *extra]

    kinds = {
        "C3D20": [cell(HEXAHEDRON)],
        "C3D15": [cell(one) for one in WEDGES],
        "C3D13": [cell(one) for one in PYRAMIDS],
    }
    if not second:
        kinds = dict(zip(("C3D8", "C3D6", "C3D5"), kinds.values(), strict=True))
    text, number = ["*Node"], 0
    text += [f"{k}, {', '.join(map(repr, map(float, place(x))))}" for k, x in enumerate(points, 1)]
    for kind, cells in kinds.items():
        text.append(f"*Element, type={kind}, elset={kind}")
        for nodes in cells:
            number += 1
            text.append(f"{number}, {', '.join(map(str, nodes[:10]))}" + (", " if len(nodes) > 10 else ""))
            text += [", ".join(map(str, nodes[10:]))] if len(nodes) > 10 else []
    text += ["*Surface, name=left", "1, S6", "*Surface, name=bottom", "1, S1", "2, S1", "3, S1", "8, S1"]
    text += ["*Nset, nset=end", "1, 2, 3, 4"]
    return "\n".join(text)


def written(tmp_path, text, name="part.inp"):
    (tmp_path / name).write_text(text)
    return str(tmp_path / name)


@pytest.mark.parametrize("second", [False, True], ids=["first order", "second order"])
def test_prisms_and_pyramids_are_split_and_fill_the_same_volume(second, tmp_path):
    """A linear displacement has no residual force inside, which gaps or overlaps of cells would cause."""
    read = coulomb.read_mesh(written(tmp_path, mixed_deck(second)))
    assert read.degree == 1 + second
    body = Elasticity(read, STEEL, [Clamp("left")])
    one = body.volume_load(np.tile([1.0, 0.0, 0.0], (len(body.x), 1)))
    assert one[:, 0].sum() == pytest.approx(3.0, rel=1e-12)
    assert body.area_of(read.facets("bottom", "test")).sum() == pytest.approx(3.0, rel=1e-12)
    u = body.x @ np.array([[1.0, 2.0, 3.0], [0.5, -1.0, 0.25], [2.0, 1.0, 4.0]])
    inside = np.all((body.x > 1e-9) & (body.x < np.array([3.0, 1.0, 1.0]) - 1e-9), axis=1)
    assert np.any(inside)
    force = body.internal_force(u)
    assert np.abs(force[inside]).max() <= 1e-12 * np.abs(force).max()


def test_cells_of_one_kind_and_their_sets(tmp_path):
    """Of twenty nodes the middles of faces and of the cell are added, and belong to sets that have all around them."""
    path = written(tmp_path, mixed_deck(True).replace("*Nset, nset=end\n1, 2, 3, 4", _left_nodes(mixed_deck(True))))
    deck = Geometry(path)
    assert list(deck.kinds) == ["second_order_tetrahedra"]
    alone = abaqus_format.read(path, "C3D20")
    assert alone.cells.shape == (1, 27)
    assert np.allclose(alone.points[alone.cells[0, 26]], [0.5, 0.5, 0.5])
    assert len(alone.node_groups["end"]) == 9
    assert np.allclose(alone.points[alone.node_groups["end"]][:, 0], 0.0)


GMSH = {
    8: ((0, 1), (0, 3), (0, 4), (1, 2), (1, 5), (2, 3), (2, 6), (3, 7), (4, 5), (4, 7), (5, 6), (6, 7)),
    6: ((0, 1), (0, 2), (0, 3), (1, 2), (1, 4), (2, 5), (3, 4), (3, 5), (4, 5)),
    5: ((0, 1), (0, 3), (0, 4), (1, 2), (1, 4), (2, 3), (2, 4), (3, 4)),
}
"""Edges of hexahedra, prisms and pyramids in gmsh's order of nodes between corners (its manual, "Node ordering")."""

TYPES = {20: 17, 15: 18, 13: 19, 8: 5, 6: 6, 5: 7}


def msh_of(deck):
    """The mixed deck as MSH 2.2: cells in the group 1, of the hexahedron 2 as well; facets "left" (7) and "bottom"."""
    elements, number = [], 0
    for width, rows in deck.solids.items():
        corners = {20: 8, 15: 6, 13: 5}.get(width, width)
        for row in rows[:, 1:].tolist():
            between = dict(zip(_EDGES[corners], row[corners:], strict=False))
            between |= {edge[::-1]: node for edge, node in between.items()}
            nodes = row[:corners] + ([between[edge] for edge in GMSH[corners]] if width > corners else [])
            for group in (1, 2) if corners == 8 else (1,):
                number += 1
                elements.append([number, TYPES[width], 2, group, group, *nodes])
    for row in [1, 2, 4, 3], [1, 5, 7, 3], [13, 9, 11, 15]:  # x = 0, and the bottoms of both hexahedral cubes
        elements.append([number := number + 1, 3, 2, *((7, 7) if row[1] == 2 else (8, 8)), *row])
    for row in [5, 9, 7], [9, 11, 7]:
        elements.append([number := number + 1, 2, 2, 8, 8, *row])
    lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$PhysicalNames", "4", '2 7 "left"', '2 8 "bottom"']
    lines += ['3 1 "all"', '3 2 "hexahedron"', "$EndPhysicalNames", "$Nodes", str(len(deck.tags))]
    lines += [f"{tag} {x} {y} {z}" for tag, (x, y, z) in zip(deck.tags, deck.points.tolist(), strict=True)]
    lines += ["$EndNodes", "$Elements", str(len(elements)), *(" ".join(map(str, row)) for row in elements)]
    return "\n".join([*lines, "$EndElements", ""])


@pytest.mark.parametrize("second", [False, True], ids=["first order", "second order"])
def test_mixed_meshes_of_gmsh(second, tmp_path):
    """As those of decks: the same volume, faces and groups, in gmsh's order of nodes."""
    deck = Geometry(written(tmp_path, mixed_deck(second)))
    read = coulomb.read_mesh(written(tmp_path, msh_of(deck), "part.msh"))
    same = coulomb.read_mesh(str(tmp_path / "part.inp"))
    assert (
        read.degree == 1 + second
        and len(read.cells["hexahedron"]) == len(same.cells["C3D20" if second else "C3D8"]) > 1
    )
    assert np.allclose(np.sort(read.domain.geometry.x, axis=0), np.sort(same.domain.geometry.x, axis=0))
    body = Elasticity(read, STEEL, [Clamp("left")])
    one = body.volume_load(np.tile([1.0, 0.0, 0.0], (len(body.x), 1)))
    assert one[:, 0].sum() == pytest.approx(3.0, rel=1e-12)
    for face, area in (("left", 1.0), ("bottom", 3.0)):
        assert body.area_of(read.facets(face, "test")).sum() == pytest.approx(area, rel=1e-12)


def test_mixed_meshes_of_vtk(tmp_path):
    """By meshio, with whole numbers on cells as groups: two prisms beside a hexahedron."""
    meshio = pytest.importorskip("meshio")
    cells = [("hexahedron", np.array([HEXAHEDRON]) - 1), ("wedge", np.array(WEDGES) - 1)]
    cells.append(("quad", np.array([[1, 2, 4, 3]]) - 1))
    path = tmp_path / "part.vtu"
    meshio.vtu.write(path, meshio.Mesh(POINTS[:12], cells, cell_data={"part": [[4], [5, 5], [6]]}))
    read = coulomb.read_mesh(path, names={"left": 6}, cell_names={"prisms": 5})
    body = Elasticity(read, STEEL, [Clamp("left")])
    one = body.volume_load(np.tile([1.0, 0.0, 0.0], (len(body.x), 1)))
    assert one[:, 0].sum() == pytest.approx(2.0, rel=1e-12)
    assert body.area_of(read.facets("left", "test")).sum() == pytest.approx(1.0, rel=1e-12)
    assert len(read.cells["prisms"]) == 6


@pytest.mark.parametrize("second", [False, True], ids=["first order", "second order"])
def test_mixed_meshes_of_med(second, tmp_path, monkeypatch):
    """As those of decks: the same volume, nodes and groups; the corners of Salome's cells go round the other way."""
    meshio = pytest.importorskip("meshio")
    deck = Geometry(written(tmp_path, mixed_deck(second)))
    kinds = {4: "tetra", 8: "hexahedron", 6: "wedge", 5: "pyramid", 10: "tetra10", 20: "hexahedron20"}
    kinds |= {15: "wedge15", 13: "pyramid13"}
    for name in kinds.values():  # meshio knows its kinds of MED, but not all of these as cells
        monkeypatch.setitem(meshio._mesh.topological_dimension, name, 3)
    cells, tags = [], []
    for width, rows in deck.solids.items():
        corners = {20: 8, 15: 6, 13: 5, 10: 4}.get(width, width)
        round_ = {8: [0, 3, 2, 1, 4, 7, 6, 5], 6: [0, 2, 1, 3, 5, 4], 5: [0, 3, 2, 1, 4], 4: [0, 2, 1, 3]}[corners]
        between = {frozenset(edge): corners + k for k, edge in enumerate(_EDGES[corners])}
        middles = [between[frozenset(round_[k] for k in edge)] for edge in _EDGES[corners]] if width > corners else []
        cells.append((kinds[width], deck.places(rows[:, 1:])[:, round_ + middles]))
        tags.append(np.full(len(rows), -1 - (corners == 8)))
    cells.append(("quad", deck.places(np.array([[1, 2, 4, 3], [1, 5, 7, 3]]))))
    mesh = meshio.Mesh(deck.points, cells, cell_data={"cell_tags": [*tags, np.array([-3, -4])]})
    mesh.cell_tags = {-1: ["all"], -2: ["all", "hexahedron"], -3: ["left"], -4: ["bottom"]}
    mesh.point_tags = {}
    meshio.med.write(tmp_path / "part.med", mesh)
    read, same = (coulomb.read_mesh(str(tmp_path / name)) for name in ("part.med", "part.inp"))
    assert read.degree == 1 + second
    assert len(read.cells["hexahedron"]) == len(same.cells["C3D20" if second else "C3D8"]) > 1
    assert np.allclose(np.sort(read.domain.geometry.x, axis=0), np.sort(same.domain.geometry.x, axis=0))
    body = Elasticity(read, STEEL, [Clamp("left")])
    one = body.volume_load(np.tile([1.0, 0.0, 0.0], (len(body.x), 1)))
    assert one[:, 0].sum() == pytest.approx(3.0, rel=1e-12)
    for face in ("left", "bottom"):
        assert body.area_of(read.facets(face, "test")).sum() == pytest.approx(1.0, rel=1e-12)


def _left_nodes(text):
    """A set of all nodes at x = 0."""
    rows = [line.split(",") for line in text.split("*Element")[0].splitlines()[1:]]
    return "*Nset, nset=end\n" + ", ".join(row[0] for row in rows if float(row[1]) == 0.0)


def test_curved_cells_keep_the_shape_of_twenty_nodes(tmp_path):
    """The volume of a cell by the 20-node functions, by a rule that is exact for them."""

    def bent(x):
        return np.array([x[0], x[1] + 0.1 * x[0] * (1.0 - x[0]), x[2] * (1.0 + 0.05 * x[0])])

    read = abaqus_format.read(written(tmp_path, mixed_deck(True, bent)), "C3D20")
    given = read.points[read.cells[0, :20]]
    corners, edges = given[:8], given[8:]
    assert np.allclose(read.points[read.cells[0, 26]], -corners.sum(axis=0) / 4 + edges.sum(axis=0) / 4)
    faces = {column: read.points[read.cells[0, column]] for column in range(20, 26)}
    assert np.allclose(faces[24], -corners[:4].sum(axis=0) / 4 + edges[:4].sum(axis=0) / 2)  # VTK's bottom


PART = """*Heading
free text, *NODE in it
*Part, name=Cube
*Node
1, 0., 0., 0.
2, 1., 0., 0.
3, 1., 1., 0.
4, 0., 1., 0.
5, 0., 0., 1.
6, 1., 0., 1.
7, 1., 1., 1.
8, 0., 1., 1.
*Element, type=C3D8R
1, 1, 2, 3, 4, 5, 6, 7, 8
*Nset, nset=All, generate
1, 8, 1
*Elset, elset=All
1
*Surface, type=ELEMENT, name=Top
All, S2
*End Part
"""


def test_instances_are_moved_and_turned(tmp_path):
    """Translated first, then turned about the axis, as Abaqus does."""
    text = PART + (
        "*Assembly, name=A\n*Instance, name=Lower, part=Cube\n*End Instance\n"
        "*Instance, name=Upper, part=Cube\n2., 0., 0.\n0., 0., 0., 0., 0., 1., 90.\n*End Instance\n"
        "*Nset, nset=Both, instance=Lower\n7\n*Nset, nset=Both, instance=Upper\n7,\n"
        "*Surface, name=Tops\nLower.All, S2\nUpper.All, S2\n*End Assembly\n"
    )
    deck = Geometry(written(tmp_path, text))
    both = deck.points[deck.places(deck.node_sets.members("Both"))]
    assert np.allclose(both, [[1.0, 1.0, 1.0], [-1.0, 3.0, 1.0]])
    read = coulomb.read_mesh(str(tmp_path / "part.inp"))
    assert read.components == 2 and len(read.faces["Tops"]) == 2 and len(read.faces["Upper.Top"]) == 1
    assert np.allclose(np.ptp(read.domain.geometry.x, axis=0), [2.0, 3.0, 1.0])


def test_numbers_of_fortran():
    assert [number_of(word) for word in ("1.D3", "1+3", ".1d2", "10", " ", "1E0", "-2.5-1")] == [
        *(1e3, 1e3, 10.0, 10.0, 0.0, 1.0, -0.25)
    ]


def test_cards_as_users_write_them(tmp_path):
    """Windows line ends, tabs, comments inside data, blanks in names, a continued keyword line, an included file."""
    (tmp_path / "more.txt").write_bytes(b"3, 4\r\n** a comment\r\n\t5,\r\n")
    text = "text before\r\n>** more\r\n*nset , NSET = a b,\r\n unsorted\r\n1,2,\r\n"
    text += "  ** comment\r\n*INCLUDE,INPUT=more.txt\r\n"
    cards = read_cards(written(tmp_path, text + "*Boundary\r\nab, 1, 3\r\n"))
    assert [(card.kind, card.line) for card in cards] == [("NSET", 3), ("BOUNDARY", 8)]
    assert cards[0].key("NSET") == "AB" and "UNSORTED" in cards[0].parameters
    assert cards[0].integers().tolist() == [1, 2, 3, 4, 5]
    with pytest.raises(ValueError, match=r"more.txt: line 3: \*nset : wrong".replace("nset ", "NSET")):
        raise cards[0].fault("wrong", 2)
    for line in ("*INCLUDE, input = 'more.txt'", '*include,INPUT="more.txt", PASSWORD=a'):
        assert read_cards(written(tmp_path, f"*NSET, NSET=a\n{line}\n"))[0].integers().tolist() == [3, 4, 5]
    with pytest.raises(ValueError, match=r"line 2: \*INCLUDE: needs INPUT=FILE on the same line"):
        read_cards(written(tmp_path, "*NSET, NSET=a\n*INCLUDE,\nINPUT=more.txt\n"))
