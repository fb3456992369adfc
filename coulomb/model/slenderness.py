"""Slenderness and supports of bodies, on which the use of multigrid depends."""

from __future__ import annotations

import numpy as np

from ..fem.deformable import Deformable
from ..fem.materials import by_group
from ..fem.named_mesh import volume
from ..fem.surface import ContactSurface
from ..linalg.reductions import Reductions

_SOFT = 1e-2  # stiffness of springs against a rigid motion, over Young's modulus times the size of the bodies


def slenderness_of(surface: ContactSurface, elasticity: Deformable) -> float:
    """Square root of the contact area, over volume by contact area: 1.6 for the block, 21 for a thin plate; collective.

    A thin body deforms far from where it is pressed: path following takes more steps and products there (46 steps and
    250 products on a bracket of slenderness 5 where the block takes 21 and 90, both from equal pressure).
    """
    over = Reductions(elasticity.comm)
    area = over.sum(surface.area)
    return float(area**1.5) / sum(over.sum(volume(member.body.mesh)) for member in elasticity.members)


def on_soft_springs(elasticity: Deformable) -> bool:
    """Whether springs alone resist a rigid motion of all bodies, and hardly; collective.

    A motion by 1 m in the root mean square takes less than `_SOFT` of E V^(1/3) (E the largest Young's modulus, V the
    volume).  Contact forces then move the bodies much farther than they deform them: the Newton systems of path
    following, with products by multigrid, need 20 to 40 products a step where exact ones need 6.
    """
    over, K = Reductions(elasticity.comm), elasticity.K
    near = K.getNearNullSpace()
    if near is None or elasticity.free or not over.max(np.abs(elasticity.spring)) > 0.0:
        return False
    modes, image = near.getVecs(), K.createVecLeft()
    stiffness = np.empty((len(modes), len(modes)))
    for k, mode in enumerate(modes):
        K.mult(mode, image)
        stiffness[:, k] = [image.dot(other) for other in modes]
    image.destroy()
    members = elasticity.members
    size = sum(over.sum(volume(member.body.mesh)) for member in members) ** (1.0 / 3.0)
    materials = [member.body.materials for member in members]
    young = max(
        (float(np.max(m.young)) for given in materials if given is not None for _, m in by_group(given)), default=0.0
    )
    softest = float(np.linalg.eigvalsh(0.5 * (stiffness + stiffness.T))[0]) * over.sum(float(len(elasticity.x)))
    return bool(softest < _SOFT * young * size)
