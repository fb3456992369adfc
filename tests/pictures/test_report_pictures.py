"""Pictures and films of a run (`coulomb plot`): what they show, and what is refused."""

import itertools
import sys

import numpy as np
import pytest
from check_runs import read_grid
from conftest import run_coulomb
from PIL import Image

from coulomb.pictures.plotting import ZONES
from coulomb.pictures.report import picture
from coulomb.pictures.report.files import read_run
from coulomb.pictures.report.limits import Limits
from coulomb.pictures.report.picture import plot
from coulomb.pictures.report.scene import Look, paint, plotter_for
from coulomb.pictures.report.sheet import sheet
from coulomb.pictures.report.shown_fields import named


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
    assert "6 steps" in plot(history, "pressure", None, None, tmp_path / "h.gif", None)
    with Image.open(tmp_path / "h.gif") as film:
        assert film.n_frames == 6
        frames = [np.asarray((film.seek(k), film.convert("RGB"))[1]).astype(int) for k in range(6)]
    assert all(np.abs(a - b).max() > 30 for a, b in itertools.pairwise(frames))  # it moves


def test_largest_value_on_a_picture_is_of_its_step(history, tmp_path, monkeypatch):
    """Colours span all steps of a history; the figure beside the bar is that of the step."""
    made = []
    monkeypatch.setattr(picture, "sheet", lambda *given: made.append(sheet(*given)) or made[-1])
    found = []
    for step in (1, 3):
        plot(history, "slip", None, None, tmp_path / "slip.png", step)
        (text,) = [text.get_text() for text in made[-1].texts if text.get_text().startswith("max ")]
        values = np.linalg.norm(read_grid(history / "steps" / f"{step:04d}" / "contact.xdmf").fields["slip"], axis=1)
        found.append(float(text.removeprefix("max ")) / (1e3 * values.max()))
    assert found == pytest.approx([1.0, 1.0], rel=1e-3)  # in mm, the unit of the whole history
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
    assert done.returncode == 0 and "plot.png" in done.stdout
    assert has_colour(pixels(tmp_path / "plot.png"), "#b3261e", 100)  # NOT CERTIFIED, in red
    plot(block, "von_mises_stress", 100.0, "iso", tmp_path / "p.pdf", None)
    assert (tmp_path / "p.pdf").read_bytes().startswith(b"%PDF")


@pytest.mark.parametrize(
    ("field", "view", "save", "step", "message"),
    [
        (
            "presure",
            None,
            "x.png",
            None,
            r"no field 'presure'; did you mean pressure\? \(known: pressure, friction_traction",
        ),
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


def test_plot_of_a_missing_run_exits_2(block, tmp_path):
    done = run_coulomb("plot", block, "--field", "presure", "--save", tmp_path / "x.png")
    assert done.returncode == 2 and done.stderr.startswith("error: there is no field 'presure'; did you mean pressure?")
    assert "Traceback" not in done.stderr and not list(tmp_path.iterdir())


def test_mp4(history, tmp_path):
    imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg", reason="the package that writes MP4 is not installed")
    plot(history, "pressure", None, None, tmp_path / "h.mp4", None)
    frames, seconds = imageio_ffmpeg.count_frames_and_secs(str(tmp_path / "h.mp4"))
    assert frames == 6 and seconds == pytest.approx(6 * 0.15, rel=0.1)


def test_mp4_without_its_package(history, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(ValueError, match=r"pip install imageio-ffmpeg\); or save a .gif"):
        plot(history, "pressure", None, None, tmp_path / "h.mp4", None)
