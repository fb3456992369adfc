"""Whether the contact is even: then the error of the stress decides how far totals are from those of the continuum."""

from __future__ import annotations

import math
from collections.abc import Mapping

from ..fem.bodies import Elasticity, relative_error, stress_errors
from ..fem.contact import clamped_nodes
from ..linalg.reductions import Reductions
from ..model.discrete_problem import DiscreteProblem
from ..model.solution import Solution


def deciding_stress_error(solution: Solution, nodes: Mapping[str, int]) -> float:
    """Estimated error of the stress over the stress in the energy norm (`fem.bodies.stress_error`), where it decides
    the errors of totals; collective.

    nan where contact is not even, by the numbers of contact points "contact", "open", "stick" and "slip": totals then
    have errors of the order of cells along the borders of sticking, slip and contact, and along edges of held faces
    that are in contact, whose nodes are no contact points.  nan also where it is not known: of a body from the user's
    forms, and for large motions.
    """
    problem = solution.problem
    known = all(isinstance(member.body, Elasticity) for member in problem.elasticity.members)
    if not known or not _even(problem, nodes):
        return math.nan
    temperature = problem.loading.temperature
    change = None if temperature is None else temperature.change
    return relative_error(stress_errors(problem.elasticity, solution.displacement, change).values())


def _even(problem: DiscreteProblem, nodes: Mapping[str, int]) -> bool:
    """Whether all contact points stick, or all slip, or all are open, and no node of a contact face is held along the
    normal; not after load steps, since slip before may have left borders behind; collective."""
    if problem.before is not None or max(nodes["open"], nodes["stick"], nodes["slip"]) < nodes["contact"]:
        return False
    faces = [face for contact in problem.contacts for face in (contact.face, contact.against) if face is not None]
    held = 0
    for member, facets in (problem.elasticity.face(face, "contact") for face in faces):
        held += len(clamped_nodes(member.body, facets))
    return Reductions(problem.comm).sum(float(held)) == 0.0
