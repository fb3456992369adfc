"""Loads against formulas; on any number of ranks: `mpirun -n 3 python -m pytest tests/fem/bodies/test_loads.py`."""

import numpy as np
import pytest
from mesh_files import BoxFile
from mpi4py import MPI
from scipy.integrate import dblquad

import coulomb
from coulomb import Clamp, Contact, ContactProblem, Elasticity, Material, Plane, Pressure, TotalForce, Traction
from coulomb.fem.meshes.mesh_parts import corners_of

comm = MPI.COMM_WORLD
CELLS = ["hexahedron", "tetrahedron"]
FACES = ("left", "right", "front", "back", "bottom", "top")
SOFT = Material(2e9, 0.3)
P = 3e5
CENTRE, RADIUS = np.array([0.3, 0.2, -0.9]), 2.0


def cap(n, cell):
    """A cube whose top is a part of a sphere about CENTRE, and whose facets there are not plane."""

    def place(x):
        top = CENTRE[2] + np.sqrt(RADIUS**2 - (x[0] - CENTRE[0]) ** 2 - (x[1] - CENTRE[1]) ** 2)
        return np.array([x[0], x[1], x[2] * top])

    return coulomb.box((1.0, 1.0, 1.0), (n, n, n), cell, place=place)


def resultants(mesh, *loads, material=SOFT, **others):
    """Force and moment about the origin of every load, over all ranks."""
    body = Elasticity(mesh, material, [Clamp("bottom")], loads, **others)
    found = []
    for applied in body.loads:
        force, moment = applied.nodal_force.sum(axis=0), np.cross(body.x, applied.nodal_force).sum(axis=0)
        found.append((comm.allreduce(force), comm.allreduce(moment)))
    return found


def facets(mesh, face):
    """Corners of all ranks' facets of a face, shape (k, corners, 3)."""
    domain = mesh.domain
    mine = domain.geometry.x[corners_of(domain, mesh.facets(face, "test"))]
    return np.concatenate(comm.allgather(mine))


def vector_areas(corners):
    """Of plane triangles, and of bilinear patches, whose vector area is half the product of the diagonals."""
    if corners.shape[1] == 3:
        return 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    a, b, c, d = (corners[:, k] for k in (0, 1, 3, 2))  # in DOLFINx the last two are exchanged
    return 0.5 * np.cross(c - a, d - b)


@pytest.mark.parametrize("cell", CELLS)
def test_pressure_on_a_plane_face(cell):
    """Force p A and moment, exactly: for constant pressure, and one that is linear in x and y."""
    mesh = coulomb.box((3.0, 1.0, 0.5), (5, 3, 2), cell)
    constant, linear = resultants(mesh, Pressure("top", P), Pressure("top", lambda x: P * (x[0] - 2.0 * x[1])))
    assert constant[0] == pytest.approx([0.0, 0.0, -3.0 * P], rel=1e-12, abs=1e-9 * P)
    assert constant[1] == pytest.approx([-1.5 * P, 4.5 * P, 0.0], rel=1e-12, abs=1e-9 * P)
    assert linear[0] == pytest.approx([0.0, 0.0, -1.5 * P], rel=1e-12, abs=1e-9 * P)  # 9/2 - 2 * 3/2
    # integrals of y p and x p over the face: 9/4 - 2, and 9 - 9/2
    assert linear[1] == pytest.approx([-0.25 * P, 4.5 * P, 0.0], rel=1e-12, abs=1e-9 * P)


@pytest.mark.parametrize("cell", CELLS)
def test_pressure_on_a_curved_face(cell):
    """On the facets exactly p times their vector areas; on the sphere p times the projected areas, to second order."""
    exact = np.array([projected(0), projected(1), 1.0])
    errors, moments = [], []
    for n in (4, 8):
        mesh = cap(n, cell)
        ((force, moment),) = resultants(mesh, Pressure("top", P))
        areas = vector_areas(facets(mesh, "top"))
        areas *= np.sign(areas[:, 2:])  # outward
        assert force == pytest.approx(-P * areas.sum(axis=0), rel=1e-12)
        assert force[2] == pytest.approx(-P, rel=1e-12)  # the projection of the facets is the unit square
        errors.append(np.abs(force / -P - exact)[:2].max())
        moments.append(np.linalg.norm(moment - np.cross(CENTRE, force)) / P)  # about the centre: 0 on the sphere
    assert errors[0] < 2e-3 and errors[1] < errors[0] / 3.5
    assert moments[0] < 2e-3 and moments[1] < moments[0] / 3.5


