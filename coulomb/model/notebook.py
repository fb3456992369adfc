"""What a notebook shows: tables by which objects show themselves, and one bar of progress per solve or load history."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from html import escape
from typing import Any

from ..solvers.results import Progress, ProgressCallback

_RED = "#c0392b"
_STYLE = "text-align:left;min-width:0;padding:2px 8px"


def verdict(good: bool, text: str) -> str:
    """A line in bold, red unless it is good."""
    return f'<p><b style="color:{"inherit" if good else _RED}">{escape(text)}</b></p>'


def table(head: Sequence[str], rows: Iterable[Sequence[object]], title: str = "") -> str:
    """Rows of texts and numbers under a head; empty if there are no rows."""
    body = [f"<tr>{''.join(_cell(entry) for entry in row)}</tr>" for row in rows]
    if not body:
        return ""
    names = "".join(f'<th style="{_STYLE}">{escape(name)}</th>' for name in head)
    caption = f'<caption style="text-align:left"><b>{escape(title)}</b></caption>' if title else ""
    return f"<table>{caption}<thead><tr>{names}</tr></thead><tbody>{''.join(body)}</tbody></table>"


def _cell(entry: object) -> str:
    text = f"{entry:.4g}" if isinstance(entry, float) else "" if entry is None else str(entry)
    return f'<td style="{_STYLE}{f";color:{_RED}" if text == "FAILED" else ""}">{escape(text)}</td>'


def in_notebook() -> bool:
    """Whether this process is the kernel of a notebook."""
    shell = getattr(sys.modules.get("IPython"), "get_ipython", lambda: None)()
    return hasattr(shell, "kernel")


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
