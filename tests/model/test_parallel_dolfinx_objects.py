"""Objects of DOLFINx and UFL as input and output: the same answers as with numbers; run alone, or with mpirun."""

import pickle
from types import SimpleNamespace
from typing import NamedTuple

import numpy as np
import pytest
import ufl
from mpi4py import MPI
from ranks import everywhere, same_error
from test_parallel_heat import two_bars
from user_forms import Script

import coulomb
from coulomb import (
    Clamp,
    Contact,
    ContactProblem,
    Material,
    NamedMesh,
    Plane,
    Pressure,
    Spring,
    ThermalContact,
    Traction,
)
from coulomb.fem import compat
from coulomb.fem.compat import fem
from coulomb.fem.geometry import evaluate_numbers, evaluate_vectors

comm = MPI.COMM_WORLD
RUBBER = Material(1e5, 0.3)
BOX = coulomb.box((1.0, 1.0, 0.5), (4, 3, 2), "tetrahedron")
HEXES = coulomb.box((1.0, 1.0, 0.5), (4, 3, 2))


def quadrature_space():
    if hasattr(fem, "functionspace"):
        import basix.ufl

        return fem.functionspace(BOX.domain, basix.ufl.quadrature_element("tetrahedron", degree=2))
    element = ufl.FiniteElement("Quadrature", BOX.domain.ufl_cell(), 2, quad_scheme="default")
    return fem.FunctionSpace(BOX.domain, element)


def fraction(x):
    return 0.1 + 0.2 * x[0]


def interpolated(value, degree=1, shape=(), family="Lagrange", domain=None):
    function = fem.Function(compat.functionspace(domain or BOX.domain, degree, shape, family), name="mine")
    function.interpolate(value)
    return function


def expression(domain):
    return 0.1 + 0.2 * ufl.SpatialCoordinate(domain)[0]


def problem(on=BOX, **changes):
    contact = {name: changes.pop(name) for name in ("friction", "gap", "cohesion", "foundation") if name in changes}
    given = {
        "material": RUBBER,
        "clamps": [Clamp("left")],
        "tractions": [Traction("top", (200.0, 0.0, -900.0))],
        "contact": Contact("bottom", **{"friction": 0.3, **contact}),
    }
    return ContactProblem(on, **{**given, **changes})


def answer(**changes):
    solution = problem(**changes).solve(1e-11)
    assert solution.certificate.passed
    return solution.displacement


def same(one, other):
    assert np.abs(one - other).max(initial=0.0) <= 1e-12 * comm.allreduce(np.abs(other).max(initial=0.0), op=MPI.MAX)


def test_values_that_change_between_answers():
    """Of contact, then of loads and material too: the answers of problems made with these numbers."""
    friction, gap = interpolated(lambda x: 0.3 + 0.0 * x[0]), fem.Constant(BOX.domain, 0.0)
    young, load = interpolated(lambda x: 5e4 + 0.0 * x[0], 0, (), "DG"), fem.Constant(BOX.domain, (0.0, 0.0, -900.0))
    posed = problem(
        friction=friction, gap=1e-3 * gap, material=Material(2.0 * young, 0.3), tractions=[Traction("top", load)]
    )
    first = posed.solve(1e-11)
    before = first.displacement.copy()
    gap.value, friction.x.array[:] = 0.5, 0.1
    pressed = [Traction("top", (0.0, 0.0, -900.0))]
    same(posed.solve(1e-11).displacement, answer(friction=0.1, gap=5e-4, tractions=pressed))
    load.value[:], young.x.array[:] = (50.0, 0.0, -700.0), 8e4
    given = {"material": Material(1.6e5, 0.3), "tractions": [Traction("top", (50.0, 0.0, -700.0))]}
    same(posed.at(0.0).solve(1e-11).displacement, answer(friction=0.1, gap=5e-4, **given))
    assert np.array_equal(first.displacement, before)


