"""Whether the contact is even: then the error of the stress decides how far totals are from those of the continuum."""

from __future__ import annotations

from collections.abc import Mapping

from ..fem.contact import clamped_nodes
from ..linalg.reductions import Reductions
from ..model.discrete_problem import DiscreteProblem


def even_contact(problem: DiscreteProblem, nodes: Mapping[str, int]) -> bool:
    """Whether all contact points stick, or all slip, or all are open, and no node of a contact face is held along the
    normal; collective.

    Otherwise totals have errors of the order of cells along the borders of sticking, slip and contact, and along edges
    of held faces that are in contact, whose nodes are no contact points.  Not after load steps either, since slip
    before may have left borders behind.

    Args:
        problem: The problem of the answer.
        nodes: Its numbers of contact points "contact", "open", "stick" and "slip".
    """
    if problem.before is not None or max(nodes["open"], nodes["stick"], nodes["slip"]) < nodes["contact"]:
        return False
    faces = [face for contact in problem.contacts for face in (contact.face, contact.against) if face is not None]
    held = 0
    for member, facets in (problem.elasticity.face(face, "contact") for face in faces):
        held += len(clamped_nodes(member.body, facets))
    return Reductions(problem.comm).sum(float(held)) == 0.0
