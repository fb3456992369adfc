"""The table of a case file that describes load steps."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from ..model.times import HALVINGS, refuse_times
from .values import ROWS, Duration, Number, Steps, Table


class HistoryTable(Table):
    """Load steps: their ends, or the end of the last and their number; from time 0, with the body free of stress."""

    times: Annotated[tuple[Number, ...], Field(max_length=ROWS)] | None = None
    end: Duration | None = None
    steps: Steps | None = None
    halvings: Annotated[int, Field(ge=0, le=30, strict=True)] = HALVINGS

    @model_validator(mode="after")
    def _times_or_steps(self) -> HistoryTable:
        if (self.times is None) == (self.end is None or self.steps is None):
            raise ValueError("give either times, a list that increases from 0, or end and steps")
        refuse_times(0.0, self.ends)
        return self

    @property
    def ends(self) -> tuple[float, ...]:
        """Ends of the steps."""
        if self.times is not None:
            return self.times
        assert self.end is not None and self.steps is not None
        return tuple(float(t) for t in np.linspace(0.0, self.end, self.steps + 1)[1:])
