"""Temperature of a body: forces, energies, temperature fields from files."""

import json

import meshio
import numpy as np
import pytest
from case_texts import one_body
from check_runs import run_case
from mpi4py import MPI

import coulomb
from coulomb import Clamp, Contact, ContactProblem, Elasticity, Material, NodalField, Plane
from coulomb.case.case import read_case
from coulomb.case.record import case_record
from coulomb.fem import compat
from coulomb.fem.bodies.loads import ThermalLoad
from coulomb.model.input_echo import loads_of
from coulomb.recheck import check

STEEL = Material(2.1e11, 0.3, expansion=1.2e-5)


def linear(x):
    return 300.0 + 40.0 * x[0] - 25.0 * x[1] + 60.0 * x[2]


def heated(temperature=linear, **options):
    return ContactProblem(
        coulomb.box((1.0, 0.5, 0.4), (3, 2, 2)),
        options.pop("material", STEEL),
        [Clamp("top")],
        Contact("bottom", 0.3, foundation=Plane((0.0, 0.0, -1e-5), (0.0, 0.0, 1.0))),
        temperature=temperature,
        **options,
    )


def written(path, kind, cells=(2, 2, 2), lengths=(1.0, 0.5, 0.4), scale=1.0, values=linear):
    """A file with the temperature on a mesh of its own, in metres over scale."""
    if kind == "dolfinx":
        domain = coulomb.box(lengths, cells, "tetrahedron", MPI.COMM_SELF).domain
        field = compat.fem.Function(compat.functionspace(domain, 1), name="T")
        field.interpolate(values)
        with compat.io.XDMFFile(MPI.COMM_SELF, str(path), "w") as file:
            file.write_mesh(domain)
            file.write_function(field)
        return path
    degree = 2 if kind == "tetra10" else 1
    cell = "tetrahedron" if degree == 2 else "hexahedron"
    domain = coulomb.box(lengths, cells, cell, MPI.COMM_SELF, degree=degree).domain
    x, rows = domain.geometry.x, compat.cell_geometry(domain)
    order = [0, 1, 3, 2, 4, 5, 7, 6] if degree == 1 else [0, 1, 2, 3, 9, 6, 8, 7, 5, 4]
    block = ("hexahedron" if degree == 1 else "tetra10", rows[:, order])
    mesh = meshio.Mesh(x / scale, [block], point_data={"T": values(x.T), "other": x[:, 0]})
    mesh.write(path, {".msh": "gmsh"}.get(path.suffix))
    return path


@pytest.mark.parametrize(
    ("name", "kind"), [("T.vtu", "hexahedron"), ("T.msh", "tetra10"), ("T.xdmf", "meshio"), ("T.xdmf", "dolfinx")]
)
def test_field_from_a_file_on_another_mesh(tmp_path, name, kind):
    """A linear field is exact inside cells, at nodes, and beside the surface."""
    field = NodalField.from_file(written(tmp_path / name, kind), "T")
    x = np.random.default_rng(2).uniform(0.0, 1.0, (3, 300)) * [[1.0], [0.5], [0.4]]
    assert field(x) == pytest.approx(linear(x))
    corners = np.array([[0.0, 1.0, 0.5], [0.0, 0.5, 0.25], [0.0, 0.4, 0.4]])
    assert field(corners) == pytest.approx(linear(corners), rel=1e-14)
    outside = np.array([[0.3], [0.2], [0.42]])  # nearer than a quarter of an edge: the value at the surface
    assert field(outside) == pytest.approx(linear(np.array([[0.3], [0.2], [0.4]])))


def test_values_at_nodes_of_the_field_are_exact(tmp_path):
    """Also those in the middle of edges of second-order cells: no interpolation."""
    field = NodalField.from_file(written(tmp_path / "T.vtu", "tetra10", values=lambda x: 1e3 * x[0] ** 2), "T")
    x = coulomb.box((1.0, 0.5, 0.4), (4, 4, 4)).domain.geometry.x
    assert field(x.T) == pytest.approx(1e3 * x[:, 0] ** 2, abs=1e-9)


def test_small_cells_beside_large_ones():
    """Cells are found whatever their size: a graded mesh, in which 20 small cells are nearer than the right one."""

    def graded(x):
        return np.array([x[0] ** 6, x[1], x[2]])

    domain = coulomb.box((1.0, 1.0, 1.0), (14, 3, 3), "tetrahedron", MPI.COMM_SELF, graded).domain
    x, rows = domain.geometry.x, compat.cell_geometry(domain).astype(np.int64)
    at = np.random.default_rng(3).uniform(size=(3, 500))
    assert NodalField(x, rows, linear(x.T))(at) == pytest.approx(linear(at))


def test_field_that_does_not_cover_the_body(tmp_path):
    path = written(tmp_path / "T.vtu", "hexahedron", lengths=(0.8, 0.5, 0.4))
    with pytest.raises(ValueError, match=r"temperature: .*T\.vtu: T does not cover the body: .* no cell at x = 1, "):
        heated(NodalField.from_file(path, "T"))
    millimetres = written(tmp_path / "mm.vtu", "hexahedron", scale=1e-3)
    with pytest.raises(ValueError, match=r"\(is scale, the metres per unit of length, right\?\)"):
        heated(NodalField.from_file(millimetres, "T", 1e-4))
    body = heated(NodalField.from_file(millimetres, "T", 1e-3)).elasticity
    assert body.at(0.0).temperature.change == pytest.approx(linear(body.x.T))


