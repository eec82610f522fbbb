"""How a recording looks in a notebook: a line on its sampling, and a row for each column."""

from __future__ import annotations

import html
from typing import TYPE_CHECKING, Final

from ..plot.sparkline import sparkline
from ..quantities.canonical import CANONICAL, ordered
from ..results.words import number
from .sampling import Sampling
from .signals import course

if TYPE_CHECKING:
    from .._core import Recording

_CELL: Final = "padding:2px 14px 2px 0;text-align:left;background:none"


def card(recording: Recording, file: str | None) -> str:
    """The recording in `file`, None where there is none, as HTML that carries its own style: names, units,
    ranges and the highest value of each stretch.
    """
    title = "Recording" if file is None else f"Recording {file}"
    sentence = Sampling.of(recording.column("t")).sentence()
    rows = []
    for name in ordered(recording.names):
        values = recording.column(name)
        low, high = float(values.min()), float(values.max())
        line = "" if name == "t" else sparkline(course(values), low, high)
        cells = (name, f"{number(low)} … {number(high)}", CANONICAL[name].unit, line, CANONICAL[name].meaning)
        rows.append("".join(f'<td style="{_CELL}">{html.escape(cell)}</td>' for cell in cells))
    heads = ("column", "range", "unit", "course", "meaning")
    head = "".join(f'<th style="{_CELL};font-weight:500;color:#5d6873">{text}</th>' for text in heads)
    body = "".join(f"<tr>{row}</tr>" for row in rows)
    load = recording.load.replace("_", " ")
    return (
        '<div style="font:14px/1.5 system-ui,sans-serif;color:#1b1f24;background:#fff;'
        'border:1px solid #d5dae0;border-radius:8px;padding:12px 16px;max-width:820px">'
        f'<div style="font-weight:650">{html.escape(title)}</div>'
        f"<div>{html.escape(sentence)}; {recording.kind.replace('_', ' ')}; load: {load}</div>"
        f'<table style="border-collapse:collapse;margin:.5em 0 0">'
        f"<thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>"
    )
