"""The rigid motions that soft springs alone resist."""

from __future__ import annotations

import numpy as np

from ..arrays import FloatArray
from ..fem.bodies import Deformable, component_modes, null_space, of_components
from ..linalg.compliance import SoftMotions
from ..linalg.reductions import Reductions

_SOFT = 1e-2
"""Stiffness of springs against a motion, over that of the body, below which it is computed apart: a product by A of a
few per cent is then wrong by as much as the body deforms."""

_FREE = 1e-10  # energy of held directions, over the nodes, up to which they do not prevent a motion


def soft_motions(elasticity: Deformable) -> SoftMotions | None:
    """The motions of single components of the bodies; None if there are none; collective.

    The stiffness of a component of N nodes is estimated by that of a cube of as many, E L, as the mean diagonal of K
    times N^(1/3), so that a motion by 1 m (root mean square) and a deformation are compared.  Springs that are stiff
    along some directions leave the motions along the others.  Anchors of free motions (`FreeMotions`) count as springs.
    """
    over, component = Reductions(elasticity.comm), elasticity.free.component
    modes, parts = component_modes(elasticity.x, component, elasticity.comm)
    held, ground = elasticity.held_part(modes), elasticity.ground
    forces = elasticity.anchoring[:, :, None] * modes
    if ground is not None:
        forces += of_components(ground, elasticity.x, component, parts, elasticity.comm)
    diagonal = elasticity.K.getDiagonal()
    stiff = diagonal.array.reshape(-1, 3).mean(axis=1)
    diagonal.destroy()
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
            found.append((elasticity.free_part(R), elasticity.free_part(KR)))
    if not found:
        return None
    R, KR = (np.concatenate(columns, axis=2) for columns in zip(*found, strict=True))
    return SoftMotions(elasticity.comm, R.reshape(3 * len(R), R.shape[2]), KR.reshape(3 * len(KR), KR.shape[2]))