def projected(axis):
    """Area of the sphere's part projected along x or y, with the sign of the normal."""

    def slope(y, x):
        dx, dy = x - CENTRE[0], y - CENTRE[1]
        return (dx, dy)[axis] / np.sqrt(RADIUS**2 - dx**2 - dy**2)

    return dblquad(slope, 0.0, 1.0, 0.0, 1.0)[0]


@pytest.mark.parametrize("cell", CELLS)
def test_buoyancy_is_the_weight_of_the_fluid(cell):
    """Archimedes: hydrostatic pressure on all faces has minus the force and moment of the fluid's weight, exactly."""
    density, g = 1025.0, 9.81
    hydrostatic = [Pressure(face, lambda x: density * g * (5.0 - x[2])) for face in FACES]
    fluid = Material(2e9, 0.3, density)
    weight, *pressures = resultants(cap(3, cell), *hydrostatic, material=fluid, gravity=(0.0, 0.0, -g))
    scale = density * g
    for k in (0, 1):
        assert np.sum([found[k] for found in pressures], axis=0) == pytest.approx(-weight[k], abs=1e-11 * scale)
    assert weight[0][2] < -1.0 * scale  # more than a cubic metre


@pytest.mark.parametrize("cell", CELLS)
def test_total_force_is_spread_uniformly(cell):
    force = np.array([1e3, -2e3, 5e3])
    ((total, moment),) = resultants(coulomb.box((3.0, 1.0, 2.0), (4, 3, 2), cell), TotalForce("right", force))
    assert total == pytest.approx(force, rel=1e-13)
    assert moment == pytest.approx(np.cross([3.0, 0.5, 1.0], force), rel=1e-12)
    ((total, _),) = resultants(cap(3, cell), TotalForce("top", force))
    assert total == pytest.approx(force, rel=1e-13)


@pytest.mark.parametrize("cell", CELLS)
def test_linear_traction(cell):
    """Force and moment of t = (y, x - z, 1 + 2 x) on the top of a box, exactly."""
    mesh = coulomb.box((2.0, 1.0, 1.0), (4, 3, 2), cell)
    ((force, moment),) = resultants(mesh, Traction("top", lambda x: np.array([x[1], x[0] - x[2], 1.0 + 2.0 * x[0]])))
    assert force == pytest.approx([1.0, 0.0, 6.0], rel=1e-12, abs=1e-12)  # of y, x - 1, 1 + 2x over 2 by 1
    # y t_z - z t_y, z t_x - x t_z, x t_y - y t_x, with z = 1: 3 - 0, 1 - (2 + 16/3), (8/3 - 2) - 2/3
    assert moment == pytest.approx([3.0, 1.0 - 22.0 / 3.0, 0.0], rel=1e-12, abs=1e-12)


def test_a_function_is_evaluated_on_its_face_only():
    ((force, _),) = resultants(coulomb.box((1, 1, 1), (2, 2, 2)), Traction("top", lambda x: np.sqrt(x[2] - 1.0) + x))
    assert force == pytest.approx([0.5, 0.5, 1.0], rel=1e-12)


@pytest.mark.parametrize("cell", CELLS)
def test_nodes_have_exactly_the_coordinates_of_the_mesh(cell):
    """So sqrt(x) has a value at x = 0 and sqrt(3 - x) at x = 3, where rounding would give nan."""
    mesh = coulomb.box((3.0, 1.0, 1.0), (6, 3, 3), cell)
    body = Elasticity(mesh, SOFT, [Clamp("bottom")])
    assert set(map(tuple, body.x)) <= set(map(tuple, mesh.domain.geometry.x))
    resultants(mesh, *(Pressure(face, lambda x: np.sqrt(x[0]) + np.sqrt(3.0 - x[0]) + np.sqrt(x[1])) for face in FACES))


