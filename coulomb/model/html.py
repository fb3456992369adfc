"""Tables by which objects show themselves in a notebook."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from html import escape

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
