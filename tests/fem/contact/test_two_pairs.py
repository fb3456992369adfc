"""A face in two pairs: its contact points, files, check, history, resume and report have both; sums that have none are
not given."""

import json
import re
import shutil

import numpy as np
import pytest
from check_runs import run_case
from conftest import run_coulomb
from report_pages import page_without_pictures
from resumed_rows import rows_of, same_to_the_tolerance
from shared_problems import jaws
from two_pairs_runs import LENS, write_lens

from coulomb import (
    Clamp,
    Contact,
    ContactProblem,
    HeatLoad,
    LoadHistory,
    Material,
    Pressure,
    ThermalContact,
    Traction,
    box,
    join,
    moved,
)
from coulomb.case.record import written_case
from coulomb.io.field_files import OPPOSITE, read_grids
from coulomb.io.history_files import HistoryFiles
from coulomb.model.nodal_answer import HELD, OPEN
from coulomb.recheck import check
from coulomb.units import plain, quantity

BELOW, ABOVE = "mid:around against low:top", "mid:around against up:bottom"
LAST = "steps/0002"


def lens(folder, cell="hexahedron", degree=1, text=LENS):
    """The directory of the run of `LENS`."""
    folder.mkdir()
    write_lens(folder, cell, degree)
    return run_case(text, folder / "run")


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return lens(tmp_path_factory.mktemp("lens") / "of")


def last_row(folder):
    """Without the sum of the forces on the cushion, which is 0 up to the residual."""
    return {name: value for name, value in rows_of(folder)[-1].items() if not name.startswith("body_mid")}


def touched(grid):
    return np.round(grid.fields["status"]) != HELD


def test_every_pair_has_its_own_fields_on_both_sides(run):
    faces = read_grids(run / LAST / "contact.xdmf")
    assert list(faces) == [BELOW, ABOVE, "low:top", "up:bottom"]
    below, above = faces[BELOW], faces[ABOVE]
    assert np.array_equal(below.points, above.points)
    assert np.any(touched(below)) and np.any(touched(above)) and not np.any(touched(below) & touched(above))
    assert np.all(below.points[touched(below), 2] < 0.2) and np.all(above.points[touched(above), 2] > 0.2)
    summary = json.loads((run / LAST / "summary.json").read_text())
    for number, (slave, master) in enumerate(((below, faces["low:top"]), (above, faces["up:bottom"]))):
        force, opposite = (grid.fields["contact_force"].sum(axis=0) for grid in (slave, master))
        assert np.allclose(force, -opposite, atol=1e-9 * np.linalg.norm(force)) and abs(force[2]) > 1e5
        entry = summary["faces"][number]
        assert np.allclose(entry["force"], force, rtol=1e-9) and np.allclose(
            entry["opposite_force"], opposite, rtol=1e-9
        )
        assert np.all(master.fields[OPPOSITE] == number) and np.all(slave.fields["face"] == number)
        assert np.array_equal(master.fields["status"] != OPEN, master.fields["pressure"] > 0.0)
    both = [grid.fields["contact_force"].sum(axis=0) for grid in (below, above)]
    assert np.allclose(both[0], -both[1], atol=1e-6 * np.linalg.norm(both[0]))  # nothing else holds the cushion


def test_history_has_both_pairs_and_no_sum_of_them(run):
    summary, rows = json.loads((run / LAST / "summary.json").read_text()), rows_of(run)
    for name, face in zip((BELOW, ABOVE), summary["faces"], strict=True):
        assert float(rows[-1][f"{name}_force_z"]) == face["force"][2]
        assert float(rows[-1][f"{name}_normal_force"]) == face["normal_force"] > 1e5
        assert float(rows[-1][f"{name}_opposite_force_x"]) == face["opposite_force"][0]
    assert not {"force_x", "moment_x", "normal_force", "centre_of_pressure_x"} & set(rows[-1])
    assert not {"force", "moment", "normal_force", "centre_of_pressure"} & set(summary["totals"])
    assert "force_on_body" not in summary
    area = sum(face["contact_area"] for face in summary["faces"])
    assert summary["totals"]["contact_area"] == pytest.approx(area, rel=1e-12)


def test_the_terminal_has_the_forces_of_each_pair(tmp_path):
    write_lens(tmp_path)
    (tmp_path / "lens.toml").write_text(LENS)
    done = run_coulomb("run", "lens.toml", "--set", "history.times=[1]", cwd=tmp_path)
    faces = json.loads((tmp_path / "run" / "steps/0001" / "summary.json").read_text())["faces"]
    for name, face in zip((BELOW, ABOVE), faces, strict=True):
        normal, friction = (plain(quantity(face[f"{kind}_force"], "N")) for kind in ("normal", "friction"))
        assert re.search(rf"{name}: normal {normal} +friction {friction}", done.stdout)


def test_a_history_is_continued(run, tmp_path):
    folder = shutil.copytree(run, tmp_path / "run")
    shutil.rmtree(folder / LAST)
    settings = written_case(folder)
    settings.load_history().run(settings.problem(), HistoryFiles(folder, resume=True))
    assert same_to_the_tolerance(last_row(run), last_row(folder)) and check(folder).passed


