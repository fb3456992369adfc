"""Pictures and pages of several bodies: one grid, bodies drawn apart, all faces seen and with colours for each."""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg

from coulomb.io.field_files import NODE, OPPOSITE, Grid
from coulomb.pictures.report.fields import Bar, Limits, limits_of, named
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
    skin_of,
    without,
)
from coulomb.pictures.report.picture import SIZE, sheet
from coulomb.pictures.report.results import stresses
from coulomb.pictures.report.scene import Look, Shot, camera_of, shoot
from coulomb.pictures.report.surface_view import surface_view

CUBE = np.array([[x, y, z] for z in (0.0, 1.0) for y in (0.0, 1.0) for x in (0.0, 1.0)])
HEXAHEDRON = np.array([[0, 1, 3, 2, 4, 5, 7, 6]])
UP = np.array([0.0, 0.0, 1.0])
ON_CELLS = frozenset({"young"})
ON_FACE = ("pressure", "friction_use", "status", "gap", "area")


def body():
    """A hexahedron, and a tetrahedron on it whose three lower nodes are at nodes of the hexahedron."""
    above = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 1.0], [0.0, 1.0, 1.0], [0.0, 0.0, 2.0]])
    lower = Grid("Hexahedron", HEXAHEDRON, CUBE, {"displacement": 0.0 * CUBE, "young": np.array([1.0])}, ON_CELLS)
    upper = Grid(
        "Tetrahedron", np.array([[0, 1, 2, 3]]), above, {"displacement": 0.0 * above + UP, "young": [2.0]}, ON_CELLS
    )
    return merged({"lower": lower, "upper": upper})


def contact():
    """The slave is the lower face of the tetrahedron, the master the upper face of the hexahedron."""

    def fields(node, normal):
        count = len(node)
        numbers = {name: np.arange(1.0, count + 1.0) for name in ON_FACE}
        vectors = {name: np.tile(UP, (count, 1)) for name in ("friction_traction", "slip")}
        return {**numbers, **vectors, NODE: np.array(node), "normal": np.tile(normal, (count, 1))}

    slave = Grid("Triangle", np.array([[0, 1, 2]]), CUBE[[4, 5, 6]], {**fields([0, 1, 2], -UP), "face": np.zeros(3)})
    on_master = {**fields([4, 5, 6, 7], UP), OPPOSITE: np.zeros(4)}
    master = Grid("Quadrilateral", np.array([[0, 1, 3, 2]]), CUBE[4:], on_master)
    return merged({"upper:bottom": slave, "lower:top": master})


@dataclass(frozen=True)
class State:
    """A state in place of its files."""

    solution: Grid
    contact: Grid
    time: None = None

    def grid(self, file):
        return self.solution if file == "solution" else self.contact


def run_of(*states, **summary):
    return Run(".", summary, {}, True, "", (), (), None, states, ())


# --- faces that a body hides ------------------------------------------------------------------------------------------


def test_a_face_below_its_body_is_seen_through_it():
    """The lower face of the upper body: its colours are seen from above."""
    pictures = []
    for on_slave in (0.0, 1.0):
        faces = contact()
        faces.fields["pressure"][:] = 0.0
        faces.fields["pressure"][:3] = on_slave
        pictures.append(
            shoot(State(body(), faces), Look(named("pressure"), Limits(0.0, 1.0), 0.0, "contact"), (300, 300))
        )
    dark, bright = (shot.pixels.astype(int) for shot in pictures)
    changed = np.abs(dark - bright)[:, :, :3].max(axis=2)
    assert np.count_nonzero(changed > 60) > 1000
    assert np.array_equal(dark[:, :, 3], bright[:, :, 3])


