"""A mesh at another place: rotated, then translated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...arrays import FloatArray, is_number
from .. import compat
from ..geometry import Point, RigidMotion, Rotation, Turn, check_point
from .named_mesh import NamedMesh

NOWHERE = (0.0, 0.0, 0.0)


def moved(mesh: NamedMesh, translate: Point = NOWHERE, rotate: Rotation | None = None) -> NamedMesh:
    """The same mesh at another place: rotated, then translated.

    Faces and groups of cells keep their names, cells their shape, curved ones too; the given mesh stays where it is, so
    that one mesh can be the model of several bodies.  Loads, directions of supports and axes of materials are those of
    space: they do not rotate with the mesh.

    Args:
        mesh: A mesh of any order.
        translate: In metres, along x, y and z.
        rotate: A rotation by a constant angle in radians; `point` and `axis` are those before the translation.

    Raises:
        ValueError: If the translation is not three finite numbers, or the angle not one.
    """
    motion = motion_of(translate, rotate)
    domain = compat.copied_mesh(mesh.domain)
    domain.geometry.x[:] = placed(motion, domain.geometry.x)
    return replace(mesh, domain=domain, touching=placed(motion, mesh.touching))


def motion_of(translate: Point, rotate: Rotation | None) -> RigidMotion:
    """The motion from the place where a mesh was made.

    Raises:
        ValueError: As `moved`.
    """
    check_point("moved: translate", translate)
    shift = np.asarray(translate, dtype=np.float64)
    if rotate is None:
        return RigidMotion(shift)
    if not isinstance(rotate, Rotation):
        raise ValueError(f"moved: rotate must be a Rotation(point, axis, angle), but is {rotate!r}")
    if not is_number(rotate.angle, -np.inf):
        raise ValueError(f"moved: the angle of rotate must be one finite number in radians, but is {rotate.angle!r}")
    axis = np.asarray(rotate.axis, dtype=np.float64)
    point = np.asarray(rotate.point, dtype=np.float64)
    return RigidMotion(shift, Turn(point, axis / np.linalg.norm(axis), float(np.asarray(rotate.angle))))


def placed(motion: RigidMotion, x: FloatArray) -> FloatArray:
    """Points x (k, 3) in metres after a motion, shape (k, 3)."""
    if motion.turn is None:
        return x + motion.translation
    turned: FloatArray = motion.turned(x - motion.turn.point) + motion.centre
    return turned
