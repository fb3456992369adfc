"""All that acts on the bodies of a problem at one time, from displacements and contact forces."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain

import numpy as np

from ..arrays import FloatArray
from ..fem.bodies import Bolt, NodalForces
from ..fem.contact import Pretension
from ..fem.meshes import SEPARATOR
from ..linalg.reductions import Reductions
from .discrete_problem import DiscreteProblem
from .resultants import (
    BodyBalance,
    BoltForce,
    ForceBalance,
    Resultant,
    RigidFaceMotion,
    balance,
    resultant_of_ground,
    resultants,
)


def force_balance(
    problem: DiscreteProblem, u: FloatArray, on_body: FloatArray, imbalance: FloatArray, reaction: FloatArray
) -> ForceBalance:
    """Resultants and balance of loads, supports, contact and elastic foundations at displacements u (k, 3); of several
    bodies, each has the loads and supports whose face names it; collective.

    Args:
        problem: The bodies, supports, ties, and their loads.
        u: Displacement, metres, shape (k, 3).
        on_body: Contact forces at the nodes, newtons, shape (k, 3).
        imbalance: What supports and ties hold, newtons, shape (k, 3).
        reaction: The part of it that supports hold, newtons, shape (k, 3).
    """
    body, time = problem.elasticity, problem.time
    constraints, members, over, x = body.constraints, body.members, Reductions(problem.comm, body.copies), body.x
    grounds = [(member, member.body.ground) for member in members if member.body.forms() is not None]
    terms = [
        resultant_of_ground(ground, u[member.nodes], member.body.x, over, member.name)
        for member, ground in grounds
        if ground is not None
    ]
    of_ties = constraints.forces(imbalance, time) if constraints.every else None
    with np.errstate(all="ignore"):  # an answer that overflows fails its certificate
        pulling = resultants(body.loads_in(problem.loading), x, over)
        holding = (*resultants(chain(body.shares(reaction), body.spring_forces(u)), x, over), *terms)
        contact = resultants([NodalForces("contact", None, on_body)], x, over)
        outer, several = (*pulling, *holding), members if len(members) > 1 else ()
        each = tuple(_balance_of(one.name, one.nodes, outer, on_body, x, over, of_ties) for one in several)
        if of_ties is None:
            return ForceBalance(pulling, holding, balance((*outer, *contact), x, over), each)
        tied = resultants(constraints.shares(imbalance, time), x, over)
        rigid = tuple(
            RigidFaceMotion(face, p, motion[:3], motion[3:], of.force, of.moment - np.cross(p, of.force))
            for (face, p, motion), of in zip(constraints.motions_of_faces(u, time), tied, strict=False)
        )
        sections = (of for of in tied if of.kind == Pretension.kind)
        screwed = tuple(_bolt_force(bolt, of) for bolt, of in zip(constraints.bolts_at(u), sections, strict=False))
        # those of cyclic symmetry alone do not add up to zero
        contact += resultants([NodalForces("ties", None, of_ties)], x, over)
        left = balance((*outer, *contact), x, over)
        return ForceBalance(pulling, holding, left, each, tied[len(rigid) :], rigid, screwed)


def _balance_of(
    name: str,
    nodes: slice,
    outer: Sequence[Resultant],
    on_body: FloatArray,
    x: FloatArray,
    over: Reductions,
    of_ties: FloatArray | None,
) -> BodyBalance:
    """The balance of one of several bodies; collective."""
    mine = [part for part in outer if part.face is not None and part.face.partition(SEPARATOR)[0] == name]
    (contact,) = resultants([NodalForces("contact", name, on_body[nodes])], x[nodes], over)
    if of_ties is not None:
        mine += resultants([NodalForces("ties", name, of_ties[nodes])], x[nodes], over)
    return BodyBalance(name, contact, balance((*mine, contact), x[nodes], over))


def _bolt_force(bolt: Bolt, of: Resultant) -> BoltForce:
    n, moment = bolt.direction, of.moment - np.cross(bolt.centre, of.force)
    along, twist = float(n @ of.force), float(n @ moment)
    shear, bending = (float(np.linalg.norm(of_all - part * n)) for of_all, part in ((of.force, along), (moment, twist)))
    return BoltForce(bolt.face, along, shear, bending, twist, bolt.shortening, bolt.locked)
