"""coulomb's large motions: the die is the slave; steps that fail are halved."""

from __future__ import annotations

from typing import Any

import numpy as np
from mpi4py import MPI

import coulomb
from coulomb.arrays import FloatArray
from coulomb.fem import compat
from coulomb.fem.compat import fem, mesh, ufl
from coulomb.kinematics import LargeMotions, NonlinearBody

from ..processes import processor_time
from . import DIE, DIE_YOUNG, FRICTION, SLAB, YOUNG, Run, bent, box_of, cells_of, constants, faces, times, way


def solve(p: int, drawing: int) -> Run:
    """Iterations are linear contact problems; RuntimeError if a certificate fails."""
    began = processor_time()
    forces, iterations, steps, ends = [], 0, 0, set(times(drawing))
    for step in coulomb.LoadHistory(times(drawing)).steps(problem(p)):
        if not step.solution.valid:
            raise RuntimeError(f"the certificate fails at {step.state.time:g}")
        iterations, steps = iterations + step.solution.outer_iterations, steps + 1
        if step.state.time in ends:
            forces.append(force_on_die(step.solution, p))
    return Run(processor_time() - began, iterations, steps, np.array(forces))


def problem(p: int) -> coulomb.ContactProblem:
    both = coulomb.join(**{SLAB: _body(SLAB, p, YOUNG), DIE: _body(DIE, p, DIE_YOUNG)})
    contact = coulomb.Contact(f"{DIE}:contact", against=f"{SLAB}:contact", friction=FRICTION, slave=True)
    return LargeMotions(both, contact)


def force_on_die(solution: Any, p: int) -> FloatArray:
    """Per millimetre of width, shape (3,)."""
    return np.array(solution.at_nodes.totals()["force"]) / box_of(p)[SLAB][1][1]


def _body(name: str, p: int, young: float) -> NonlinearBody:
    low, high = map(np.array, box_of(p)[name])
    domain = mesh.create_box(MPI.COMM_SELF, [low, high], cells_of(p)[name], mesh.CellType.hexahedron)
    if name == DIE:
        domain.geometry.x[:] = bent(domain.geometry.x)
    V = compat.functionspace(domain, 1, (3,))
    u, given = fem.Function(V), fem.Function(V)
    F, (c10, d1) = ufl.Identity(3) + ufl.grad(u), constants(young)
    J = ufl.det(F)
    energy = c10 * (J ** (-2.0 / 3.0) * ufl.inner(F, F) - 3.0) + (J - 1.0) ** 2 / d1
    held, contact = (
        mesh.locate_entities_boundary(domain, 2, lambda x, face=face: getattr(faces(name, x.T), face))
        for face in ("held", "contact")
    )
    sides = mesh.locate_entities_boundary(domain, 2, lambda x: np.isclose(x[1], low[1]) | np.isclose(x[1], high[1]))
    bcs = [
        fem.dirichletbc(given.sub(axis), fem.locate_dofs_topological(V.sub(axis), 2, facets))
        for facets, axis in ((held, 0), (held, 2), (sides, 1))
    ]

    def update(now: float) -> None:
        there = np.array(way(now) if name == DIE else (0.0, 0.0, 0.0))
        given.interpolate(lambda x: np.tile(there[:, None], (1, x.shape[1])))

    return NonlinearBody(
        energy * ufl.dx(metadata={"quadrature_degree": 3}), bcs, {"contact": contact}, displacement=u, update=update
    )
