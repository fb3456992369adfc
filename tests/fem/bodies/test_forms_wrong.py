"""Forms, spaces, conditions and faces that cannot be used, and what is said."""

import numpy as np
import pytest
import ufl
from conftest import without_pictures
from mpi4py import MPI
from user_forms import Script, strain

import coulomb
from coulomb import Clamp, Contact, ContactProblem, Elasticity, Material
from coulomb.fem import compat
from coulomb.fem.bodies import compiled_form
from coulomb.fem.compat import fem, mesh

BOX = coulomb.box((1.0, 1.0, 1.0), (2, 2, 2), "tetrahedron")
S = Script(BOX, 1)
A, L = S.elasticity(1e9, 0.3), ufl.inner(S.constant((0.0, 0.0, -1.0)), S.v) * ufl.dx
HELD = S.bc((0.0, 0.0, 0.0), "top")


def forms_on(space):
    u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
    return ufl.inner(ufl.grad(u), ufl.grad(v)) * ufl.dx


def mixed():
    if hasattr(fem, "functionspace"):
        import basix.ufl

        parts = [basix.ufl.element("P", "tetrahedron", 1, shape=(3,)), basix.ufl.element("P", "tetrahedron", 1)]
        return fem.functionspace(BOX.domain, basix.ufl.mixed_element(parts))
    P = BOX.domain.ufl_cell()
    parts = [ufl.VectorElement("P", P, 1), ufl.FiniteElement("P", P, 1)]
    return fem.FunctionSpace(BOX.domain, ufl.MixedElement(parts))


def on(domain, degree=1, shape=(3,), family="Lagrange"):
    return forms_on(compat.functionspace(domain, degree, shape, family))


def square():
    return mesh.create_unit_square(MPI.COMM_WORLD, 2, 2)


def prisms():
    return mesh.create_unit_cube(MPI.COMM_WORLD, 1, 1, 1, mesh.CellType.prism)


def tags(facets, dim=2):
    facets = np.sort(np.asarray(facets, dtype=np.int32))
    return mesh.meshtags(BOX.domain, dim, facets, np.full(len(facets), 7, dtype=np.int32))


def inner_facets():
    topology = BOX.domain.topology
    count = topology.index_map(2).size_local
    return np.setdiff1d(np.arange(count, dtype=np.int32), mesh.exterior_facet_indices(topology))


class Constraint:
    """Like MultiPointConstraint of dolfinx_mpc."""

    slaves = np.zeros(1, dtype=np.int32)


def named(name, value):
    """A function on the cells."""
    function = S.on_cells(lambda x: np.full(x.shape[1], value))
    function.name = name
    return function


