"""What oscilloscopes leave unsaid in their CSV files.

Tektronix, LeCroy and others head a time in seconds with the bare word "Time". Siglent calls it "Source".
Rigol counts samples and gives start and increment once, at the end of the first two lines.
"""

from __future__ import annotations

import re
from dataclasses import replace

from .sniff import Column, Layout

_CHANNEL = re.compile(
    r"(ch(annel)?[ _]?[0-9a-d]|c[1-8]|[1-8]|ampl(itude)?|math\d?|ref[a-d]?)$", re.IGNORECASE
)


def seconds(layout: Layout) -> Layout:
    """`layout` with its time in seconds where all other columns are channels of an oscilloscope."""
    names = [column.name for column in layout.columns]
    time = next((k for k, name in enumerate(names) if name.lower() in {"time", "source", "x-axis"}), None)
    others = [name for k, name in enumerate(names) if k != time and not name.startswith("column ")]
    if time is None or not others or not all(_CHANNEL.match(name) for name in others):
        return layout
    columns = list(layout.columns)
    columns[time] = columns[time]._replace(unit=columns[time].unit or "s")
    return replace(layout, columns=tuple(columns))


def uncounted(text: str) -> tuple[str, tuple[float, float] | None]:
    """The text of a file that counts its samples with a header that fits its rows, and start and step in s.

    Any other text comes back as it is, with None.
    """
    head, _, rest = text.partition("\n")
    if head.lstrip()[:2].lower() != "x,":
        return text, None
    below, _, rows = rest.partition("\n")
    names, values = _fields(head), _fields(below)
    if [name.lower() for name in names[-2:]] != ["start", "increment"] or values[0].lower() != "sequence":
        return text, None
    try:
        start, step = float(values[-2]), float(values[-1])
    except (ValueError, IndexError):
        return text, None
    end = "," if rows.partition("\n")[0].rstrip().endswith(",") else ""
    return f"X,{','.join(names[1:-2])}{end}\n1,{','.join(values[1:-2])}{end}\n{rows}", (start, step)


def _fields(line: str) -> list[str]:
    return [field.strip() for field in line.strip().removesuffix(",").split(",")]


def timed(layout: Layout) -> Layout:
    """`layout` with the time in seconds, `t`, in place of the number X of each sample."""
    columns = (Column("t", "s", c.header) if c.name == "X" else c for c in layout.columns)
    return replace(layout, columns=tuple(columns))
