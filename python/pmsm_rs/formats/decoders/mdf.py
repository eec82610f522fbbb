"""ASAM MDF by asammdf: named channels only, each group with its own time base, never united by guesswork."""

from __future__ import annotations

from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from ...errors import shown
from ..gate import take, within
from ..member import BOOLEAN, NUMBER, NUMBER_BYTES, OBJECT, TEXT, Member, Refused, Wanted
from ..source import MISSING_FIX
from . import Parts

TIME: Final = "time"
_CUT_FIX: Final = "export it again; it may be cut short or damaged"
_MASTER, _VIRTUAL_MASTER = 2, 3
# Signed, unsigned and floating-point numbers in either byte order.
_NUMERIC: Final = range(6)
_STRINGS: Final = range(6, 10)


class Table:
    """The channels of a file as GROUP/CHANNEL, groups counted from 0, and the time of the group in use."""

    def __init__(self, file: str, max_bytes: int) -> None:
        """Reads the metadata, not the values."""
        from asammdf import MDF

        self.max_bytes = max_bytes
        self.file: Any = MDF(file, raise_on_multiple_occurrences=False)
        self.places: list[tuple[int, int]] = []
        self.members: list[Member] = []
        timed = False
        for g, group in enumerate(cast("list[Any]", self.file.groups)):
            rows = int(group.channel_group.cycles_nr)
            for c, channel in enumerate(group.channels):
                kind = getattr(channel, "channel_type", 0)
                if kind in (_MASTER, _VIRTUAL_MASTER) or c == self.file.masters_db.get(g):
                    timed = timed or rows > 0
                    continue
                if not rows:
                    continue
                unit = getattr(channel, "unit", None) or getattr(channel.conversion, "unit", None)
                self.places.append((g, c))
                self.members.append(
                    Member(channel.name, str(g), kind=_kind(channel), shape=(rows,), unit=_text(unit))
                )
        if timed and not any(member.name == TIME for member in self.members):
            self.members.append(Member(TIME, unit="s"))

    def read(self, wanted: list[Wanted]) -> Parts:
        """The channels wanted, after a check of their declared sizes; refuses time bases that differ."""
        channels = [item for item in wanted if item.index < len(self.places)]
        rows = {g: int(self.file.groups[g].channel_group.cycles_nr) for g in map(self._group, channels)}
        total = NUMBER_BYTES * (sum(rows[self._group(item)] for item in channels) + sum(rows.values()))
        records = (n * int(self.file.groups[g].channel_group.samples_byte_nr) for g, n in rows.items())
        within(max(total, max(records, default=0)), self.max_bytes)
        time = self._common_time(channels)
        if time is None:
            raise Refused("no channel with a time base is wanted", "map at least one channel", column=TIME)
        return [[take(self._values(item) if item in channels else time, item)] for item in wanted]

    def _group(self, item: Wanted) -> int:
        return self.places[item.index][0]

    def _values(self, item: Wanted) -> NDArray[Any]:
        group, index = self.places[item.index]
        signal = self.file.get(group=group, index=index, ignore_invalidation_bits=True)
        if len(signal.samples) != self.file.groups[group].channel_group.cycles_nr:
            raise Refused("it holds fewer values than it declares", _CUT_FIX, column=item.column)
        invalid = signal.invalidation_bits
        if invalid is not None and np.any(invalid):
            row = int(np.argmax(invalid))
            raise Refused("the value is missing", MISSING_FIX, column=item.column, row=row)
        values: NDArray[Any] = signal.samples
        return values

    def _common_time(self, channels: list[Wanted]) -> NDArray[Any] | None:
        first: tuple[str, NDArray[Any]] | None = None
        seen: set[int] = set()
        for item in channels:
            group, name = self._group(item), self.members[item.index].name
            if group in seen:
                continue
            seen.add(group)
            master = np.asarray(self.file.get_master(group))
            if len(master) != self.file.groups[group].channel_group.cycles_nr:
                raise Refused(
                    "its time base holds fewer values than it declares", _CUT_FIX, column=item.column
                )
            if first is None:
                first = (name, master)
            elif not np.array_equal(first[1], master):
                raise Refused(
                    f"it is sampled at other times than '{shown(first[0])}'",
                    "export them on one time base, for instance by MDF.resample of asammdf",
                    column=item.column,
                )
        return None if first is None else first[1]


def _kind(channel: Any) -> str:
    if channel.data_type not in _NUMERIC:
        return TEXT if channel.data_type in _STRINGS else OBJECT
    return BOOLEAN if channel.bit_count == 1 else NUMBER


def _text(value: Any) -> str | None:
    return value if isinstance(value, str) and value.strip() else None
