"""Rigid motions of bodies that contact alone holds, as the contact points see them."""

from __future__ import annotations

import numpy as np
from mpi4py import MPI

from ..fem.bodies import Deformable, Loading
from ..fem.contact import ContactSurface, rows_of
from ..solvers.rigid_motions import RigidMotions


def rigid_motions(elasticity: Deformable, surface: ContactSurface, loading: Loading) -> RigidMotions | None:
    """The motions that contact alone prevents, with the loads along them; None if supports prevent all; collective."""
    free = elasticity.free
    if not len(free):
        return None
    R = elasticity.free_part(free.modes(elasticity.x))
    G = np.stack([rows_of(surface.free_B, R[:, :, number]).ravel() for number in range(len(free))])
    e = elasticity.comm.allreduce(np.einsum("kcq,kc->q", R, loading.load), op=MPI.SUM)
    return RigidMotions(G, e, tuple(map(str, free.motions)))


def refuse_untouched(elasticity: Deformable, surface: ContactSurface) -> None:
    """Check that every component that supports do not hold has contact points; collective.

    Raises:
        ValueError: On every rank, with the component and its motions.
    """
    free = elasticity.free
    if not len(free):
        return
    R = elasticity.free_part(free.modes(elasticity.x))
    for number in dict.fromkeys(motion.component for motion in free.motions):
        own = [k for k, motion in enumerate(free.motions) if motion.component == number]
        moved = [rows_of(surface.free_B, R[:, :, k]) for k in own]  # all of them, on every rank
        if not elasticity.comm.allreduce(bool(np.any(moved)), op=MPI.LOR):
            moves = ", ".join(str(free.motions[k]) for k in own)
            raise ValueError(
                f"nothing holds {free.bodies[number]}: it has no contact face; clamps and springs leave it free: it "
                f"{moves}; give it a clamp, a spring or a contact"
            )
