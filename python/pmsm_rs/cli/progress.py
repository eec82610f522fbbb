"""Progress on a terminal: one line that says how far a computation is, in per cent and in words."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Mapping
from typing import Final, NamedTuple, TextIO

WIDTH: Final = 20
"""Signs of the bar."""


class Stage(NamedTuple):
    """A stage of a computation: its words, and where it begins and ends as shares of the whole."""

    words: str
    begin: float = 0.0
    end: float = 1.0


Stages = Mapping[str, Stage]

DIAGNOSIS: Final[Stages] = {
    "bare machine": Stage("fitting the dq-model"),
    "effects": Stage("looking for effects"),
    "alternatives": Stage("comparing sets of effects"),
    "map of what is left": Stage("mapping the remaining mismatch"),
    "answer": Stage("computing uncertainties and power"),
}
"""The core gives shares of the whole here; each fit tells of its own steps beside them."""

SIMULATION: Final[Stages] = {"simulating": Stage("simulating the drive")}
DESIGN: Final[Stages] = {"manoeuvres": Stage("comparing manoeuvres")}

_SWARM: Final = 0.8
"""Share of an identification that the swarm takes where least squares follow."""


def identification(method: str) -> Stages:
    """The stages of an identification by `method`."""
    border = {"pso": 1.0, "lm": 0.0}.get(method, _SWARM)
    return {
        "particle swarm": Stage("searching by particle swarm", 0.0, border),
        "least squares": Stage("refining by least squares", border, 1.0),
    }


class Bar:
    """A line of progress that never runs backwards, called with a stage and the share of it that is done.

    With `stages` only those are shown: what else a computation tells of are steps within them.
    """

    def __init__(
        self, out: TextIO, stages: Stages | None = None, *, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._out, self._stages, self._clock = out, stages, clock
        self._begin = clock()
        self._done = 0.0
        self._shown = ""
        self._signs = "█░" if _shows(out, "█░") else "#."

    def __call__(self, stage: str, fraction: float) -> None:
        """Draws the line anew, unless it would go back."""
        known = Stage(stage) if self._stages is None else self._stages.get(stage)
        if known is None:
            return
        done = known.begin + (known.end - known.begin) * min(max(fraction, 0.0), 1.0)
        if done < self._done:
            return
        self._done = done
        full = round(WIDTH * done)
        bar = self._signs[0] * full + self._signs[1] * (WIDTH - full)
        took = self._clock() - self._begin
        line = f"{bar} {100 * done:3.0f} %  {known.words}, {took:.0f} s"
        if line != self._shown:
            self._shown = line
            wipe(self._out, line)


def wipe(out: TextIO, line: str = "") -> None:
    """Puts `line` in place of the line of progress, cut to the width of the terminal."""
    room = max(shutil.get_terminal_size().columns - 1, 1)
    out.write(f"\r{line[:room]:<{room}}" + ("" if line else "\r"))
    out.flush()


def _shows(out: TextIO, signs: str) -> bool:
    try:
        signs.encode(getattr(out, "encoding", None) or "ascii")
    except (UnicodeEncodeError, LookupError):
        return False
    return True
