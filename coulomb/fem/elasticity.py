"""Linear elasticity of one body: stiffness K, load f, near-nullspace, internal forces, stress."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from mpi4py import MPI
from petsc4py import PETSc

from ..arrays import FloatArray
from . import compat
from .body import ElasticBody, Material, strain
from .compat import fem, ufl
from .fields import Amplitude, Field, evaluate_amplitude, evaluate_vectors, on_all_ranks
from .meshes import NamedMesh

_MODES = (
    *("translation along x", "translation along y", "translation along z"),
    *("rotation about x", "rotation about y", "rotation about z"),
)


@dataclass(frozen=True)
class Clamp:
    """Prescribed displacement on a face.

    Attributes:
        face: Name of the face.
        components: Which components are held, letters of "xyz".
        value: Displacement in metres, a vector or a function of x; components not held are ignored.
        amplitude: What the value is multiplied by in the course of time.

    Raises:
        ValueError: If components is not made of different letters of "xyz".
    """

    face: str
    components: str = "xyz"
    value: Field = (0.0, 0.0, 0.0)
    amplitude: Amplitude = 1.0

    def __post_init__(self) -> None:
        letters = set(self.components)
        if not letters or len(letters) != len(self.components) or letters - set("xyz"):
            raise ValueError(
                f"clamp on {self.face!r}: components must be letters of 'xyz', but are {self.components!r}"
            )


@dataclass(frozen=True)
class Traction:
    """Surface load on a face.

    Attributes:
        face: Name of the face.
        value: Traction in pascals, a vector or a function of x.
        amplitude: What the value is multiplied by in the course of time.
    """

    face: str
    value: Field
    amplitude: Amplitude = 1.0


class Elasticity(ElasticBody):
    """K u = f on trilinear hexahedra or linear tetrahedra, with clamps built in.

    Constrained rows and columns of K are zero but for the diagonal, which is the mean diagonal of the free ones (a 1
    there would spoil the multigrid and every scale); f has the prescribed values, so that K u = f holds them exactly.

    Attributes:
        mesh: The body.
        V: Its space of displacements.
        K: Stiffness, N/m; block size 3, symmetric positive definite, with the rigid body modes as its near-nullspace.
        f: Load in newtons, with the prescribed displacements built in.
        load: The load alone, this rank's part, shape (k, 3), newtons.
        fixed: Which components are prescribed, this rank's nodes, shape (k, 3).
        prescribed: Their values in metres, 0 elsewhere, shape (k, 3).
        dragged: Which components are prescribed to be other than 0 at some time, shape (k, 3).
        time: The time of load, prescribed and f; K does not change.

    Raises:
        ValueError: If a face is unknown, a value not finite, or the clamps leave the body a rigid motion.
    """

    def __init__(
        self,
        mesh: NamedMesh,
        material: Material,
        clamps: Sequence[Clamp],
        tractions: Sequence[Traction] = (),
        body_force: Field = (0.0, 0.0, 0.0),
        body_force_amplitude: Amplitude = 1.0,
        time: float = 0.0,
    ):
        super().__init__(mesh.domain, material)
        self.mesh = mesh
        self.fixed, self.dragged = np.zeros((2, self._owned, 3), dtype=bool)
        self._clamps = [self._prescribe(clamp) for clamp in clamps]
        self._refuse_floating_body()
        self._loads = self._assemble_loads(tractions, body_force, body_force_amplitude)

        trial = ufl.TrialFunction(self.V)
        self.K = compat.assemble_matrix(fem.form(ufl.inner(self._stress(trial), strain(self._test)) * ufl.dx))
        self._held = self._eliminate_fixed()
        self._attach_rigid_body_modes()
        self._load_at(time)

    def at(self, time: float) -> Elasticity:
        """The same body and K under the loads and prescribed displacements of another time; collective.

        Raises:
            ValueError: On every rank, if an amplitude has no finite value at that time.
        """
        other = copy.copy(self)
        other._load_at(time)
        return other

    def _load_at(self, time: float) -> None:
        self.time = time
        self.load: FloatArray = np.zeros((self._owned, 3))
        for amplitude, what, load in self._loads:
            self.load += self._factor(amplitude, time, what) * load
        self.prescribed: FloatArray = np.zeros((self._owned, 3))
        for clamp, nodes, values in self._clamps:
            factor = self._factor(clamp.amplitude, time, f"clamp on {clamp.face!r}")
            for component in map("xyz".index, clamp.components):
                self.prescribed[nodes, component] = factor * values[:, component]
        self.f = self.K.createVecRight()
        free = self.load
        if self.mesh.comm.allreduce(bool(np.any(self.prescribed)), op=MPI.LOR):
            free = self.load - self.internal_force(self.prescribed)
        self.f.array[:] = np.where(self.fixed, self._held * self.prescribed, free).ravel()

    def _factor(self, amplitude: Amplitude, time: float, what: str) -> float:
        factor: float = on_all_ranks(lambda: evaluate_amplitude(amplitude, time, what), "", self.mesh.comm)
        return factor

    # --- constraints and loads ----------------------------------------------------------------------------------

    def _prescribe(self, clamp: Clamp) -> tuple[Clamp, npt.NDArray[np.int32], FloatArray]:
        nodes = self.nodes(clamp.face, "clamp")
        values = evaluate_vectors(clamp.value, self.x[nodes], f"clamp on {clamp.face!r}", self.mesh.comm)
        for component in map("xyz".index, clamp.components):
            self.fixed[nodes, component] = True
            self.dragged[nodes, component] = values[:, component] != 0.0
        return clamp, nodes, values

    def _refuse_floating_body(self) -> None:
        comm, x = self.mesh.comm, self.x
        count = comm.allreduce(len(x), op=MPI.SUM)
        centre = comm.allreduce(x.sum(axis=0), op=MPI.SUM) / count
        r = x - centre
        size = math.sqrt(comm.allreduce(float(np.sum(r**2)), op=MPI.SUM) / count)
        modes = np.zeros((*x.shape, 6))
        for k in range(3):
            i, j = (k + 1) % 3, (k + 2) % 3
            modes[:, k, k] = 1.0
            modes[:, i, 3 + k], modes[:, j, 3 + k] = -r[:, j] / size, r[:, i] / size
        held = modes[self.fixed]
        gram = comm.allreduce(held.T @ held, op=MPI.SUM)
        eigenvalues, vectors = np.linalg.eigh(gram)
        free = vectors[:, eigenvalues <= 1e-10 * max(float(eigenvalues[-1]), 1e-300)]
        if free.shape[1]:
            names = [name for name, row in zip(_MODES, free, strict=True) if np.linalg.norm(row) > 0.3]
            raise ValueError(
                f"the body floats: its clamps leave it {', '.join(names)}; hold these by a clamp, "
                "contact alone does not make the stiffness invertible"
            )

    def _assemble_loads(
        self, tractions: Sequence[Traction], body_force: Field, body_force_amplitude: Amplitude
    ) -> list[tuple[Amplitude, str, FloatArray]]:
        """Every load with its amplitude, and what it is called in errors."""
        loads = [(body_force_amplitude, "body_force", self._integrate(body_force, "body_force", ufl.dx))]
        for traction in tractions:
            facets, what = self.mesh.facets(traction.face, "traction"), f"traction on {traction.face!r}"
            loads.append((traction.amplitude, what, self._integrate(traction.value, what, self._ds(facets))))
        return loads

    def _integrate(self, field: Field, what: str, measure: Any) -> FloatArray:
        """Integral of field . v for every hat function, this rank's part, shape (k, 3)."""
        density = fem.Function(self.V)
        density.x.array[: 3 * self._owned] = evaluate_vectors(field, self.x, what, self.mesh.comm).ravel()
        density.x.scatter_forward()
        return self._assemble(fem.form(ufl.inner(density, self._test) * measure))

    def _ds(self, facets: npt.NDArray[np.int32]) -> Any:
        tags = compat.meshtags(self.mesh.domain, 2, facets, np.ones(len(facets), dtype=np.int32))
        return ufl.Measure("ds", domain=self.mesh.domain, subdomain_data=tags, subdomain_id=1)

    def _eliminate_fixed(self) -> float:
        """Zero the rows and columns of the fixed components; what stands on their diagonal then."""
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

    # --- what others ask ----------------------------------------------------------------------------------------

    def nodes(self, face: str, what: str) -> npt.NDArray[np.int32]:
        """This rank's nodes on a face, sorted; ValueError if there is no such face."""
        facets = self.mesh.facets(face, what)
        dofs = np.unique(fem.locate_dofs_topological(self.V, 2, facets))
        owned: npt.NDArray[np.int32] = dofs[dofs < self._owned].astype(np.int32)
        return owned

    def nodal_area(self, face: str) -> FloatArray:
        """Integral of every hat function over a face in m^2, this rank's nodes, shape (k,)."""
        ones = (1.0, 1.0, 1.0)
        return self._integrate(ones, "area", self._ds(self.mesh.facets(face, "contact")))[:, 0]

    def nodal_normal(self, face: str) -> FloatArray:
        """Integral of the body's outward normal against every hat function over a face, m^2, shape (k, 3)."""
        n = ufl.FacetNormal(self.mesh.domain)
        return self._assemble(fem.form(ufl.inner(n, self._test) * self._ds(self.mesh.facets(face, "contact"))))