def dovetail():
    """Root (0) and disc (1): two undercut flanks of the root, inclined to x by 45 degrees, along the slot y."""
    length = np.array([0.0, 3.0, 0.0])
    left, right = (np.array([[s * 1.0, 0.0, 1.0], [s * 2.0, 0.0, 0.0]]) for s in (-1.0, 1.0))
    points = np.concatenate([left, left + length, right, right + length])
    cells = np.array([[0, 1, 3, 2], [4, 5, 7, 6]])
    out = np.concatenate([np.tile([-1.0, 0.0, 1.0], (4, 1)), np.tile([1.0, 0.0, 1.0], (4, 1))]) / 2.0**0.5
    fields = {"area": np.ones(8), "status": np.ones(8)}
    root = Grid("Quadrilateral", cells, points, {**fields, "normal": out, "face": np.zeros(8)})
    disc = Grid("Quadrilateral", cells, points, {**fields, "normal": -out, OPPOSITE: np.zeros(8)})
    bodies = {"root": Grid("Hexahedron", HEXAHEDRON, CUBE * [4.0, 3.0, 5.0] - [2.0, 0.0, 0.0], {})}
    bodies["disc"] = Grid("Hexahedron", HEXAHEDRON, CUBE * [8.0, 3.0, 4.0] - [4.0, 0.0, 3.0], {})
    return merged(bodies), merged({"root:flanks": root, "disc:flanks": disc})


def test_a_dovetail_is_drawn_out_along_its_slot():
    """The disc's flanks point down: along them the root would be drawn through the disc."""
    bodies, faces = dovetail()
    moved, _ = drawn_apart(bodies, faces)
    apart = (moved.points - bodies.points)[0] - (moved.points - bodies.points)[8]
    assert abs(apart[1]) > 3.0 and np.allclose(apart[[0, 2]], 0.0, atol=1e-5)


# --- the frame --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("lengths", [(5.0, 1.0, 1.0), (1.0, 5.0, 1.0)], ids=["along x", "along y"])
@pytest.mark.parametrize("slope", [0.0, 0.1, -0.1])
def test_a_long_body_lies_in_a_wide_frame(lengths, slope):
    points = CUBE * lengths
    normal = np.array([slope, 0.0, -1.0]) if lengths[0] > 1.0 else np.array([0.0, slope, -1.0])
    down = np.tile(normal / np.linalg.norm(normal), (4, 1))
    fields = {"normal": down, "pressure": np.ones(4), "status": np.ones(4), "area": np.ones(4)}
    face = Grid("Quadrilateral", np.array([[0, 1, 3, 2]]), points[:4], fields)
    state = State(Grid("Hexahedron", HEXAHEDRON, points, {"displacement": 0.0 * points}), face)
    camera = camera_of([state], Look(named("pressure"), Limits(0.0, 1.0), 0.0, "contact"), (1500, 1100))
    assert camera.size[0] == 1500 and camera.size[0] > 1.5 * camera.size[1]


# --- colours ----------------------------------------------------------------------------------------------------------


def three_faces(*largest):
    """A body with so many contacts, each on a face of two facets with these largest pressures."""
    count = len(largest)
    points = np.concatenate([CUBE[:4] + [2.0 * k, 0.0, 0.0] for k in range(count)])
    cells = np.concatenate([np.array([[0, 1, 3, 2]]) + 4 * k for k in range(count)])
    pressure = np.concatenate([np.array([0.0, 0.5, 1.0, 0.25]) * value for value in largest])
    fields = {"pressure": pressure, "face": np.repeat(np.arange(float(count)), 4), "area": np.ones(4 * count)}
    fields |= {"normal": np.tile(-UP, (4 * count, 1)), "status": np.ones(4 * count)}
    grid = Grid("Quadrilateral", cells, points, fields)
    entries = [{"faces": [f"face {k}"], "force": [0.0] * 3, "moment": [0.0] * 3} for k in range(count)]
    return run_of(
        State(grid, grid), faces=entries, maximum={"contact_pressure": max(largest), "displacement": 0.0}
    ), grid


