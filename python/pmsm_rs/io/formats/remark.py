"""What was done to the data on the way in, for the user to read."""

from __future__ import annotations

from typing import NamedTuple


class Remark(NamedTuple):
    """What was found and done, what follows from it, and what to do: each a plain sentence."""

    finding: str
    consequence: str
    fix: str