def test_the_page_has_both_pairs(run):
    pytest.importorskip("pyvista")
    text, nodes = (
        page_without_pictures(run, charts=True),
        json.loads((run / LAST / "summary.json").read_text())["nodes"],
    )
    assert f"{nodes['open']} / {nodes['stick']} / {nodes['slip']}" in text
    assert f"normal force of {BELOW} / {ABOVE}" in text and f"normal force of {ABOVE}" in text
    assert f"contact at {BELOW}" in text and f"contact at {ABOVE}" in text
    assert text.count('"name": "mid:around"') == 1  # of the faces to choose from


def test_a_picture_shows_every_face_once_with_both_pairs(run):
    pytest.importorskip("pyvista")
    from coulomb.pictures.report.fields import zone_counts
    from coulomb.pictures.report.grids import drawn_apart, merged

    faces, bodies = (read_grids(run / LAST / f"{name}.xdmf") for name in ("contact", "solution"))
    whole = merged(faces)
    assert [block.name for block in whole.blocks] == ["mid:around", "low:top", "up:bottom"]
    pressure = whole.fields["pressure"][whole.blocks[0].points]
    assert np.array_equal(pressure, faces[BELOW].fields["pressure"] + faces[ABOVE].fields["pressure"])
    nodes = json.loads((run / LAST / "summary.json").read_text())["nodes"]
    counts = zone_counts(whole)
    assert {name: counts[name] for name in ("open", "stick", "slip")} == {
        name: nodes[name] for name in ("open", "stick", "slip")
    }
    apart, _ = drawn_apart(merged(bodies), whole)
    low, mid, up = ((apart.points - merged(bodies).points)[block.points.start] for block in apart.blocks)
    assert mid[2] - low[2] > 0.3 and up[2] - mid[2] > 0.3 and np.allclose((low - up)[:2], 0.0, atol=1e-6)


FINE = "cells = [10, 6, 1]"


@pytest.mark.parametrize(
    ("cell", "degree", "plates", "names"),
    [
        ("tetrahedron", 2, {}, [BELOW, ABOVE, "low:top", "up:bottom"]),
        ("hexahedron", 2, {}, [BELOW, ABOVE, "low:top", "up:bottom"]),
        ("hexahedron", 1, {"low", "up"}, ["low:top", "up:bottom", BELOW, ABOVE]),  # the cushion is the master of both
        ("hexahedron", 1, {"up"}, [BELOW, "up:bottom", "low:top", ABOVE]),  # or the slave of one, the master of another
    ],
)
def test_the_check_passes_with_every_cell_and_whichever_face_is_the_slave(cell, degree, plates, names, tmp_path):
    """The finer plates are slaves; a master has the status, the pressure and the forces of each pair apart."""
    parts = LENS.replace("[0.5, 1]", "[1]").split("cells = [2, 1, 1]")
    low, up = (FINE if name in plates else "cells = [2, 1, 1]" for name in ("low", "up"))
    folder = lens(tmp_path / "of", cell, degree, parts[0] + low + parts[1] + up + parts[2])
    faces, found = read_grids(folder / "steps/0001/contact.xdmf"), check(folder)
    assert list(faces) == names and found.passed and not found.faults, str(found)
    for plate, name, side in (("low", BELOW, -1.0), ("up", ABOVE, 1.0)):
        if plate in plates:
            grid = faces[name]
            assert np.all(side * (grid.points[touched(grid), 2] - 0.2) > 0.0)
            assert side * grid.fields["contact_force"][:, 2].sum() < -1e5
            assert np.array_equal(grid.fields["status"] != OPEN, (grid.fields["pressure"] > 0.0) | ~touched(grid))
    row = last_row(folder)
    assert {f"{face}_force_x" for face in names[:2]} | {f"{face}_opposite_force_x" for face in names[:2]} <= set(row)


def test_nodes_in_both_pairs_are_remarked():
    """The three nodes in the middle of the pad are opposite to both bases; where these are far from each other along
    the normal, only one can be touched, and the nodes have a contact point at each."""
    bases = {name: moved(box((1.0, 1.0, 0.5), (1, 1, 1)), (x, 0.0, -0.5)) for name, x in (("one", 0.0), ("two", 1.0))}
    pad = box((2.0, 1.0, 0.5), (4, 2, 1))
    contacts = [Contact("pad:bottom", against=f"{name}:top", friction=0.3) for name in bases]
    clamps = [Clamp("one:bottom"), Clamp("two:bottom")]
    # the second base nearer than the first, or as near, or far
    for gap, points, lost in ((0.0, [9, 6], 1), (-1e-4, [6, 9], 1), (-0.1, [9, 9], 0)):
        raised = {"one": moved(bases["one"], (0.0, 0.0, gap)), "two": bases["two"]}
        problem = ContactProblem(join(pad=pad, **raised), Material(2e11, 0.0), clamps, contacts)
        assert np.bincount(problem.surface.part).tolist() == points
        remarks = [text for number in (0, 1) for text in problem.body.pair(number).remarks]
        assert sum("3 of its nodes are contact points of another face" in text for text in remarks) == lost


