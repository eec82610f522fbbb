"""When the rows of a recording were taken: rate, duration, and where time is missing."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

_GAP: Final = 1.5
_GAP_OF_MOTION: Final = 6.0
"""Sample times from which a step is a gap with and without voltages, as the core has them."""
_VOLTAGES: Final = frozenset({"v_d", "v_q", "v_a"})
_EVEN: Final = 0.02
"""Share of the sample time by which the steps of an even clock may differ."""


def gap_of(names: Iterable[str]) -> float:
    """Sample times from which a step of a recording with the canonical columns `names` is a gap."""
    return _GAP_OF_MOTION if _VOLTAGES.isdisjoint(names) else _GAP


@dataclass(frozen=True)
class Sampling:
    """Sample times of a recording or of one of its groups, in s.

    `period` is the median step, None with fewer than two rows, and `shortest` and `longest` are the extreme
    ones. `gaps` steps are longer than 1.5 periods (6 without voltages), the longest of them behind the time
    `longest_at`. `back` steps do not go forward. `group` names the group, None where the file has one time
    only.
    """

    rows: int
    duration: float
    period: float | None
    shortest: float | None
    longest: float | None
    longest_at: float | None
    gaps: int
    back: int
    group: str | None = None

    @classmethod
    def of(cls, stamps: NDArray[np.float64], group: str | None = None, *, gap: float = _GAP) -> Sampling:
        """Of sample times in s, shape (rows,); those that are not finite are passed over. A step of more
        than `gap` sample times is a gap.
        """
        known = stamps[np.isfinite(stamps)]
        steps = np.diff(known)
        forward = steps[steps > 0.0]
        if not forward.size:
            return cls(len(stamps), 0.0, None, None, None, None, 0, int(np.sum(steps <= 0.0)), group)
        period = float(np.median(forward))
        last = int(np.argmax(steps))
        return cls(
            len(stamps),
            float(known[-1] - known[0]),
            period,
            float(forward.min()),
            float(forward.max()),
            float(known[last]),
            int(np.sum(steps > gap * period)),
            int(np.sum(steps <= 0.0)),
            group,
        )

    def to_dict(self) -> dict[str, Any]:
        """For JSON: the fields, and the rate in Hz."""
        return {**vars(self), "rate": None if self.period is None else 1.0 / self.period}

    def sentence(self) -> str:
        """Rows, rate, duration and gaps in one line."""
        parts = [f"{self.rows} rows"]
        if self.period is None:
            return f"{parts[0]}, without a sample rate"
        parts.append(f"one every {_seconds(self.period)} ({_hertz(1.0 / self.period)})")
        parts.append(f"{_seconds(self.duration)} in all")
        assert self.shortest is not None
        assert self.longest is not None
        assert self.longest_at is not None
        even = max(self.longest - self.period, self.period - self.shortest) <= _EVEN * self.period
        if self.gaps:
            what = "1 gap" if self.gaps == 1 else f"{self.gaps} gaps, the longest"
            parts.append(f"{what} of {_seconds(self.longest)} at t = {self.longest_at:.10g} s")
        elif even:
            parts.append("no gaps")
        else:
            parts.append(f"no gaps, steps of {_seconds(self.shortest)} to {_seconds(self.longest)}")
        if self.back:
            parts.append(f"time does not go forward at {self.back} row{'s' if self.back > 1 else ''}")
        return ", ".join(parts)


def _seconds(value: float) -> str:
    value = float(f"{value:.4g}")
    factor, unit = (1.0, "s") if value >= 1.0 else (1e3, "ms") if value >= 1e-4 else (1e6, "µs")
    return f"{value * factor:.4g} {unit}"


def _hertz(value: float) -> str:
    value = float(f"{value:.5g}")
    factor, unit = (1e-6, "MHz") if value >= 1e6 else (1e-3, "kHz") if value >= 1e4 else (1.0, "Hz")
    return f"{value * factor:.5g} {unit}"
