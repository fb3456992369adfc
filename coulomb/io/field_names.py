"""Names of the fields in the result files."""

from __future__ import annotations

from ..fem.bodies import FIELDS, HELD_OBLIQUE, STRESSES, TEMPERATURE
from ..model.accumulated import ACCUMULATED
from ..model.master_fields import CARRIED

ON_CELLS = STRESSES
"""Fields of solution.h5, one number per cell; besides those of `cell_materials`."""

ON_BODY = ("displacement", "load", "held", "prescribed", "spring_force")
"""Fields of solution.h5, one vector per node."""

INTERNAL, ROUNDING = "internal_force", "rounding_force"
"""Fields of solution.h5 of a body of the user's forms, which are not in the files: its internal forces, and those of a
rounding error of the displacement (`rounding_forces`)."""

GROUND = tuple(f"rigid_force_{number}" for number in range(1, 7))
"""The nodal forces of the rigid motions of a body with springs or Robin terms: `Deformable.ground`."""

OURS = (*ON_CELLS, *ON_BODY, *FIELDS, *GROUND, HELD_OBLIQUE, INTERNAL, ROUNDING, TEMPERATURE)
"""All names of fields of solution.h5."""

ON_FACE = (
    *("pressure", "friction_traction", "slip", "gap", "status", "friction_use"),
    *(*ACCUMULATED, "contact_force", "normal", "tangent_1", "tangent_2", "initial_gap", "given_gap", "area"),
    *("coefficient", "friction", "cohesion", "slip_bound", "slip_origin", "face"),
)
"""Fields of contact.h5, one number or vector per node of the contact face."""

ON_OPPOSITE = (*CARRIED, "status", "contact_force", "normal", "area")
"""Fields of contact.h5 on faces opposite in pairs, beside `OPPOSITE`."""

VECTORS_ON_FACE = ("friction_traction", "slip", "contact_force", "normal", "tangent_1", "tangent_2", "slip_origin")
"""Those of both that are vectors."""
