"""The view of the contact surface in the report: its data, and its behaviour in a browser."""

import re
import shutil

import h5py
import numpy as np
import pytest
from check_runs import read_grid
from report_pages import data_of, needs_chromium, numbers, open_page, page_of, refined

from coulomb.pictures.report.fields import named
from coulomb.pictures.report.files import read_run
from coulomb.pictures.report.surface_view import surface_view


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


# --- in a browser: a page is opened once for several tests ----------------------------------------------------------

BETWEEN = """
  canvas.closest("details").open = true;
  canvas.blur();
  choose(0);
  slide("scale", part("scale").defaultScale ??= part("scale").value);
  slide("step", part("step").max);
  reset();
"""
"""Before each script: the view as it was at first."""


def seen(text, folder, *scripts):
    """What the scripts reported, one after the other on the same page, without a message on the console."""
    view, console = open_page(text, folder, "".join(f"{{{BETWEEN}{script}}}" for script in scripts))
    assert not console
    return view


@pytest.fixture(scope="module")
def block_seen(block, tmp_path_factory):
    return seen(page_of(block), tmp_path_factory.mktemp("block"), SHOWS, AXES, FRAME)


@pytest.fixture(scope="module")
def history_seen(history, tmp_path_factory):
    return seen(page_of(history), tmp_path_factory.mktemp("history"), WHEEL, TIP, PHONE, FRAME)


@needs_chromium
def test_the_view_draws(block_seen):
    view = block_seen
    assert int(view["drawn"]) > 50_000
    assert int(view["arrowsinfront"]) > 500 > 50 > int(view["arrowsbehind"])  # the surface hides them from behind
    counts = [int(view[f"zone{code}"]) for code in range(4)]
    assert int(view["blue0"]) < 100 < min(counts)  # zones are shown on request only, each in its colour
    assert counts[2] > 5 * max(counts[0], counts[1], counts[3])  # most of the surface slips
    assert view["legend"] == "openstickslipno contact point"
    assert int(view["turned"]) < 0.6 * counts[2]  # after a quarter turn the surface is seen from its edge
    assert re.fullmatch(r"(open|stick|slip|no contact point) at \(.*\) m", view["tip"])


SHOWS = """
  report("drawn", count());
  report("arrowsInFront", count("#141414"));
  drag(314, 0);
  report("arrowsBehind", count("#141414"));
  reset();
  part("arrows").click();
  report("blue0", count(ZONES[1]) + count(ZONES[2]));
  choose(3);
  ZONES.forEach((colour, k) => report("zone" + k, count(colour)));
  report("legend", part("legend").textContent);
  drag(0, 157);
  report("turned", count(ZONES[2]));
  reset();
  let tip = "";
  for (let x = 0; x < box.width && !tip; x += 8)
    for (let y = 0; y < box.height && !tip; y += 8) {
      at("pointermove", x, y);
      tip = part("tip").hidden ? "" : part("tip").textContent;
    }
  report("tip", tip);
  part("arrows").click();
"""


@needs_chromium
def test_the_wheel_scrolls_the_page_unless_the_view_has_focus(history_seen):
    view = history_seen
    assert view["scrolled"] == "true" and view["left"] == view["home"]  # the page scrolls, the view stays
    assert view["scrolledwithfocus"] == "false" and int(view["far"]) < 0.3 * int(view["home"])
    assert view["scrolledafterescape"] == "true" and view["after"] == view["far"]
    assert view["finger"] == "pan-y" and view["fingerwithfocus"] == "none"  # a finger scrolls the page, too


WHEEL = """
  report("home", count());
  report("scrolled", wheel(600));
  report("left", count());
  report("finger", getComputedStyle(canvas).touchAction);
  canvas.focus();
  report("fingerWithFocus", getComputedStyle(canvas).touchAction);
  report("scrolledWithFocus", wheel(600));
  report("far", count());
  canvas.dispatchEvent(new KeyboardEvent("keydown", { key: "Escape", bubbles: true, cancelable: true }));
  report("scrolledAfterEscape", wheel(600));
  report("after", count());
"""


@needs_chromium
@pytest.mark.parametrize("run", ["block", "history"])
def test_the_body_stays_in_the_frame(run, request):
    """At every rotation and step and the largest scale of the displacement, nothing reaches the border."""
    view = request.getfixturevalue(f"{run}_seen")
    assert int(view["states"]) == (8 if run == "block" else 16) and view["atborder"] == "0"
    assert float(view["smallest"]) > 0.6  # and it fills the frame, in one direction at least
    assert float(view["shifted"]) > 100.0 and view["movedout"] == "false"


