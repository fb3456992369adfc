"""`coulomb plot` and `coulomb report` need only the files that they draw."""

import json
import re
import shutil
from pathlib import Path

import pytest
from conftest import SMALL_CASE, run_coulomb
from report_pages import page_without_pictures

from coulomb.pictures.report import files, picture

PRESSED = (
    SMALL_CASE.partition("[[clamp]]")[0]
    + """\
[[prescribed_displacement]]
face = "top"
value = [0.0, 0.0, -1e-4]
amplitude = [[0, 0], [1, 1]]
[contact]
face = "bottom"
friction = 0.3
[history]
times = [0.5, 1.0, 1.5]
[output]
picture = false
"""
)


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """A single run, and a load history."""
    home = tmp_path_factory.mktemp("runs")
    for name, text in (("single", SMALL_CASE), ("history", PRESSED)):
        (home / f"{name}.toml").write_text(text)
        run_coulomb("run", f"{name}.toml", "--quiet", "--output", name, cwd=home)
    return home


@pytest.fixture
def copy(runs, tmp_path, monkeypatch):
    shutil.copytree(runs, tmp_path / "runs")
    monkeypatch.chdir(tmp_path / "runs")
    files._grids.clear()
    return tmp_path / "runs"


def spoil(folder, name, how):
    path = folder / name
    if how == "missing":
        path.unlink()
    else:
        path.write_bytes(b"\xff\xfe\x00\x01 no text" if how == "binary" else path.read_bytes()[:100])


@pytest.fixture(autouse=True)
def _small(monkeypatch):
    monkeypatch.setattr(picture, "SHOT", (300, 220))


def drawn(folder, field):
    said = picture.plot(folder, field, None, None, Path("x.png"), None)
    assert Path("x.png").stat().st_size > 5000
    return said


@pytest.mark.parametrize(
    ("name", "how"), [("summary.json", "cut short"), ("iterations.csv", "binary"), ("case.json", "missing")]
)
def test_a_field_is_drawn_from_its_own_file(copy, name, how):
    spoil(copy / "single", name, how)
    for field in ("pressure", "von_mises_stress"):
        assert drawn(copy / "single", field) == "x.png"


@pytest.mark.parametrize(
    ("name", "field", "how"),
    [
        ("solution.xdmf", "pressure", "missing"),
        ("contact.h5", "displacement", "missing"),
    ],
)
def test_a_field_is_drawn_without_the_other_file(copy, name, field, how):
    spoil(copy / "single", name, how)
    assert drawn(copy / "single", field) == f"x.png; without {name.split('.')[0]}.xdmf, which cannot be read"
    other = "displacement" if field == "pressure" else "pressure"
    with pytest.raises(ValueError, match=rf"{name.split('.')[0]}\.xdmf: cannot be read"):
        drawn(copy / "single", other)


@pytest.mark.parametrize(("name", "how"), [("summary.json", "missing"), ("history.csv", "binary")])
def test_a_history_is_drawn_by_its_steps(copy, name, how):
    spoil(copy / "history", name, how)
    assert drawn(copy / "history", "pressure") == "x.png"
    run = files.read_run(copy / "history", ("contact",))
    assert [step.time for step in run.steps] == [0.5, 1.0, 1.5]
    assert run.alarm == ("certificate unknown: summary.json cannot be read" if name == "summary.json" else "")


def test_an_empty_directory_is_no_run(tmp_path):
    with pytest.raises(ValueError, match=r"holds no run: there is no contact\.xdmf"):
        picture.plot(tmp_path, "pressure", None, None, tmp_path / "x.png", None)


@pytest.mark.parametrize(
    ("kind", "name"), [("single", "iterations.csv"), ("single", "case.json"), ("history", "history.csv")]
)
def test_a_report_without_optional_files(copy, kind, name):
    whole = page_without_pictures(copy / kind)
    spoil(copy / kind, name, "missing")
    rest = page_without_pictures(copy / kind, charts=True)
    assert "<html" in rest and (kind == "single" or rest.count("<tr") == whole.count("<tr"))


@pytest.mark.parametrize("kind", ["single", "history"])
def test_damaged_tables_are_named(copy, kind):
    name = "history" if kind == "history" else "iterations"
    spoil(copy / kind, f"{name}.csv", "binary")
    with pytest.raises(ValueError, match=rf"{kind}/{name}\.csv: cannot be read: it is not a text table: "):
        page_without_pictures(copy / kind, charts=True)
    if kind == "history":  # found before pictures are drawn
        done = run_coulomb("report", kind, code=2)
        assert re.match(r"error: history/history\.csv: cannot be read: .*\n\Z", done.stderr)


def test_short_lines_in_tables(copy):
    table = copy / "single" / "iterations.csv"
    head, first, *others = table.read_text().splitlines()
    table.write_text("\n".join([head, first, others[0].split(",")[0], others[1] + ",7,8"]) + "\n")
    assert "<html" in page_without_pictures(copy / "single", charts=True)
    assert json.loads((copy / "single" / "summary.json").read_text())["certificate"]["passed"]
