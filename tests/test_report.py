"""The report of a run and pictures of it: what they say, that they need nothing else, and that a browser draws them."""

import base64
import html
import itertools
import json
import re
import shutil
import subprocess
import sys
from dataclasses import replace

import h5py
import numpy as np
import pytest
from conftest import ROOT, run_coulomb, solved_block
from PIL import Image

from coulomb import apart, output
from coulomb.plotting import ZONES, Grid, read_grid
from coulomb.report import charts, page
from coulomb.report.fields import named
from coulomb.report.files import read_run
from coulomb.report.picture import plot
from coulomb.report.scene import Look, paint, plotter_for
from coulomb.report.surface_view import surface_view, thinned_surface
from coulomb.report.units import number, quantity, scale_of, vector

BLOCK, HISTORY = ROOT / "demos" / "block.toml", ROOT / "demos" / "history.toml"
SMALL = ("--set", "mesh.cells=[12,4,4]", "--set", "output.picture=false")
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium to open the page in")


@pytest.fixture(scope="module")
def block(tmp_path_factory):
    directory = tmp_path_factory.mktemp("runs") / "block"
    done = run_coulomb("run", BLOCK, *SMALL, "--report", "--output", directory)
    assert done.returncode == 0, done.stderr
    return directory


@pytest.fixture(scope="module")
def failed(tmp_path_factory):
    directory = tmp_path_factory.mktemp("runs") / "failed"
    solver = ("--set", "solver={method='fixed-point', max_outer=3}")
    done = run_coulomb("run", BLOCK, *SMALL, *solver, "--set", "output.report=true", "--output", directory)
    assert done.returncode == 1
    return directory


@pytest.fixture(scope="module")
def history(tmp_path_factory):
    directory = tmp_path_factory.mktemp("runs") / "history"
    small = ("--set", "mesh.cells=[4,4,2]", "--set", "history={end=6.0, steps=6}", "--set", "output.picture=false")
    done = run_coulomb("run", HISTORY, *small, "--report", "--output", directory)
    assert done.returncode == 0, done.stderr
    return directory


def page_of(directory):
    return (directory / "report.html").read_text(encoding="utf-8")


def words_of(directory):
    """The text of the page, as it is read."""
    text = re.sub(r"<(style|script|svg).*?</\1>", " ", page_of(directory), flags=re.DOTALL)
    return re.sub(r"\s+", " ", html.unescape(re.sub(r"<[^>]*>", " ", text))).replace("\u202f", " ")


def data_of(directory):
    found = re.search(r'id="view3d-data">(.*?)</script>', page_of(directory), flags=re.DOTALL)
    return json.loads(found.group(1))


def numbers(text, kind="<f4"):
    return np.frombuffer(base64.b64decode(text), dtype=kind)


# --- the page -------------------------------------------------------------------------------------------------------


def test_page_needs_nothing_else(block, failed, history):
    for directory in (block, failed, history):
        text = page_of(directory)
        assert "://" not in text  # no address of anything, not even of a namespace
        assert not re.findall(r'(?:src|href|action)="(?!data:|#)[^"]*"', text) and "@import" not in text
        assert "default-src 'none'" in text  # the browser would not load it either
        assert str(directory.parent) not in text and str(ROOT) not in text  # nor the places of this machine
        assert 50_000 < len(text) < 3_000_000


def test_page_tells_what_was_solved(block):
    words, told = words_of(block), json.loads((block / "summary.json").read_text())
    assert "Certified All 11 conditions hold" in words and "NOT CERTIFIED" not in words
    for part in (
        "3 m × 1 m × 1 m",
        "192 hexahedra (12 × 4 × 4), 325 nodes",
        "Young's modulus 211.9 GPa, Poisson's ratio 0.277",
        "traction on top (0, 10, −40) MPa",
        "Coulomb friction 0.3",
        f"normal force {told['force_on_body']['normal'] / 1e6:.6g} MN",
        f"greatest pressure {told['maximum']['contact_pressure'] / 1e6:.4g} MPa",
        f"products by A {told['iterations']['products']}",
        f"PETSc {told['versions']['PETSc']}",
        "friction cone friction within its bound 0 1×10⁻⁶ ✓ ok",
    ):
        assert part in words, part
    assert page_of(block).count("<figure>") == 6 and page_of(block).count("data:image/png") == 6