@pytest.mark.parametrize(
    ("name", "field", "message"),
    [
        ("T.vtu", "heat", r"has no field 'heat' with values at nodes; it has 'T', 'other'"),
        ("T.csv", "T", r"a field is read from files that end in \.xdmf, \.vtu"),
        ("gone.vtu", "T", r"gone\.vtu: cannot be read: No such file"),
        ("gone.xdmf", "T", r"gone\.xdmf: cannot be read: No such file"),
    ],
)
def test_wrong_files(tmp_path, name, field, message):
    written(tmp_path / "T.vtu", "hexahedron")
    with pytest.raises(ValueError, match=message):
        NodalField.from_file(tmp_path / name, field)


def test_shell_cells_and_vectors_are_refused(tmp_path):
    x = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    flat = meshio.Mesh(x, [("triangle", [[0, 1, 2]])], point_data={"T": x[:, 0], "v": x})
    meshio.write(tmp_path / "flat.vtu", flat)
    with pytest.raises(ValueError, match=r"has no solid cells, .* \(cells: triangle\)"):
        NodalField.from_file(tmp_path / "flat.vtu", "T")
    with pytest.raises(ValueError, match=r"v must be one number per node, but has shape \(3, 3\)"):
        NodalField.from_file(tmp_path / "flat.vtu", "v")


def test_wrong_temperatures():
    with pytest.raises(ValueError, match="temperature must be a finite number in kelvin or degrees, but is nan"):
        heated(float("nan"))
    with pytest.raises(ValueError, match="reference_temperature must be a finite number"):
        heated(300.0, reference_temperature="cold")
    with pytest.raises(ValueError, match=r"temperature: .* not finite"):
        heated(lambda x: np.where(x[0] > 0.9, np.nan, 300.0))
    with pytest.raises(ValueError, match="expansion of every material, but the material has none: expansion, 1/K"):
        heated(300.0, material=Material(2.1e11, 0.3))
    with pytest.raises(ValueError, match="expansion must be a finite number in 1/K, but is 'big'"):
        Material(2.1e11, 0.3, expansion="big")


@pytest.mark.parametrize(("cell", "degree"), [("tetrahedron", 2), ("hexahedron", 2)])
def test_free_expansion_has_no_stress(cell, degree):
    """A linear temperature bends a free body without stress, exactly in second order: u is quadratic."""
    mesh = coulomb.box((1.0, 0.5, 0.4), (2, 1, 1), cell, degree=degree)
    body = Elasticity(mesh, STEEL, [Clamp("left")], thermal=ThermalLoad(linear, 300.0))
    a, (gx, gy, gz) = STEEL.expansion, (40.0, -25.0, 60.0)
    T = linear(body.x.T) - 300.0
    squares = 0.5 * (body.x**2).sum(axis=1)
    u = a * (T[:, None] * body.x - np.outer(squares, [gx, gy, gz]))
    loading = body.at(0.0)
    assert np.abs(body.internal_force(u) - loading.load).max() <= 1e-12 * np.abs(loading.load).max()
    stress = body.cell_fields(body.function(u), loading)[0].x.array
    assert stress.max() <= 1e-12 * STEEL.young * a * np.abs(T).max()


def test_load_of_its_own_kind():
    """Its forces and moments are zero; the work of the load is the elastic energy of the expansion that it causes."""
    problem = heated(linear, reference_temperature=300.0, temperature_amplitude=[(0.0, 0.0), (2.0, 1.0)])
    (load,) = loads_of(problem, [0.0, 1.0, 2.0])
    assert load.what == "thermal, temperature change from -12.5 to 64 K" and load.time == 2.0
    assert not np.any(load.force) and not np.any(load.moment)
    assert problem.at(1.0).loading.temperature.change == pytest.approx(0.5 * (linear(problem.elasticity.x.T) - 300.0))
    assert not np.any(problem.loading.load)
    solution = problem.at(2.0).solve()
    (found,) = solution.loads
    assert (found.kind, found.face) == ("thermal", None) and solution.certificate.passed
    assert np.linalg.norm(found.force) <= 1e-12 * found.nodal and solution.force_balance.balance <= 1e-12


CASE = one_body((1.0, 0.5, 0.4), (3, 2, 2), 2.1e11, expansion=1.2e-5)
CASE += """\
[temperature]
file = "T.vtu"
field = "T"
reference = 290.0
[[clamp]]
face = "top"
[contact]
face = "bottom"
friction = 0.3
"""


def test_case_with_a_field_from_a_file(tmp_path):
    """The name is relative to the case; `check` reads the file again, and resume notices if it has changed."""
    written(tmp_path / "T.vtu", "hexahedron")
    run = run_case(CASE, tmp_path / "run")
    summary = json.loads((run / "summary.json").read_text())
    assert summary["temperature_change"] == pytest.approx({"min": -2.5, "max": 74.0})
    assert check(run).passed
    settings = read_case(tmp_path / "run.toml")
    assert set(case_record(settings, MPI.COMM_SELF)["files"]) == {"temperature.file"}
    written(tmp_path / "T.vtu", "hexahedron", values=lambda x: linear(x) + 1e-3)
    faults = "\n".join(check(run).faults)
    assert "solution.xdmf: temperature_change" in faults and "solution.xdmf: load" in faults
    (tmp_path / "T.vtu").unlink()
    assert any("T.vtu is not there" in line for line in check(run).trusted)
