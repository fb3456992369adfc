"""Progress in a notebook: one bar per solve or load history, where nothing else displays it."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from ..solvers.results import Progress, ProgressCallback


def in_notebook() -> bool:
    """Whether this process is the kernel of a notebook."""
    return "ipykernel" in sys.modules


class NotebookBar:
    """A bar from 0 to 1 with words beside it."""

    def __init__(self) -> None:
        from IPython.display import HTML, display

        self._html: Any = HTML
        self._handle = display(HTML(""), display_id=True)

    def show(self, share: float, words: str) -> None:
        """Replace what is displayed."""
        self._handle.update(self._html(f'<progress max="1" value="{share:.3f}"></progress> {words}'))


@contextmanager
def residuals_shown(
    progress: ProgressCallback | None, tolerance: float, rank: int
) -> Iterator[ProgressCallback | None]:
    """The callback of a solve: what is given, or in a notebook one that shows how the residual falls."""
    if progress is not None or not in_notebook():
        yield progress
        return
    bar = NotebookBar() if rank == 0 else None

    def show(step: Progress) -> None:
        share = math.log(max(step.residual, 1e-300)) / math.log(min(tolerance, 0.5))
        if bar is not None:
            bar.show(min(max(share, 0.0), 1.0), str(step))

    yield show
