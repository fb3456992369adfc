"""The view of the contact surface in the report: its data, and its behaviour in a browser."""

import json
import re
import shutil

import h5py
import numpy as np
import pytest
from check_runs import read_grid
from report_pages import data_of, needs_chromium, numbers, open_page, page_of, refined

from coulomb.io.field_files import Grid
from coulomb.pictures.report.files import read_run
from coulomb.pictures.report.shown_fields import named
from coulomb.pictures.report.surface_view import surface_view, thinned_surface


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


# --- in a browser


@needs_chromium
def test_the_view_draws(block, tmp_path):
    view, console = open_page(page_of(block), tmp_path, SHOWS)
    assert not console
    assert view["by"] == "webgl" and int(view["drawn"]) > 50_000
    assert int(view["arrowsinfront"]) > 500 > 50 > int(view["arrowsbehind"])  # the surface hides them from behind
    counts = [int(view[f"zone{code}"]) for code in range(4)]
    assert int(view["blue0"]) < 100 < min(counts)  # zones are shown on request only, each in its colour
    assert counts[2] > 5 * max(counts[0], counts[1], counts[3])  # most of the surface slips
    assert view["legend"] == "openstickslipno contact point"
    assert int(view["turned"]) < 0.6 * counts[2]  # after a quarter turn the surface is seen from its edge
    assert re.fullmatch(r"(open|stick|slip|no contact point) at \(.*\) m", view["tip"])


SHOWS = """
  report("by", canvas.dataset.by);
  report("drawn", canvas.dataset.drawn);
  report("arrowsInFront", count("#141414"));
  drag(314, 0);
  report("arrowsBehind", count("#141414"));
  part("reset").click();
  part("arrows").click();
  report("blue0", count(ZONES[1]) + count(ZONES[2]));
  choose(3);
  ZONES.forEach((colour, k) => report("zone" + k, count(colour)));
  report("legend", part("legend").textContent);
  drag(0, 157);
  report("turned", count(ZONES[2]));
  part("reset").click();
  let tip = "";
  for (let x = 0; x < box.width && !tip; x += 8)
    for (let y = 0; y < box.height && !tip; y += 8) {
      at("pointermove", x, y);
      tip = part("tip").hidden ? "" : part("tip").textContent;
    }
  report("tip", tip);
"""


@needs_chromium
@pytest.mark.parametrize("flat", [False, True], ids=["webgl", "canvas"])
def test_the_wheel_scrolls_the_page_unless_the_view_has_focus(history, tmp_path, flat):
    text = page_of(history)
    assert '"flat": false' in text
    view, console = open_page(text.replace('"flat": false', f'"flat": {json.dumps(flat)}'), tmp_path, WHEEL)
    assert not console and view["by"] == ("canvas" if flat else "webgl")
    assert view["scrolled"] == "true" and view["left"] == view["home"]  # the page scrolls, the view stays
    assert view["scrolledwithfocus"] == "false" and int(view["far"]) < 0.3 * int(view["home"])
    assert view["scrolledafterescape"] == "true" and view["after"] == view["far"]
    assert view["finger"] == "pan-y" and view["fingerwithfocus"] == "none"  # a finger scrolls the page, too


WHEEL = """
  report("by", canvas.dataset.by);
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
def test_the_body_stays_in_the_frame(run, tmp_path, request):
    """At every rotation and step and the largest scale of the displacement, nothing reaches the border."""
    view, console = open_page(page_of(request.getfixturevalue(run)), tmp_path, FRAME)
    assert not console
    assert int(view["states"]) >= 24 and view["atborder"] == "0"
    assert float(view["smallest"]) > 0.6  # and it fills the frame, in one direction at least
    assert float(view["shifted"]) > 100.0 and view["movedout"] == "false"


FRAME = """
  let [states, atBorder, smallest] = [0, 0, 1];
  const look = () => {
    const seen = pixels();
    const [x, y] = [0, 1].map((k) => seen.map((pixel) => pixel[k]));
    const least = (values) => values.reduce((a, b) => Math.min(a, b), Infinity);
    const most = (values) => values.reduce((a, b) => Math.max(a, b), -Infinity);
    atBorder += seen.filter(([x, y]) => x < 2 || y < 2 || x > canvas.width - 3 || y > canvas.height - 3).length;
    const fills = Math.max((most(x) - least(x)) / canvas.width, (most(y) - least(y)) / canvas.height);
    smallest = Math.min(smallest, fills);
    states++;
    return least(x);
  };
  for (const scale of [part("scale").value, part("scale").max])
    for (const step of [0, part("step").max]) {
      slide("scale", scale);
      slide("step", step);
      for (let turn = 0; turn < 6; turn++) {
        look();
        drag(turn % 2 ? 40 : 70, turn % 3 ? 60 : 25);
      }
    }
  report("states", states);
  report("atBorder", atBorder);
  report("smallest", smallest);
  part("reset").click();
  const before = look();
  drag(-3000, 0, { shiftKey: true });
  report("movedOut", look() !== before);  // as large as the frame, it cannot be moved out of it
  canvas.focus();
  wheel(-900);
  const middle = pixels().length;
  drag(-3000, 0, { shiftKey: true });
  const there = pixels();
  report("shifted", there.length ? Math.abs(there.length - middle) : -1);