OTHER = Script(BOX, 1)
WRONG = {
    "unsymmetric": (lambda: {"a": A + 1e8 * ufl.inner(S.u.dx(0), S.v) * ufl.dx}, "a is not symmetric.*differ by"),
    "negative": (lambda: {"a": -A}, "a is not positive definite: a\\(u, u\\) = -"),
    "exchanged": (lambda: {"a": L, "L": A}, "a must be a bilinear form.*has one argument.*exchange a and L"),
    "bilinear L": (lambda: {"L": A}, "L must be a linear form.*two arguments"),
    "no form": (lambda: {"a": 3.0}, "a must be a form of UFL.*3.0"),
    "a - L": (
        lambda: {"a": A - L},
        r"terms with one argument and with two, .* Body\(ufl.lhs\(F\), ufl.rhs\(F\), ...\)",
    ),
    "a == L": (lambda: {"a": A == L, "L": None}, r"a is an equation: give its sides, Body\(a, L, ...\)"),
    "mixed": (lambda: {"a": forms_on(mixed()), "L": None, "bcs": []}, "is mixed"),
    "scalars": (lambda: {"a": on(BOX.domain, 1, ()), "L": None, "bcs": []}, "of scalars.*three components"),
    "two components": (lambda: {"a": on(BOX.domain, 1, (2,)), "L": None, "bcs": []}, "2 values per node"),
    "discontinuous": (lambda: {"a": on(BOX.domain, 1, (3,), "DG"), "L": None, "bcs": []}, "discontinuous"),
    "degree 3": (lambda: {"a": on(BOX.domain, 3), "L": None, "bcs": []}, "degree 3.*of degree 1 or 2"),
    "2D": (lambda: {"a": on(square(), 1, (2,)), "L": None, "bcs": [], "faces": {}}, "in 2D space; a 3D mesh"),
    "prisms": (lambda: {"a": on(prisms()), "L": None, "bcs": [], "faces": {}}, "prism; only tetrahedra and hexahedra"),
    "other space": (lambda: {"bcs": [OTHER.bc((0.0, 0.0, 0.0), "top")]}, r"bcs\[0\] is on another space"),
    "L elsewhere": (lambda: {"L": ufl.inner(S.constant((0.0, 0.0, 1.0)), OTHER.v) * ufl.dx}, "one space: the same"),
    "a number": (lambda: {"bcs": [HELD, 0.0]}, r"bcs\[1\] must be a dirichletbc.*0.0"),
    "no list": (lambda: {"bcs": HELD}, "bcs must be a list of dirichletbc"),
    "constraint": (lambda: {"bcs": [Constraint()]}, "multi-point constraint; these are not supported"),
    "inside": (lambda: {"faces": {"sole": inner_facets()[:3]}}, "face 'sole': [1-9]* of its facets are not on the"),
    "outside": (lambda: {"faces": {"sole": [10**6]}}, "1000000 is no facet of this mesh, which has the facets 0 to"),
    "negative facet": (lambda: {"faces": {"sole": [-1]}}, "-1 is no facet"),
    "facets and value": (lambda: {"faces": {"sole": (np.arange(3), 3)}}, "give the numbers of its facets"),
    "markers": (lambda: {"faces": {"sole": np.ones(3) > 0}}, "give the numbers of its facets"),
    "no facets": (lambda: {"faces": {"sole": []}}, "face 'sole' has no facets"),
    "no names": (lambda: {"faces": BOX.faces["bottom"]}, "faces must be names with facets"),
    "tags of cells": (lambda: {"faces": {"sole": (tags([0], 3), 7)}}, "MeshTags are of dimension 3"),
    "not finite": (lambda: {"a": S.constant(np.nan) * A}, "not finite: .*coefficients; a constant in a is not finite$"),
    "a function not set": (
        lambda: {"a": S.elasticity(named("young", 0.0), 0.3)},
        "0 for .* coefficients; the function 'young' in a is 0$",
    ),
    "a constant of 0": (lambda: {"a": S.constant(0.0) * A}, r"at x = \([0-9., ]+\); .*; a constant in a is 0$"),
    "a function not finite": (
        lambda: {"a": S.elasticity(named("E", np.nan), 0.3)},
        "not finite.*; the function 'E' in a is not finite$",
    ),
    "update fails": (lambda: {"update": lambda t: 1 / 0}, r"update\(0\): division by zero"),
    "load not finite": (lambda: {"L": S.constant(np.inf) * L}, "L: has values that are not finite"),
    "held at nan": (lambda: {"bcs": [S.bc((0.0, np.nan, 0.0), "top")]}, "bcs: a prescribed displacement is not finite"),
    "unknown face": (lambda: {"faces": {"base": BOX.faces["bottom"]}}, "no face 'sole' on this mesh.*faces are base"),
    "tags inside": (lambda: {"faces": tags(inner_facets()[:2])}, "no face 'sole'.*it has no faces|faces are"),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_input(case):
    change, message = WRONG[case]
    given = {"a": A, "L": L, "bcs": [HELD], "faces": {"sole": BOX.faces["bottom"]}, **change()}
    with pytest.raises(ValueError, match=message):
        ContactProblem(coulomb.Body(**given), Contact("sole", 0.3))


def test_names_of_functions_that_a_compiler_refuses(monkeypatch):
    """FFCx of DOLFINx 0.5 writes them into C."""

    def refused(form):
        raise RuntimeError("gcc failed with exit code 1")

    monkeypatch.setattr(compiled_form.fem, "form", refused)
    with pytest.raises(ValueError, match="exit code 1; 'mu of place' names a function: give it one of letters"):
        compiled_form.compiled(named("mu of place", 1.0) * ufl.dx, "a", MPI.COMM_WORLD)


def test_a_face_of_tags_with_facets_inside():
    body = coulomb.Body(A, L, [HELD], tags([*inner_facets()[:2], *BOX.faces["bottom"]]))
    with pytest.raises(ValueError, match="face '7' of the MeshTags has 2 facets inside the body"):
        ContactProblem(body, Contact("7", 0.3))


def test_another_meshs_tags_and_forms():
    other = coulomb.box((1.0, 1.0, 1.0), (2, 2, 2), "tetrahedron")
    foreign = mesh.meshtags(other.domain, 2, np.sort(other.faces["bottom"]), np.ones(8, dtype=np.int32))
    for faces in (foreign, {"sole": (foreign, 1)}):
        with pytest.raises(ValueError, match="MeshTags are of another mesh"):
            coulomb.Body(A, L, [HELD], faces)
    with pytest.raises(ValueError, match="NamedMesh of another mesh"):
        coulomb.Body(A, L, [HELD], other)
    with pytest.raises(ValueError, match="another space than a"):
        coulomb.Body(A, L, [Script(other, 1).bc((0.0, 0.0, 0.0), "top")], BOX)
    script = Script(other, 1)
    with pytest.raises(ValueError, match=r"on 2 meshes|of different spaces"):
        coulomb.Body(A + ufl.inner(script.u, script.v) * ufl.dx, L, [HELD], BOX)
    curved = Script(coulomb.second_order(other), 1)
    with pytest.raises(ValueError, match=r"degree 1.*of degree 2"):
        coulomb.Body(curved.elasticity(1e9, 0.3), None, [curved.bc((0.0, 0.0, 0.0), "top")], curved.mesh)


@pytest.mark.parametrize(
    ("linear_solver", "explicit"),
    [
        (coulomb.solvers.DirectSolver, True),
        (coulomb.solvers.DirectSolver, False),
        (coulomb.solvers.IterativeSolver, False),
    ],
)
def test_an_indefinite_form_with_a_positive_diagonal(linear_solver, explicit):
    a = A - 4e9 * ufl.inner(S.u, S.v) * ufl.dx
    body = coulomb.Body(a, L, [HELD], BOX)
    problem = ContactProblem(body, Contact("bottom", 0.3), linear_solver=linear_solver, explicit=explicit)
    with pytest.raises(ValueError, match="a is not positive definite"):
        problem.solve()


def test_a_function_that_is_0_where_the_diagonal_is_not():
    """Without shear stiffness."""
    mu, strains = named("mu", 0.0), ufl.inner(ufl.sym(ufl.grad(S.u)), ufl.grad(S.v))
    body = coulomb.Body((1e9 * ufl.div(S.u) * ufl.div(S.v) + mu * strains) * ufl.dx, L, [HELD], BOX)
    with pytest.raises(ValueError, match=r"a is not positive definite.*; the function 'mu' in a is 0$"):
        ContactProblem(body, Contact("bottom", 0.3)).solve()


def test_a_body_takes_no_other_loads_and_a_mesh_needs_a_material():
    body = coulomb.Body(A, L, [HELD], BOX)
    with pytest.raises(ValueError, match="has its own loads and supports"):
        ContactProblem(body, Contact("bottom", 0.3), [Clamp("top")])
    with pytest.raises(ValueError, match="has its own loads and supports"):
        ContactProblem(body, [Clamp("top")], Contact("bottom", 0.3))
    with pytest.raises(ValueError, match="has its own material"):
        ContactProblem(body, Material(1e9, 0.3), contact=Contact("bottom", 0.3))
    for given in ((BOX, Contact("bottom", 0.3)), (BOX,), (BOX, Material(1e9, 0.3), [Clamp("top")])):
        with pytest.raises(ValueError, match=r"ContactProblem\(body, contact\)"):
            ContactProblem(*given)
    for contact in ((), "bottom", [Clamp("top")]):
        with pytest.raises(ValueError, match="contact must be a Contact, or several"):
            ContactProblem(body, contact)
    ours = Elasticity(BOX, Material(1e9, 0.3), [Clamp("top")])
    assert ContactProblem(ours, Contact("bottom", 0.3)).solve().certificate.passed


def test_fields_that_cannot_be_written(tmp_path):
    solution = ContactProblem(coulomb.Body(A, L, [HELD], BOX), Contact("bottom", 0.3)).solve()
    elsewhere = Script(coulomb.box((1.0, 1.0, 1.0), (1, 1, 1)), 1).function()
    for name, value, message in (
        ("damage", 1.0, "must be a Function of DOLFINx"),
        ("displacement", solution.function, "have a field of this name"),
        ("a/b", solution.function, "printable word without /"),
        ("other", elsewhere, "on another mesh than the body"),
    ):
        with pytest.raises(ValueError, match=message):
            solution.write(tmp_path, fields={name: value})
    assert strain(S.u).ufl_shape == (3, 3)
    stress = fem.Function(compat.functionspace(BOX.domain, 1, (3,), "DG"), name="q")
    with without_pictures():
        solution.write(tmp_path, fields={"q": stress})
