"""GetFEM on the two blocks: integral contact between non-matching meshes, augmented Lagrangian, Newton, MUMPS.

The brick integrates over the facets of the upper block and projects its points onto the lower one.  The law holds for
trilinear multipliers in the mean, not node by node.
"""

from __future__ import annotations

import contextlib
import importlib
import time
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from ..two_blocks import BLOCKS, FRICTION, SPRING, TRACTIONS, UPPER, Block, Grid, grid
from .answer import Answer, Unsolved
from .pair import answer

TOLERANCE = 1e-9
"""Tolerance of GetFEM's relative residual."""

AUGMENTATIONS = (0.1, 0.03)
"""Over the upper block's Young's modulus by its cell size: the first that converges is taken, and its time alone
counts.  Smaller ones take more steps; 0.1 does not converge for p = 8, nor 0.3 for 4 and 16, nor 1 for any."""

ALART_CURNIER = 1
"""The option of the brick that has the multipliers themselves as forces; the unsymmetric one."""

MOST_STEPS = 50
FACES = {"bottom": 1, "top": 2, "left": 3, "right": 4}
OUTWARD = {"bottom": (0, 0, -1), "top": (0, 0, 1), "left": (-1, 0, 0), "right": (1, 0, 0)}
LEXICOGRAPHIC = [0, 1, 3, 2, 4, 5, 7, 6]


def solve(p: int) -> Answer:
    """Iterations are Newton's."""
    *others, last = AUGMENTATIONS
    for augmentation in others:
        with contextlib.suppress(Unsolved):
            return _solve(p, augmentation)
    return _solve(p, last)


def _solve(p: int, augmentation: float) -> Answer:
    gf: Any = importlib.import_module("getfem")
    began = time.perf_counter()
    model = gf.Model("real")  # in metres; forces over Young's modulus of the upper block: one tolerance suits both
    grids = {name: grid(block, p) for name, block in BLOCKS.items()}
    made = {name: _add_block(gf, model, name, block, grids[name]) for name, block in BLOCKS.items()}
    mesh, _ = made["upper"]
    points = gf.MeshIm(mesh, gf.Integ("IM_GAUSS_PARALLELEPIPED(3,4)"))
    model.add_Dirichlet_condition_with_simplification("lower", FACES["bottom"])
    for face, traction in TRACTIONS.items():
        model.add_initialized_data(face, [value / UPPER.young for value in traction])
        model.add_source_term_brick(points, "upper", face, FACES[face])
    nodes = {name: _numbers(made[name][1], grids[name]) for name in BLOCKS}
    model.add_explicit_matrix("upper", "upper", _springs(gf, grids["upper"], nodes["upper"]))

    stress = gf.MeshFem(mesh, 3)
    stress.set_fem(gf.Fem("FEM_QK(3,1)"))
    model.add_filtered_fem_variable("stress", stress, FACES["bottom"])
    model.add_initialized_data("r", augmentation * UPPER.finer * p)
    model.add_initialized_data("friction", FRICTION)
    model.add_integral_contact_between_nonmatching_meshes_brick(
        points, "upper", "lower", "stress", "r", "friction", FACES["bottom"], FACES["top"], ALART_CURNIER
    )
    steps, converged = model.solve(
        "max_res", TOLERANCE, "max_iter", MOST_STEPS, "lsolver", "mumps", "lsearch", "simplest"
    )
    u = {name: np.empty_like(grids[name].points) for name in BLOCKS}
    for name, field in u.items():
        field[nodes[name]] = model.variable(name).reshape(-1, 3)
    seconds = time.perf_counter() - began
    if not converged:
        raise Unsolved(f"not converged in {steps} steps")
    return answer(p, u["lower"], u["upper"], seconds, int(steps))


def _add_block(gf: Any, model: Any, name: str, block: Block, made: Grid) -> tuple[Any, Any]:
    """The block's displacements and stiffness; its mesh and space."""
    mesh = gf.Mesh("empty", 3)
    corners = made.points[made.cells[:, LEXICOGRAPHIC]]
    mesh.add_convex(gf.GeoTrans("GT_QK(3,1)"), np.asfortranarray(corners.transpose(2, 1, 0)))
    for face, region in FACES.items():
        mesh.set_region(region, mesh.outer_faces_with_direction(OUTWARD[face], 0.01))
    space = gf.MeshFem(mesh, 3)
    space.set_fem(gf.Fem("FEM_QK(3,1)"))
    points = gf.MeshIm(mesh, gf.Integ("IM_GAUSS_PARALLELEPIPED(3,3)"))
    young, poisson = block.young / UPPER.young, block.poisson
    model.add_fem_variable(name, space)
    model.add_initialized_data(f"lambda_{name}", young * poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson)))
    model.add_initialized_data(f"mu_{name}", 0.5 * young / (1.0 + poisson))
    model.add_isotropic_linearized_elasticity_brick(points, name, f"lambda_{name}", f"mu_{name}")
    return mesh, space


def _numbers(space: Any, made: Grid) -> Any:
    """Numbers of the nodes of the space in the grid."""
    distance, number = cKDTree(made.points).query(space.basic_dof_nodes()[:, ::3].T)
    if distance.max() > 1e-9 or len(np.unique(number)) < len(made.points):
        raise Unsolved("its mesh has other nodes")
    return number


def _springs(gf: Any, made: Grid, nodes: Any) -> Any:
    """Stiffness of the springs, integrated over the face as coulomb's; `nodes` are those of the space in the grid."""
    stiffness, products = gf.Spmat("empty", 3 * len(nodes), 3 * len(nodes)), made.products("left")
    place = np.argsort(nodes)
    for row, column, area in zip(place[products.row], place[products.col], products.data, strict=True):
        for axis in range(3):
            stiffness.add(3 * int(row) + axis, 3 * int(column) + axis, SPRING / UPPER.young * area)
    return stiffness
