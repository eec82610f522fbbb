"""A course of values as one line of text."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

BLOCKS: Final = "▁▂▃▄▅▆▇█"
ASCII: Final = "_.:-=+*#"


def sparkline(values: Sequence[float], low: float | None, high: float | None, levels: str = BLOCKS) -> str:
    """One sign of `levels` for each of `values`, from the lowest at `low` to the highest at `high`; a blank
    for NaN. Values that are all the same are `constant`.
    """
    if low is None or high is None:
        return ""
    if low == high:
        return "constant"
    # The range itself may be beyond a float.
    shares = (value / 2.0 - low / 2.0 if math.isfinite(value) else value for value in values)
    whole = high / 2.0 - low / 2.0
    top = len(levels) - 1
    return "".join(levels[round(share / whole * top)] if math.isfinite(share) else " " for share in shares)
