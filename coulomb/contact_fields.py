"""Contacts and their fields in files: names, words, units and formulas, for output, check, pictures and docs.

A new field is an entry here and a row of the table in docs/theory.md.  A face that is in several contacts has a name
for each.  Standard library only: pictures import it.
"""

from __future__ import annotations

import functools
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

ANSWER = "displacement and contact forces"
"""What the computed fields follow from, in words."""


@dataclass(frozen=True)
class ContactField:
    """A field of contact.xdmf.

    Attributes:
        name: Its name there.
        title: In words, as in pictures.
        unit: Without prefix; empty for numbers and directions.
        values: Its values at the contact points, shape (m,) or (m, 3), from a `NodalAnswer`; collective.
        vector: Whether it has three components.
        shown: Where it can be seen beside ParaView: by `coulomb plot`; in the 3D view of the report as well; there only
            for load histories.
        opposite: How the face opposite in a pair gets it: as a mean of the contact points opposite, or the same with
            the opposite sign; empty if it does not, or otherwise (`coulomb.model.opposite`).
        fraction: Whether its values are between 0 and 1.
        between: In the middle of edges of 10-node tetrahedra, the value by those of the two vertices.
        follows: What `coulomb check` computes it from; empty for the contact forces, from which it computes the others.
    """

    name: str
    title: str
    unit: str
    values: Callable[[Any], Any]
    vector: bool = False
    shown: Literal["", "plot", "report", "history"] = ""
    opposite: Literal["", "mean", "reversed"] = ""
    fraction: bool = False
    between: Literal["mean", "least", "most"] = "mean"
    follows: str = ANSWER

    @property
    def given(self) -> bool:
        """Whether it is input of the computation: by the case and the mesh."""
        return self.follows != ANSWER


_FACES, _CASE = "the meshes and the case", "the case"

CONTACT_FIELDS = (
    ContactField("pressure", "contact pressure", "Pa", lambda at: at.pressure, shown="report", opposite="mean"),
    ContactField(
        "friction_traction",
        "friction traction",
        "Pa",
        lambda at: at.friction_traction,
        vector=True,
        shown="report",
        opposite="reversed",
    ),
    ContactField(
        "friction_use",
        "friction use (friction over its bound)",
        "",
        lambda at: at.friction_use,
        shown="report",
        opposite="mean",
        fraction=True,
    ),
    ContactField("status", "zones", "", lambda at: at.status.astype(float), shown="report", between="least"),
    ContactField("slip", "slip", "m", lambda at: at.slip, vector=True, shown="report", opposite="reversed"),
    ContactField(
        "gap", "remaining gap", "m", lambda at: at.gap - at.relative_displacement[:, 0], shown="report", opposite="mean"
    ),
    ContactField(
        "accumulated_slip",
        "slip accumulated since the start",
        "m",
        lambda at: at.accumulated.slip,
        shown="history",
        opposite="mean",
    ),
    ContactField(
        "friction_work",
        "friction work since the start",
        "J/m²",
        lambda at: at.accumulated.friction_work,
        shown="history",
        opposite="mean",
    ),
    ContactField(
        "largest_pressure",
        "largest pressure since the start",
        "Pa",
        lambda at: at.accumulated.pressure,
        shown="history",
        opposite="mean",
    ),
    ContactField("contact_force", "contact force on the body", "N", lambda at: at.on_body, vector=True, follows=""),
    ContactField("normal", "unit normal, out of the body", "", lambda at: at.frames[:, 0], vector=True, follows=_FACES),
    ContactField("tangent_1", "first tangent", "", lambda at: at.frames[:, 1], vector=True, follows="normal and case"),
    ContactField("tangent_2", "second tangent", "", lambda at: at.frames[:, 2], vector=True, follows="normal and case"),
    ContactField("initial_gap", "gap before deformation", "m", lambda at: at.gap, follows=_FACES),
    ContactField("given_gap", "given part of that gap", "m", lambda at: at.given_gap, follows=_CASE),
    ContactField("area", "area", "m²", lambda at: at.area, follows="the facets"),
    ContactField(
        "coefficient", "coefficient of friction; of Tresca's law the slip stress in Pa", "", lambda at: at.coefficient
    ),
    ContactField("friction", "coefficient of friction", "", lambda at: at.friction, follows=_CASE),
    ContactField("cohesion", "cohesion or slip stress", "Pa", lambda at: at.cohesion, follows=_CASE),
    ContactField("slip_bound", "bound of friction in the solver", "N", lambda at: at.slip_bound),
    ContactField(
        "normal_compliance",
        "displacement of the node under a normal force on it, over the force: the entry of A",
        "m/N",
        lambda at: at.compliance[:, 0],
    ),
    ContactField(
        "tangential_compliance", "the same along the tangents, the mean", "m/N", lambda at: at.compliance[:, 1]
    ),
    ContactField(
        "slip_origin",
        "displacement from which slip is measured",
        "m",
        lambda at: at.slip_origin_in_space,
        vector=True,
        follows="the step before, and the foundation's displacement",
    ),
    ContactField("face", "number of the contact", "", lambda at: at.part.astype(float), between="most", follows=_FACES),
)
"""All of them, in the order of the files."""

