"""Load histories where some ranks have no contact nodes."""

import numpy as np
import pytest

from coulomb import Clamp, Contact, ContactProblem, LoadHistory, Material, Traction, box


@pytest.mark.parametrize("clamped", [("left",), ()], ids=["clamped", "floating"])
def test_ranks_without_contact_nodes(clamped):
    """A tall column on a plane: the ranks that own its upper part have no contact nodes; the resultant is the load."""
    problem = ContactProblem(
        box((0.2, 0.2, 2.0), (1, 1, 12)),
        Material(2e11, 0.3),
        clamps=[Clamp(face, components="y") for face in clamped],
        tractions=[Traction("top", (0.0, 0.0, -1e7)), Traction("top", (2e5, 0.0, 0.0), amplitude=np.sin)],
        contact=Contact("bottom", friction=0.5),
    )
    taken = list(LoadHistory([1.0, 1.5, 2.0]).steps(problem))
    assert all(step.solution.valid for step in taken)
    assert [step.row["normal_force"] for step in taken] == pytest.approx([0.04 * 1e7] * 3, rel=1e-8)
