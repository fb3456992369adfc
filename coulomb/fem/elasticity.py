"""Linear elasticity of one body: stiffness K, load f, near-nullspace."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from . import compat
from .body import strain
from .compat import fem, ufl
from .loaded_body import Clamp, LoadedBody, Loading, PrescribedDisplacement, Spring
from .loads import Load, Traction
from .materials import Materials
from .meshes import NamedMesh
from .user_values import Amplitude, Field

__all__ = ["Clamp", "Elasticity", "Materials", "PrescribedDisplacement", "Spring", "Traction"]


class Elasticity(LoadedBody):
    """K u = f on trilinear hexahedra or linear tetrahedra, with prescribed displacements and springs.

    Constrained rows and columns of K are zero except for the diagonal, which is the mean diagonal of the free ones (a 1
    there would disturb multigrid and all scales); f, which depends on time, has the prescribed values, so that
    K u = f holds them exactly.  Springs act at the nodes, each with the area of its hat function: diagonal in K, and
    exact for a face that moves without tilting.

    Attributes:
        K: Stiffness, N/m; block size 3, symmetric positive definite, with the rigid body modes as its near-nullspace;
            it does not change with time.

    Raises:
        ValueError: As `LoadedBody`, or if the springs that hold the body are too soft in comparison with rounding
            errors.
    """

    def __init__(
        self,
        mesh: NamedMesh,
        materials: Materials,
        clamps: Sequence[PrescribedDisplacement],
        tractions: Sequence[Load] = (),
        body_force: Field = (0.0, 0.0, 0.0),
        springs: Sequence[Spring] = (),
        body_force_amplitude: Amplitude = 1.0,
        gravity: Sequence[float] = (0.0, 0.0, 0.0),
        gravity_amplitude: Amplitude = 1.0,
    ):
        super().__init__(
            *(mesh, materials, clamps, tractions, body_force, springs, body_force_amplitude),
            *(gravity, gravity_amplitude),
        )
        trial = ufl.TrialFunction(self.V)
        self.K = compat.assemble_matrix(fem.form(ufl.inner(self._stress(trial), strain(self._test)) * ufl.dx))
        self._add_springs()
        self._held = self._eliminate_fixed()
        self._attach_rigid_body_modes()

    def f(self, loading: Loading) -> PETSc.Vec:
        """The load in newtons, with the prescribed displacements included, so that K u = f; collective."""
        f, free = self.K.createVecRight(), loading.load
        if self.mesh.comm.allreduce(bool(np.any(loading.prescribed)), op=MPI.LOR):
            free = loading.load - self.internal_force(loading.prescribed)
        f.array[:] = np.where(self.fixed, self._held * loading.prescribed, free).ravel()
        return f

    def _add_springs(self) -> None:
        comm = self.mesh.comm
        diagonal = self.K.getDiagonal()
        stiff = comm.allreduce(float(np.max(diagonal.array, initial=0.0)), op=MPI.MAX)
        diagonal.array[:] += self.spring.ravel()
        self.K.setDiagonal(diagonal)
        diagonal.destroy()
        count = comm.allreduce(self._owned, op=MPI.SUM)
        free = self._rigid_motions(np.where(self.fixed, 1.0, self.spring / stiff), 1e-12 * count)
        if free:
            raise ValueError(
                f"the springs are too soft in comparison with rounding errors: against {free} the nodes have less than "
                "1e-12 of the body's own stiffness; make the springs stiffer, or hold the body by a clamp"
            )

    def _eliminate_fixed(self) -> float:
        """Zero the rows and columns of the fixed components; returns their new diagonal entry."""
        comm = self.mesh.comm
        diagonal = self.K.getDiagonal()
        free = diagonal.array[~self.fixed.ravel()]
        mean = float(comm.allreduce(float(free.sum()), op=MPI.SUM) / comm.allreduce(len(free), op=MPI.SUM))
        diagonal.destroy()
        first = self.K.getOwnershipRange()[0]
        rows = (first + np.flatnonzero(self.fixed)).astype(PETSc.IntType)
        self.K.setOption(PETSc.Mat.Option.KEEP_NONZERO_PATTERN, True)
        self.K.zeroRowsColumns(rows, diag=mean)
        self.K.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        self.K.setOption(PETSc.Mat.Option.SPD, True)
        return mean

    def _attach_rigid_body_modes(self) -> None:
        coordinates = self.K.createVecRight()
        coordinates.setBlockSize(3)
        coordinates.array[:] = self.x.ravel()
        modes = PETSc.NullSpace().createRigidBody(coordinates)
        self.K.setNearNullSpace(modes)
        modes.destroy()
        coordinates.destroy()
