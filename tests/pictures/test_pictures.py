"""Pictures: nothing cut off, distinguishable zones, arrows that do not hide the field, round ticks."""

import itertools

import numpy as np
import pytest
from conftest import solved_block
from matplotlib.figure import Figure
from PIL import Image

from coulomb import Clamp, Contact, ContactProblem, Material, Traction, box
from coulomb.io import output
from coulomb.pictures import drawing_process
from coulomb.pictures.plotting import ZONES, renderer
from coulomb.pictures.report import overview, scene, sheet
from coulomb.pictures.report.camera import MARGIN, SHAPES, framing, looking_at
from coulomb.pictures.report.files import read_run
from coulomb.pictures.report.limits import Bar, limits_of
from coulomb.pictures.report.scene import VIEWS, Look, automatic_scale, camera_of, shoot
from coulomb.pictures.report.shown_fields import named

PAIRS = list(itertools.combinations(dict(ZONES.values()), 2))


# --- colours ---------------------------------------------------------------------------------------------------------


def linear(colour):
    """Red, green and blue of "#rrggbb", in proportion to light (IEC 61966-2-1)."""
    encoded = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255.0
    return np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)


def lab(light):
    """CIE L*a*b* (D65) of linear red, green and blue."""
    to_xyz = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    t = np.array(to_xyz) @ light / [0.9505, 1.0, 1.089]
    f = np.where(t > (6 / 29) ** 3, np.cbrt(t), t / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


BLIND = {  # Machado, Oliveira, Fernandes 2009, Table 1: severity 1
    "protan": [[0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216], [-0.003882, -0.048116, 1.051998]],
    "deutan": [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]],
    "tritan": [[1.255528, -0.076749, -0.178779], [-0.078411, 0.930809, 0.147602], [0.004733, 0.691367, 0.303900]],
}


@pytest.mark.parametrize("pair", PAIRS, ids="-".join)
def test_zones_differ_in_greyscale(pair):
    """By the contrast of luminance of WCAG 2, which is 1.06 for colours that look the same in grey."""
    darker, lighter = sorted(float(linear(dict(ZONES.values())[name]) @ [0.2126, 0.7152, 0.0722]) for name in pair)
    assert (lighter + 0.05) / (darker + 0.05) > 2.0


@pytest.mark.parametrize("pair", PAIRS, ids="-".join)
@pytest.mark.parametrize("eyes", BLIND)
def test_zones_differ_for_the_colour_blind(pair, eyes):
    """A difference of 2 is just visible side by side, one of 20 is another colour."""
    first, second = (
        lab(np.clip(np.array(BLIND[eyes]) @ linear(dict(ZONES.values())[name]), 0.0, 1.0)) for name in pair
    )
    assert np.linalg.norm(first - second) > 30.0


# --- camera ----------------------------------------------------------------------------------------------------------

BODIES = {
    "block": (3.0, 1.0, 1.0),
    "rod": (50.0, 0.5, 0.5),
    "plate": (1.0, 1.0, 0.001),
    "sheet": (1.0, 1.0, 0.0),
    "line": (0.0, 0.0, 1e-3),
    "large": (3e6, 1e6, 2e6),
}


@pytest.mark.parametrize("lengths", BODIES.values(), ids=BODIES)
@pytest.mark.parametrize("view", VIEWS)
def test_the_view_contains_the_body_and_little_else(lengths, view):
    """By VTK's own projection: all points within the picture, and some of them near its border."""
    corners = np.array(list(itertools.product((0.0, 1.0), repeat=3))) * lengths + [7.0, -3.0, 2.0]
    points = np.concatenate([corners, 0.5 * (corners[:1] + corners)])
    direction, up = (np.array(part) for part in VIEWS[view] or looking_at(np.array([0.0, 0.0, -1.0])))
    parallel = view in ("top", "bottom", "front", "back", "left", "right")
    camera = framing(points, direction, up, (1500, 1100), parallel)
    plotter = renderer().Plotter(off_screen=True, window_size=camera.size)
    plotter.add_mesh(renderer().PolyData(points))
    camera.aim(plotter)
    matrix = plotter.camera.GetCompositeProjectionTransformMatrix(camera.size[0] / camera.size[1], -1, 1)
    transform = np.array([[matrix.GetElement(i, j) for j in range(4)] for i in range(4)])
    plotter.close()
    seen = np.column_stack([points, np.ones(len(points))]) @ transform.T
    seen = seen[:, :2] / seen[:, 3:]
    assert np.abs(seen).max() <= 1.0
    width, height = np.ptp(seen, axis=0)
    shape = camera.size[0] / camera.size[1]
    full = 2.0 / (1.0 + 2.0 * MARGIN)
    if lengths != BODIES["line"]:
        assert width == pytest.approx(full, rel=0.01) or shape < 1.05 * SHAPES[0] or shape > 0.95 * SHAPES[1]
        assert height == pytest.approx(full, rel=0.01) or shape > 0.95 * SHAPES[1]
        assert max(width, height) == pytest.approx(full, rel=0.01)
    assert camera.size[0] == 1500 or camera.size[1] == 1100
    assert camera.size[0] <= 1500 and camera.size[1] <= 1100


# --- pictures --------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def block(tmp_path_factory):
    directory = tmp_path_factory.mktemp("pictures") / "block"
    output.write(solved_block(6), directory)
    return read_run(directory)


def look(run, field, view="contact", **changes):
    chosen = named(field)
    return Look(chosen, limits_of(run, chosen), changes.get("scale", automatic_scale(run)), view)