OBJECTS = {
    "P1": lambda domain: interpolated(fraction, domain=domain),
    "P2": lambda domain: interpolated(fraction, 2, domain=domain),
    "DG1": lambda domain: interpolated(fraction, 1, (), "DG", domain),
    "expression of UFL": expression,
    "fem.Expression": lambda domain: fem.Expression(
        expression(domain), compat.interpolation_points(compat.functionspace(domain, 1))
    ),
    "component": lambda domain: interpolated(lambda x: (x[1], fraction(x), x[0]), 1, (3,), domain=domain)[1],
}


VALUE = r"expressions of UFL; a fem.Constant has one in \.value"
MISPLACED = {
    "factor": (lambda c: problem(tractions=[Traction("top", (0, 0, -9), amplitude=c)]), "amplitude must .* a Constant"),
    "its function": (lambda c: problem(tractions=[Traction("top", (0, 0, -9), amplitude=lambda t: c)]), VALUE),
    "motion": (lambda c: ContactProblem(BOX, RUBBER, [], Contact("bottom", 0.1, motion=lambda t: (0, 0, c))), VALUE),
    "function": (lambda c: problem(friction=lambda x: c + x[0]), "friction: .*" + VALUE),
    "force": (lambda c: coulomb.TotalForce("top", (0.0, 0.0, c)), "three finite numbers"),
    "probe": (lambda c: coulomb.Probe("middle", (0.0, 0.0, c)), "three finite numbers"),
    "poisson": (lambda c: Material(1e5, c), "poisson must be a number in .*, but is a Constant"),
    "shape": (lambda c: problem(tractions=[Traction("top", c)]), r"values of shape \(\); three components"),
    "vector": (lambda c: problem(friction=fem.Constant(BOX.domain, (0.1, 0.2, 0.3))), r"shape \(3,\); a number"),
    "text": (lambda c: problem(tractions=[Pressure("top", "3")]), "pressure on 'top': must be a number .* '3'"),
    "cohesion": (lambda c: problem(cohesion="30"), "cohesion must be a number >= 0, but is '30'"),
}


@pytest.mark.parametrize("kind", MISPLACED)
def test_misplaced_values(kind):
    """float() of a constant of UFL calls itself for ever: what takes numbers says so, and where they are."""
    make, message = MISPLACED[kind]
    with pytest.raises(ValueError, match=message):
        make(fem.Constant(BOX.domain, 0.5))


@pytest.mark.parametrize("cells", [BOX, HEXES], ids=["tetrahedra", "hexahedra"])
@pytest.mark.parametrize("kind", OBJECTS)
def test_values_at_points(cells, kind):
    """At nodes, and inside of cells, where second order is exact; every rank has other points, one of them none."""
    x = np.random.default_rng(7 + comm.rank).random((0 if comm.rank == 1 else 20, 3)) * (1.0, 1.0, 0.5)
    x[:6] = cells.domain.geometry.x[:6] if len(x) else x
    found = evaluate_numbers(OBJECTS[kind](cells.domain), x, "friction", comm)
    assert found.shape == (len(x),) and np.abs(found - fraction(x.T)).max(initial=0.0) <= 1e-12


def test_vectors_constants_and_jumps():
    x = np.array([[0.5, 0.5, 0.5], [0.25, 1 / 3, 0.0]])
    function = interpolated(lambda x: (x[0], 2.0 * x[1], -x[2]), 1, (3,))
    same(evaluate_vectors(function, x, "traction", comm), x * (1.0, 2.0, -1.0))
    place = ufl.as_vector((0, ufl.SpatialCoordinate(BOX.domain)[1], 2.0))
    same(evaluate_vectors(place, x, "traction", comm), np.column_stack([[0, 0], x[:, 1], [2, 2]]))
    for constant in (fem.Constant(BOX.domain, (1.0, 2.0, 3.0)), ufl.as_vector((1.0, 2.0, 3.0))):
        same(evaluate_vectors(constant, x, "traction", comm), np.array([[1.0, 2.0, 3.0]] * 2))
    # at a node of hexahedra the mean of the cells that touch: of 0 and 1 on both sides of x = 1/2
    step = interpolated(lambda x: np.where(x[0] > 0.5, 1.0, 0.0), 0, (), "DG", HEXES.domain)
    places = np.array([[0.5, 1 / 3, 0.0], [0.25, 0.0, 0.0], [0.75, 1.0, 0.5], [0.6, 0.1, 0.1]])
    same(evaluate_numbers(step, places, "friction", comm), np.array([0.5, 0.0, 1.0, 1.0]))


