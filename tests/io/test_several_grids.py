"""Several named grids in one pair of XDMF and HDF5 files: bodies, and the faces of pairs."""

import numpy as np
import pytest
from mpi4py import MPI

from coulomb.fem.meshes.xdmf_writing import SOLIDS
from coulomb.io.field_files import grids_of, read_grids
from coulomb.io.grid_file import GridFields, GridPart, described, groups_of, write_grids
from coulomb.io.output import Series

CUBE = np.array([[x, y, z] for z in (0.0, 1.0) for y in (0.0, 1.0) for x in (0.0, 1.0)])
HEXAHEDRON = GridPart("Hexahedron", np.array([[0, 1, 3, 2, 4, 5, 7, 6]]), CUBE)
TETRAHEDRON = GridPart("Tetrahedron", np.array([[0, 1, 2, 3]]), CUBE[[4, 5, 6, 7]] + [0.0, 0.0, 1e-3])
NAMES = ("lower", "upper part")


def written(path, time):
    """A hexahedron under a tetrahedron, whose displacements grow with time."""
    path.parent.mkdir(parents=True, exist_ok=True)
    grids = [
        GridFields(mesh, {"displacement": time * mesh.points, "status": mesh.points[:, 0]}, {"young": np.ones(1)}, name)
        for name, mesh in zip(NAMES, (HEXAHEDRON, TETRAHEDRON), strict=True)
    ]
    write_grids(MPI.COMM_SELF, path, grids, time, "bodies")
    return path


def test_grids_are_read_by_their_names(tmp_path):
    path = written(tmp_path / "solution.xdmf", 2.0)
    grids = read_grids(path)
    assert list(grids) == list(NAMES) and [grid.cell for grid in grids.values()] == ["Hexahedron", "Tetrahedron"]
    groups = grids_of(path)
    assert groups == {"lower": "lower", "upper part": "upper_part"}
    for name, mesh in zip(NAMES, (HEXAHEDRON, TETRAHEDRON), strict=True):
        grid = grids[name]
        assert np.array_equal(grid.points, mesh.points) and np.array_equal(grid.cells, mesh.cells)
        assert np.array_equal(grid.fields["displacement"], 2.0 * mesh.points) and grid.on_cells == {"young"}
        assert np.array_equal(grids[name].fields["status"], mesh.points[:, 0])


def test_pyvista_reads_them_and_their_series(tmp_path):
    pyvista = pytest.importorskip("pyvista")
    steps = [(f"steps/{number:04d}", float(number)) for number in (1, 2)]
    series = Series(tmp_path, "solution.xdmf")
    for k, (directory, time) in enumerate(steps):
        written(tmp_path / directory / "solution.xdmf", time)
        series.write([name for name, _ in steps[: k + 1]])
    assert pyvista.read(tmp_path / "steps" / "0001" / "solution.xdmf").keys() == list(NAMES)
    reader = pyvista.get_reader(tmp_path / "solution.xdmf")
    assert reader.time_values == [1.0, 2.0]
    for time in reader.time_values:
        reader.set_active_time_value(time)
        blocks = reader.read()
        assert [block.get_cell(0).type.name for block in blocks] == ["HEXAHEDRON", "TETRA"]
        for block in blocks:
            assert np.allclose(block.point_data["displacement"], time * block.points) and "young" in block.cell_data


def test_a_series_reads_each_step_once(tmp_path):
    """Reading all again after each step takes time that grows with the square of their number."""
    series, first = Series(tmp_path, "solution.xdmf"), written(tmp_path / "1" / "solution.xdmf", 1.0)
    series.write(["1"])
    first.unlink()
    written(tmp_path / "2" / "solution.xdmf", 2.0)
    series.write(["1", "2"])
    text = (tmp_path / "solution.xdmf").read_text()
    assert [text.count(f"{step}/solution.h5:/Function/lower/displacement/0") for step in "123"] == [1, 1, 0]
    assert [text.count(f'<Time Value="{time}" />') for time in (1.0, 2.0)] == [3, 3]


def test_groups_differ_whatever_the_names_are():
    assert groups_of(["a b", "a_b", "a:b", "mesh", ""]) == ("a_b", "a_b_2", "a_b_3", "mesh_2", "")


def test_what_a_file_describes(tmp_path):
    assert described(written(tmp_path / "solution.xdmf", 2.0), SOLIDS, "bodies") == 2.0


@pytest.mark.parametrize(
    ("old", "new", "fault"),
    [
        (
            "Function/upper_part/status",
            "Function/lower/status",
            "but <DataItem .* solution.h5:/Function/upper_part/sta",
        ),
        ("Mesh/lower/topology", "Mesh/upper_part/topology", "but <DataItem .* solution.h5:/Mesh/lower/topology"),
        ('"Tetrahedron"', '"Quadrilateral"', "but <Topology TopologyType='Tetrahedron'"),
        ('Name="status"', 'Name="state"', "shows other data than solution.h5 has: Function/lower/state/0, "),
        ('Center="Cell"', 'Center="Node"', "but <Attribute Name='young' AttributeType='Scalar' Center='Cell'>"),
        ('Dimensions="8 3"', 'Dimensions="7 3"', "but <DataItem Dimensions='8 3'"),
        ('Name="bodies"', 'Name="faces"', "but <Grid Name='bodies'"),
        ("</Domain>", '<Grid Name="more" /></Domain>', "has <Grid Name='more'>, but None describes"),
    ],
)
def test_a_file_that_describes_other_data_is_refused(old, new, fault, tmp_path):
    path = written(tmp_path / "solution.xdmf", 1.0)
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(ValueError, match=fault):
        described(path, SOLIDS, "bodies")