def test_a_run_that_failed_is_red(failed):
    text, words = page_of(failed), words_of(failed)
    told = json.loads((failed / "summary.json").read_text())
    assert '<header class="failed">' in text and "<title>failed: NOT CERTIFIED</title>" in text
    assert "are not a solution" in words and "Solver: max iterations" in words
    assert "Successive Tresca ended with a Coulomb residual of" in words  # what the solver said
    bad = [name for name, check in told["certificate"].items() if isinstance(check, dict) and not check["passed"]]
    assert f"{len(bad)} of 11 conditions fail" in words and words.count("✗ failed") == len(bad) > 3
    assert "Tresca problems 3" in words


def test_page_of_a_history(history):
    text, words = page_of(history), words_of(history)
    assert "6 load steps to time 6" in words and "All 6 steps" in words
    assert "components x held moved by (2, 0, 0) mm, times 0 at 1, 1 at 2, −1 at 4, 1 at 6" in words
    assert text.count('<svg role="img"') == 5  # force, hysteresis, surface, effort, convergence
    assert words.count("passed") == 6
    data = data_of(history)
    assert [step["label"] for step in data["steps"]] == [f"time {t}" for t in range(1, 7)]
    row = (history / "history.csv").read_text().splitlines()[3].split(",")
    greatest = float(row[(history / "history.csv").read_text().splitlines()[0].split(",").index("greatest_pressure")])
    shown = numbers(data["steps"][2]["values"]["pressure"]) * data["fields"][0]["factor"]
    assert shown.max() == pytest.approx(greatest, rel=1e-6)


def test_force_is_drawn_against_what_moves_most(history):
    run = read_run(history)
    assert "against prescribed displacement" in charts.force_displacement(run)
    moved = replace(run, case={"contact": {"motion": [[0.0, 0.0, 0.0, 0.0], [6.0, 0.1, 0.0, 0.0]]}})
    assert "against displacement of the foundation" in charts.force_displacement(moved)
    still = replace(run, steps=run.steps[-1:], rows=run.rows[-1:])
    assert charts.force_displacement(still) == ""


def test_a_history_that_did_not_end_says_so(history, tmp_path):
    shutil.copytree(history, tmp_path / "h")
    told = json.loads((tmp_path / "h" / "summary.json").read_text())
    told["last"]["step"]["pending"] = [8.0, 7.0]
    (tmp_path / "h" / "summary.json").write_text(json.dumps(told))
    done = run_coulomb("report", tmp_path / "h", "--save", tmp_path / "h.html")
    assert done.returncode == 0 and "h.html" in done.stdout
    (tmp_path / "h.html").replace(tmp_path / "h" / "report.html")
    assert "NOT CERTIFIED" in words_of(tmp_path / "h")
    assert "ended at time 6, before its end at 8" in words_of(tmp_path / "h")


def test_a_run_from_python_has_no_case(tmp_path):
    (tmp_path / "case.json").write_text("{}")  # of an earlier run: not of this one
    (tmp_path / "report.html").write_text("")
    output.write(solved_block(6), tmp_path, picture=False)
    assert not (tmp_path / "case.json").exists() and not (tmp_path / "report.html").exists()
    page.write(tmp_path, tmp_path / "report.html")
    assert "loads (20, 30, −120) MN in all" in words_of(tmp_path) and "49 nodes held" in words_of(tmp_path)