@pytest.mark.parametrize(
    ("given", "number"),
    [
        ({"friction": lambda d: fem.Constant(d, 0.25)}, {"friction": 0.25}),
        ({"friction": lambda d: interpolated(fraction)}, {"friction": fraction}),
        ({"gap": lambda d: 1e-3 * expression(d), "cohesion": lambda d: 100 * interpolated(fraction, 2)},
         {"gap": lambda x: 1e-3 * fraction(x), "cohesion": lambda x: 100.0 * fraction(x)}),
    ],
)  # fmt: skip
def test_contacts(given, number):
    same(answer(**{name: value(BOX.domain) for name, value in given.items()}), answer(**number))


def test_loads_materials_springs_and_temperature():
    domain = BOX.domain
    height = ufl.SpatialCoordinate(domain)[2]
    hot = Material(interpolated(lambda x: 1e5 * (1.0 + x[0]), 0, (), "DG"), 0.3, expansion=1e-4)
    objects = {
        "material": hot,
        "tractions": [
            Traction("top", fem.Constant(domain, (200.0, 0.0, -900.0))),
            Pressure("right", interpolated(lambda x: 500.0 * x[1])),
        ],
        "springs": [Spring("back", interpolated(lambda x: 1e4 * (1.0 + x[0])))],
        "temperature": 10.0 + 4.0 * height,
        "body_force": ufl.as_vector((0, 0, -100 * height)),
    }
    functions = {
        "material": Material(lambda x: 1e5 * (1.0 + x[0]), 0.3, expansion=1e-4),
        "tractions": [Traction("top", (200.0, 0.0, -900.0)), Pressure("right", lambda x: 500.0 * x[1])],
        "springs": [Spring("back", lambda x: 1e4 * (1.0 + x[0]))],
        "temperature": lambda x: 10.0 + 4.0 * x[2],
        "body_force": lambda x: (0.0 * x[2], 0.0 * x[2], -100.0 * x[2]),
    }
    same(answer(**objects), answer(**functions))
    plain = {"springs": [Spring("back", 1e4)]}
    of_place = {"material": Material(lambda x: 1e5 + 0.0 * x[0], 0.3), "springs": [Spring("back", lambda x: 1e4)]}
    assert np.abs(answer(**of_place) - answer(**plain)).max(initial=0.0) <= 1e-12


def test_conductance():
    """Of a contact between bars, with the temperatures of its formula in test_parallel_heat."""
    place = ufl.SpatialCoordinate(coulomb.box((0.02, 0.02, 0.05), (2, 1, 2)).domain)
    one, other = (
        np.sort(everywhere(two_bars(ThermalContact(conductance=value)).solve().heat.change))
        for value in (2000.0 + 1e4 * place[0], lambda x: 2000.0 + 1e4 * x[0])
    )
    # on ranks the meshes of the two are divided differently, and the answers agree to the solver's tolerance
    assert np.abs(one - other).max() <= (1e-12 if comm.size == 1 else 1e-7) * np.abs(other).max()


def test_a_foundation_that_is_a_function():
    plane = Plane((0.0, 0.0, -1e-3), (0.0, 0.0, 1.0))
    one, other = answer(foundation=lambda x: x[2] + 1e-3), answer(foundation=plane)
    assert np.abs(one - other).max(initial=0.0) <= 1e-9 * comm.allreduce(np.abs(other).max(initial=0.0), op=MPI.MAX)


class Data(NamedTuple):
    """As MeshData of DOLFINx 0.11."""

    mesh: object
    cell_tags: object
    facet_tags: object
    ridge_tags: object
    peak_tags: object
    physical_groups: dict


