"""The fields in VTKHDF and as a table, beside those of the XDMF files."""

import csv

import meshio
import numpy as np
import pytest
import pyvista
from check_runs import read_grid
from conftest import ROOT, run_coulomb

FORMATS = ("--set", 'output.format=["xdmf","vtkhdf","csv"]', "--set", "output.picture=false")


def run(name, directory, *changes):
    words = [word for change in changes for word in ("--set", change)]
    done = run_coulomb("run", ROOT / "demos" / f"{name}.toml", *FORMATS, *words, "--output", directory)
    assert "cannot be written" not in done.stderr, done.stderr
    return directory


def read_step(path, step):
    """A step of a VTKHDF file, by VTK's reader, and their number."""
    reader = pyvista.get_reader(str(path)).reader
    reader.UpdateInformation()
    reader.SetStep(step)
    reader.Update()
    return pyvista.wrap(reader.GetOutputDataObject(0)), reader.GetNumberOfSteps()


@pytest.fixture(scope="module")
def history(tmp_path_factory):
    changes = ("mesh.cells=[4,4,2]", "history={end=4.0, steps=4}")
    return run("history", tmp_path_factory.mktemp("formats") / "history", *changes)


def test_every_step_of_a_history(history):
    for step in (0, 3):
        for name, place in (("solution", "displacement"), ("contact", "pressure")):
            grid, count = read_step(history / f"{name}.vtkhdf", step)
            expected = read_grid(history / "steps" / f"{step + 1:04d}" / f"{name}.xdmf")
            assert count == 4 and np.array_equal(grid.points, expected.points)
            assert np.array_equal(grid[place], expected.fields[place]) and np.any(grid[place])
            assert grid.n_cells == len(expected.cells)
        assert grid.area == pytest.approx(0.01, rel=1e-12)
    run_coulomb("check", history)


@pytest.mark.parametrize("place", ["", "steps/0002"])
def test_xdmf_is_read_by_meshio_and_pyvista(history, place):
    """A load history, and a single run."""
    for name, field in (("solution", "displacement"), ("contact", "pressure")):
        path = history / place / f"{name}.xdmf"
        reader = pyvista.get_reader(str(path))
        with meshio.xdmf.TimeSeriesReader(path) as series:
            points, cells = series.read_points_cells()
            steps = [series.read_data(k) for k in range(series.num_steps)]
        assert [time for time, *_ in steps] == reader.time_values and len(steps) == (1 if place else 4)
        for number, (_, on_points, _) in enumerate(steps):
            reader.set_active_time_point(number)
            grid = reader.read()
            assert np.array_equal(grid.points, points) and grid.n_cells == len(cells[0].data)
            assert np.array_equal(np.ravel(grid[field]), np.ravel(on_points[field])) and np.any(grid[field])


def test_the_table_of_contact_nodes(history):
    with (history / "contact.csv").open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if float(row["time"]) == 4.0]
    with (history / "history.csv").open(newline="") as file:
        last = list(csv.DictReader(file))[-1]
    assert len(rows) == 25
    for axis in "xyz":
        force = sum(float(row[f"contact_force_{axis}"]) for row in rows)
        assert force == pytest.approx(float(last[f"force_{axis}"]), abs=1e-9 * float(last["normal_force"]))
    assert max(float(row["pressure"]) for row in rows) == float(last["greatest_pressure"])


def test_bodies_of_other_cells_are_one_grid(tmp_path):
    """With their numbers."""
    folder = run(
        "two_blocks", tmp_path / "two", "body.0.cells=[2,2,1]", "body.1.cells=[3,3,2]", "body.1.cell='tetrahedron'"
    )
    grid, count = read_step(folder / "solution.vtkhdf", 0)
    assert count == 1 and set(grid.celltypes) == {10, 12} and set(grid["part"]) == {0, 1}
    lower = grid.extract_cells(grid["part"] == 0)
    assert lower.n_cells == 4 and lower.volume + grid.extract_cells(grid["part"] == 1).volume == pytest.approx(
        grid.volume
    )
    # the way of docs/run-directory.md, since meshio reads no XDMF file of several grids
    pyvista.save_meshio(tmp_path / "bodies.vtu", grid)
    assert sum(len(block.data) for block in meshio.read(tmp_path / "bodies.vtu").cells) == grid.n_cells


def test_without_xdmf_there_is_no_check():
    done = run_coulomb("check-case", ROOT / "demos" / "block.toml", "--set", 'output.format=["vtkhdf"]', code=2)
    assert 'format must have "xdmf", which coulomb check reads' in done.stderr
