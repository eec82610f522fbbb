"""What oscilloscopes leave unsaid in their CSV files.

Tektronix, LeCroy and others head a time in seconds with the bare word "Time"; Siglent calls it "Source";
Rigol counts samples and gives start and increment once, at the end of the first two lines.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .sniff import Layout
from .source import Source

_CHANNEL = re.compile(
    r"(ch(annel)?[ _]?[0-9a-d]|c[1-8]|[1-8]|ampl(itude)?|math\d?|ref[a-d]?)$", re.IGNORECASE
)
_COUNTED = re.compile(r"\s*X,(?P<channels>[^\n]*?),Start,Increment,?\s*$", re.IGNORECASE)
_SEQUENCE = re.compile(
    r"\s*Sequence,(?P<units>[^\n]*?),(?P<start>[^,\n]+),(?P<step>[^,\n]+?),?\s*$", re.IGNORECASE
)


def seconds(layout: Layout) -> Layout:
    """`layout` with its time in seconds where all other columns are channels of an oscilloscope."""
    time = next((name for name in layout.names if name.lower() in {"time", "source", "x-axis"}), None)
    others = [name for name in layout.names if name != time and not name.startswith("column ")]
    if time is None or not others or not all(_CHANNEL.match(name) for name in others):
        return layout
    return replace(layout, units={time: "s", **layout.units})


def uncounted(text: str) -> tuple[str, tuple[float, float] | None]:
    """The text of a file that counts its samples with a header that fits its rows, and start and step in s.

    Any other text comes back as it is, with None.
    """
    head, _, rest = text.partition("\n")
    below, _, rows = rest.partition("\n")
    names, values = _COUNTED.match(head), _SEQUENCE.match(below)
    if names is None or values is None:
        return text, None
    try:
        start, step = float(values["start"]), float(values["step"])
    except ValueError:
        return text, None
    end = "," if rows.partition("\n")[0].rstrip().endswith(",") else ""
    return f"X,{names['channels']}{end}\n1,{values['units']}{end}\n{rows}", (start, step)


def timed(source: Source, axis: tuple[float, float]) -> Source:
    """`source` with the time of each sample in place of its number X."""
    start, step = axis

    def read(wanted: Iterable[str]) -> dict[str, NDArray[np.float64]]:
        chosen = list(wanted)
        raw = source.read(["X" if name == "t" else name for name in chosen])
        return {name: start + step * raw["X"] if name == "t" else raw[name] for name in chosen}

    names = tuple("t" if name == "X" else name for name in source.names)
    units = {name: unit for name, unit in source.units.items() if name != "X"}
    return replace(source, names=names, read=read, units={**units, "t": "s"})