def test_an_edge_touches_two_bodies():
    """A block is pressed into a corner of two others, which without Poisson's ratio bear it with uniform pressures."""
    blocks = {"below": ((1.0, 1.0, 0.5), (0.0, 0.0, -0.5)), "beside": ((0.5, 1.0, 1.0), (1.0, 0.0, 0.0))}
    mesh = join(
        block=box((1.0, 1.0, 1.0), (3, 3, 3)),
        **{name: moved(box(size, (2, 2, 2)), at) for name, (size, at) in blocks.items()},
    )
    contacts = [Contact("block:bottom", 0.0, against="below:top"), Contact("block:right", 0.0, against="beside:left")]
    held = [Clamp("below:bottom"), Clamp("beside:right"), Clamp("block:front", "y")]
    loads = [Pressure("block:top", 1e6), Pressure("block:left", 2e6)]
    problem = ContactProblem(mesh, Material(2e11, 0.0), held, contacts, loads)
    at, nodes = problem.solve().at_nodes, problem.surface.nodes
    assert len(nodes) == 32 and len(np.unique(nodes)) == 28
    for part, pressure in enumerate((1e6, 2e6)):
        assert at.pressure[at.part == part] == pytest.approx(pressure, rel=1e-6)


def pad_on_two():
    """A pad that is pressed down at one end on two bases, its lower face in two pairs, and is warmed."""
    bases = {name: moved(box((1.0, 1.0, 0.5), (2, 2, 2)), (x, 0.0, -0.5)) for name, x in (("one", 0.0), ("two", 1.0))}
    warm = ThermalContact(conductance=1e3)
    contacts = [Contact("pad:bottom", 0.3, against=f"{name}:top", slave=True, thermal=warm) for name in bases]
    held = [Clamp("one:bottom"), Clamp("two:bottom"), Clamp("pad:back", "y")]
    down = Traction("pad:top", lambda x: np.outer(x[0], [0.0, 0.0, -1e6]).T)
    heat = [HeatLoad(f"{name}:bottom", temperature=20.0) for name in bases]
    heat += [HeatLoad("pad:top", flux=flux) for flux in (1e3, 2e3)]
    mesh = join(pad=box((2.0, 1.0, 0.5), (8, 2, 2)), **bases)
    steel = Material(2e11, 0.0, expansion=0.0, conductivity=50.0)
    return ContactProblem(mesh, steel, held, contacts, [down], heat=heat, reference_temperature=20.0)


def test_every_pair_has_its_own_totals():
    """A face in two pairs gives its name to neither alone: not to error bars, columns, fields, and heat flows."""
    solution = pad_on_two().solve()
    bars, names = solution.error(), ["pad:bottom against one:top", "pad:bottom against two:top"]
    pressing = [solution.at_nodes.totals(part)["normal_force"] for part in range(2)]
    assert pressing[1] > 1.5 * pressing[0] > 0.0 and sum(pressing) == pytest.approx(2e6)
    table = solution.table()
    for name, force in zip(names, pressing, strict=True):
        bar = bars[f"faces.{name}.normal_force"]
        assert bar.value[0] == force and 0.0 < bar.bar[0] < 0.5 * force
        assert table["pressure"] @ (table["area"] * (table["contact_face"] == name)) == pytest.approx(force)
        assert solution.face(name).contact_force[:, 2].sum() == pytest.approx(force)
    assert solution.face("pad:bottom").pressure == pytest.approx(solution.face(names[0]).pressure)
    assert len({bar.quantity for bar in bars.bars}) == len(bars.bars)
    flows = {flow.name: flow.power for flow in solution.heat.flows}
    assert len(flows) == len(solution.heat.flows) and {f"heat_friction_{'_'.join(names[1].split())}"} <= set(flows)
    assert [flows[f"heat_heat_flux_pad:top{number}"] for number in ("", "_2")] == pytest.approx([2e3, 4e3])


def test_the_same_pair_twice_is_refused():
    mesh = join(base=box((1.0, 1.0, 1.0), (1, 1, 1)), pad=moved(box((1.0, 1.0, 1.0), (1, 1, 1)), (0.0, 0.0, 1.0)))
    contacts = [Contact("pad:bottom", 0.3, against="base:top"), Contact("base:top", 0.2, against="pad:bottom")]
    with pytest.raises(ValueError, match="the pair of 'base:top' and 'pad:bottom' is given twice"):
        ContactProblem(mesh, Material(2e11, 0.0), [Clamp("base:bottom")], contacts)


def test_of_several_foundations_only_the_force_is_a_sum(tmp_path):
    """On one body forces add up; normal forces of different faces do not."""
    files = HistoryFiles(tmp_path)
    LoadHistory([1.0]).run(jaws(), files)
    (row,), summary = files.rows, json.loads((tmp_path / "steps/0001/summary.json").read_text())
    assert "force_x" in row and "normal_force" not in row and "centre_of_pressure_x" not in row
    assert summary["force_on_body"].keys() == {"vector"} and "force" in summary["totals"]
    assert row["top_normal_force"] == summary["faces"][1]["normal_force"] > 0.0
    assert check(tmp_path).passed