def test_faces_of_low_pressure_have_colours_of_their_own():
    run, grid = three_faces(100.0, 3.0, 2.0)
    limits = limits_of(run, named("pressure"))
    assert (limits.low, limits.high, limits.ends) == (0.0, 100.0, (100.0, 3.0, 3.0))
    drawn = limits.stretched(grid.fields["pressure"], grid)
    assert [drawn[4 * k : 4 * k + 4].max() for k in range(3)] == pytest.approx([100.0, 100.0, 200.0 / 3.0])
    assert limits.bars(grid.fields["pressure"], grid) == [
        Bar(0.0, 100.0, 0.0, 100.0, "face 0"),
        Bar(0.0, 3.0, 0.0, 3.0, "face 1, face 2"),
    ]


def test_faces_of_similar_pressure_share_them():
    run, grid = three_faces(100.0, 30.0, 60.0)
    limits = limits_of(run, named("pressure"))
    assert limits == Limits(0.0, 100.0, 1e-8 * 100.0)
    assert limits.bars(grid.fields["pressure"], grid) == [Bar(0.0, 100.0, 0.0, 100.0)]


def test_ranges_of_pairs_are_named_by_both_faces():
    run, grid = three_faces(100.0, 3.0)
    entries = [{**face, "against": other} for face, other in zip(run.faces, ("low:top", "up:bottom"), strict=True)]
    limits = limits_of(replace(run, summary={**run.summary, "faces": entries}), named("pressure"))
    assert [bar.of for bar in limits.bars(grid.fields["pressure"], grid)] == [
        "face 0 against low:top",
        "face 1 against up:bottom",
    ]


def test_rounding_errors_get_no_colours():
    """A face whose pressures are below the accuracy is shown with pressure 0, in the range of the others."""
    run, grid = three_faces(100.0, 1e-9, 50.0)
    limits = limits_of(run, named("pressure"))
    assert limits.ends == () and limits.stretched(grid.fields["pressure"], grid)[4:8].tolist() == [0.0] * 4


def test_faces_opposite_have_the_colours_of_their_pair():
    faces = contact()
    faces.fields["face"][:3], faces.fields[OPPOSITE][3:] = 1.0, 1.0  # the pair is the second contact
    faces.fields["pressure"][:] = [1.0, 2.0, 8.0, 1.0, 2.0, 8.0, 4.0]
    limits = Limits(0.0, 80.0, 0.0, (80.0, 8.0), ("one", "other"))
    assert limits.stretched(faces.fields["pressure"], faces).tolist() == [10.0, 20.0, 80.0, 10.0, 20.0, 80.0, 40.0]


def test_the_view_of_a_face_has_its_range():
    """By name of the face, over the largest range; values stay what they are."""
    faces = contact()
    faces.fields["face"][:3], faces.fields[OPPOSITE][3:] = 1.0, 1.0  # the pair is the second contact
    slave, master = (
        Grid(block.kind, corners, faces.points[block.points], {k: v[block.points] for k, v in faces.fields.items()})
        for block, corners in zip(faces.blocks, (np.array([[0, 1, 2]]), np.array([[0, 1, 3, 2]])), strict=True)
    )
    of_first = {"face": np.zeros(3), OPPOSITE: np.full(3, -1.0), "pressure": np.full(3, 200.0)}
    first = slave._replace(points=CUBE[:3], fields={**slave.fields, **of_first})
    all_faces = merged({"lower:side": first, "upper:bottom": slave, "lower:top": master})
    entries = [{"faces": [name], "force": [0.0] * 3, "moment": [0.0] * 3} for name in ("lower:side", "upper:bottom")]
    run = run_of(State(body(), all_faces), faces=entries, maximum={"contact_pressure": 200.0})
    data, _ = surface_view(run, 1.0)
    (pressure,) = [field for field in data["fields"] if field["name"] == "pressure"]
    assert pressure["high"] * pressure["factor"] == pytest.approx(200.0)
    assert pressure["of_faces"] == pytest.approx({"lower:side": 1.0, "upper:bottom": 0.02, "lower:top": 0.02})


