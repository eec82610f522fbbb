"""How a canonical column is made of a file's own: an entry of [columns], or a guess."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Rule:
    """How one canonical column is made: SI value of (raw · scale + offset) in `unit`, of the constant `value`
    in `unit`, or a time axis of `period` s.

    `unit` None means the unit that the file states, else the canonical one. `file` names another file, beside
    the recording, that has the column.
    """

    source: str | None = None
    unit: str | None = None
    scale: float = 1.0
    offset: float = 0.0
    period: float | None = None
    value: float | None = None
    file: str | None = None


Rules = Mapping[str, Rule | None]
"""Rules by canonical name; None leaves the column out."""
