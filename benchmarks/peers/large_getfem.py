"""GetFEM's large-sliding contact: `add_integral_large_sliding_contact_brick_raytracing`, Newton's method, MUMPS.

The contact points are the integration points of the slave face; Alart and Curnier's augmented Lagrangian; slip is the
difference of the displacements at the ends of two load steps.  GetFEM has no load steps of its own: one that fails is
halved here, as coulomb's.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from coulomb.arrays import FloatArray

from .answer import Unsolved

TOLERANCE = 1e-8
"""Of GetFEM's residual, which is relative."""

MOST_STEPS, HALVINGS = 50, 6
HELD, CONTACT = 1, 2

Mask = npt.NDArray[np.bool_]


class _Cells(NamedTuple):
    map: str
    element: str
    quadrature: str


_CELLS = {
    8: _Cells("GT_QK(3,1)", "FEM_QK(3,1)", "IM_GAUSS_PARALLELEPIPED(3,3)"),
    4: _Cells("GT_PK(3,1)", "FEM_PK(3,1)", "IM_TETRAHEDRON(2)"),
}


class LargeSliding:
    """Bodies with the energy C10 (J^(-2/3) I1 - 3) + (J - 1)^2 / D1, and contact of the slave among them.

    Args:
        friction: Its coefficient.
        augmentation: The augmentation parameter, about Young's modulus over the size of the bodies.
        release: The distance beyond which there is no contact.
    """

    def __init__(self, friction: float, augmentation: float, release: float):
        self.gf: Any = importlib.import_module("getfem")
        self.gf.util_trace_level(0)
        self.gf.util_warning_level(0)  # inverted elements of iterates far from the answer
        self.model = self.gf.Model("real")
        for name, value in (("r", augmentation), ("friction", friction), ("alpha", 1.0)):
            self.model.add_initialized_data(name, value)
        self.brick = self.model.add_integral_large_sliding_contact_brick_raytracing(
            "r", release, "friction", "alpha", 0
        )
        self._kept: list[Any] = []
        self._held: dict[str, tuple[int, npt.NDArray[np.int64]]] = {}
        self._names: list[str] = []
        self._forces: list[str] = []

    def add_body(
        self,
        name: str,
        x: FloatArray,
        cells: npt.NDArray[np.integer[Any]],
        constants: tuple[float, float],
        held: Callable[[FloatArray], Mask],
        contact: Callable[[FloatArray], Mask],
        slave: bool,
    ) -> None:
        """A body of points x (k, 3) and cells (c, 8 or 4), x fastest.

        Args:
            name: Its name.
            x, cells: Its mesh.
            constants: C10 and D1.
            held: Of points (k, 3), which components are prescribed, shape (k, 3).
            contact: Of points, whether they are on the contact face.
            slave: Whether the contact points are on its face.
        """
        gf, model, u, kind = self.gf, self.model, f"u{name}", _CELLS[cells.shape[1]]
        mesh = gf.Mesh("empty", 3)
        for corners in cells:
            mesh.add_convex(gf.GeoTrans(kind.map), x[corners].T)
        points = mesh.pid()[np.flatnonzero(contact(mesh.pts().T))]
        outer = mesh.outer_faces()
        chosen = {tuple(face) for face in mesh.faces_from_pid(points).T}
        mesh.set_region(CONTACT, outer[:, [tuple(face) in chosen for face in outer.T]])
        space, quadrature = gf.MeshFem(mesh, 3), gf.MeshIm(mesh, gf.Integ(kind.quadrature))
        space.set_fem(gf.Fem(kind.element))
        model.add_fem_variable(u, space)
        model.add_fem_data(f"before{name}", space)
        F, (c10, d1) = f"(Id(3)+Grad_{u})", constants
        model.add_nonlinear_term(quadrature, f"{c10!r}*(pow(Det{F},-2/3)*Norm_sqr{F}-3)+sqr(Det{F}-1)/{d1!r}")
        dofs = np.flatnonzero(held(space.basic_dof_nodes()[:, ::3].T))
        B = gf.Spmat("empty", len(dofs), space.nbdof())
        for row, dof in enumerate(map(int, dofs)):
            B.add(row, dof, 1.0)
        model.add_variable(f"reaction{name}", len(dofs))
        condition = model.add_constraint_with_multipliers(u, f"reaction{name}", B, np.zeros(len(dofs)))
        self._held[name] = condition, dofs
        self._names.append(name)
        self._kept += [mesh, space, quadrature]
        if slave:
            force = f"force{name}"
            self._forces.append(force)
            model.add_filtered_fem_variable(force, space, CONTACT)
            # friction across, where nothing moves, is not determined: a spring of it, almost without effect
            model.add_linear_term(quadrature, f"-1e-3*{force}(2)*Test_{force}(2)", CONTACT)
            model.add_slave_contact_boundary_to_large_sliding_contact_brick(
                self.brick, quadrature, CONTACT, u, force, f"before{name}"
            )
        else:
            model.add_master_contact_boundary_to_large_sliding_contact_brick(
                self.brick, quadrature, CONTACT, u, f"before{name}"
            )

    def add_obstacle(self, distance: str) -> None:
        """A rigid obstacle of a signed distance in x, y, z."""
        self.model.add_rigid_obstacle_to_large_sliding_contact_brick(self.brick, distance, 3)

    def reaction(self, name: str) -> FloatArray:
        """Minus the forces that hold a body, shape (3,): those of contact."""
        _, dofs = self._held[name]
        total = np.bincount(dofs % 3, weights=self.model.variable(f"reaction{name}"), minlength=3)
        return total.astype(np.float64)

    def steps(
        self, name: str, way: Callable[[float], Sequence[float]], times: Sequence[float]
    ) -> tuple[FloatArray, int, int]:
        """Forces of contact on a body at the ends of load steps, shape (k, 3), Newton's iterations, also those of steps
        that failed, and completed steps.

        Args:
            name: Of the body whose held components move.
            way: Displacement at a time.
            times: Ends of the steps.

        Raises:
            Unsolved: If the smallest part of a step fails.
        """
        model, (condition, dofs) = self.model, self._held[name]
        variables = [f"{kind}{one}" for one in self._names for kind in ("u", "reaction")] + self._forces
        forces, iterations, completed, now = [], 0, 0, 0.0
        for goal in times:
            step = whole = goal - now
            while now < goal:
                end = goal if now + 1.001 * step > goal else now + step
                kept = {one: model.variable(one).copy() for one in variables}
                for one in self._names:
                    model.set_variable(f"before{one}", kept[f"u{one}"])
                model.set_private_rhs(condition, np.array(way(end))[dofs % 3])
                newton, converged = model.solve(
                    "max_res", TOLERANCE, "max_iter", MOST_STEPS, "lsolver", "mumps", "lsearch", "simplest"
                )
                iterations += int(newton)
                if not converged:
                    for one, value in kept.items():
                        model.set_variable(one, value)
                    step *= 0.5
                    if step < whole * 0.5**HALVINGS:
                        raise Unsolved(f"not converged from {now:g} to {end:g}, the smallest part of a step")
                    continue
                now, completed, step = end, completed + 1, 2.0 * step
            forces.append(self.reaction(name))
        return np.array(forces), iterations, completed
