"""Pictures and films: nothing cut off, distinguishable zones, arrows that do not hide the field, round ticks."""

import itertools
import sys

import numpy as np
import pytest
from check_runs import read_grid
from conftest import run_coulomb
from matplotlib.figure import Figure
from PIL import Image

from coulomb import Clamp, Contact, ContactProblem, Material, Traction, box
from coulomb.io import output
from coulomb.pictures.drawing_process import DrawingProcess
from coulomb.pictures.report import picture, scene
from coulomb.pictures.report.fields import ZONES, Bar, Limits, limits_of, named
from coulomb.pictures.report.files import read_run
from coulomb.pictures.report.grids import renderer
from coulomb.pictures.report.picture import colour_bar, legend, plot, sheet
from coulomb.pictures.report.scene import (
    MARGIN,
    SHAPES,
    VIEWS,
    Look,
    automatic_scale,
    camera_of,
    framing,
    looking_at,
    paint,
    plotter_for,
    shoot,
)

# --- colours ---------------------------------------------------------------------------------------------------------


def luminance(colour):
    """Relative luminance of "#rrggbb" (WCAG 2)."""
    encoded = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255.0
    light = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    return float(light @ [0.2126, 0.7152, 0.0722])


@pytest.mark.parametrize("pair", list(itertools.combinations(dict(ZONES.values()), 2)), ids="-".join)
def test_zones_differ_in_greyscale(pair):
    """And so for the colour-blind: the contrast of luminance is 1.06 for colours that look the same in grey."""
    darker, lighter = sorted(luminance(dict(ZONES.values())[name]) for name in pair)
    assert (lighter + 0.05) / (darker + 0.05) > 2.0


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
@pytest.mark.parametrize("view", ["contact", "top"])
def test_the_view_contains_the_body_and_little_else(lengths, view):
    """By VTK's own projection: all points within the picture, and some of them near its border."""
    corners = np.array(list(itertools.product((0.0, 1.0), repeat=3))) * lengths + [7.0, -3.0, 2.0]
    points = np.concatenate([corners, 0.5 * (corners[:1] + corners)])
    direction, up = (np.array(part) for part in VIEWS[view] or looking_at(np.array([0.0, 0.0, -1.0])))
    parallel = view in ("top", "bottom", "front", "back", "left", "right")
    camera = framing(points, direction, up, (1500, 1100), parallel)
    plotter = renderer().Plotter(off_screen=True, window_size=camera.size)
    plotter.add_mesh(renderer().PolyData(points))
    plotter.camera = camera.of_vtk
    plotter.renderer.ResetCameraClippingRange()
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
def run(block):
    return read_run(block)


def look(run, field, view="contact", **changes):
    chosen = named(field)
    return Look(chosen, limits_of(run, chosen), changes.get("scale", automatic_scale(run)), view)


@pytest.mark.parametrize(
    ("field", "view"),
    [("status", "contact"), ("friction_traction", "contact"), ("displacement", "iso"), ("displacement", "front")],
)
def test_nothing_is_cut_off(run, field, view):
    """The outermost pixels are empty, those next to them are not on any side: the body fills the picture."""
    shot = shoot(run.steps[0], look(run, field, view), (600, 450))
    seen = shot.pixels[:, :, 3] > 0
    height, width = seen.shape
    assert not (seen[0].any() or seen[-1].any() or seen[:, 0].any() or seen[:, -1].any())
    rows, columns = np.flatnonzero(seen.any(axis=1)), np.flatnonzero(seen.any(axis=0))
    if field != "friction_traction":  # whose arrows may end before the room that is kept for them
        assert rows[0] <= 0.03 * height + 2 and rows[-1] >= 0.97 * height - 3
        assert columns[0] <= 0.03 * width + 2 and columns[-1] >= 0.97 * width - 3


@pytest.mark.parametrize("field", ["friction_traction", "slip"])
def test_arrows_do_not_hide_the_field(run, field, monkeypatch):
    chosen = look(run, field)
    camera = camera_of(run.steps, chosen, (900, 600))
    whole = shoot(run.steps[0], chosen, camera=camera).pixels.astype(int)
    monkeypatch.setattr(scene, "_arrows", lambda *_: None)
    bare = shoot(run.steps[0], chosen, camera=camera).pixels.astype(int)
    zones = shoot(run.steps[0], look(run, "status"), camera=camera).pixels.astype(int)
    grey = np.ptp(zones[:, :, :3], axis=2) < 25
    face = (zones[:, :, 3] > 0) & ~grey
    hidden = (np.abs(whole - bare).max(axis=2) > 40)[face].mean()
    assert 0.002 < hidden < 0.02


