"""Shared by the tests of the report: a page as text, as words, as data, and as Chromium shows it."""

import base64
import html
import json
import re
import shutil
import subprocess
from unittest import mock

import numpy as np
import pytest

from coulomb.pictures.report import page
from coulomb.pictures.report.fields import ZONES

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
needs_chromium = pytest.mark.skipif(CHROMIUM is None, reason="there is no Chromium to open the page in")


def page_of(directory):
    return (directory / "report.html").read_text(encoding="utf-8")


class NoCharts:
    """In place of the module of the charts: each is empty."""

    def __getattr__(self, name):
        return lambda run: ""


def page_without_pictures(directory, charts=False):
    """The page as text, without pictures, which take most of its time, and with its charts if asked for."""
    with mock.patch.object(page, "_pictures", lambda *_: []):
        with mock.patch.object(page, "charts", page.charts if charts else NoCharts()):
            return page.render(page.read_run(directory))


def words_of(directory):
    """The visible text of the page."""
    text = re.sub(r"<(style|script|svg).*?</\1>", " ", page_of(directory), flags=re.DOTALL)
    return re.sub(r"\s+", " ", html.unescape(re.sub(r"<[^>]*>", " ", text))).replace("\u202f", " ")


def data_of(directory):
    found = re.search(r'id="view3d-data">(.*?)</script>', page_of(directory), flags=re.DOTALL)
    return json.loads(found.group(1))


def numbers(text, kind="<f4"):
    return np.frombuffer(base64.b64decode(text), dtype=kind)


def refined(text, count):
    """The page of a surface of count x count cells in place of its own, pressure 1 everywhere."""
    found = re.search(r'(id="view3d-data">)(.*?)(</script>)', text, flags=re.DOTALL)
    data = json.loads(found.group(2))
    own = numbers(data["points"]).reshape(-1, 3)
    low, high = own.min(axis=0), own.max(axis=0)
    x, y = np.meshgrid(*np.linspace(low[:2], high[:2], count + 1).T, indexing="ij")
    points = np.column_stack([x.ravel(), y.ravel(), np.full(x.size, low[2])])
    k = (np.arange(count)[:, None] * (count + 1) + np.arange(count)).ravel()
    triangles = np.concatenate(
        [np.column_stack([k, k + count + 1, k + count + 2]), np.column_stack([k, k + count + 2, k + 1])]
    )
    edges = np.concatenate([np.column_stack([k, k + 1]), np.column_stack([k, k + count + 1])])

    def packed(values, kind="<f4"):
        return base64.b64encode(np.ascontiguousarray(values, dtype=kind).tobytes()).decode()

    data |= {"points": packed(points), "normals": packed(0 * points + [0, 0, -1])}
    data |= {"triangles": packed(triangles, "<u4"), "edges": packed(edges, "<u4")}
    for step in data["steps"]:
        step |= {"surface": packed(0 * points), "arrows": packed(0 * points)}
        step["values"] = {name: packed(np.full(len(points), data["fields"][0]["high"])) for name in step["values"]}
    return text[: found.start(2)] + json.dumps(data) + text[found.end(2) :]


# --- in a browser ---------------------------------------------------------------------------------------------------

TOOLS = """
  const canvas = document.querySelector("#view3d canvas");
  const part = (name) => document.querySelector(`[data-part="${name}"]`);
  const report = (name, value) => document.body.setAttribute("data-" + name, value);
  /** Call `visit` with place and colour of every pixel of the canvas that is not empty. */
  const scan = (visit) => {
    const copy = document.createElement("canvas");
    [copy.width, copy.height] = [canvas.width, canvas.height];
    const pen = copy.getContext("2d");
    pen.drawImage(canvas, 0, 0);
    const { data } = pen.getImageData(0, 0, copy.width, copy.height);
    for (let k = 0; k < data.length; k += 4)
      if (data[k + 3] > 0)
        visit((k / 4) % copy.width, Math.floor(k / 4 / copy.width), data[k], data[k + 1], data[k + 2]);
  };
  /** Number of pixels of a colour, or of all that are not empty. */
  const count = (hex) => {
    const [red, green, blue] = hex ? [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16)) : [];
    let found = 0;
    scan((x, y, r, g, b) => {
      if (!hex || (Math.abs(r - red) < 4 && Math.abs(g - green) < 4 && Math.abs(b - blue) < 4)) found++;
    });
    return found;
  };
  const box = canvas.getBoundingClientRect();
  canvas.setPointerCapture = () => {};
  const place = (x, y) => {  // asked for each time: what gets focus is scrolled into sight
    const { left, top } = canvas.getBoundingClientRect();
    return { clientX: left + x, clientY: top + y };
  };
  const at = (kind, x, y, more) =>
    canvas.dispatchEvent(new PointerEvent(kind, { pointerId: 1, ...place(x, y), ...more }));
  const reset = () => part("reset").click();
  const drag = (x, y, more) => {
    at("pointerdown", 100, 100);
    at("pointermove", 100 + x, 100 + y, more);
    at("pointerup", 100 + x, 100 + y);
  };
  /** Whether the page was left to scroll. */
  const wheel = (by, x = box.width / 2, y = box.height / 2) =>
    canvas.dispatchEvent(new WheelEvent("wheel", { deltaY: by, cancelable: true, ...place(x, y) }));
  const choose = (k) => ((part("field").selectedIndex = k), part("field").dispatchEvent(new Event("change")));
  const slide = (name, value) => ((part(name).value = value), part(name).dispatchEvent(new Event("input")));
"""
"""Available to the script of a test: the canvas, functions for mouse and keys, and `report` to report a value."""


def open_page(text, tmp_path, script, phone=False):
    """Show a page in Chromium.

    Args:
        text: The page.
        tmp_path: For a copy of it and the browser's profile.
        script: Runs after the page has been drawn, with TOOLS; ZONES are the colours of the zones.
        phone: Show it 390 pixels wide.

    Returns:
        What the script reported, by name in lower case, and the messages on the console.
    """
    colours = json.dumps([colour for _, colour in ZONES.values()])
    probe = f"<script>addEventListener('load', () => setTimeout(() => {{{TOOLS}{script}}}, 300));</script>"
    page = text + probe.replace("ZONES", colours)
    copy = tmp_path / "probe.html"
    if phone:  # a window of a desktop is never so small
        inside = json.dumps(page).replace("</", "<\\/")
        page = f"""<body><iframe style="width: 390px; height: 800px; border: 0"></iframe><script>
          const inner = document.querySelector("iframe").contentDocument;
          inner.open(), inner.write({inside}), inner.close();
          setTimeout(() => {{
            for (const {{ name, value }} of inner.body.attributes) document.body.setAttribute(name, value);
            document.querySelectorAll("script, iframe").forEach((element) => element.remove());
          }}, 3000);
        </script></body>"""
    copy.write_text(page, encoding="utf-8")
    flags = ["--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]
    flags += ["--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-component-update"]
    flags += ["--disable-sync", "--enable-logging=stderr", "--virtual-time-budget=10000", "--window-size=1000,900"]
    flags += ["--hide-scrollbars", f"--user-data-dir={tmp_path / 'profile'}", "--dump-dom", f"file://{copy}"]
    done = subprocess.run([CHROMIUM, *flags], capture_output=True, text=True, timeout=600, check=True)
    body = re.search(r"<body([^>]*)>", done.stdout).group(1)
    lines = [line for line in done.stderr.splitlines() if "CONSOLE" in line]
    console = [line for line in lines if "GL Driver Message" not in line]  # of a slow machine's software renderer
    return dict(re.findall(r'data-([\w-]+)="([^"]*)"', body)), console