@pytest.mark.parametrize("cell", CELLS)
def test_weight_of_a_hanging_bar(cell):
    """Reaction rho V g exactly; with nu = 0 on hexahedra the mean stress of each layer is rho g (z below it)."""
    height, area, g, layers = 4.0, 0.25, 9.81, 8
    material = Material(2e11, 0.0, density=7850.0)
    problem = ContactProblem(
        coulomb.box((0.5, 0.5, height), (1, 1, layers), cell),
        material,
        [Clamp("top", "z"), Clamp("left", "x"), Clamp("front", "y")],
        Contact("bottom", 0.3, foundation=Plane((0, 0, -1.0), (0, 0, 1))),
        gravity=(0.0, 0.0, -g),
    )
    u, body = problem.solve().displacement, problem.elasticity
    held = np.isclose(body.x[:, 2], height)
    reaction = comm.allreduce((body.internal_force(u) - problem.loading.load)[held, 2].sum())
    assert reaction == pytest.approx(7850.0 * area * height * g, rel=1e-9)
    lowest = np.isclose(body.x[:, 2], 0.0)
    sunk = comm.allreduce(u[lowest, 2].sum()) / comm.allreduce(int(lowest.sum()))
    assert sunk == pytest.approx(-7850.0 * g * height**2 / 2 / 2e11, rel=1e-9 if cell == "hexahedron" else 0.02)
    if cell == "hexahedron":
        stress = body.stresses(body.function(u))[0].x.array
        middles = (np.arange(layers) + 0.5) * height / layers
        found = np.unique(np.round(np.concatenate(comm.allgather(stress)), 3))
        assert found == pytest.approx(7850.0 * g * middles, rel=1e-8)


def test_density_by_cell_group(tmp_path):
    """Half of the bar, a cubic metre, is three times as heavy as the other half."""
    path = comm.bcast(tmp_path / "part.msh")
    if comm.rank == 0:
        BoxFile().write(path)
    comm.barrier()
    mesh, light, heavy = coulomb.read_mesh(path), Material(2e11, 0.3, 1000.0), Material(2e11, 0.3, 3000.0)
    for materials, weight in (({"soft": light, "stiff": heavy}, -4e4), ({"soft": heavy, "stiff": heavy}, -6e4)):
        body = Elasticity(mesh, materials, [Clamp("left")], gravity=(0.0, 0.0, -10.0))
        found = comm.allreduce(body.loads[0].nodal_force.sum(axis=0))
        assert found == pytest.approx([0.0, 0.0, weight], rel=1e-12, abs=1e-8)


def body_with(*loads, material=SOFT, **others):
    return lambda: resultants(coulomb.box((1, 1, 1), (2, 1, 1)), *loads, material=material, **others)


@pytest.mark.parametrize(
    ("act", "message"),
    [
        (body_with(gravity=(0, -9.81)), r"gravity must be three finite numbers, m/s\^2"),
        (lambda: Material(1e9, 0.3, -7850.0), r"density must be a number of kg/m\^3, not below 0, but is -7850"),
        (lambda: TotalForce("top", (1.0, np.nan, 0.0)), "total force on 'top': the force must be three finite numbers"),
        (lambda: TotalForce("top", 5.0), "total force on 'top': the force must be three finite numbers"),
        (body_with(Pressure("topp", 1.0)), "pressure.*'topp'"),
        (body_with(Pressure("top", np.nan)), "pressure on 'top': the value has entries that are not finite"),
        (body_with(Pressure("top", lambda x: x)), "pressure on 'top': the function must return"),
        (body_with(Pressure("top", lambda x: 1.0 / x[0])), "pressure on 'top': the value has entries that are not"),
    ],
)
@pytest.mark.filterwarnings("ignore:divide by zero")
def test_wrong_loads(act, message):
    with pytest.raises(ValueError, match=message):
        act()
