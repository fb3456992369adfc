"""Nodes, facets and fields of a contact face."""

from __future__ import annotations

from dataclasses import dataclass

from ..arrays import FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class FaceAnswer:
    """Nodes and facets of a contact face of this rank, with the contact fields as attributes: `face.pressure`.

    The names are those of contact.xdmf (`fields`); units are in docs/theory.md.  Nodes without a contact point have the
    status 3 and zeros.  The middle nodes of 10-node tetrahedra have values between those of the vertices, over which
    sums of forces go: `connectivity[:, :3]`.

    Attributes:
        coordinates: Of its nodes before deformation, metres, shape (k, 3).
        connectivity: The nodes of its facets in VTK's order, numbered over all ranks, rank after rank, shape (f, n).
        fields: By name, shapes (k,) or (k, 3).
    """

    name: str
    coordinates: FloatArray
    connectivity: IntArray
    fields: dict[str, FloatArray]

    def __getattr__(self, name: str) -> FloatArray:
        if name.startswith("_") or name not in self.fields:
            raise AttributeError(f"a contact face has no {name!r}; its fields are {', '.join(self.fields)}")
        return self.fields[name]