def test_data_of_the_view_are_those_of_the_files(block):
    data, contact = data_of(block), read_grid(block / "contact.xdmf")
    points = numbers(data["points"]).reshape(-1, 3)
    assert np.allclose(points, contact.points, atol=1e-6)
    corners = points[numbers(data["triangles"], "<u4").reshape(-1, 3)]
    areas = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    assert areas.sum() == pytest.approx(3.0, rel=1e-5)
    fields = {entry["name"]: entry for entry in data["fields"]}
    assert list(fields) == ["pressure", "friction_traction", "friction_use", "status", "slip", "gap"]
    assert fields["pressure"]["unit"] == "MPa" and fields["slip"]["unit"] == "µm"
    for name in fields:
        values = named(name).values(contact)
        shown = numbers(data["steps"][0]["values"][name]) * fields[name]["factor"]
        assert np.allclose(shown, values, rtol=1e-5, atol=1e-6 * np.abs(values).max()), name
    assert np.allclose(
        numbers(data["steps"][0]["arrows"]).reshape(-1, 3), contact.fields["friction_traction"], rtol=1e-5
    )
    assert len(numbers(data["outline"]["lines"], "<u4")) >= 2 * 4 * (12 + 4 + 4)  # twelve edges of the block


def test_nodes_may_be_in_another_order_in_every_step(history, tmp_path):
    """As after a resume on other ranks."""
    shutil.copytree(history, tmp_path / "h")
    before, _ = surface_view(read_run(tmp_path / "h"), 1.0)
    for name in ("contact", "solution"):
        path = tmp_path / "h" / "steps" / "0003" / f"{name}.h5"
        with h5py.File(path, "r+") as file:
            count = len(file["Mesh/mesh/geometry"])
            order = np.random.default_rng(11).permutation(count)
            cells = np.argsort(order)[file["Mesh/mesh/topology"][()]]
            file["Mesh/mesh/topology"][...] = cells
            file["Mesh/mesh/geometry"][...] = file["Mesh/mesh/geometry"][()][order]
            for group in file["Function"].values():
                for data in group.values():
                    if len(data) == count:
                        data[...] = data[()][order]
    after, _ = surface_view(read_run(tmp_path / "h"), 1.0)
    assert after["steps"] == before["steps"]


def test_a_large_surface_is_thinned():
    n = 60
    x, y = np.meshgrid(np.linspace(0, 2, n + 1), np.linspace(0, 1, n + 1), indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel(), 0 * x.ravel()])
    first = (np.arange(n)[:, None] * (n + 1) + np.arange(n)).ravel()
    grid = Grid("Quadrilateral", np.column_stack([first, first + n + 1, first + n + 2, first + 1]), points, {})
    nodes, cells = thinned_surface(grid, 500)
    assert 200 < len(nodes) <= 500 and len(set(nodes)) == len(nodes)
    assert cells.max() < len(nodes) and len(cells) > 150
    kept = points[nodes]
    assert np.ptp(kept, axis=0) == pytest.approx([2.0, 1.0, 0.0], abs=0.1)
    same, all_cells = thinned_surface(grid, 10_000)
    assert len(same) == len(points) and np.array_equal(all_cells, grid.cells)


def test_report_of_no_run_exits_2(tmp_path):
    done = run_coulomb("report", tmp_path)
    assert done.returncode == 2 and "holds no run: there is no summary.json" in done.stderr
    assert "Traceback" not in done.stderr
    (tmp_path / "summary.json").write_text("{}")
    done = run_coulomb("plot", tmp_path, "--save", tmp_path / "x.png")
    assert done.returncode == 2 and "not a summary of coulomb's" in done.stderr


def test_what_draws_starts_no_mpi(block):
    """Neither DOLFINx nor MPI is imported on the way."""
    command = [
        sys.executable,
        "-X",
        "importtime",
        apart.__file__,
        "coulomb.report",
        "page",
        block,
        block / "again.html",
    ]
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=True)
    assert " coulomb.report.page" in done.stderr and "jinja2" in done.stderr
    for name in ("dolfinx", "mpi4py", "petsc4py", "coulomb.problem"):
        assert not re.search(rf"\| +{name}\b", done.stderr), name
    (block / "again.html").unlink()


# --- in a browser ---------------------------------------------------------------------------------------------------