COMPLIANCES: Final = ("normal_compliance", "tangential_compliance", "tangential_compliance")
"""Fields with the diagonal of A along n, t1 and t2."""


@functools.cache
def names(**having: object) -> tuple[str, ...]:
    """Names of the fields whose attributes have these values."""
    return tuple(
        field.name for field in CONTACT_FIELDS if all(getattr(field, key) == value for key, value in having.items())
    )


AGAINST = " against "
"""Between the names of a face and of that opposite, where a face is in several contacts."""


def side_names(contacts: Iterable[tuple[str, str | None]]) -> list[tuple[str, str | None]]:
    """Names in files of the two sides of every contact: the faces, or of one in several contacts "FACE against OTHER",
    "FACE against foundation NUMBER".

    Args:
        contacts: Of every contact its face, and that opposite; None against a foundation.
    """
    given = list(contacts)
    count, rigid = Counter(face for pair in given for face in pair), Counter(face for face, other in given if not other)
    seen = Counter[str]()

    def name(face: str, other: str | None) -> str:
        if other is not None:
            return face if count[face] == 1 else f"{face}{AGAINST}{other}"
        seen[face] += 1
        return face if rigid[face] == 1 else f"{face}{AGAINST}foundation {seen[face]}"

    return [(name(face, other), None if other is None else name(other, face)) for face, other in given]


def sides_of(faces: Iterable[Mapping[str, Any]]) -> list[tuple[str, str | None]]:
    """`side_names` of the entries `faces` of a summary."""
    return side_names((face["faces"][0], face.get("against")) for face in faces)


_ON_BODY: Final = {
    **{"displacement": "m", "prescribed": "m", "load": "N", "spring_force": "N", "tie_force": "N"},
    **{"peel_stress": "Pa", "shear_stress": "Pa"},
}


def unit_of(name: str) -> str:
    """The unit of the SI, without prefix, of a field of contact.xdmf or solution.xdmf; empty for others."""
    if name.startswith(("stress_", "von_mises_", "principal_")) and name != "stress_error":
        return "Pa"
    return _ON_BODY.get(name) or next((field.unit for field in CONTACT_FIELDS if field.name == name), "")


def named_faces(faces: Sequence[Mapping[str, Any]]) -> list[tuple[str, Mapping[str, Any]]]:
    """Name (`side_names`) and entry of every contact in the entries `faces` of a summary."""
    return [(name, face) for (name, _), face in zip(sides_of(faces), faces, strict=True)]


def normal_forces(row: Mapping[str, Any], end: str = "normal_force") -> dict[str, Any]:
    """Normal force of every contact in a line of history.csv, newtons, by its name, of the only one by ""; or another
    total of contacts with this name."""
    if end in row:
        return {"": row[end]}
    return {name.removesuffix(f"_{end}"): value for name, value in row.items() if name.endswith(f"_{end}")}
