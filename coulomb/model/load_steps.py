"""What the load steps of bodies of large displacements share."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np
from mpi4py import MPI

from ..arrays import FloatArray, Int32Array, in_words, unit_vectors
from ..fem.bodies import Deformable, JoinedBodies, nonlinear
from ..fem.contact import Ways, facet_patch, inside_of, into_foundation, through_each_other, two_sides
from ..fem.geometry import RigidFoundation, rotation_matrix
from ..fem.meshes import SEPARATOR
from ..linalg.reductions import Reductions
from ..units import amount
from .arguments import linear_solver_of, names_of_sides
from .contact_body import ContactBody
from .contact_faces import StatePoints
from .equilibrium import without_equilibrium
from .iterate import Iterate, Linearised
from .provenance import now, timed
from .state import State

_log = logging.getLogger(__name__)

_ARM: Final = 1e-3
"""Largest distance of tied faces over the root of a node's area; chords of a ring of facets of 4 degrees leave 2e-4."""

_SAME_WAY: Final = 0.5
"""Cosine of the angle between the outward normals of a face and of its foundation at a node above which this is behind
the face: edges of a face may press aside, and a little backwards."""

_LINE: Final = 1e-6
"""Ratio of the second moments of nodes across and along a line below which they are on it."""

_TURN: Final = np.array([0.05, 0.1, 0.15])
"""Rotation vector of a body as a whole in radians, by which no energy of strains changes; and shears beside it."""

_OBJECTIVE: Final = 1e-6
"""Energy of this rotation over that of the shears up to which it is a rounding error."""


_NARROW: Final = 0.1
"""Width of the pressing part of a face over that of all that has pressed below which it is a line."""

_USED: Final = 0.9
"""Part of the largest friction of a face from which on this may be why a step fails."""

_SLIDES: Final = 1e-3
"""Slip in a load step over this width from which a face slides."""