PROBE = """<script>
addEventListener("load", () => setTimeout(() => {
  const canvas = document.querySelector("#view3d canvas");
  const part = (name) => document.querySelector(`[data-part="${name}"]`);
  const count = (hex) => {
    const copy = document.createElement("canvas");
    [copy.width, copy.height] = [canvas.width, canvas.height];
    const pen = copy.getContext("2d");
    pen.drawImage(canvas, 0, 0);
    const pixels = pen.getImageData(0, 0, copy.width, copy.height).data;
    const wanted = hex && [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16));
    let found = 0;
    for (let k = 0; k < pixels.length; k += 4)
      if (pixels[k + 3] > 0 && (!wanted || wanted.every((v, c) => Math.abs(v - pixels[k + c]) < 4))) found++;
    return found;
  };
  const tell = (name, value) => document.body.setAttribute("data-" + name, value);
  tell("by", canvas.dataset.by);
  tell("drawn", canvas.dataset.drawn);
  const box = canvas.getBoundingClientRect();
  canvas.setPointerCapture = () => {};
  const at = (kind, x, y) =>
    canvas.dispatchEvent(new PointerEvent(kind, { pointerId: 1, clientX: box.left + x, clientY: box.top + y }));
  const drag = (x, y) => (at("pointerdown", 100, 100), at("pointermove", 100 + x, 100 + y), at("pointerup", 100, 100));
  tell("arrowsInFront", count("#141414"));
  drag(314, 0);
  tell("arrowsBehind", count("#141414"));
  part("reset").click();
  part("arrows").click();
  const choose = (k) => ((part("field").selectedIndex = k), part("field").dispatchEvent(new Event("change")));
  tell("blue0", count("#2166ac") + count("#f4a582"));
  choose(3);
  ZONES.forEach((colour, k) => tell("zone" + k, count(colour)));
  tell("legend", part("legend").textContent);
  canvas.dispatchEvent(new WheelEvent("wheel", { deltaY: 600, cancelable: true }));
  tell("far", count());
  part("reset").click();
  tell("home", count());
  drag(0, 157);
  tell("turned", count("#f4a582"));
  part("reset").click();
  let tip = "";
  for (let x = 0; x < box.width && !tip; x += 8)
    for (let y = 0; y < box.height && !tip; y += 8) {
      at("pointermove", x, y);
      tip = part("tip").hidden ? "" : part("tip").textContent;
    }
  tell("tip", tip);
}, 300));
</script>"""


