"""ASAM MDF by asammdf: named channels only, each group with the sample times of its master channel."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from ..gate import take, within
from ..member import BOOLEAN, NUMBER, NUMBER_BYTES, OBJECT, TEXT, Member, Refused, Wanted
from ..source import MISSING_FIX
from . import NO_TIME, NO_TIME_FIX, Parts

TIME: Final = "time"
_CUT_FIX: Final = "export it again; it may be cut short or damaged"
_MASTER, _VIRTUAL_MASTER = 2, 3
_FRAMES: Final = ("CAN_DataFrame", "CAN_DataFrame.ID")
# Signed, unsigned and floating-point numbers in either byte order.
_NUMERIC: Final = range(6)
_STRINGS: Final = range(6, 10)


class Table:
    """The channels of a file as GROUP/CHANNEL, groups counted from 0, and the time of each group."""

    def __init__(self, file: str, max_bytes: int, dbc: str | None = None) -> None:
        """Reads the metadata, not the values; with a `dbc` takes logged frames of a CAN bus apart."""
        from asammdf import MDF

        self.max_bytes = max_bytes
        self.file: Any = MDF(file, raise_on_multiple_occurrences=False)
        if dbc is not None and any(channel in self.file for channel in _FRAMES):
            self.file = self.file.extract_bus_logging({"CAN": [(dbc, 0)]})
            self.file.configure(raise_on_multiple_occurrences=False)
        self.places: list[tuple[int, int | None]] = []
        self.members: list[Member] = []
        for g, group in enumerate(cast("list[Any]", self.file.groups)):
            rows = int(group.channel_group.cycles_nr)
            if not rows:
                continue
            timed = False
            for c, channel in enumerate(group.channels):
                kind = getattr(channel, "channel_type", 0)
                if kind in (_MASTER, _VIRTUAL_MASTER) or c == self.file.masters_db.get(g):
                    timed = True
                    continue
                unit = getattr(channel, "unit", None) or getattr(channel.conversion, "unit", None)
                self._add(g, c, Member(channel.name, kind=_kind(channel), shape=(rows,), unit=_text(unit)))
            if timed:
                self._add(g, None, Member(TIME, unit="s", shape=(rows,), stamps=True))
        if any(member.stamps for member in self.members) and not any(
            member.name == TIME and not member.stamps for member in self.members
        ):
            self.members.append(Member(TIME, unit="s", stamps=True, why=NO_TIME, fix=NO_TIME_FIX))

    def read(self, wanted: list[Wanted]) -> Parts:
        """The channels and times wanted, after a check of their declared sizes."""
        rows = {g: int(self.file.groups[g].channel_group.cycles_nr) for g in map(self._group, wanted)}
        total = NUMBER_BYTES * (sum(rows[self._group(item)] for item in wanted) + sum(rows.values()))
        records = (n * int(self.file.groups[g].channel_group.samples_byte_nr) for g, n in rows.items())
        within(max(total, max(records, default=0)), self.max_bytes)
        return [[take(self._values(item), item)] for item in wanted]

    def _add(self, group: int, channel: int | None, member: Member) -> None:
        self.places.append((group, channel))
        self.members.append(replace(member, group=str(group), base=str(group)))

    def _group(self, item: Wanted) -> int:
        return self.places[item.index][0]

    def _values(self, item: Wanted) -> NDArray[Any]:
        group, index = self.places[item.index]
        if index is None:
            return self._time(group, item)
        signal = self.file.get(group=group, index=index, ignore_invalidation_bits=True)
        if len(signal.samples) != self.file.groups[group].channel_group.cycles_nr:
            raise Refused("it holds fewer values than it declares", _CUT_FIX, column=item.column)
        invalid = signal.invalidation_bits
        if invalid is not None and np.any(invalid):
            if item.gaps:
                return np.ma.array(signal.samples, mask=invalid)
            row = int(np.argmax(invalid))
            raise Refused("the value is missing", MISSING_FIX, column=item.column, row=row)
        values: NDArray[Any] = signal.samples
        return values

    def _time(self, group: int, item: Wanted) -> NDArray[Any]:
        master = np.asarray(self.file.get_master(group))
        if len(master) != self.file.groups[group].channel_group.cycles_nr:
            raise Refused("it holds fewer values than it declares", _CUT_FIX, column=item.column)
        return master


def _kind(channel: Any) -> str:
    if channel.data_type not in _NUMERIC:
        return TEXT if channel.data_type in _STRINGS else OBJECT
    return BOOLEAN if channel.bit_count == 1 else NUMBER


def _text(value: Any) -> str | None:
    return value if isinstance(value, str) and value.strip() else None
