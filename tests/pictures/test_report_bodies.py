"""Pictures and pages of several bodies: their grids as one, bodies drawn apart, faces to choose from."""

from dataclasses import dataclass

import numpy as np
import pytest

pytest.importorskip("pyvista")

from coulomb.io.field_files import OPPOSITE, Grid
from coulomb.pictures.report.files import Run
from coulomb.pictures.report.grids import (
    contact_points,
    corners_in,
    drawn_apart,
    first_order,
    merged,
    nodes_in_body,
    outward,
    patches,
    polygons,
    renderer,
    skin_of,
    without,
)
from coulomb.pictures.report.surface_view import surface_view

CUBE = np.array([[x, y, z] for z in (0.0, 1.0) for y in (0.0, 1.0) for x in (0.0, 1.0)])
HEXAHEDRON = np.array([[0, 1, 3, 2, 4, 5, 7, 6]])
UP = np.array([0.0, 0.0, 1.0])
ON_FACE = ("pressure", "friction_use", "status", "gap", "area")


def body():
    """A hexahedron, and a tetrahedron on it whose three lower nodes are at nodes of the hexahedron."""
    above = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [0.0, 1.0, 1.0], [0.0, 0.0, 2.0]])
    lower = Grid("Hexahedron", HEXAHEDRON, CUBE, {"displacement": 0.0 * CUBE, "young": np.array([1.0])})
    upper = Grid("Tetrahedron", np.array([[0, 1, 2, 3]]), above, {"displacement": 0.0 * above + UP, "young": [2.0]})
    return merged({"lower": lower, "upper": upper})


def contact():
    """The slave is the lower face of the tetrahedron, the master the upper face of the hexahedron."""

    def fields(count, normal):
        numbers = {name: np.arange(1.0, count + 1.0) for name in ON_FACE}
        vectors = {name: np.tile(UP, (count, 1)) for name in ("friction_traction", "slip")}
        return {**numbers, **vectors, "normal": np.tile(normal, (count, 1))}

    slave = Grid("Triangle", np.array([[0, 1, 2]]), CUBE[[4, 5, 6]], {**fields(3, -UP), "face": np.zeros(3)})
    master = Grid("Quadrilateral", np.array([[0, 1, 3, 2]]), CUBE[4:], {**fields(4, UP), OPPOSITE: np.zeros(4)})
    return merged({"upper:bottom": slave, "lower:top": master})


def test_grids_of_different_cells_are_one():
    both = body()
    assert [block.name for block in both.blocks] == ["lower", "upper"]
    assert corners_in(both.cells).tolist() == [8, 4] and polygons(both.cells)[[0, 9]].tolist() == [8, 4]
    skin = skin_of(renderer(), both, both.points)
    assert skin.n_cells == 6 + 4
    facets = np.array([[4, 5, 7, 6], [8, 9, 10, 10]])  # of each body the face between them
    assert without(skin, facets).n_cells == 10 - 2


def test_nodes_on_a_face_are_those_of_its_own_body():
    assert nodes_in_body(contact(), body()).tolist() == [8, 9, 10, 4, 5, 6, 7]


def test_faces_opposite_have_no_contact_nodes():
    assert contact_points(contact()).tolist() == [True] * 3 + [False] * 4


def test_zones_of_triangles_beside_quadrilaterals_are_cut():
    both, every = contact(), np.ones(7, dtype=bool)
    pieces = patches(renderer(), both.cells, both.points, every)
    assert pieces.n_cells == 3 + 4 and pieces.area == pytest.approx(1.5)


def test_the_slave_is_drawn_apart_from_the_master():
    moved, faces = drawn_apart(body(), contact())
    apart = (moved.points - body().points)[[0, 8]]
    assert np.allclose(apart[1] - apart[0], 0.55 * 2.0**0.5 * UP, atol=1e-5)
    assert np.allclose((faces.points - contact().points)[[0, 3]], apart[[1, 0]])


