"""GetFEM's large-sliding contact (`add_integral_large_sliding_contact_brick_raytracing`), Newton's method, MUMPS.

The contact points are the integration points of the die's face; Alart and Curnier's augmented Lagrangian; friction
between the displacements at the ends of two load steps.  GetFEM has no load steps of its own: one that fails is halved
here, as coulomb's.
"""

from __future__ import annotations

import importlib
import time
from typing import Any

import numpy as np

from coulomb.arrays import FloatArray

from ..peers.answer import Unsolved
from . import DIE, DIE_YOUNG, FRICTION, SLAB, YOUNG, Run, constants, faces, grid, times, way, width

TOLERANCE = 1e-8
"""Of GetFEM's residual, which is relative."""

AUGMENTATION = 1.0
"""Young's modulus of the slab over millimetres."""

RELEASE = 0.5
"""Distance in millimetres beyond which there is no contact: less than the thickness of the bodies."""

MOST_STEPS, HALVINGS = 50, 6
HELD, CONTACT = 1, 2


class Model:
    """Both bodies of a mesh of p cells per millimetre."""

    def __init__(self, p: int):
        self.gf: Any = importlib.import_module("getfem")
        self.gf.util_trace_level(0)
        self.model = self.gf.Model("real")
        self.kept: list[Any] = []
        self.held: dict[str, Any] = {}
        self.across, self.p = 1.0 / width(p), p
        contact = {name: self._body(name, p, young) for name, young in ((SLAB, YOUNG), (DIE, DIE_YOUNG))}
        for name, value in (("r", AUGMENTATION), ("friction", FRICTION), ("alpha", 1.0)):
            self.model.add_initialized_data(name, value)
        self.model.add_filtered_fem_variable("force", contact[DIE][1], CONTACT)
        # the friction across, where nothing moves, is not determined
        self.model.add_linear_term(contact[DIE][0], "-1e-3*force(2)*Test_force(2)", CONTACT)
        brick = self.model.add_integral_large_sliding_contact_brick_raytracing("r", RELEASE, "friction", "alpha", 0)
        self.model.add_slave_contact_boundary_to_large_sliding_contact_brick(
            *(brick, contact[DIE][0], CONTACT, f"u{DIE}", "force", f"before{DIE}")
        )
        self.model.add_master_contact_boundary_to_large_sliding_contact_brick(
            *(brick, contact[SLAB][0], CONTACT, f"u{SLAB}", f"before{SLAB}")
        )

    def _body(self, name: str, p: int, young: float) -> tuple[Any, Any]:
        gf, model, u = self.gf, self.model, f"u{name}"
        x, cells = grid(name, p)
        mesh = gf.Mesh("empty", 3)
        for corners in cells:
            mesh.add_convex(gf.GeoTrans("GT_QK(3,1)"), x[corners].T)
        at = faces(name, mesh.pts().T)
        for region, points in ((HELD, at.held), (CONTACT, at.contact)):
            mesh.set_region(region, mesh.faces_from_pid(mesh.pid()[np.flatnonzero(points)]))
        space = gf.MeshFem(mesh, 3)
        space.set_fem(gf.Fem("FEM_QK(3,1)"))
        points = gf.MeshIm(mesh, gf.Integ("IM_GAUSS_PARALLELEPIPED(3,3)"))
        model.add_fem_variable(u, space)
        model.add_fem_data(f"before{name}", space)
        c10, d1 = constants(young)
        F = f"(Id(3)+Grad_{u})"
        energy = f"{c10!r}*(pow(Det{F},-2/3)*Norm_sqr{F}-3)+sqr(Det{F}-1)/{d1!r}"
        self.kept += [mesh, space, points]
        model.add_nonlinear_term(points, energy)
        nodes = space.basic_dof_nodes()[:, ::3].T
        held = np.zeros((len(nodes), 3), dtype=bool)
        held[:, 1], held[faces(name, nodes).held] = True, True
        dofs = np.flatnonzero(held)
        B = gf.Spmat("empty", len(dofs), space.nbdof())
        for row, dof in enumerate(map(int, dofs)):
            B.add(row, dof, 1.0)
        model.add_variable(f"reaction{name}", len(dofs))
        brick = model.add_constraint_with_multipliers(u, f"reaction{name}", B, np.zeros(len(dofs)))
        self.held[name] = brick, dofs
        return points, space

    def move(self, where: tuple[float, float, float]) -> None:
        """The top of the die."""
        brick, dofs = self.held[DIE]
        self.model.set_private_rhs(brick, np.array(where)[dofs % 3])

    def force_on_die(self) -> FloatArray:
        """Per millimetre of width, shape (3,): what the constraints of the die take."""
        _, dofs = self.held[DIE]
        total = np.bincount(dofs % 3, weights=self.model.variable(f"reaction{DIE}"), minlength=3)
        force: FloatArray = self.across * total
        return force

    def solved(self) -> tuple[int, bool]:
        """Newton's steps from the present state, and whether it has converged."""
        steps, converged = self.model.solve(
            *("max_res", TOLERANCE, "max_iter", MOST_STEPS, "lsolver", "mumps", "lsearch", "simplest")
        )
        return int(steps), bool(converged)


def solve(p: int, drawing: int) -> Run:
    """Iterations are Newton's, also of steps that failed; Unsolved if the smallest part of a step fails."""
    began = time.perf_counter()
    bodies = Model(p)
    model, names = bodies.model, ("uslab", "udie", "force", "reactionslab", "reactiondie")
    forces, iterations, completed, now = [], 0, 0, 0.0
    for goal in times(drawing):
        step = whole = goal - now
        while now < goal:
            end = min(now + step, goal)
            kept = {name: model.variable(name).copy() for name in names}
            for name in (SLAB, DIE):
                model.set_variable(f"before{name}", kept[f"u{name}"])
            bodies.move(way(end))
            newton, converged = bodies.solved()
            iterations += newton
            if not converged:
                for name, value in kept.items():
                    model.set_variable(name, value)
                step *= 0.5
                if step < whole * 0.5**HALVINGS:
                    raise Unsolved(
                        f"not converged from {now:g} to {end:g} s in {MOST_STEPS} steps, nor in larger steps"
                    )
                continue
            now, completed, step = end, completed + 1, 2.0 * step
        forces.append(bodies.force_on_die())
    return Run(time.perf_counter() - began, iterations, completed, np.array(forces))
