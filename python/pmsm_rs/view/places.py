"""Where a mismatch sits, as people read it."""

from __future__ import annotations

from collections.abc import Sequence

from ..results.findings import DiagnosisValues, Location
from ..results.words import percent


def places(answer: DiagnosisValues) -> list[Location]:
    """The places of the mismatch, none told twice; none at all where nothing is missing."""
    if answer.verdict == "no_mismatch" and not answer.remaining:
        # What is within the noise sits nowhere.
        return []
    return _told_once(answer.located)


def share_of(at: Location) -> str:
    """The share of the mismatch at a place, a dash where it is none of its own."""
    return percent(at.share) if at.share > 0.0 else "–"


def _told_once(located: Sequence[Location]) -> list[Location]:
    """The places without those whose sentence another one repeats word by word."""
    return [
        at
        for count, at in enumerate(located)
        if not any(
            at.sentence in other.sentence and (at.sentence != other.sentence or number < count)
            for number, other in enumerate(located)
            if number != count
        )
    ]