# --- the sheet --------------------------------------------------------------------------------------------------------

SHOT = Shot(np.full((60, 80, 4), 255, dtype=np.uint8), np.eye(3, 2))


def drawn(*given):
    figure = sheet(*given)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return figure, canvas.get_renderer()


@pytest.mark.parametrize("held", [0, 11, 123_456])
def test_the_legend_is_whole(held):
    zones = {"open": 123_456, "stick": 123_456, "slip": 123_456, "no contact point": held}
    figure, by = drawn(SHOT, named("status"), [Bar(0.0, 3.0, 0.0, 3.0)], "", "", zones)
    box, directions = figure.legends[0].get_window_extent(by), figure.axes[1].get_window_extent(by)
    assert box.x0 >= directions.x1 and box.x1 <= figure.bbox.x1 and box.y0 >= 0.0
    assert box.y1 <= figure.axes[0].get_window_extent(by).y0


@pytest.mark.parametrize("count", [1, 2, 4])
def test_colour_bars_are_below_each_other(count):
    bars = [Bar(-7e6 / 10**k, 7e6 / 10**k, -6.543e6 / 10**k, 1.234e6 / 10**k, f"face {k}") for k in range(count)]
    figure, by = drawn(SHOT, named("friction_traction_x"), bars, "caption", "ALARM", {})
    assert (figure.get_size_inches() * 150.0 % 2 == 0).all()  # of films
    boxes = [axis.get_tightbbox(by) for axis in figure.axes[2:]]
    assert len(boxes) == count and boxes[0].y1 <= figure.axes[0].get_window_extent(by).y0 and boxes[-1].y0 >= 0.0
    assert all(below.y1 <= above.y0 for above, below in pairwise(boxes))
    texts = [text for text in figure.texts if text.get_text().startswith("max ")]
    assert texts[0].get_text() == "max 1.234\nmin −6.543" and len(texts) == count
    assert all(text.get_window_extent(by).x1 <= figure.bbox.x1 for text in figure.texts)
    assert figure.axes[2].get_xlabel().startswith("face 0: ")


def test_sheets_have_one_size():
    figure, _ = drawn(SHOT, named("pressure"), [Bar(0.0, 1.0, 0.0, 1.0)], "", "", {})
    assert tuple(figure.get_size_inches()) == SIZE


# --- stresses ---------------------------------------------------------------------------------------------------------


def test_table_of_stresses():
    """Of every body whose stress is known: of one of the user's forms the merged grid has zeros."""
    parts = {"ours": 2.0 * CUBE, "forms": CUBE, "theirs": CUBE}
    two, known = HEXAHEDRON.repeat(2, axis=0), frozenset(("stress_xy", "principal_stress_1"))
    grids = {name: Grid("Hexahedron", two, points, {}, known) for name, points in parts.items()}
    for name, scale in (("ours", 1e6), ("theirs", 1e3)):
        grids[name].fields["stress_xy"] = np.array([-2.0, 3.0]) * scale
        grids[name].fields["principal_stress_1"] = np.array([5.0, 4.0]) * scale
    state = State(merged(grids), contact())
    assert stresses(run_of(state, forms={"forms": {"degree": 1}}))[1] == [
        ("ours", "stress xy", "−2\u202fMPa", "3\u202fMPa"),
        ("ours", "first (largest) principal stress", "4\u202fMPa", "5\u202fMPa"),
        ("theirs", "stress xy", "−2\u202fkPa", "3\u202fkPa"),
        ("theirs", "first (largest) principal stress", "4\u202fkPa", "5\u202fkPa"),
    ]


# --- the title --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("command", "title"),
    [
        ("coulomb run cases/joint.toml --output results/third", "joint"),
        ("coulomb run --quiet 'my joint.toml'", "my joint"),
        ("python joint.py", "third"),
        ("coulomb run 'joint.toml", "third"),  # changed by hand
    ],
)
def test_the_title_names_the_case(command, title, tmp_path):
    """A run from Python has none: its directory is named."""
    run = replace(run_of(State(body(), contact()), run={"command": command}), directory=tmp_path / "third")
    assert run.title == title


