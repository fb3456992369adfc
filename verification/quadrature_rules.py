"""A defect of FFCx (0.5 to 0.11), without coulomb: `python -m verification.quadrature_rules`.

A form whose integrals have a rule with one point and one with several is compiled wrongly: what stands outside the
loops of all rules, since with one point everything is constant, is taken in the loops of the others.  On distorted
hexahedra the matrix is 10 % off, its product with a vector by `ufl.action` 72 %; the sum of both integrals, each
compiled by itself, is right.  `coulomb.fem.bodies.compiled_form` compiles them so.
"""

from typing import Any

import numpy as np
import ufl
from mpi4py import MPI  # before dolfinx, as its wheel of PyPI requires

import dolfinx.fem.petsc as petsc  # isort: skip
from dolfinx import fem, mesh  # isort: skip


def main() -> None:
    domain = mesh.create_box(MPI.COMM_SELF, [[0.0] * 3, [1.0] * 3], (3, 3, 3), mesh.CellType.hexahedron)
    domain.geometry.x[:] += 0.05 * np.random.default_rng(3).standard_normal(domain.geometry.x.shape)
    space = fem.functionspace if hasattr(fem, "functionspace") else fem.FunctionSpace  # the second until 0.6
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