FRAME = """
  let [states, atBorder, smallest] = [0, 0, 1];
  const look = () => {
    const [low, high] = [[Infinity, Infinity], [-Infinity, -Infinity]];
    scan((x, y) => {
      [low[0], low[1]] = [Math.min(low[0], x), Math.min(low[1], y)];
      [high[0], high[1]] = [Math.max(high[0], x), Math.max(high[1], y)];
    });
    atBorder += low[0] < 2 || low[1] < 2 || high[0] > canvas.width - 3 || high[1] > canvas.height - 3;
    smallest = Math.min(smallest, Math.max((high[0] - low[0]) / canvas.width, (high[1] - low[1]) / canvas.height));
    states++;
    return low[0];
  };
  for (const scale of [part("scale").value, part("scale").max])
    for (const step of new Set(["0", part("step").max])) {
      slide("scale", scale);
      slide("step", step);
      for (let turn = 0; turn < 4; turn++) {
        look();
        drag(turn % 2 ? 40 : 70, turn % 3 ? 60 : 25);
      }
    }
  report("states", states);
  report("atBorder", atBorder);
  report("smallest", smallest);
  reset();
  const before = look();
  drag(-3000, 0, { shiftKey: true });
  report("movedOut", look() !== before);  // as large as the frame, it cannot be moved out of it
  canvas.focus();
  wheel(-900);
  const middle = count();
  drag(-3000, 0, { shiftKey: true });
  report("shifted", Math.abs(count() - middle));
  canvas.blur();
"""


@needs_chromium
def test_the_tip_follows_its_node(history, history_seen):
    """It shows the value at the node when the step changes, moves with the node, and closes when the mouse leaves."""
    data, view = data_of(history), history_seen
    assert view["distance"] == view["distanceafter"] == "0,0,0"  # the ring is on the node, before and after
    assert view["first"] != view["last"] and view["place"] == view["placelast"]
    place = data["length"]["factor"] * np.array([float(v) for v in view["place"].split(", ")])
    node = int(np.argmin(np.linalg.norm(numbers(data["points"]).reshape(-1, 3) - place, axis=1)))
    for name, step in (("first", 0), ("last", -1)):
        value = numbers(data["steps"][step]["values"]["pressure"])[node]
        assert float(view[name].split()[0]) == pytest.approx(float(value), rel=1e-3)
    assert view["moved"] == "true" and view["gone"] == "true" and view["whiledragging"] == "true"
    assert view["tapped"] == "false" and view["withstep"] == view["found"] == view["undermouse"] == "true"


TIP = """
  const near = () =>  // the node whose tip is shown, from the text of its place
    part("tip").textContent.match(/at \\((.*)\\)/)[1];
  const ring = () => {
    const [spot, frame] = [part("spot").getBoundingClientRect(), canvas.getBoundingClientRect()];
    return [spot.left + spot.width / 2 - frame.left, spot.top + spot.height / 2 - frame.top];
  };
  slide("step", 0);
  for (let x = box.width / 2; x < box.width && part("tip").hidden; x += 6)
    for (let y = 0; y < box.height && part("tip").hidden; y += 6) at("pointermove", x, y);
  const [x, y] = ring();
  // a tap keeps the tip, at whatever step
  at("pointerdown", x, y, { pointerType: "touch" });
  at("pointerup", x, y, { pointerType: "touch" });
  at("pointerleave", x, y, { pointerType: "touch" });
  report("tapped", part("tip").hidden);
  report("first", part("tip").textContent);
  report("place", near());
  const offset = () => {  // the ring is where a pointer finds the same node again
    const [a, b] = ring();
    const found = near();
    at("pointermove", a, b);
    const again = [near() === found ? 0 : 1, Math.round(ring()[0] - a), Math.round(ring()[1] - b)];
    at("pointerdown", a, b, { pointerType: "touch" });
    at("pointerup", a, b, { pointerType: "touch" });
    return again.join();
  };
  report("distance", offset());
  const atFirst = ring();
  slide("step", part("step").max);
  report("withStep", Math.hypot(ring()[0] - atFirst[0], ring()[1] - atFirst[1]) > 3);
  report("last", part("tip").textContent);
  report("placeLast", near());
  report("distanceAfter", offset());
  const before = ring();
  canvas.focus();
  wheel(-300, box.width / 4, box.height / 4);
  report("moved", Math.hypot(ring()[0] - before[0], ring()[1] - before[1]) > 5);
  at("pointerdown", 100, 100);
  at("pointermove", 140, 100);
  report("whileDragging", part("tip").hidden);
  at("pointerup", 140, 100);
  reset();
  for (let y = 0; y < box.height && part("tip").hidden; y += 6) at("pointermove", x, y);
  report("found", !part("tip").hidden);
  const mouse = ring();
  wheel(400);  // the node goes from under the mouse: the tip is of another one, or of none
  const off = Math.hypot(ring()[0] - mouse[0], ring()[1] - mouse[1]);
  report("underMouse", part("tip").hidden || off < 15);
  at("pointerleave", x, y, { pointerType: "mouse" });
  report("gone", part("tip").hidden);
"""


