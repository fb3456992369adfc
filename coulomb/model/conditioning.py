"""Shape, gaps and supports of bodies, on which the use of multigrid depends."""

from __future__ import annotations

from typing import Any, Final, cast

import numpy as np

from ..arrays import FloatArray
from ..fem.bodies import (
    Deformable,
    by_group,
    component_modes,
    diagonal_of,
    largest_poisson,
    null_space,
    of_components,
)
from ..fem.contact import ContactSurface
from ..fem.geometry import of_place
from ..fem.meshes import aspects, volume
from ..linalg.compliance import Measures, SoftMotions
from ..linalg.reductions import Reductions

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
    stiff = diagonal_of(elasticity.K).reshape(-1, 3).mean(axis=1)[: len(elasticity.x)]
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


_NEAR: Final = 1e-3  # of the diagonal of the bodies, about as far as small strains let their surfaces move

_TETRAHEDRA = 1.0 + np.sqrt(2.0)  # aspect of six that fill a cube

_BENDS: Final = 25.0  # cube of the diagonal of a body over its volume: 12 for the block, 27 to 77 for parts that bend
_APART: Final = 1e3  # largest over smallest Young's modulus


def slenderness_of(surface: ContactSurface, elasticity: Deformable) -> float:
    """Square root of the contact area, over volume by contact area: 1.6 for the block, 21 for a thin plate; collective.

    A thin body deforms far from where it is pressed: path following takes more steps and products there (46 steps and
    250 products on a bracket of slenderness 5 where the block takes 21 and 90, both from equal pressure).
    """
    over = Reductions(elasticity.comm)
    area = over.sum(surface.area)
    return float(area**1.5) / sum(over.sum(volume(member.body.mesh)) for member in elasticity.members)


def near_part(surface: ContactSurface, elasticity: Deformable) -> float:
    """Part of the contact face, by area, whose gap exceeds the smallest by at most 1e-3 diagonals; collective.

    1 for a face on its plane, 0.05 for a half ring on a plane: most of its nodes stay open whatever happens.
    """
    over, gap = Reductions(elasticity.comm), surface.gap
    near = gap <= over.min(gap) + _NEAR * np.linalg.norm(over.extent(elasticity.x))
    return over.sum(surface.area[near]) / over.sum(surface.area)


def measures_of(surface: ContactSurface, elasticity: Deformable, displacement: int, contact: int) -> Measures:
    """What decides how long multigrid takes, with the unknowns of all ranks; collective."""
    bodies = [member.body for member in elasticity.members]
    return Measures(
        displacement,
        contact,
        slenderness_of(surface, elasticity),
        near_part(surface, elasticity),
        any(body.mesh.tetrahedra for body in bodies),
        len(elasticity.free) > 0,
        any(body.degree == 2 for body in bodies),
        aspect_of(elasticity),
        elongation_of(surface, elasticity),
        max((largest_poisson(body.materials) for body in bodies if body.materials is not None), default=0.0),
    )


def aspect_of(elasticity: Deformable) -> float:
    """Aspect of the cells in the mean over a body, over that of cubes, or of the tetrahedra that fill one; of the body
    where it is largest; collective."""
    over, found = Reductions(elasticity.comm), []
    for member in elasticity.members:
        each = aspects(member.body.mesh)
        usual = _TETRAHEDRA if member.body.mesh.tetrahedra else 1.0
        found.append(over.sum(each) / (over.sum(float(len(each))) * usual))
    return max(found)


def elongation_of(surface: ContactSurface, elasticity: Deformable) -> float:
    """Square of the diagonal of a contact face over its area, of the face where it is largest; collective."""
    over, found = Reductions(elasticity.comm), []
    for number in range(len(surface.faces)):
        here = surface.part == number
        found.append(float(np.sum(over.extent(surface.x[here]) ** 2)) / over.sum(surface.area[here]))
    return max(found)


def on_soft_springs(elasticity: Deformable) -> bool:
    """Whether springs alone resist a rigid motion of all bodies, and hardly; collective.

    A motion by 1 m in the root mean square takes less than `_SOFT` of E V^(1/3) (E the largest Young's modulus, V the
    volume).  Contact forces then move the bodies much farther than they deform them: path following by multigrid takes
    three to ten times as many iterations as predicted, although these motions are computed apart.
    """
    over, K = Reductions(elasticity.comm), elasticity.K
    near = K.getNearNullSpace()
    if near is None or elasticity.free or elasticity.ground is None:
        return False
    modes, image = near.getVecs(), K.createVecLeft()
    stiffness = np.empty((len(modes), len(modes)))
    for k, mode in enumerate(modes):
        K.mult(mode, image)
        stiffness[:, k] = [image.dot(other) for other in modes]
    image.destroy()
    size = sum(over.sum(volume(member.body.mesh)) for member in elasticity.members) ** (1.0 / 3.0)
    softest = float(np.linalg.eigvalsh(0.5 * (stiffness + stiffness.T))[0]) * over.sum(float(len(elasticity.x)))
    return bool(softest < _SOFT * max(_moduli(elasticity), default=0.0) * size)


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
