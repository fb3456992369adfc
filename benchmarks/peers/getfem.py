"""GetFEM: nodal contact with Coulomb friction (Alart-Curnier augmented Lagrangian) on its own mesh, Newton, MUMPS.

It uses GetFEM's basic contact brick, on which the brick for rigid obstacles is based, without the clamped nodes, whose
multipliers would be undetermined.
"""

from __future__ import annotations

import importlib
import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from coulomb.arrays import FloatArray

from .answer import FRICTION, LENGTHS, POISSON, STEPS, TRACTIONS, YOUNG, Answer, Unsolved, stacked, tractions

TOLERANCE = 1e-9
"""Tolerance of GetFEM's relative residual."""

AUGMENTATION = 0.2
"""Over Young's modulus times the cell size: of 0.1, 0.3, 1, 3 and 10, values below 1 need the fewest steps, and with
values above 1 Newton's method does not converge."""

MOST_STEPS = 100
CLAMPED, TOP, RIGHT = 1, 2, 3


def solve(p: int) -> Answer:
    """Iterations are Newton's."""
    began = time.perf_counter()
    model, x, _kept = model_of(p)
    steps, converged = solved(model, TRACTIONS)
    forces = forces_of(model)
    seconds = time.perf_counter() - began
    if not converged:
        raise Unsolved(f"not converged in {steps} steps")
    return Answer(seconds, int(steps), x, forces)


def solve_history(p: int) -> Answer:
    """The load history by Newton's method from the state after the step before.

    The brick takes friction against B_T (u + gamma wt): with gamma = 1 and wt minus the displacement after the step
    before, that is the slip since then.
    """
    began = time.perf_counter()
    model, x, _kept = model_of(p, incremental=True)
    forces: list[FloatArray] = []
    first, iterations = 0.0, 0
    for number in range(1, STEPS + 1):
        steps, converged = solved(model, tractions(float(number)))
        if not converged:
            raise Unsolved(f"load step {number} not converged in {steps} steps")
        forces.append(forces_of(model))
        iterations += int(steps)
        model.set_variable("before", -model.variable("u"))
        first = first or time.perf_counter() - began
    return Answer(time.perf_counter() - began, iterations, x, stacked(forces), first_seconds=first)


def model_of(p: int, incremental: bool = False) -> tuple[Any, Any, Any]:
    """GetFEM's model with loads 0, its contact nodes (m, 3), and what must live as long as the model.

    Args:
        p: Cells per metre.
        incremental: Whether slip counts from minus the data "before", at first 0.
    """
    gf: Any = importlib.import_module("getfem")
    mesh = gf.Mesh("cartesian", *(np.linspace(0.0, length, round(length * p) + 1) for length in LENGTHS))
    for region, direction in ((CLAMPED, (-1, 0, 0)), (TOP, (0, 0, 1)), (RIGHT, (1, 0, 0))):
        mesh.set_region(region, mesh.outer_faces_with_direction(direction, 0.01))
    space = gf.MeshFem(mesh, 3)
    space.set_fem(gf.Fem("FEM_QK(3,1)"))
    points = gf.MeshIm(mesh, gf.Integ("IM_GAUSS_PARALLELEPIPED(3,3)"))

    model = gf.Model("real")
    model.add_fem_variable("u", space)  # in metres; forces over Young's modulus, so that one tolerance suits both
    model.add_initialized_data("lambda", POISSON / ((1.0 + POISSON) * (1.0 - 2.0 * POISSON)))
    model.add_initialized_data("mu", 0.5 / (1.0 + POISSON))
    model.add_isotropic_linearized_elasticity_brick(points, "u", "lambda", "mu")
    for region, face in ((TOP, "top"), (RIGHT, "right")):
        model.add_initialized_data(face, [0.0, 0.0, 0.0])
        model.add_source_term_brick(points, "u", face, region)
    model.add_Dirichlet_condition_with_simplification("u", CLAMPED)
    return model, _add_contact(gf, model, space, AUGMENTATION / p, incremental), (mesh, space, points)


def solved(model: Any, on_faces: Mapping[str, Sequence[float]]) -> tuple[int, bool]:
    """Newton's method from the model's state under tractions in pascals: its steps, and whether it converged."""
    for face, traction in on_faces.items():
        model.set_variable(face, [value / YOUNG for value in traction])
    steps, converged = model.solve(
        "max_res", TOLERANCE, "max_iter", MOST_STEPS, "lsolver", "mumps", "lsearch", "simplest"
    )
    return int(steps), bool(converged)


def forces_of(model: Any) -> FloatArray:
    """Forces on the body in newtons, shape (m, 3)."""
    normal, tangential = model.variable("normal"), model.variable("tangential").reshape(-1, 2)
    forces: FloatArray = YOUNG * np.column_stack([tangential, -normal])
    return forces


def _add_contact(gf: Any, model: Any, space: Any, augmentation: float, incremental: bool) -> Any:
    """Contact of the nodes of z = 0 except the clamped ones; their coordinates, shape (m, 3)."""
    nodes = space.basic_dof_nodes()[:, 0::3]
    near = 1e-9
    contact = np.flatnonzero((nodes[2] < near) & (nodes[0] > near))
    m = len(contact)
    normal, tangential = gf.Spmat("empty", m, space.nbdof()), gf.Spmat("empty", 2 * m, space.nbdof())
    for row, node in enumerate(map(int, contact)):
        normal.add(row, 3 * node + 2, -1.0)
        tangential.add(2 * row, 3 * node, 1.0)
        tangential.add(2 * row + 1, 3 * node + 1, 1.0)
    model.add_variable("normal", m)
    model.add_variable("tangential", 2 * m)
    model.add_initialized_data("r", augmentation)
    model.add_initialized_data("friction", FRICTION)
    model.add_initialized_data("gap", np.zeros(m))
    model.add_initialized_data("alpha", np.ones(m))
    since: tuple[str, ...] = ()
    if incremental:
        model.add_initialized_data("gamma", 1.0)
        model.add_initialized_data("before", np.zeros(space.nbdof()))
        since = ("gamma", "before")
    model.add_basic_contact_brick(
        "u", "normal", "tangential", "r", normal, tangential, "friction", "gap", "alpha", 1, *since
    )
    return nodes[:, contact].T