@needs_chromium
def test_axes_turn_with_the_body(block, block_seen):
    """The ends of the three axes in the corner are the directions in which points of the body lie."""
    view, data = block_seen, data_of(block)
    assert view["names"] == "xyz"
    for when in ("before", "after"):
        ends = np.array([[float(v) for v in view[f"{when}-{axis}"].split(",")] for axis in "xyz"])
        # rows x, y, z; columns right and down: completed by the direction to the eye they form a rotation
        assert np.allclose(ends.T @ ends, np.eye(2), atol=2e-3)
    towards = np.array(data["direction"]) / np.linalg.norm(data["direction"])
    right = np.cross(data["up"], towards)
    right /= np.linalg.norm(right)
    expected = np.column_stack([right, -np.cross(towards, right)])
    before = np.array([[float(v) for v in view[f"before-{axis}"].split(",")] for axis in "xyz"])
    assert np.allclose(before, expected, atol=2e-3) and view["before-x"] != view["after-x"]


AXES = """
  const lines = (when) => {
    const groups = [...part("axes").querySelectorAll("[data-axis]")];
    report("names", groups.map((group) => group.dataset.axis).sort().join(""));
    for (const group of groups) {
      const line = group.querySelector("line");
      report(`${when}-${group.dataset.axis}`, [line.getAttribute("x2"), line.getAttribute("y2")].join());
    }
  };
  lines("before");
  drag(80, 30);
  lines("after");
"""


@needs_chromium
def test_mesh_lines_do_not_hide_the_colours_of_a_fine_mesh(block, tmp_path):
    """The highest pressure everywhere is the last colour of viridis, also of a surface of 200 x 200 cells."""
    view = seen(refined(page_of(block), 200), tmp_path, 'report("share", count("#fde725") / count());')
    assert float(view["share"]) > 0.75


@needs_chromium
def test_on_phones_panels_are_below_each_other_and_tables_scroll(history, history_seen, tmp_path):
    view, console = open_page(page_of(history), tmp_path, PHONE, phone=True)
    assert not console
    assert view["width"] == "390" and view["page"] == "390"  # the page itself does not scroll sideways
    assert int(view["charts"]) == int(view["stacked"]) == 6
    assert view["hint"] == "scroll sideways →" and view["shadow"] != "none"
    assert view["hintatend"] == "← scroll sideways"
    assert history_seen["charts"] == "6" and history_seen["stacked"] == "0"  # side by side on a wide screen


PHONE = """
  const charts = [...document.querySelectorAll(".chart")].filter((chart) => chart.querySelector("svg"));
  for (const closed of document.querySelectorAll("details")) closed.open = true;
  const edges = (panel) => panel.getBoundingClientRect();
  const stacked = charts.filter(({ children: [one, other] }) => edges(other).top >= edges(one).bottom);
  const table = document.querySelector(".wide .steps").parentElement;
  table.dispatchEvent(new Event("scroll"));
  report("width", innerWidth);
  report("page", document.documentElement.scrollWidth > innerWidth ? document.documentElement.scrollWidth : 390);
  report("charts", charts.length);
  report("stacked", stacked.length);
  report("hint", table.nextElementSibling.textContent);
  report("shadow", getComputedStyle(table).boxShadow);
  table.scrollLeft = 10000;
  table.dispatchEvent(new Event("scroll"));
  report("hintAtEnd", table.nextElementSibling.textContent);
"""


@needs_chromium
def test_without_webgl_the_page_says_so(block, tmp_path):
    """The tools of the tests find no canvas then: errors of a page are detected."""
    text = page_of(block).replace('getContext("webgl2"', 'getContext("none"')
    told = '<script>document.body.setAttribute("data-told", document.getElementById("view3d").textContent)</script>'
    view, console = open_page(text + told, tmp_path, "")
    assert view["told"].startswith("The view needs WebGL 2")
    assert console and all("null" in line for line in console)