@pytest.mark.parametrize("field", ["pressure", "status", "friction_traction", "displacement"])
@pytest.mark.parametrize("view", VIEWS)
def test_nothing_is_cut_off(block, field, view):
    """The outermost pixels are empty, those next to them are not on any side: the body fills the picture."""
    shot = shoot(block.steps[0], look(block, field, view), (600, 450))
    seen = shot.pixels[:, :, 3] > 0
    height, width = seen.shape
    assert not (seen[0].any() or seen[-1].any() or seen[:, 0].any() or seen[:, -1].any())
    rows, columns = np.flatnonzero(seen.any(axis=1)), np.flatnonzero(seen.any(axis=0))
    if field != "friction_traction":  # whose arrows may end before the room that is kept for them
        assert rows[0] <= 0.03 * height + 2 and rows[-1] >= 0.97 * height - 3
        assert columns[0] <= 0.03 * width + 2 and columns[-1] >= 0.97 * width - 3


@pytest.mark.parametrize("field", ["friction_traction", "slip"])
def test_arrows_do_not_hide_the_field(block, field, monkeypatch):
    chosen = look(block, field)
    camera = camera_of(block.steps, chosen, (900, 600))
    whole = shoot(block.steps[0], chosen, camera=camera).pixels.astype(int)
    monkeypatch.setattr(scene, "_arrows", lambda *_: None)
    bare = shoot(block.steps[0], chosen, camera=camera).pixels.astype(int)
    zones = shoot(block.steps[0], look(block, "status"), camera=camera).pixels.astype(int)
    grey = np.ptp(zones[:, :, :3], axis=2) < 25
    face = (zones[:, :, 3] > 0) & ~grey
    hidden = (np.abs(whole - bare).max(axis=2) > 40)[face].mean()
    assert 0.002 < hidden < 0.02


def test_the_picture_shows_pressure_and_zones(block, tmp_path):
    path = overview.draw(block.directory)
    image = np.asarray(Image.open(path).convert("RGB")).astype(int)
    half = len(image) // 2

    def count(part, colour):
        wanted = [int(colour[k : k + 2], 16) for k in (1, 3, 5)]
        return np.count_nonzero(np.abs(part - wanted).max(axis=2) <= 3)

    assert all(count(image[half:], colour) > 3000 for _, colour in list(ZONES.values())[:3])
    assert count(image[:half], "#440154") > 3000 and count(image[:half], dict(ZONES.values())["slip"]) == 0
    path.unlink()


@pytest.mark.parametrize(
    ("lengths", "cells", "wide"), [((3.0, 1.0, 1.0), (6, 2, 2), True), ((1, 1, 1), (2, 2, 2), False)]
)
def test_arrangement_of_the_two_views(tmp_path, lengths, cells, wide):
    """Without contact there is a picture as well."""
    problem = ContactProblem(
        box(lengths, cells),
        Material(2e11, 0.3),
        [Clamp("left")],
        Contact("bottom", 0.3),
        [Traction("top", (0.0, 0.0, 1e6))],
    )
    solution = problem.solve()
    assert not solution.contact_force.any()
    output.write(solution, tmp_path)
    width, height = Image.open(overview.draw(tmp_path)).size
    assert (width < height) == wide


def test_a_thin_body_is_not_turned_inside_out(tmp_path):
    """At the scale that shows displacements as a twentieth of the plate, its two faces would be exchanged."""
    problem = ContactProblem(
        box((1.0, 1.0, 0.01), (6, 6, 1)),
        Material(2e11, 0.3),
        [Clamp("left")],
        Contact("bottom", 0.3),
        [Traction("top", (0.0, 0.0, -4e7))],
    )
    output.write(problem.solve(), tmp_path)
    run = read_run(tmp_path)
    body, scale = run.steps[0].grid("solution"), automatic_scale(run)
    height = (body.points + scale * body.fields["displacement"])[:, 2]
    top = body.points[:, 2] > 0.005
    assert height[top].min() > height[~top].max()
    assert scale * np.abs(body.fields["displacement"]).max() > 1e-3  # and it is still visible


@pytest.mark.parametrize("limits", [(0.0, 189.3e6), (0.0, 7.77e-7), (-96.62e3, 96.62e3), (0.0, 1.0), (0.0, 33.0)])
def test_ticks_are_round(limits):
    figure = Figure()
    sheet.colour_bar(figure, named("pressure"), Bar(*limits, *limits), (0.2, 0.1, 0.6, 0.03))
    ticks = [tick for tick in figure.axes[0].get_xticks()]
    low, high = figure.axes[0].get_xlim()
    assert 3 <= sum(low <= tick <= high for tick in ticks) <= 9
    step = np.diff(ticks)[0]
    assert np.allclose(np.diff(ticks), step) and np.allclose(np.array(ticks) / step, np.round(np.array(ticks) / step))
    assert min(abs(np.log10(step / nice) % 1.0 - whole) for nice in (1, 2, 5) for whole in (0, 1)) < 1e-9


def test_legend_counts_nodes_in_words():
    figure = Figure()
    sheet.legend(figure, {"open": 12, "stick": 0, "slip": 1, "no contact point": 0}, (0.5, 0.5))
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert texts == ["open: 12 nodes", "stick: 0 nodes", "slip: 1 node"]


# --- the process that draws --------------------------------------------------------------------------------


def test_the_drawing_process_ends_with_its_input():
    """As when the run that started it is killed: its standard input ends."""
    assert drawing_process.begin().finish("", seconds=120.0) == (0, "")


def test_the_drawing_process_can_be_stopped():
    process = drawing_process.begin()
    process.stop()
    process.stop()
    assert process._process.returncode == -9
    code, said = process.finish("[]")
    assert code != 0 and said
