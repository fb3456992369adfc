"""A defect of FFCx as a report for https://github.com/FEniCS/ffcx/issues: `python -m verification.quadrature_rules`.

Title: Wrong result where integrals of one form have a quadrature rule with one point and one with several

The integral of |grad w|^2 over one cube is 1/6 by several points, and 0 by the one in the middle; the form with both
gives 0: the integral by several points takes the gradient at the point of the other one.  `several + one` gives the
same.  Values, vectors and matrices are concerned, and on hexahedra that are no parallelepipeds the Jacobian too: in
selective reduced integration matrices are 10 % off, vectors by `ufl.action` 72 % (`distorted` below).  Each integral
compiled by itself is right, and so are sums of rules with several points.

Expected: 1/6, the sum of both.  Got: 0, without a warning.  FFCx 0.5.0 (DOLFINx 0.5.2) to 0.11.

Cause, in `IntegralGenerator` (codegeneration/integral_generator.py, in 0.5 integrals.py): with a rule of one point all
tables are piecewise constant, and so is every node of the factorised graph.  `generate_piecewise_partition` stores
these nodes in the scope of no rule, `scopes[None]`, by their expression of UFL alone.  For another rule
`generate_partition` asks `get_var`, which falls back on that scope, finds the same expression, and uses the value at
the one point instead of generating its own.  What is stored there has to be the same for all rules: nodes of which the
tables are piecewise because the functions are, not because the rule has one point; or its key has to name the rule.

Related: FEniCS/ffcx issue 394, in which such a form did not compile.
"""

from typing import Any

import numpy as np
import ufl
from mpi4py import MPI  # before dolfinx, as its wheel of PyPI requires

import dolfinx.fem.petsc as petsc  # isort: skip
from dolfinx import fem, mesh  # isort: skip


def main() -> None:
    domain = mesh.create_unit_cube(MPI.COMM_SELF, 1, 1, 1, mesh.CellType.hexahedron)
    space = fem.functionspace if hasattr(fem, "functionspace") else fem.FunctionSpace  # the second until 0.6
    w = fem.Function(space(domain, ("Lagrange", 1)))
    w.interpolate(lambda x: (x[0] - 0.5) * (x[1] - 0.5))
    one, several = (
        ufl.inner(ufl.grad(w), ufl.grad(w)) * ufl.dx(metadata={"quadrature_degree": degree}) for degree in (1, 3)
    )
    expected = fem.assemble_scalar(fem.form(one)) + fem.assemble_scalar(fem.form(several))
    found = fem.assemble_scalar(fem.form(one + several))
    print(f"expected {expected:.6f}, got {found:.6f}")
    distorted(space)


def distorted(space: Any) -> None:
    """Matrix and action on hexahedra that are no parallelepipeds."""
    domain = mesh.create_box(MPI.COMM_SELF, [[0.0] * 3, [1.0] * 3], (3, 3, 3), mesh.CellType.hexahedron)
    domain.geometry.x[:] += 0.05 * np.random.default_rng(3).standard_normal(domain.geometry.x.shape)
    V = space(domain, ("Lagrange", 1))
    u, v, w = ufl.TrialFunction(V), ufl.TestFunction(V), fem.Function(V)
    w.x.array[:] = np.random.default_rng(5).standard_normal(len(w.x.array))
    several = ufl.inner(ufl.grad(u), ufl.grad(v)) * ufl.dx(metadata={"quadrature_degree": 3})
    one = u.dx(0) * v.dx(0) * ufl.dx(metadata={"quadrature_degree": 1})

    def product(form: Any) -> Any:
        A = petsc.assemble_matrix(fem.form(form))
        A.assemble()
        return A * (w.vector if hasattr(w, "vector") else w.x.petsc_vec)  # the first until 0.9

    def action(form: Any) -> Any:
        return petsc.assemble_vector(fem.form(ufl.action(form, w)))

    right = (product(several) + product(one)).array
    for name, found in (
        ("matrix of the sum", product(several + one)),
        ("action of the sum", action(several + one)),
        ("sum of the actions", action(several) + action(one)),
    ):
        print(f"{name}: off by {np.abs(found.array - right).max() / np.abs(right).max():.1e}")


if __name__ == "__main__":
    main()