class LoadSteps:
    """What the load steps of bodies of large displacements share.

    Args:
        body: The bodies before deformation, with their contact faces.
        linear_solver, explicit: Of the linear problems.
        itself: The faces in contact with themselves, by the numbers of the contacts.

    Raises:
        ValueError: On every rank, if tied faces are apart, or the nodes of a section of a bolt are on a line.

    Attributes:
        contacts: The contacts, with the foundations before any motion.
        points: All nodes of the contact faces: which of them are contact points depends on the displacement.
        remedy: Number of the first tangent that is tried.
        damped: Whether changes of the displacement are damped where tangents are not positive definite: iterates then
            go through an instability (snap-through) to the next equilibrium.
        damping: The last one that made a tangent positive definite; 0 without one.
        stable: Whether an equilibrium has to be stable.
        answered: The bodies before deformation in the last load step with an answer, and its iterate.
    """

    def __init__(
        self,
        body: ContactBody,
        time: float,
        linear_solver: object,
        explicit: bool | None,
        branch: str,
        itself: Mapping[int, str],
    ):
        self.body, self.elasticity, self.remedy, self.stable = body, body.elasticity, 0, branch == "stable"
        self.damped, self.damping = False, 0.0
        self.answered: tuple[Deformable, Iterate] | None = None
        self.held_by_contact = len(self.elasticity.unheld) > 0
        self._refuse_ties_across_gaps()
        self._refuse_sections_on_lines()
        self._warn_of_energies_by_turns()
        self._methods = linear_solver_of(linear_solver), explicit
        self.contacts = tuple(
            replace(one, slave=True)
            if foundation is None
            else replace(one, foundation=foundation, force_point=body.foundation_loads.points.get(number))
            for number, (one, foundation) in enumerate(zip(body.contacts, body.foundations, strict=True))
        )
        self.itself, self._sided = itself, (self.elasticity, body)
        of_states = [replace(one, face=itself.get(k, one.face)) for k, one in enumerate(self.contacts)]
        self.points = StatePoints.of_faces(self.elasticity, of_states)

    def sided(self, u: FloatArray) -> tuple[Deformable, ContactBody]:
        """The bodies before deformation in a load step from a displacement u (k, 3), and with their contact faces: of
        faces in contact with themselves with the sides that they have there; collective."""
        if not self.itself or Reductions(self.elasticity.comm).all(not np.any(u)):
            return self.elasticity, self.body
        sides = dict[str, dict[str, Int32Array]]()
        for number, name in self.itself.items():
            member, facets = self.elasticity.face(name, "contact")
            of, depth = u[member.nodes], self.contacts[number].depth
            first, second = two_sides(member.body.mesh, facets, of, depth)[:2]
            names = names_of_sides(name.split(SEPARATOR)[-1])
            sides.setdefault(member.name, {}).update(zip(names, (first, second), strict=True))
        for elasticity, body in ((self.elasticity, self.body), self._sided):
            there = {one.name: one.body.mesh.faces for one in elasticity.members}
            same = (np.array_equal(there[of][side], new) for of, faces in sides.items() for side, new in faces.items())
            if self.elasticity.comm.allreduce(all(same), op=MPI.LAND):
                return elasticity, body
        bodies = [one.body.with_faces(sides.get(one.name, {})) for one in self.elasticity.members]
        whole = self.elasticity
        elasticity = whole.of(bodies) if isinstance(whole, JoinedBodies) else bodies[0]
        self._sided = elasticity, self.body.on_sides(elasticity)
        return self._sided

    def passage(self, begin: Iterate, end: Iterate, before: FloatArray, x: FloatArray) -> str:
        """What passes through what it may touch in a step between two iterates, in words; "" if nothing does.  Contacts
        are looked at that press neither `before`, by the forces at the points of states (m, 3), nor after, by x (3 m,);
        and a foundation that presses before or after may not end behind its face; collective."""
        over, comm = Reductions(self.elasticity.comm), self.elasticity.comm
        for number, (contact, foundation) in enumerate(zip(self.contacts, begin.foundations, strict=True)):
            behind = [] if foundation is None else self._behind(number, foundation, begin, end, before, x)
            if behind:
                return (
                    f"the foundation of {contact.face!r} gets behind it in the step, at x = ({in_words(behind[0])}) m: "
                    "it is small beside the step, or beside the facets"
                )
            then, now = before[self.points.part == number], x.reshape(-1, 3)[end.problem.surface.part == number]
            if not over.all(not np.any(then) and not np.any(now)):
                continue
            if foundation is None:
                names, through = (contact.face, str(contact.against)), repr(contact.against)
                faces = ((one.body.face(name, "contact") for one in (begin, end)) for name in names)
                patches = [tuple(facet_patch(of.body, facets) for of, facets in face) for face in faces]
                passed = through_each_other(patches, comm)
            else:
                nodes, through = begin.body.nodes(contact.face, "contact"), "its foundation"
                places = [
                    one.problem.state.foundation_motions[number].undone(one.body.x[nodes]) for one in (begin, end)
                ]
                given = end.problem.body.given_gap(end.problem.surface, end.time)
                gap = over.max(np.append(given[end.problem.surface.part == number], 0.0))
                passed = begin.body.x[nodes][into_foundation(Ways(*places), foundation, gap)]
            every = [tuple(map(float, place)) for places in comm.allgather(passed) for place in places]
            if every:
                return (
                    f"{contact.face!r} passes through {through} in the step, from x = ({in_words(min(every))}) m on: "
                    "inside between its start and its end, at which nothing touches"
                )
        return ""

    def _behind(
        self,
        number: int,
        foundation: RigidFoundation,
        begin: Iterate,
        end: Iterate,
        before: FloatArray,
        x: FloatArray,
    ) -> list[tuple[float, ...]]:
        """Where nodes of a contact press on the far side of its foundation after a step, or have pressed on the near
        one, which is inside the body now; arguments as of `passage`; metres, of all ranks; collective."""
        surface, (normals, outward) = end.problem.surface, np.zeros((2, *end.body.x.shape))
        member, facets = end.body.face(self.contacts[number].face, "contact")
        outward[member.nodes] = unit_vectors(member.body.positive_weights(facets)[1])
        pressing, pressed = np.zeros((2, len(outward)), dtype=bool)
        pressing[surface.nodes[(surface.part == number) & (x[0::3] > 0.0)]] = True
        pressed[self.points.nodes[(self.points.part == number) & np.any(before != 0.0, axis=1)]] = True
        nodes = np.flatnonzero(pressing | pressed)
        motions = [one.problem.state.foundation_motions[number] for one in (begin, end)]
        then, now = (of.undone(one.body.x[nodes]) for of, one in zip(motions, (begin, end), strict=True))
        if len(nodes):
            normals[nodes] = motions[1].turned(foundation.normal(now))
        far = np.einsum("ki,ki->k", normals, outward)[nodes] > _SAME_WAY
        inside = inside_of(motions[1].done(then[far & ~pressing[nodes]]), member)
        behind = np.concatenate([end.body.x[nodes[far & pressing[nodes]]], inside])
        return sorted(tuple(map(float, place)) for places in self.elasticity.comm.allgather(behind) for place in places)

    def reasons(self, state: State, begin: Iterate, end: Iterate, x: FloatArray) -> str:
        """Why a load step from a state may have no answer, in words; "" if no reason is known; `begin` is the iterate
        there, and `end` that at the same displacement with what is given at the end, x (3 m,) the forces of the state;
        collective."""
        unheld = without_equilibrium(end.problem)
        said = f"at the place where the step begins {unheld}; " if unheld else self._used_up(end, x)
        return self._sliding_off(state, begin) + said + self._interference(state, end)

    def _used_up(self, end: Iterate, x: FloatArray) -> str:
        """Where a step begins with nearly as much friction as there may be at the forces x (3 m,), in words;
        arguments and result as of `reasons`; collective."""
        over, bound, part = Reductions(self.elasticity.comm), end.problem.slip_bound(x), end.problem.surface.part
        friction = np.linalg.norm(x.reshape(-1, 3)[:, 1:], axis=1)
        sums = [[over.sum(one[part == number]) for one in (friction, bound)] for number in range(len(self.contacts))]
        used = [
            (one.face, min(a / b, 1.0)) for one, (a, b) in zip(self.contacts, sums, strict=True) if a > _USED * b > 0.0
        ]
        said = (f"{share:.0%} of the friction of {face!r} is used up where the step begins; " for face, share in used)
        return "".join(said)

    def _interference(self, state: State, end: Iterate) -> str:
        """Which interferences grow in a step, in words; arguments and result as of `reasons`; collective."""
        over, said, surface, body = Reductions(self.elasticity.comm), "", end.problem.surface, end.problem.body
        then = body.given_gap(surface, state.time) * (state.before is not None)  # a first step begins without any
        now = body.given_gap(surface, end.time)
        for number, contact in enumerate(self.contacts):
            before, after = (-over.min(np.append(gap[surface.part == number], 0.0)) for gap in (then, now))
            if after > before:
                said += (
                    f"the interference of {contact.face!r} grows from {amount(before)} to {amount(after)} in the step: "
                    "let it grow in smaller steps (gap_amplitude); "
                )
        return said

    def _sliding_off(self, state: State, begin: Iterate) -> str:
        """Which contacts slide off what they press on, in words: they have pressed on an area, and slide on what is a
        line; arguments and result as of `reasons`; collective."""
        if state.before is None:
            return ""
        over, said, x = Reductions(self.elasticity.comm), "", begin.body.x[self.points.nodes]
        force, slip = np.linalg.norm(state.force_on_body, axis=1), state.slip_rate * (state.time - state.before.time)
        for number, (contact, foundation) in enumerate(zip(self.contacts, begin.foundations, strict=True)):
            here = self.points.part == number
            pressing, pressed = np.where(here, force, 0.0), here & (state.accumulated.pressure > 0.0)
            if over.all(not np.any(pressing)):
                continue
            (place, narrow), (_, wide) = (_spread(x, weights, over) for weights in (pressing, pressed.astype(float)))
            slid = over.max(slip[pressing > 0.0])
            if narrow < _NARROW * wide and slid > _SLIDES * wide:
                what = "its foundation" if foundation is not None else repr(contact.against)
                said += (
                    f"{contact.face!r} slides off {what}, beyond which nothing may hold it: at the start of the step, "
                    f"after a slip of {amount(slid)} in the one before, it presses along a line alone, by "
                    f"x = ({in_words(tuple(map(float, place)))}) m; "
                )
        return said

    def damps(self) -> bool:
        """Whether a failed step is worth another attempt with damping, which is set: not if it was damped already, or
        no tangent has been other than positive definite."""
        again, self.damped = not self.damped and self.remedy > 0, True
        return again

    def _refuse_ties_across_gaps(self) -> None:
        """Nodes of a tie follow across a distance as the ends of rigid arms, with the linear part of their rotations:
        turned far, they end up to that distance from where they belong, as do those of ties that begin; collective."""
        for one in self.elasticity.constraints.given:
            if one.begin is not None:
                raise ValueError(f"{one.what}: in large motions ties act from the start: leave out begin")
        for tie in self.elasticity.constraints.ties:
            facet = Reductions(self.elasticity.comm).max(np.sqrt(tie.area))
            if tie.arm > _ARM * facet:
                raise ValueError(
                    f"{tie.kind} of {tie.face!r} to {tie.against!r}: the faces are up to {amount(tie.arm)} apart, "
                    f"{tie.arm / facet:.1%} of a facet's length; in large motions tied faces must touch: move one of "
                    "the bodies (coulomb.moved), or mesh the gap; where both are curved, use finer or second-order "
                    "cells"
                )

    def _refuse_sections_on_lines(self) -> None:
        """Of nodes on a line a rotation about it is not known; collective."""
        over = Reductions(self.elasticity.comm)
        for bolt in self.elasticity.constraints.bolts:
            sums = over.total(np.array([*bolt.arms.sum(axis=0), len(bolt.arms)]))
            r = bolt.arms - sums[:3] / sums[3]
            sizes = np.linalg.eigvalsh(over.total((r.T @ r).ravel()).reshape(3, 3))
            if sizes[1] < _LINE * sizes[2]:
                raise ValueError(
                    f"{bolt.given.what}: the nodes that follow the other side are on a line, about which the rotation "
                    "of the bolt would be unknown: use a finer mesh, or end supports before the section"
                )

    def _warn_of_energies_by_turns(self) -> None:
        """Of energies of the user's that change as the body turns as a whole, as those of small strains do; those with
        terms on the surface may be of springs to the ground; collective."""
        for member in self.elasticity.members:
            body, x = nonlinear(member.body), member.body.reference
            if body.materials is not None or body.resists_translation:
                continue
            turned, sheared = map(body.strain_energy, (x @ rotation_matrix(_TURN).T - x, x[:, [1, 2, 0]] * _TURN))
            if turned is not None and sheared is not None and abs(turned) > _OBJECTIVE * abs(sheared):
                if self.elasticity.comm.rank == 0:
                    _log.warning(
                        "forms%s: the energy changes by %.2g J as the body turns by %.2g rad as a whole: it is not "
                        "objective, as one of small strains; in large motions let it depend on F.T * F",
                        f" of body {member.name!r}" if member.name else "",
                        turned,
                        np.linalg.norm(_TURN),
                    )

    def posed(
        self,
        body: Deformable,
        time: float,
        undeformed: ContactBody,
        poses: FloatArray | None,
        motions: FloatArray | None = None,
    ) -> Linearised:
        """The linear contact problem of bodies at their deformed place, and how they are `undeformed`, with foundations
        under load in these poses, and others moved by factors (faces,) of their motions; collective."""
        there = ContactBody(lambda: body.at_time(time), body.comm, self.contacts, time, *self._methods)
        there.undeformed, there.motion_factors = undeformed, motions
        with timed(there.seconds, "assembly"):
            state = there.state(time, poses=poses)
        return Linearised(there, state, "enforce", now(), there.seconds)


def _spread(x: FloatArray, weights: FloatArray, over: Reductions) -> tuple[FloatArray, float]:
    """The centre (3,) of points x (k, 3) with weights (k,), and their width, twice the root of the second of their
    principal moments, metres; collective."""
    whole = over.sum(weights)
    centre = over.total(weights @ x) / whole
    moments = over.total(((x - centre) * weights[:, None]).T @ (x - centre)) / whole
    return centre, 2.0 * float(np.sqrt(np.maximum(np.linalg.eigvalsh(moments)[1], 0.0)))
