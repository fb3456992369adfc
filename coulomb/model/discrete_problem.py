"""A contact problem in one state: what solvers and certificates work with."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import replace
from datetime import datetime
from typing import Self

import numpy as np

from ..arrays import FloatArray
from ..fem.meshes import NamedMesh
from ..linalg.compliance import BodyCompliance
from ..solvers.friction_problem import FrictionProblem
from ..solvers.rigid_motions import NO_MOTION, RigidMotions
from .certificate import Evidence
from .contact_body import ContactBody
from .linear_problem import ContactState, LinearProblem
from .problem_evidence import gather_evidence
from .stability import Stability
from .state import State


class DiscreteProblem:
    """A body in a state, u = K^-1 (f - B^T x) + R alpha with the contact forces x, which obey |x_t| <= c a + F x_n.

    R are the rigid motions that contact alone prevents (`FreeMotions`), alpha their amounts; without any, u = K^-1 (f -
    B^T x).

    Args:
        body: The time-independent part: K, K^-1, A, contact faces and foundations.
        state: The state at one time: loads, gaps, frames, law of friction, slip origin.
        small_strain: What becomes of an answer outside the theory, "enforce" or "warn".
        started: Date and time when it was set up.
        seconds: Wall time of each phase so far.
        before: End of the load step before, from which the certificate measures slip; by default from the state's
            `slip_origin`.

    Attributes:
        unknowns: Free displacement unknowns and contact unknowns, over all ranks.
        elasticity: K, loads and supports at this time.
        loading: Loads and prescribed displacements.
        time: Time of loads, prescribed displacements and the foundation's position.
        law: Law of friction at this rank's contact points.
        slid: The problem after small displacements (k, 3) in metres, where faces that slide on each other alone owe
            anything to these beyond the linear problem (`Iterate.slid`); else None.
    """

    slid: Callable[[FloatArray], DiscreteProblem] | None = None

    def __init__(
        self,
        body: ContactBody,
        state: ContactState,
        small_strain: str,
        started: datetime,
        seconds: dict[str, float],
        before: State | None = None,
    ):
        self.body, self.state, self.small_strain = body, state, small_strain
        self.started, self.seconds, self.before = started, seconds, before
        self.comm, self.contacts, self.unknowns = body.comm, body.contacts, body.unknowns
        self.elasticity, self.loading, self.time = state.elasticity, state.loading, state.time
        self.surface, self.law = state.surface, state.law
        self._known: LinearProblem | None = None

    def in_state(
        self,
        state: ContactState,
        seconds: dict[str, float] | None = None,
        before: State | None = None,
        body: ContactBody | None = None,
    ) -> Self:
        """The problem of the same body, or of it with other supports, in another state; `seconds` and `before` as of
        its arguments."""
        posed = copy.copy(self)
        given = body or self.body, state, self.small_strain, self.started, {} if seconds is None else seconds, before
        DiscreteProblem.__init__(posed, *given)
        return posed

    def elsewhere(
        self, u: FloatArray, poses: FloatArray | None, before: State | None, motions: FloatArray | None = None
    ) -> DiscreteProblem:
        """The problem at the same time with foundations under load in other poses (faces, 6), others moved by factors
        (faces,) of their motions, after another load step; in large motions also at another displacement u (k, 3);
        collective."""
        body = self.body.with_motions(motions)
        return self.in_state(body.posed(self.state, poses, before), None, before, body)

    def with_factors(self, x: FloatArray) -> DiscreteProblem:
        """The same problem with a K that has factors, at contact forces x (3 m,); collective."""
        return self

    @property
    def mesh(self) -> NamedMesh:
        """The mesh of the body, if there is one body only."""
        return self.elasticity.alone.mesh

    @property
    def motions(self) -> FloatArray:
        """Translations of the foundations, metres, shape (faces, 3); rotations are in `state.foundation_motions`."""
        return np.array([motion.translation for motion in self.state.foundation_motions])

    @property
    def prescribed(self) -> FloatArray:
        """The displacements that supports prescribe, 0 elsewhere, metres, shape (k, 3)."""
        return self.elasticity.held.held_part(self.loading.prescribed)

    @property
    def linear(self) -> LinearProblem:
        """f, K^-1, A and b: one object until K or the method for K^-1 changes, which is then made anew."""
        known, stiffness = self._known, self.body.stiffness
        if known is None or known.stiffness.method is not stiffness.present:
            fixed = stiffness.of(self.elasticity, self.seconds)
            known = self._known = LinearProblem(fixed, self.state, self.seconds)
        return known

    @property
    def A(self) -> BodyCompliance:
        """As of `LinearProblem`."""
        return self.linear.A

    @property
    def b(self) -> FloatArray:
        """As of `LinearProblem`."""
        return self.linear.b

    @property
    def friction_problem(self) -> FrictionProblem:
        """A, b and the law, without the body."""
        return self.linear.friction_problem

    @property
    def mean_compliance(self) -> float:
        """Mean of diag(A) in metres per newton."""
        return self.friction_problem.mean_diagonal

    @property
    def compliances(self) -> FloatArray:
        """diag(A) of every contact point, of both tangents the mean, metres per newton, shape (m, 3)."""
        return self.linear.compliances

    @property
    def rigid(self) -> RigidMotions | None:
        """As of `ContactState`."""
        return self.state.rigid

    def relative_displacement(self, u: FloatArray, alpha: FloatArray = NO_MOTION) -> FloatArray:
        """As of `ContactState`."""
        return self.state.relative_displacement(u, alpha)

    def displacement(self, x: FloatArray) -> FloatArray:
        """As of `LinearProblem`."""
        return self.linear.displacement(x)

    def moved(self, u: FloatArray, alpha: FloatArray) -> FloatArray:
        """u + R alpha, amounts alpha (q,) of the free motions; metres, shapes (k, 3)."""
        own = alpha[max(len(alpha) - len(self.elasticity.free), 0) :]  # after those of foundations under load
        return u + self.elasticity.reduction.displacement(self.elasticity.free_unknowns @ own) if len(own) else u

    def evidence(
        self, x: FloatArray, u: FloatArray, before: State | None = None, alpha: FloatArray = NO_MOTION
    ) -> Evidence:
        """The evidence for a certificate, from body, contact faces and foundations as given; collective.

        Args:
            x: Contact forces in newtons, shape (3 m,), point by point (n, t1, t2) of the surface.
            u: Displacement in metres, this rank's nodes, shape (k, 3).
            before: State after the load step before; by default slip is measured from `slip_origin`.
            alpha: Amounts of free motions, shape (q,), of which those of foundations under load count, by default 0.
        """
        return gather_evidence(self.body, self.state, x, u, self.compliances, before, alpha)

    def stability(self, x: FloatArray) -> Stability | None:
        """Of an answer with contact forces x (3 m,) in newtons: K of small strains is positive definite; None if it is
        not known; collective."""
        return Stability(0, 0, np.zeros_like(self.elasticity.x))

    def without_stiffness(self, x: FloatArray, R: FloatArray) -> FloatArray:
        """The combinations (q, p) of free motions, unknowns (k + p, 3, q), that no stiffness resists under contact
        forces x (3 m,): in small strains all; collective."""
        return np.eye(R.shape[2])

    def slip_bound(self, x: FloatArray) -> FloatArray:
        """Bound of the friction force of every node at the forces x (3 m,), newtons, shape (m,)."""
        return self.law.radius(x[0::3])

    def tresca(self, slip_bound: FloatArray) -> FrictionProblem:
        """The Tresca problem with these slip bounds in newtons, shape (m,)."""
        return replace(self.friction_problem, law=FrictionProblem.tresca(self.A, self.b, slip_bound).law)
