"""The table of a case file that describes a probe."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .values import Name, Table, Vector

if TYPE_CHECKING:
    from ..model.probes import Probe


class ProbeTable(Table):
    """A named point in metres at which displacement, slip and pressure are reported, and the body that has it."""

    name: Name
    point: Vector
    body: Name | None = None

    def probe(self) -> Probe:
        """What the table describes."""
        from ..model.probes import Probe

        return Probe(self.name, self.point, self.body)