class Group(NamedTuple):
    dim: int
    tag: int


def mesh_data():
    domain = BOX.domain
    facets = np.concatenate([BOX.faces[name] for name in ("bottom", "top", "left")]).astype(np.int32)
    values = np.repeat([2, 3, 9], [len(BOX.faces[name]) for name in ("bottom", "top", "left")]).astype(np.int32)
    cells = np.arange(domain.topology.index_map(3).size_local, dtype=np.int32)
    tags = compat.meshtags(domain, 2, facets, values), compat.meshtags(domain, 3, cells, np.full_like(cells, 2))
    groups = {"bottom": Group(2, 2), "top": Group(2, 3), "all": Group(3, 2)}
    return Data(domain, tags[1], tags[0], None, None, groups)


def test_meshes_and_faces():
    data = mesh_data()
    named = NamedMesh(data)
    assert set(named.faces) == {"bottom", "top", "9"} and list(named.cells) == ["all"]
    by_value = NamedMesh(data.mesh, data.facet_tags, data.cell_tags)
    assert set(by_value.faces) == {"2", "3", "9"} and list(by_value.cells) == ["2"]
    located = {"bottom": lambda x: np.isclose(x[2], 0.0), "top": (data.facet_tags, 3), "left": BOX.faces["left"]}
    for faces in (located, {name: one for name, one in BOX.faces.items() if name in located}):
        found = NamedMesh(data.mesh, faces)
        assert all(np.array_equal(np.sort(found.faces[name]), np.sort(BOX.faces[name])) for name in located)
    expected = answer(clamps=[])
    same(answer(on=data, clamps=[], material={"all": RUBBER}), expected)
    same(answer(on=tuple(data[:3]), clamps=[], contact=Contact("2", 0.3), tractions=[
        Traction("3", (200.0, 0.0, -900.0))]), expected)  # fmt: skip
    assert list(coulomb.join(one=data).bodies["one"].faces) == list(named.faces)
    script = Script(BOX, 1)
    assert set(coulomb.Body(script.elasticity(1e5, 0.3), faces=data).mesh.faces) == set(named.faces)


def test_words():
    data, script = mesh_data(), Script(BOX, 1)
    a = script.elasticity(1e5, 0.3)
    groups = same_error(lambda: coulomb.Body(a, faces=data.physical_groups))
    assert "physical group" in groups and "faces=data" in groups
    assert "tuple of int, int" in same_error(lambda: coulomb.Body(a, faces={"sole": (2, 4)}))
    assert "facet_tags" in same_error(lambda: problem(on=data.mesh))
    assert "2 blocks" in same_error(lambda: coulomb.Body([[a, None], [None, a]], faces=data))
    assert "trial or test functions" in same_error(lambda: problem(friction=script.u[0]))
    assert "Pressure acts along" in same_error(lambda: problem(friction=ufl.FacetNormal(BOX.domain)[0]))
    assert "shape (3," in same_error(lambda: problem(friction=fem.Constant(BOX.domain, (1.0, 2.0, 3.0))))
    at_points = fem.Function(quadrature_space(), name="mine")
    assert "the function 'mine' has values at quadrature points alone" in same_error(
        lambda: problem(friction=at_points)
    )
    assert "has a function with values at" in same_error(lambda: problem(friction=2.0 * at_points))
    far = coulomb.moved(BOX, (5.0, 0.0, 0.0)).domain
    assert "the function 'mine' has no value at" in same_error(
        lambda: problem(friction=interpolated(fraction, domain=far))
    )
    assert "must be >= 0 everywhere" in same_error(lambda: problem(friction=interpolated(lambda x: x[0] - 0.9)))
    assert "a function of x" in same_error(lambda: Contact("bottom", 0.3, foundation=7.0))
    rubber = coulomb.NeoHookean(interpolated(fraction), 0.3)
    assert "young must be a number" in same_error(lambda: problem(material=rubber, kinematics="large"))
    assert "must be > 0 everywhere" in same_error(lambda: problem(material=Material(lambda x: 0.0 * x[0], 0.3)))
    single = SimpleNamespace(
        topology=SimpleNamespace(dim=3), geometry=SimpleNamespace(x=np.zeros((1, 3), dtype=np.float32))
    )
    assert "float32" in same_error(lambda: NamedMesh(single, {}))