def open_page(text, tmp_path, script=PROBE):
    """What Chromium makes of a page: data that the probe left on its body, console messages, and a screenshot."""
    colours = json.dumps([colour for _, colour in ZONES.values()])
    copy = tmp_path / "probe.html"
    copy.write_text(text + script.replace("ZONES", colours), encoding="utf-8")
    flags = ["--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    flags += ["--enable-logging=stderr", "--virtual-time-budget=10000", "--window-size=1000,900", "--hide-scrollbars"]
    flags += [f"--user-data-dir={tmp_path / 'profile'}", "--dump-dom", f"file://{copy}"]
    done = subprocess.run([CHROMIUM, *flags], capture_output=True, text=True, timeout=180, check=True)
    body = re.search(r"<body([^>]*)>", done.stdout).group(1)
    console = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    return dict(re.findall(r'data-([\w-]+)="([^"]*)"', body)), console


@needs_chromium
def test_the_view_draws(block, tmp_path):
    told, console = open_page(page_of(block), tmp_path)
    assert not console
    assert told["by"] == "webgl" and int(told["drawn"]) > 50_000
    assert int(told["arrowsinfront"]) > 500 > 50 > int(told["arrowsbehind"])  # the surface hides them from behind
    counts = [int(told[f"zone{code}"]) for code in range(4)]
    assert int(told["blue0"]) < 100 < min(counts)  # zones show only when they are asked for, each in its colour
    assert counts[2] > 5 * max(counts[0], counts[1], counts[3])  # most of the surface slips
    assert told["legend"] == "openstickslipheld"
    assert int(told["far"]) < 0.3 * int(told["home"])  # the wheel moves away
    assert int(told["turned"]) < 0.6 * counts[2]  # by a quarter turn the surface is seen from its edge
    assert re.fullmatch(r"(open|stick|slip|held) at \(.*\) m", told["tip"])


@needs_chromium
def test_the_view_draws_without_webgl(history, tmp_path):
    text = page_of(history)
    assert '"flat": false' in text
    told, console = open_page(text.replace('"flat": false', '"flat": true'), tmp_path)
    assert not console
    assert told["by"] == "canvas" and int(told["drawn"]) > 50_000
    assert int(told["zone2"]) > 10_000 and int(told["far"]) < 0.3 * int(told["home"])


@needs_chromium
def test_console_of_a_broken_page_is_seen(block, tmp_path):
    """The test above can fail."""
    _, console = open_page(page_of(block).replace("const told = JSON", "const told = JASON"), tmp_path)
    assert any("JASON" in line for line in console)


# --- pictures -------------------------------------------------------------------------------------------------------


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
    paint(plotter, step, Look(named("gap"), (0.0, 1e-3), 1000.0, "bottom"))
    meshes = [actor.mapper.dataset for actor in plotter.actors.values()]
    face = next(mesh for mesh in meshes if "shown" in mesh.point_data)
    moved = contact.points + 1000.0 * body.fields["displacement"][order]
    assert np.allclose(face.points, moved, atol=1e-5) and np.abs(moved - contact.points).max() > 0.3
    assert np.allclose(face["shown"], contact.fields["gap"] * 1e3)  # in mm
    plotter.close()


def test_plot_without_a_display_writes_a_file(block, failed, tmp_path, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    done = run_coulomb("plot", failed, "--field", "displacement_z", cwd=tmp_path)
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
def test_what_is_not_there_is_refused(block, tmp_path, field, view, save, step, message):
    with pytest.raises(ValueError, match=message):
        plot(block, field, None, view, tmp_path / save, step)
    assert not list(tmp_path.iterdir())


def test_plot_of_what_is_not_there_exits_2(block, tmp_path):
    done = run_coulomb("plot", block, "--field", "presure", "--save", tmp_path / "x.png")
    assert done.returncode == 2 and done.stderr.startswith("error: there is no field 'presure'; did you mean pressure?")
    assert "Traceback" not in done.stderr and not list(tmp_path.iterdir())


def test_mp4(history, tmp_path):
    imageio_ffmpeg = pytest.importorskip("imageio_ffmpeg", reason="the package that writes MP4 is not installed")
    plot(history, "pressure", None, None, tmp_path / "h.mp4", None)
    frames, seconds = imageio_ffmpeg.count_frames_and_secs(str(tmp_path / "h.mp4"))
    assert frames == 6 and seconds == pytest.approx(6 * 0.15, rel=0.1)


def test_mp4_without_its_package_says_what_to_install(history, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(ValueError, match=r"pip install imageio-ffmpeg\); or save a .gif"):
        plot(history, "pressure", None, None, tmp_path / "h.mp4", None)


# --- numbers in words -------------------------------------------------------------------------------------------------


def test_quantities():
    assert quantity(1.5125e8, "Pa") == "151.2\u202fMPa" and quantity(2.5e-5, "m") == "25\u202fµm"
    assert quantity(-1234.5, "N") == "−1.234\u202fkN" and quantity(0.0, "J") == "0\u202fJ"
    assert quantity(None, "m") == "–" and quantity(float("nan")) == "–"
    assert quantity(999_960.0, "Pa") == "1\u202fMPa"  # not 1000 kPa
    assert quantity(0.0231, "m²") == "231\u202fcm²" and quantity(7200.0, "s") == "7200\u202fs"
    assert number(3.2e-15, 2) == "3.2×10⁻¹⁵" and number(980.3, 2) == "980" and number(-0.5) == "−0.5"
    assert vector([1e7, -2e-3, -4e7], "Pa") == "(10, 0, −40)\u202fMPa"
    assert scale_of(0.3, "") == (1.0, "")


def test_named_fields():
    assert named("slip").component is None and named("slip_y").component == 1
    assert named("slip_y").limits(np.array([-2.0, 1.0])) == (-2.0, 2.0)  # zero is in the middle of the colours
    assert named("pressure").limits(np.array([1.0, 3.0])) == (0.0, 3.0)
    assert named("friction_use").limits(np.array([0.2, 0.4])) == (0.0, 1.0)
    with pytest.raises(ValueError, match="did you mean gap"):
        named("gapp")