def test_the_picture_shows_pressure_and_zones(run):
    path = picture.draw(run.directory)
    image = pixels(path)
    above, below = np.split(image, [len(image) // 2])
    assert all(has_colour(below, colour, 3000) for _, colour in list(ZONES.values())[:3])
    assert has_colour(above, "#440154", 3000) and not has_colour(above, dict(ZONES.values())["slip"], 0)
    path.unlink()


def solved(directory, lengths, cells, traction):
    """The run of a steel plate, held on its left, with contact below, and loaded above."""
    contact, load = Contact("bottom", 0.3), Traction("top", (0.0, 0.0, traction))
    problem = ContactProblem(box(lengths, cells), Material(2e11, 0.3), [Clamp("left")], contact, [load])
    output.write(problem.solve(), directory)
    return read_run(directory)


@pytest.mark.parametrize(
    ("lengths", "cells", "wide"), [((3.0, 1.0, 1.0), (6, 2, 2), True), ((1, 1, 1), (2, 2, 2), False)]
)
def test_arrangement_of_the_two_views(tmp_path, lengths, cells, wide):
    """Without contact there is a picture as well."""
    run = solved(tmp_path, lengths, cells, 1e6)
    assert not run.steps[0].grid("contact").fields["pressure"].any()
    width, height = Image.open(picture.draw(tmp_path)).size
    assert (width < height) == wide


def test_a_thin_body_is_not_turned_inside_out(tmp_path):
    """At the scale that shows displacements as a twentieth of the plate, its two faces would be exchanged."""
    run = solved(tmp_path, (1.0, 1.0, 0.01), (6, 6, 1), -4e7)
    body, scale = run.steps[0].grid("solution"), automatic_scale(run)
    height = (body.points + scale * body.fields["displacement"])[:, 2]
    top = body.points[:, 2] > 0.005
    assert height[top].min() > height[~top].max()
    assert scale * np.abs(body.fields["displacement"]).max() > 1e-3  # and it is still visible


@pytest.mark.parametrize("limits", [(0.0, 189.3e6), (0.0, 7.77e-7), (-96.62e3, 96.62e3), (0.0, 1.0), (0.0, 33.0)])
def test_ticks_are_round(limits):
    figure = Figure()
    colour_bar(figure, named("pressure"), Bar(*limits, *limits), (0.2, 0.1, 0.6, 0.03))
    ticks = [tick for tick in figure.axes[0].get_xticks()]
    low, high = figure.axes[0].get_xlim()
    assert 3 <= sum(low <= tick <= high for tick in ticks) <= 9
    step = np.diff(ticks)[0]
    assert np.allclose(np.diff(ticks), step) and np.allclose(np.array(ticks) / step, np.round(np.array(ticks) / step))
    assert min(abs(np.log10(step / nice) % 1.0 - whole) for nice in (1, 2, 5) for whole in (0, 1)) < 1e-9


def test_legend_counts_nodes_in_words():
    figure = Figure()
    legend(figure, {"open": 12, "stick": 0, "slip": 1, "no contact point": 0}, (0.5, 0.5))
    texts = [text.get_text() for text in figure.legends[0].get_texts()]
    assert texts == ["open: 12 nodes", "stick: 0 nodes", "slip: 1 node"]


# --- the process that draws --------------------------------------------------------------------------------


def test_the_drawing_process_ends_with_its_input():
    """As when the run that started it is killed: its standard input ends."""
    assert DrawingProcess("overview").finish("", seconds=120.0) == (0, "")


def test_the_drawing_process_can_be_stopped():
    process = DrawingProcess("overview")
    process.stop()
    process.stop()
    assert process._process.returncode == -9
    code, said = process.finish("[]")
    assert code != 0 and said


@pytest.fixture(autouse=True)
def _small(monkeypatch):
    """The body in pictures has fewer pixels than usual."""
    monkeypatch.setattr(picture, "SHOT", (450, 330))


def pixels(path):
    return np.asarray(Image.open(path).convert("RGB")).astype(int)


def has_colour(image, colour, least):
    wanted = [int(colour[k : k + 2], 16) for k in (1, 3, 5)]
    return np.count_nonzero(np.abs(image - wanted).max(axis=2) < 4) > least


def test_plot_of_zones_and_of_a_film(block, history, tmp_path):
    plot(block, "status", None, None, tmp_path / "z.png", None)
    image = pixels(tmp_path / "z.png")
    for _, colour in ZONES.values():
        assert has_colour(image, colour, 500), colour
    assert "6 steps" in plot(history, "friction_work", None, None, tmp_path / "h.gif", None)
    with Image.open(tmp_path / "h.gif") as film:
        assert film.n_frames == 6
        frames = [np.asarray((film.seek(k), film.convert("RGB"))[1]).astype(int) for k in range(6)]
    assert all(np.abs(a - b).max() > 30 for a, b in itertools.pairwise(frames))  # it moves


def test_largest_value_on_a_picture_is_of_its_step(history, tmp_path, monkeypatch):
    """And so are the colours: those of a film span all steps."""
    made = []
    monkeypatch.setattr(picture, "sheet", lambda *given: made.append(sheet(*given)) or made[-1])
    found, largest = [], []
    for step in (1, 3):
        plot(history, "slip", None, None, tmp_path / "slip.png", step)
        (text,) = [text.get_text() for text in made[-1].texts if text.get_text().startswith("max ")]
        values = np.linalg.norm(read_grid(history / "steps" / f"{step:04d}" / "contact.xdmf").fields["slip"], axis=1)
        found.append(float(text.removeprefix("max ")) / (1e6 * values.max()))
        largest.append(values.max())
    assert found == pytest.approx([1.0, 1.0], rel=1e-3)
    assert [float(figure.axes[-1].get_xlim()[1]) / (1e6 * top) for figure, top in zip(made, largest, strict=True)] == (
        pytest.approx([1.0, 1.0], rel=1e-6)
    )
    assert any("time 3\u202fs" in text.get_text() for text in made[-1].texts)


def test_scale_and_view_change_the_picture(block, tmp_path):
    images = []
    for scale, view in ((None, None), (0.0, None), (None, "bottom")):
        plot(block, "gap", scale, view, tmp_path / "gap.png", None)
        images.append(pixels(tmp_path / "gap.png"))
    assert images[0].shape == images[1].shape == images[2].shape == (960, 1320, 3)
    assert np.abs(images[0] - images[1]).max() > 50 < np.abs(images[0] - images[2]).max()


def test_the_contact_face_moves_with_the_body(block):
    step = read_run(block).steps[0]
    body, contact = step.grid("solution"), step.grid("contact")
    order = [int(np.argmin(np.linalg.norm(body.points - point, axis=1))) for point in contact.points]
    plotter = plotter_for((300, 200))
    paint(plotter, step, Look(named("gap"), Limits(0.0, 1e-3), 1000.0, "bottom"))
    meshes = [actor.mapper.dataset for actor in plotter.actors.values()]
    face = next(mesh for mesh in meshes if "shown" in mesh.point_data)
    moved = contact.points + 1000.0 * body.fields["displacement"][order]
    assert np.allclose(face.points, moved, atol=1e-5) and np.abs(moved - contact.points).max() > 0.3
    assert np.allclose(face["shown"], contact.fields["gap"] * 1e3)  # in mm
    plotter.close()


def test_plot_without_a_display_writes_a_file(block, failed, tmp_path, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    done = run_coulomb("plot", failed, "--field", "displacement_z", cwd=tmp_path, process=True)
    assert "plot.png" in done.stdout
    assert has_colour(pixels(tmp_path / "plot.png"), "#b3261e", 100)  # NOT CERTIFIED, in red
    plot(block, "von_mises_stress", 100.0, "iso", tmp_path / "p.pdf", None)
    assert (tmp_path / "p.pdf").read_bytes().startswith(b"%PDF")


@pytest.mark.parametrize(
    ("field", "view", "save", "step", "message"),
    [
        ("presure", None, "x.png", None, r"no field 'presure'; did you mean pressure\? \(known: pressure, friction_t"),
        ("gap", "behind", "x.png", None, r"no view 'behind' \(known: contact, iso"),
        ("gap", None, "x.tiff", None, "x.tiff: must end in .png, .jpg, .pdf, .svg for a picture"),
        ("gap", None, "x.gif", None, "holds a single run: a film needs a load history"),
        ("gap", None, "x.png", 2, "there is no step 2; there are 1"),
    ],
)
def test_unknown_fields_and_steps_are_refused(block, tmp_path, field, view, save, step, message):
    with pytest.raises(ValueError, match=message):
        plot(block, field, None, view, tmp_path / save, step)
    assert not list(tmp_path.iterdir())


def test_mp4(history, tmp_path):
    imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg", reason="the package that writes MP4 is not installed")
    plot(history, "pressure", None, None, tmp_path / "h.mp4", None)
    frames, seconds = imageio_ffmpeg.count_frames_and_secs(str(tmp_path / "h.mp4"))
    assert frames == 6 and seconds == pytest.approx(6 * 0.15, rel=0.1)


def test_mp4_without_its_package(history, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(ValueError, match=r"pip install imageio-ffmpeg\); or save a .gif"):
        plot(history, "pressure", None, None, tmp_path / "h.mp4", None)
