"""Shape, materials and supports of bodies, on which the use of factors and multigrid depends, or why both fail."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final, cast

import numpy as np
from petsc4py import PETSc

from ..arrays import FloatArray
from ..fem import compat
from ..fem.bodies import (
    Deformable,
    SingleBody,
    by_group,
    component_modes,
    null_space,
    of_components,
)
from ..fem.geometry import of_place
from ..fem.meshes import volume
from ..linalg.compliance import SoftMotions
from ..linalg.factors import NotPositiveDefinite
from ..linalg.reductions import Reductions
from ..linalg.solve_errors import CGNotConverged

_SOFT: Final = 1e-2
"""Stiffness of springs against a rigid motion, over that of the body (Young's modulus times its size), below which it
is computed apart: a product by A of a few per cent is then wrong by as much as the body deforms."""

_FREE: Final = 1e-10  # energy of held directions, over the nodes, up to which they do not prevent a motion


def soft_motions(elasticity: Deformable) -> SoftMotions | None:
    """The motions of single components of the bodies; None if there are none; collective.

    The stiffness of a component of N nodes is estimated by that of a cube of as many, E L, as the mean diagonal of K
    times N^(1/3), so that a motion by 1 m (root mean square) and a deformation are compared.  Springs that are stiff
    along some directions leave the motions along the others.  Anchors of free motions (`FreeMotions`) count as springs.
    """
    over, component = Reductions(elasticity.comm), elasticity.free.component
    modes, parts = component_modes(elasticity.x, component, elasticity.comm)
    held, ground = elasticity.reduction.prevented(modes), elasticity.ground
    forces = elasticity.anchoring[: len(modes), :, None] * modes
    if ground is not None:
        forces += of_components(ground, elasticity.x, component, parts, elasticity.comm)
    stiff = elasticity.reduced.diagonal.reshape(-1, 3).mean(axis=1)[: len(elasticity.x)]
    found: list[tuple[FloatArray, FloatArray]] = []
    for number in range(len(parts)):
        here = component == number
        count, total = over.sum(float(np.sum(here))), over.sum(stiff[here])
        own, resisting = modes[here], forces[here]
        prevented, energy = (over.total(np.einsum("kci,kcj->ij", own, part)) for part in (held[here], resisting))
        free = null_space(prevented, _FREE * count)
        sizes, V = np.linalg.eigh(free.T @ (0.5 * (energy + energy.T)) @ free)
        soft = (sizes > 0.0) & (sizes < _SOFT * total / count * count ** (1.0 / 3.0))
        if np.any(soft):
            T = free @ V[:, soft] / np.sqrt(sizes[soft])
            R, KR = np.zeros((2, *modes.shape[:2], T.shape[1]))
            R[here], KR[here] = own @ T, resisting @ T
            found.append((elasticity.reduction.reduced(elasticity.held.free_part(R)), elasticity.reduction.along(KR)))
    if not found:
        return None
    R, KR = (np.concatenate(columns, axis=2) for columns in zip(*found, strict=True))
    return SoftMotions(elasticity.comm, R.reshape(3 * len(R), R.shape[2]), KR.reshape(3 * len(KR), KR.shape[2]))


_BENDS: Final = 25.0  # cube of the diagonal of a body over its volume: 12 for the block, 27 to 77 for parts that bend
_APART: Final = 1e3  # largest over smallest Young's modulus


def ill_conditioned(elasticity: Deformable) -> bool:
    """Whether K is probably too ill-conditioned for factors in single precision; collective.

    A rule: where a body is long beside its thickness, so that it bends (a hook or a clip, not a block or a wedge), or
    materials are far apart.  Of the parts in docs/measurements.md with 12 000 unknowns and more it is right on all but
    a half ring that is held at both ends; with some thousand unknowns most of them do not need double precision.
    """
    over, moduli = Reductions(elasticity.comm), _moduli(elasticity)
    if moduli and max(moduli) > _APART * min(moduli):
        return True
    for member in elasticity.members:
        if np.linalg.norm(over.extent(member.body.x)) ** 3 > _BENDS * over.sum(volume(member.body.mesh)):
            return True
    return False


def _moduli(elasticity: Deformable) -> list[float]:
    """Young's moduli of all materials, of orthotropic ones the largest, pascals; 0 of functions of place, which may be
    far apart."""
    materials = [member.body.materials for member in elasticity.members]
    moduli = [m.young for given in materials if given is not None for _, m in by_group(given)]
    return [0.0 if of_place(young) else float(np.max(cast(Any, young))) for young in moduli]


_FLAT: Final = 1e4
"""Length of a cell over its thickness from which its shape is named as the cause of a singular stiffness."""


@contextmanager
def explained(elasticity: Deformable) -> Iterator[None]:
    """Failures of K^-1 as errors in the form a, if K is made of the user's forms, or in the shape of cells."""
    try:
        yield
    except (ValueError, PETSc.Error, CGNotConverged) as error:
        slow = isinstance(error, CGNotConverged) and not error.indefinite
        if elasticity.forms() is not None and not slow:
            raise NotPositiveDefinite(
                "Body: a is not positive definite where bcs hold nothing, to rounding: look at the signs of its terms "
                "and coefficients, and whether bcs or Robin terms hold every part of the body"
                + "".join(member.body.suspects() for member in elasticity.members)
            ) from None
        flattest = max(_proportion(member.body) for member in elasticity.members)
        if not isinstance(error, NotPositiveDefinite) or flattest < _FLAT:
            raise
        raise NotPositiveDefinite(
            f"{error}: there are cells {flattest:.1e} times as long as they are thick; check the lengths and the unit "
            "of the mesh"
        ) from None


def _proportion(body: SingleBody) -> float:
    """The largest extent of a cell over its smallest one, of all cells; collective."""
    points = body.domain.geometry.x[compat.cell_geometry(body.domain)]
    sizes = np.linalg.svd(points - points.mean(axis=1, keepdims=True), compute_uv=False)
    return Reductions(body.comm).max(sizes[:, 0] / np.maximum(sizes[:, 2], np.finfo(float).tiny))