def test_a_pin_is_drawn_out_of_its_hole_along_the_axis():
    around = np.linspace(0.0, 2.0 * np.pi, 8, endpoint=False)
    circle = np.column_stack([np.cos(around), 0.0 * around, np.sin(around)])
    ring = np.concatenate([circle, circle + [0.0, 3.0, 0.0]])
    facets = np.array([[k, (k + 1) % 8, 8 + (k + 1) % 8, 8 + k] for k in range(8)])
    inwards = -np.tile(circle, (2, 1))
    fields = {"normal": inwards, "area": np.ones(16), "status": np.zeros(16)}
    pin = Grid("Quadrilateral", facets, ring, {**fields, "face": np.zeros(16)})
    hole = Grid("Quadrilateral", facets, ring, {**fields, OPPOSITE: np.zeros(16)})
    bodies = {name: Grid("Hexahedron", HEXAHEDRON, ring[:8], {}) for name in ("pin", "plate")}
    bodies["pin"] = bodies["pin"]._replace(points=3.0 * CUBE)
    moved, _ = drawn_apart(merged(bodies), merged({"pin:outside": pin, "plate:hole": hole}))
    apart = moved.points[0] - bodies["pin"].points[0] - (moved.points[8] - bodies["plate"].points[0])
    assert np.allclose(np.abs(apart), [0.0, 3.3, 0.0], atol=1e-4)


def test_a_ball_is_drawn_out_of_its_socket_and_seen_from_above():
    """Of a whole sphere the part with a partner counts; z is upward although the normals of this part point down."""
    points = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]])
    facets = np.array([[0, 1, 2], [3, 2, 1]])
    fields = {"normal": points, "area": np.ones(4), "status": np.array([3.0, 3.0, 3.0, 0.0])}
    ball = Grid("Triangle", facets, points, {**fields, OPPOSITE: np.zeros(4)})
    cup = Grid("Triangle", facets, points, {**fields, "normal": -points, "face": np.zeros(4)})
    bodies = {name: Grid("Hexahedron", HEXAHEDRON, CUBE + 3.0 * k * UP, {}) for k, name in enumerate(("cup", "ball"))}
    contact_faces = merged({"cup:inside": cup, "ball:sphere": ball})
    moved, _ = drawn_apart(merged(bodies), contact_faces)
    away = moved.points[8] - bodies["ball"].points[0] - (moved.points[0] - bodies["cup"].points[0])
    assert away[2] > 0.5 and np.allclose(away[:2], 0.0, atol=1e-6)
    assert np.allclose(outward(contact_faces), UP)


@dataclass(frozen=True)
class _State:
    """A state in place of its files."""

    time: None = None

    def grid(self, file):
        return body() if file == "solution" else contact()


def test_the_page_has_every_face_to_choose_from():
    run = Run(".", {}, {}, True, "", (), (), None, (_State(),), ())
    data, omitted = surface_view(run, 1.0)
    assert [face["name"] for face in data["faces"]] == ["upper:bottom", "lower:top"] and not omitted
    assert [face["nodes"] for face in data["faces"]] == [[0, 3], [3, 7]]
    assert [face["triangles"] for face in data["faces"]] == [[0, 3], [3, 9]]
    assert [face["edges"] for face in data["faces"]] == [[0, 6], [6, 14]]
    below, above = (face["direction"][2] for face in data["faces"])
    assert below < 0.0 < above


def test_second_order_cells_are_counted_per_body():
    tetrahedron = first_order(Grid("Tetrahedron_10", np.array([range(10)]), np.eye(10, 3), {}))
    both = merged({"a": tetrahedron, "b": Grid("Hexahedron", HEXAHEDRON, CUBE, {})})
    assert [(block.kind, block.pieces) for block in both.blocks] == [("Tetrahedron_10", 8), ("Hexahedron", 1)]
