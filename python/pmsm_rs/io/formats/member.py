"""What a reader tells of its file before any value is read, and what is wanted of it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from .selection import Selection

NUMBER_BYTES: Final = 8
# Every member of a group carries the group's name; without a limit, many members times a long name of the
# group would take far more memory than the file.
_LONGEST_GROUP: Final = 1024
NUMBER, COMPLEX, BOOLEAN, TEXT = "number", "complex", "boolean", "text"
DATE, DURATION, OBJECT = "date", "duration", "object"
UNKNOWN: Final = "unknown"
"""The kind of values that only reading them tells."""

_KINDS: Final = {
    "f": NUMBER,
    "i": NUMBER,
    "u": NUMBER,
    "c": COMPLEX,
    "b": BOOLEAN,
    "S": TEXT,
    "U": TEXT,
    "T": TEXT,
    "M": DATE,
    "m": DURATION,
}


class Refused(Exception):
    """What a member or its file holds cannot be used, for a reason that the user can change."""

    def __init__(self, problem: str, fix: str, *, column: str | None = None, row: int | None = None) -> None:
        """`row` counts from 0. `others` are refusals of other columns in the same row, as far as known."""
        super().__init__(problem)
        self.problem, self.fix, self.column, self.row = problem, fix, column, row
        self.others: tuple[Refused, ...] = ()


@dataclass(frozen=True)
class Member:
    """A column, variable or channel as its file declares it, before any value is read.

    `group` is the path of the group that it is in. `shape` is None where the number of rows is not known.
    `header` is the name as the file spells it, where that is more than `name`. `why` says what keeps it from
    being used, `fix` what to do then. `memory` is what unpacking takes in bytes, where that is more than the
    numbers. `held` says that its values are in memory as they are wanted. `base` names the time base that it
    was sampled on, where the file has several; with `stamps` it holds the sample times of that base.
    `takes_in` are the columns that a clock, made of dates and times of day, takes in; None for what is no
    clock. Raises Refused on a group whose name is far too long.
    """

    name: str
    group: str = ""
    kind: str = NUMBER
    shape: tuple[int, ...] | None = None
    unit: str | None = None
    header: str | None = None
    why: str | None = None
    fix: str | None = None
    memory: int = 0
    held: bool = False
    base: str | None = None
    stamps: bool = False
    takes_in: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        """Checks the length of the group's name."""
        if len(self.group) > _LONGEST_GROUP:
            raise Refused(
                f"the name of a group has {len(self.group)} characters",
                f"name groups by at most {_LONGEST_GROUP} characters",
            )

    @property
    def path(self) -> str:
        """GROUP/NAME, or the name alone outside of any group."""
        return f"{self.group}/{self.name}" if self.group else self.name

    @property
    def is_note(self) -> bool:
        """Whether it is a single remark, such as a string, or sample times, and no column: found only by its
        name.
        """
        if self.stamps:
            return self.base is not None
        barred = self.why is not None or self.kind not in (NUMBER, COMPLEX, UNKNOWN)
        return barred and self.shape is not None and math.prod(self.shape) <= 1

    @property
    def needed(self) -> int:
        """Bytes that unpacking takes, 0 where the number of rows is not known."""
        size = math.prod(self.shape) * NUMBER_BYTES if self.shape is not None else 0
        return max(size * (2 if self.kind == COMPLEX else 1), self.memory)


@dataclass(frozen=True)
class Wanted:
    """What is wanted of member number `index`, and the name `column` by which the user asked for it.

    With `gaps` a missing value is NaN where the format can tell, and no fault.
    """

    index: int
    column: str
    part: Selection
    gaps: bool = False


def kind_of(dtype: np.dtype[np.generic]) -> str:
    """The kind of the values of a NumPy type."""
    return _KINDS.get(dtype.kind, OBJECT)