"""


@needs_chromium
def test_the_tip_follows_its_node(history, tmp_path):
    """It shows the value at the node when the step changes, moves with the node, and closes when the mouse leaves."""
    data = data_of(history)
    view, console = open_page(page_of(history), tmp_path, TIP)
    assert not console
    assert view["distance"] == view["distanceafter"] == "0,0,0"  # the ring is on the node, before and after
    assert view["first"] != view["last"] and view["place"] == view["placelast"]
    node = int(view["node"])
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
  const data = JSON.parse(document.getElementById("view3d-data").textContent);
  const points = new Float32Array(Uint8Array.from(atob(data.points), (letter) => letter.charCodeAt(0)).buffer);
  const numberOf = (place) => {
    const wanted = place.split(", ").map(Number);
    for (let k = 0; k < points.length / 3; k++)
      if (wanted.every((v, c) => Math.abs(points[3 * k + c] / data.length.factor - v) < 1e-3)) return k;
    return -1;
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
  report("node", numberOf(near()));
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
  part("reset").click();
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
def test_axes_turn_with_the_body(block, tmp_path):
    """The ends of the three axes in the corner are the directions in which points of the body lie."""
    view, console = open_page(page_of(block), tmp_path, AXES)
    assert not console and view["names"] == "xyz"
    for when in ("before", "after"):
        ends = np.array([[float(v) for v in view[f"{when}-{axis}"].split(",")] for axis in "xyz"])
        # rows x, y, z; columns right and down: completed by the direction to the eye they form a rotation
        assert np.allclose(ends.T @ ends, np.eye(2), atol=2e-3)
    data = data_of(block)
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
@pytest.mark.parametrize("flat", [False, True], ids=["webgl", "canvas"])
def test_mesh_lines_do_not_hide_the_colours_of_a_fine_mesh(block, tmp_path, flat):
    """The highest pressure everywhere is the last colour of viridis: of a surface of 200 x 200 cells as of 8 x 8."""
    shares, whole = [], page_of(block).replace('"flat": false', f'"flat": {json.dumps(flat)}')
    for cells in (8, 200):
        view, console = open_page(refined(whole, cells), tmp_path, 'report("share", count("#fde725") / count());')
        assert not console
        shares.append(float(view["share"]))
    assert shares[0] > 0.8 and shares[1] > shares[0] - 0.05


@needs_chromium
def test_wide_charts_scroll_on_phones(history, tmp_path):
    view, console = open_page(page_of(history), tmp_path, PHONE, phone=True)
    assert not console
    assert view["width"] == "390" and view["page"] == "390"  # the page itself does not scroll sideways
    assert int(view["charts"]) == int(view["hints"]) == 6
    assert view["hint"] == "scroll sideways →" and view["shadow"] != "none"
    assert view["hintatend"] == "← scroll sideways"
    view, _ = open_page(page_of(history), tmp_path, PHONE)
    assert view["hints"] == "0" and view["shadow"] == "none"  # on a wide screen there is nothing to scroll


PHONE = """
  const charts = [...document.querySelectorAll(".chart")].filter((chart) => chart.querySelector("svg"));
  const hints = charts.filter((chart) => chart.nextElementSibling.textContent);
  report("width", innerWidth);
  report("page", document.documentElement.scrollWidth > innerWidth ? document.documentElement.scrollWidth : 390);
  report("charts", charts.length);
  report("hints", hints.length);
  report("hint", charts[0].nextElementSibling.textContent);
  report("shadow", getComputedStyle(charts[0]).boxShadow);
  charts[0].scrollLeft = 10000;
  charts[0].dispatchEvent(new Event("scroll"));
  report("hintAtEnd", charts[0].nextElementSibling.textContent);
"""


@needs_chromium
def test_errors_of_a_page_are_detected(block, tmp_path):
    """Checks that the tests above can fail."""
    _, console = open_page(page_of(block).replace("const data = JSON", "const data = JASON"), tmp_path, "")
    assert any("JASON" in line for line in console)