@pytest.mark.parametrize(("cells", "degree"), [("hexahedron", 1), ("tetrahedron", 2)])
def test_fields_as_functions(cells, degree):
    """Integrals of the functions over the face are the totals; the certificate and totals can be pickled."""
    script = Script(coulomb.box((1.0, 1.0, 0.5), (3, 3, 2), cells), degree)
    L = ufl.inner(script.constant((200.0, 0.0, -900.0)), script.v) * script.ds("top")
    body = coulomb.Body(script.elasticity(1e5, 0.3), L, [script.bc((0.0, 0.0, 0.0), "left")], faces=script.mesh)
    solution = ContactProblem(body, Contact("bottom", 0.3)).solve()
    pressure, traction, total = solution.function("pressure"), solution.function("traction"), solution.forces
    assert pressure is solution.function("pressure") and solution.function is solution.function("displacement")

    def integral(form):
        return comm.allreduce(fem.assemble_scalar(fem.form(form)))

    assert integral(pressure * script.ds("bottom")) == pytest.approx(total["normal_force"], rel=1e-12)
    force = [integral(traction[k] * script.ds("bottom")) for k in range(3)]
    assert force == pytest.approx(total["force"], rel=1e-9, abs=1e-9 * total["normal_force"])
    assert integral(pressure * script.ds("top")) == pytest.approx(0.0, abs=1e-9 * total["normal_force"])
    nodes = script.nodes("bottom")
    status = solution.function("status")
    assert np.count_nonzero(status.x.array != 3.0) <= comm.allreduce(len(nodes)) and status.name == "status"
    assert comm.allreduce(int(np.sum(status.x.array != 3.0))) > 0
    jump = solution.function("+") - solution.function("-")  # still a Function of UFL
    assert integral(ufl.inner(jump, jump) * ufl.dS) == pytest.approx(0.0, abs=1e-20)
    assert "there is no field 'presure'; there are displacement, pressure" in same_error(
        lambda: solution.function("presure")
    )
    assert "\n" not in repr(solution) and repr(solution).startswith("Solution(converged, certificate passed, time 0")
    assert pickle.loads(pickle.dumps(solution.forces)) == total and pickle.dumps(solution.certificate)
    with pytest.raises(TypeError, match=r"pickle solution\.certificate"):
        pickle.dumps(solution)


def test_functions_of_a_pair():
    lower = coulomb.box((1.0, 1.0, 0.5), (3, 3, 2))
    upper = coulomb.moved(coulomb.box((1.0, 1.0, 0.5), (2, 2, 2), "tetrahedron"), (0.0, 0.0, 0.5))
    pair = Contact("lower:top", 0.3, against="upper:bottom")
    loads = [Pressure("upper:top", 100.0)]
    joined = coulomb.join(lower=lower, upper=upper)
    solution = ContactProblem(joined, RUBBER, [Clamp("lower:bottom")], pair, loads).solve()
    for body, facets, sign in (("lower", lower.faces["top"], -1.0), ("upper", upper.faces["bottom"], 1.0)):
        script = Script(lower if body == "lower" else upper, 1)
        traction = solution.functions[body]("traction")
        assert traction is solution.functions[body]("traction") and len(facets) <= len(traction.x.array)
        face = "top" if body == "lower" else "bottom"
        force = comm.allreduce(fem.assemble_scalar(fem.form(traction[2] * script.ds(face))))
        assert force == pytest.approx(sign * 100.0, rel=1e-9)
    assert solution.forces["normal_force"] == pytest.approx(100.0, rel=1e-9)
    assert "several bodies" in same_error(lambda: solution.function)