# --- several bodies ---------------------------------------------------------------------------------------------------


def test_grids_of_different_cells_are_one():
    both = body()
    assert [block.name for block in both.blocks] == ["lower", "upper"]
    assert corners_in(both.cells).tolist() == [8, 4] and polygons(both.cells)[[0, 9]].tolist() == [8, 4]
    skin = skin_of(both, both.points)
    assert skin.n_cells == 6 + 4
    facets = np.array([[4, 5, 7, 6], [8, 9, 10, 10]])  # of each body the face between them
    assert without(skin, facets).n_cells == 10 - 2


def test_ends_of_a_bar_with_contact_all_around_are_drawn():
    """All their nodes are on the contact face, as those of a pin of few cells."""
    skin = skin_of(Grid("Hexahedron", HEXAHEDRON, CUBE, {}), CUBE)
    sides = np.array([[0, 1, 5, 4], [1, 3, 7, 5], [3, 2, 6, 7], [2, 0, 4, 6]])
    ends = without(skin, sides)
    assert ends.n_cells == 2 and sorted(ends.cell_centers().points[:, 2]) == pytest.approx([0.0, 1.0])
    assert without(skin, np.vstack([sides, [[0, 1, 3, 2], [4, 5, 7, 6]]])).n_cells == 0


def test_nodes_on_a_face_are_those_of_its_own_body():
    assert nodes_in_body(contact(), body()).tolist() == [8, 9, 10, 4, 5, 6, 7]


def test_faces_opposite_have_no_contact_nodes():
    assert contact_points(contact()).tolist() == [True] * 3 + [False] * 4


def test_zones_of_triangles_beside_quadrilaterals_are_cut():
    """Into pieces of the same size for every corner: a third of a triangle, a quarter of a quadrilateral."""
    both = contact()
    pieces = patches(both.cells, both.points)
    assert sorted(pieces.cell_data["node"]) == list(range(7)) and pieces.area == pytest.approx(1.5)
    areas = pieces.compute_cell_sizes()["Area"]
    assert areas == pytest.approx(np.where(pieces.cell_data["node"] < 3, 1.0 / 6.0, 1.0 / 4.0))


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
    bodies["plate"] = bodies["plate"]._replace(points=CUBE * [5.0, 5.0, 5.0] - [0.0, 1.0, 0.0])  # from -1 to 4
    moved, _ = drawn_apart(merged(bodies), merged({"pin:outside": pin, "plate:hole": hole}))
    apart = moved.points[0] - bodies["pin"].points[0] - (moved.points[8] - bodies["plate"].points[0])
    assert np.allclose(np.abs(apart), [0.0, 4.3, 0.0], atol=1e-4)  # all of it, by the shorter way


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


def test_the_page_has_every_face_to_choose_from():
    data, omitted = surface_view(run_of(State(body(), contact())), 1.0)
    assert [face["name"] for face in data["faces"]] == ["upper:bottom", "lower:top"] and not omitted
    assert [face["nodes"] for face in data["faces"]] == [(0, 3), (3, 7)]
    assert [face["triangles"] for face in data["faces"]] == [(0, 3), (3, 9)]
    assert [face["edges"] for face in data["faces"]] == [(0, 6), (6, 14)]
    below, above = (face["direction"][2] for face in data["faces"])
    assert below < 0.0 < above


def test_second_order_cells_are_counted_per_body():
    tetrahedron = first_order(Grid("Tetrahedron_10", np.array([range(10)]), np.eye(10, 3), {}))
    both = merged({"a": tetrahedron, "b": Grid("Hexahedron", HEXAHEDRON, CUBE, {})})
    assert [(block.kind, block.pieces) for block in both.blocks] == [("Tetrahedron_10", 8), ("Hexahedron", 1)]
