"""What a function owes to what constraints prescribe, from what it owes to displacements and forces: transposes of
`linear_constraints`."""

from __future__ import annotations

import numpy as np

from ...arrays import FloatArray
from .constraints import at_nodes_of
from .lasting_supports import share_left
from .linear_constraints import Constraints
from .reduction import LONGEST_CHAIN


def _with_followers(constraints: Constraints, owed: FloatArray) -> FloatArray:
    """What a function owes to displacements (k, 3), with what it owes to those of nodes that follow them."""
    reduction, whole = constraints.reduction, owed
    for _ in range(LONGEST_CHAIN):
        whole = owed + at_nodes_of(reduction.W, reduction.followed(whole))
    return whole


def owed_before(constraints: Constraints, time: float, start: float, owed: FloatArray) -> FloatArray:
    """What a function owes to the displacements after a load step that ended at `start`, by the lengths of locked bolts
    and by how far faces are apart where ties have begun, from what it owes to prescribed displacements; per metre,
    shapes (k, 3); collective."""
    if not constraints.ties:
        return np.zeros_like(owed)
    reduction, whole = constraints.reduction, _with_followers(constraints, owed)
    along, apart = reduction.moved_transposed(whole), np.zeros_like(owed)
    kept, then = np.zeros(reduction.width), constraints.before_step.reduction
    for (bolt, own), locked in zip(constraints.of_bolts, constraints.locked, strict=True):
        kept[own] = along[own] if locked and bolt.given.force is not None else 0.0
    for one, tie in constraints.begun:
        apart[tie.nodes] += share_left(one, start, time) * reduction.followed(whole)[tie.nodes]
    return then.on_followed(then.followed(apart + then.amounts_transposed(kept)))


def owed_to_motions(
    constraints: Constraints, owed: FloatArray, v: FloatArray
) -> tuple[dict[str, FloatArray], dict[str, float]]:
    """What a function owes to the six prescribed components of every rigid face, per metre and radian, and to the force
    of every bolt, or its prescribed shortening, by their faces, from what it owes to prescribed displacements and to
    forces, shapes (k, 3); 0 where nothing is prescribed; collective."""
    reduction = constraints.reduction
    whole = reduction.followed(_with_followers(constraints, owed)) if constraints.ties else owed
    motions = {
        motion.given.face: np.where(
            motion.given.prescribed,
            reduction.comm.allreduce(np.einsum("mcp,mc->p", motion.of_components(reduction.x), whole[motion.nodes])),
            0.0,
        )
        for motion in constraints.motions
    }
    lengths, forces = reduction.moved_transposed(whole), reduction.amounts(reduction.apart(v))
    bolts = {
        bolt.face: float(lengths[own] if bolt.given.force is None else 0.0 if locked else forces[own])
        for (bolt, own), locked in zip(constraints.of_bolts, constraints.locked, strict=True)
    }
    return motions, bolts
