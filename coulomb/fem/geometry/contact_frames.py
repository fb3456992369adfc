"""Frames of the contact points: the normal and two tangents, the tangents scaled where friction is orthotropic.

With coefficients F1 along a direction and F2 across it, the friction force T of a node lies in an ellipse,

    (T1/(F1 x_n))^2 + (T2/(F2 x_n))^2 <= 1,       F = max(F1, F2)

and slip is along the outward normal of the ellipse at T (associated rule).  In y_i = T_i F/F_i this is the disc
|y| <= F x_n, with slip along y.  So the tangents are multiplied by F_i/F: B^T y is then the force T, B u the slip
that belongs to y, and all else is as for one coefficient.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from ...arrays import FloatArray
from .user_values import Coefficient, Field, evaluate_numbers, evaluate_vectors, first_place, on_all_ranks

if TYPE_CHECKING:
    from mpi4py import MPI

_ALONG_NORMAL: Final = 1e-3
"""Sine of the angle between a direction and a normal below which the direction has no place in the tangent plane."""

HELD_BEYOND: Final = 1.0 - 1e-10
"""A node whose normal has at least this length along prescribed directions cannot be in contact."""

HELD_BELOW: Final = 1.5e-5
"""The same as a length along directions that are not prescribed: one of a row of B T over that of the row of B."""

_CLEAN: Final = 1e-10
"""A held part of a tangent shorter than this is a rounding error."""

LEAST_RATIO: Final = 1e-3
"""Smallest ratio of the two coefficients of a node: what it scales enters A squared."""


def tangent_frames(n: FloatArray) -> FloatArray:
    """Frames (n, t1, t2) of unit normals n (k, 3), shape (k, 3, 3).

    Of the coordinate axes, the one nearest to n is dropped; t1 and t2 are the other two, in their order, made
    orthogonal to n and then to each other.  So t1, t2 are x, y on a horizontal face, and an axis perpendicular to n
    always is a tangent: a node held in that direction has a row that involves only held components.
    """
    nearest = np.argmax(np.round(np.abs(n), 9), axis=1)  # at 45 degrees the choice must not depend on rounding
    others = np.array([[1, 2], [0, 2], [0, 1]])[nearest]
    t1, t2 = np.eye(3)[others[:, 0]], np.eye(3)[others[:, 1]]
    square = np.abs(np.einsum("ki,ki->k", t2, n)) < 1e-12  # an axis perpendicular to n must be kept: make it the first
    first, second = np.where(square[:, None], t2, t1), np.where(square[:, None], t1, t2)
    first = first - np.einsum("ki,ki->k", first, n)[:, None] * n
    first /= np.linalg.norm(first, axis=1)[:, None]
    second = second - np.einsum("ki,ki->k", second, n)[:, None] * n
    second -= np.einsum("ki,ki->k", second, first)[:, None] * first
    second /= np.linalg.norm(second, axis=1)[:, None]
    swap = square[:, None]
    return np.stack([n, np.where(swap, second, first), np.where(swap, first, second)], axis=1)


def supported_frames(n: FloatArray, H: FloatArray) -> FloatArray:
    """Frames (n, t1, t2) of unit normals n (k, 3) at nodes that are held along directions with projectors H (k, 3, 3).

    They are `tangent_frames` where those have no tangent that is partly held.  Elsewhere t1 is the held direction, or
    the free one if there are two, projected into the tangent plane: then t2 is wholly free or wholly held, and t1 is
    wholly held if a held direction is in the tangent plane.
    """
    frames = tangent_frames(n)
    length = np.linalg.norm(np.einsum("kij,kaj->kai", H, frames[:, 1:]), axis=2)
    partly = np.any((length > _CLEAN) & (length < 1.0 - _CLEAN), axis=1)
    if not np.any(partly):
        return frames
    sizes, directions = np.linalg.eigh(H[partly])
    one = sizes[:, 1] < 0.5  # held along one direction, the last; else along two, and free along the first
    direction = np.where(one[:, None], directions[:, :, 2], directions[:, :, 0])
    normal = n[partly]
    t1 = direction - np.einsum("ki,ki->k", direction, normal)[:, None] * normal
    t1 /= np.linalg.norm(t1, axis=1)[:, None]
    largest = np.argmax(np.round(np.abs(t1), 9), axis=1)  # the sign must not depend on the eigensolver
    t1 *= np.sign(t1[np.arange(len(t1)), largest])[:, None]
    frames[partly, 1], frames[partly, 2] = t1, np.cross(normal, t1)
    return frames


def inverse_frames(frames: FloatArray) -> FloatArray:
    """The rows of frames (k, 3, 3) over the squares of their lengths.

    The rows G are orthogonal, so this is G^-T: slip (3,) as a space vector is G^-1 (B u), and the components of a force
    f (3,) are G^-T f.
    """
    return frames / np.einsum("kij,kij->ki", frames, frames)[:, :, None]


def tangent_lengths(frames: FloatArray) -> FloatArray:
    """Lengths of t1 and t2 of frames (k, 3, 3), shape (k, 2)."""
    return np.linalg.norm(frames[:, 1:], axis=2)


@dataclass(frozen=True)
class FrictionAxes:
    """Orthotropic friction of a face.

    Attributes:
        along: Coefficient of friction F1 along the direction, a number or a function of place.
        across: Coefficient F2 across it.
        direction: Where F1 acts, projected into the tangent plane of each node: a vector or a function of place.
    """

    along: Coefficient
    across: Coefficient
    direction: Field

    def coefficients(self, x: FloatArray, what: str, comm: MPI.Comm) -> FloatArray:
        """F1 and F2 at points x (k, 3) in metres, shape (k, 2); ValueError on every rank if one is negative or not
        finite, or too small beside the other; collective."""
        pair = [evaluate_numbers(given, x, f"{what}: friction", comm) for given in (self.along, self.across)]
        values: FloatArray = np.column_stack(pair)

        def check() -> None:
            apart = np.min(values, axis=1) < LEAST_RATIO * np.max(values, axis=1)
            if np.any(apart):
                F1, F2 = values[np.argmax(apart)]
                said = f"friction ({F1:g}, {F2:g}) at x = {first_place(x, apart)}"
                raise ValueError(
                    f"{said}: the smaller coefficient must be at least {LEAST_RATIO:g} of the larger, or both 0"
                )

        on_all_ranks(check, what, comm)
        return values

    def frames(
        self, n: FloatArray, H: FloatArray, x: FloatArray, what: str, comm: MPI.Comm, deformation: FloatArray | None
    ) -> FloatArray:
        """Rows n, t1 F1/F, t2 F2/F of points with unit normals n (k, 3) and projectors onto their held directions H
        (k, 3, 3), which were at x (k, 3) before a deformation with these gradients (k, 3, 3), shape (k, 3, 3);
        collective.

        t1 is the deformed direction projected into the tangent plane, t2 = n x t1.  Where F1 = F2 they are
        `supported_frames`.

        Raises:
            ValueError: On every rank, as `coefficients`, and if the direction is along a normal.
        """
        F = self.coefficients(x, what, comm)
        directions = evaluate_vectors(self.direction, x, f"{what}: direction", comm)
        if deformation is not None:
            directions = np.einsum("kij,kj->ki", deformation, directions)
        differ = F[:, 0] != F[:, 1]

        def scaled() -> FloatArray:
            frames = supported_frames(n, H)
            size = np.linalg.norm(directions, axis=1)
            if np.any(differ & (size == 0.0)):
                raise ValueError("the direction of friction must not be zero")
            t1 = directions / np.where(size > 0.0, size, 1.0)[:, None]
            t1 = t1 - np.einsum("ki,ki->k", t1, n)[:, None] * n
            length = np.linalg.norm(t1, axis=1)
            lost = differ & (length < _ALONG_NORMAL)
            if np.any(lost):
                at = first_place(x, lost)
                raise ValueError(f"the direction of friction is along the normal at x = {at}; it must lie in the face")
            t1 /= np.where(length > 0.0, length, 1.0)[:, None]
            ratio = F / np.where(differ, np.max(F, axis=1), 1.0)[:, None]
            frames[differ, 1] = (t1 * ratio[:, :1])[differ]
            frames[differ, 2] = (np.cross(n, t1) * ratio[:, 1:])[differ]
            return frames

        return on_all_ranks(scaled, what, comm)


def friction_frames(
    axes: FrictionAxes | None,
    n: FloatArray,
    H: FloatArray,
    x: FloatArray,
    face: str,
    comm: MPI.Comm,
    deformation: FloatArray | None = None,
) -> FloatArray:
    """Rows n, t1, t2 of points of a contact face with unit normals n (k, 3) and projectors onto their held directions H
    (k, 3, 3), which were at x (k, 3) before deformation, with the axes of orthotropic friction if there are any
    (`FrictionAxes.frames`), shape (k, 3, 3); collective."""
    if axes is None:
        return supported_frames(n, H)
    return axes.frames(n, H, x, f"contact face {face!r}", comm, deformation)


def held_length(directions: FloatArray, H: FloatArray) -> FloatArray:
    """Length of the parts of directions (k, 3) that are held, with the projectors H (k, 3, 3) of the nodes, or their
    means at contact points (`ContactPoints.held`); shape (k,)."""
    squares: FloatArray = np.einsum("ki,kij,kj->k", directions, H, directions)
    return np.sqrt(np.maximum(squares, 0.0))
