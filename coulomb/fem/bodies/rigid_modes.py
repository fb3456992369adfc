"""The six rigid motions of a body, or of each of its components."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from mpi4py import MPI

from ...arrays import BoolArray, FloatArray, IntArray
from ...units import amount

SMALL: Final = 1e-3
"""Parts of loads and directions below this are not worth a word."""


@dataclass(frozen=True, eq=False)
class RigidLoad:
    """Force and moment of loads along the free motions of a component.

    Attributes:
        force: In newtons, shape (3,).
        moment: About the centre of the component, newton metres, shape (3,).
    """

    component: int
    part: RigidPart
    force: FloatArray
    moment: FloatArray

    @property
    def size(self) -> float:
        """Of the force, or of the moment over the radius, newtons."""
        return max(float(np.linalg.norm(self.force)), float(np.linalg.norm(self.moment)) / self.part.radius)

    def scaled(self, factor: float) -> str:
        """The amounts of a part of it, in words."""
        return " and ".join(size for size, _ in self._said(factor))

    def __str__(self) -> str:
        return " and ".join(f"{where} with {size}" for size, where in self._said(1.0))

    def _said(self, factor: float) -> list[tuple[str, str]]:
        """Amount and direction of the force and of the moment, those that are no rounding errors."""
        force, moment = (float(np.linalg.norm(vector)) for vector in (self.force, self.moment))
        said = []
        if force > SMALL * self.size:
            said.append((f"{amount(factor * force, 'N')}", f"along {direction_in_words(self.force, SMALL)}"))
        if moment > SMALL * self.size * self.part.radius:
            place = ", ".join(f"{value:.4g}" for value in tidy(self.part.centre, self.part.radius))
            axis = direction_in_words(self.moment, SMALL)
            said.append((f"{amount(factor * moment, 'N m')}", f"around {axis} through ({place})"))
        return said


def direction_in_words(vector: FloatArray, part: float = SMALL) -> str:
    """x, y, z, or the unit vector as (0.96, 0.29, 0), without components below a part of it."""
    unit = tidy(vector / (float(np.linalg.norm(vector)) or 1.0), part / SMALL)
    for axis, name in enumerate("xyz"):
        if np.count_nonzero(unit) == 1 and unit[axis] != 0.0:
            return name if unit[axis] > 0.0 else f"-{name}"
    return f"({', '.join(f'{value:.2g}' for value in unit)})"


def tidy(vector: FloatArray, size: float) -> FloatArray:
    """Without components that are rounding errors beside a size."""
    return np.where(np.abs(vector) < SMALL * size, 0.0, vector) + 0.0


@dataclass(frozen=True, eq=False)
class RigidPart:
    """A component of a body: the mean of its nodes (3,) and the root mean square of their distances from it, metres."""

    centre: FloatArray
    radius: float


def rigid_modes(x: FloatArray, comm: MPI.Comm) -> FloatArray:
    """Translations along x, y, z and rotations about these axes through the mean of all nodes x, shape (k, 3, 6);
    collective.

    Each has the size 1: the translations at every node, the rotations in the root mean square of all nodes.
    """
    return component_modes(x, np.zeros(len(x), dtype=np.int64), comm)[0]


def displacements_of(r: FloatArray, size: FloatArray) -> FloatArray:
    """Displacements of points r (k, 3) in translations along x, y, z and rotations about them, by 1/size radians;
    sizes (k,), metres; shape (k, 3, 6)."""
    modes = np.zeros((*r.shape, 6))
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        modes[:, k, k] = 1.0
        modes[:, i, 3 + k], modes[:, j, 3 + k] = -r[:, j] / size, r[:, i] / size
    return modes


def component_modes(x: FloatArray, component: IntArray, comm: MPI.Comm) -> tuple[FloatArray, tuple[RigidPart, ...]]:
    """The six rigid motions of the component of each node, of one metre, shape (k, 3, 6), and the components;
    collective."""
    count = int(comm.allreduce(int(np.max(component, initial=-1)), op=MPI.MAX)) + 1
    number = comm.allreduce(np.bincount(component, minlength=count).astype(np.float64))
    sums = np.stack([np.bincount(component, weights=axis, minlength=count) for axis in x.T], axis=1)
    centre = comm.allreduce(sums) / number[:, None]
    r = x - centre[component]
    squares = comm.allreduce(np.bincount(component, weights=np.sum(r**2, axis=1), minlength=count))
    radius = np.sqrt(squares / number)
    radius[radius == 0.0] = 1.0
    parts = tuple(RigidPart(c, float(size)) for c, size in zip(centre, radius, strict=True))
    return displacements_of(r, radius[component]), parts


def of_components(
    forces: FloatArray, x: FloatArray, component: IntArray, parts: Sequence[RigidPart], comm: MPI.Comm
) -> FloatArray:
    """Forces of the motions of each node's component (`component_modes`), from those of the body as a whole
    (`rigid_modes`), linear in them, shapes (k, 3, 6); collective."""
    _, (whole,) = component_modes(x, np.zeros(len(x), dtype=np.int64), comm)
    of = np.zeros_like(forces)
    for number, part in enumerate(parts):
        here = component == number
        moved = np.cross(np.eye(3), whole.centre - part.centre) / part.radius  # of the body's centre, by unit rotations
        of[here, :, :3] = forces[here, :, :3]
        of[here, :, 3:] = whole.radius / part.radius * forces[here, :, 3:] + forces[here, :, :3] @ moved.T
    return of


def of_part(forces: FloatArray, x: FloatArray, here: BoolArray, comm: MPI.Comm) -> FloatArray:
    """Forces of the `rigid_modes` of a component's nodes, those `here` (k,), from those of the body as a whole (k, 3,
    6); collective."""
    _, parts = component_modes(x, np.where(here, 0, 1), comm)
    return of_components(forces, x, np.where(here, 0, 1), parts, comm)[here]


def null_space(energy: FloatArray, limit: float) -> FloatArray:
    """The motions with an energy between -`limit` and `limit`, orthonormal columns of six components, shape (6, q): one
    far below 0, as where a body under stress turns, is not free."""
    sizes, vectors = np.linalg.eigh(0.5 * (energy + energy.T))
    return vectors[:, np.abs(sizes) <= limit]


def nearest_turn(x: FloatArray, y: FloatArray, comm: MPI.Comm) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Of the rigid motion with a finite rotation that is nearest to one from points x to y, shapes (k, 3): the means of
    both, (3,), and the rotation R, (3, 3) (Kabsch 1976); collective."""
    count = comm.allreduce(len(x))
    from_, to = comm.allreduce(np.array([x.sum(axis=0), y.sum(axis=0)])) / count
    return from_, to, turn_of(comm.allreduce((x - from_).T @ (y - to)))


def turn_of(products: FloatArray) -> FloatArray:
    """The rotation R that is nearest to a motion from x to y, both about their means, by the sum of x y^T, (3, 3)."""
    left, _, right = np.linalg.svd(products)
    return right.T @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ left.T


@dataclass(frozen=True, eq=False)
class Wrench:
    """A force and a moment of which the directions do not turn, at a point that moves with a face.

    Attributes:
        point: The point before deformation, metres, shape (3,).
        force, moment: Newtons and newton metres, shapes (3,).
        forces: The forces on nodes that stand for them now, newtons, shape (k, 3).
    """

    face: str
    point: FloatArray
    force: FloatArray
    moment: FloatArray
    forces: FloatArray
