"""ASAM MDF by asammdf: named channels only, each group with its own time base, never united by guesswork."""

from __future__ import annotations

from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from ..selection import Selection
from ..source import MISSING_FIX
from . import NUMBER_BYTES, Parts, Refused, describe, numbers, too_large

TIME: Final = "time"
_CUT_FIX: Final = "export it again; it may be cut short or damaged"
_MASTER, _VIRTUAL_MASTER = 2, 3
# Signed, unsigned and floating-point numbers in either byte order.
_NUMERIC: Final = range(6)


class Table:
    """The channels of a file as GROUP/CHANNEL, groups counted from 0, and the time of the group in use."""

    def __init__(self, file: str, max_bytes: int) -> None:
        """Reads the metadata, not the values."""
        from asammdf import MDF

        self.max_bytes = max_bytes
        self.file: Any = MDF(file, raise_on_multiple_occurrences=False)
        self.places: dict[str, tuple[int, int]] = {}
        self.columns = []
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
                path = f"{g}/{channel.name}"
                if path in self.places:
                    path = f"{path}#{c}"
                self.places[path] = (g, c)
                plain = channel.data_type in _NUMERIC
                why = None if plain else "it holds no plain numbers"
                unit = getattr(channel, "unit", None) or getattr(channel.conversion, "unit", None)
                self.columns.append(describe(path, unit=_text(unit), shape=(rows,), why=why))
        if timed and not any(path.split("/", 1)[1] == TIME for path in self.places):
            self.columns.append(describe(TIME, unit="s"))

    def read(self, wanted: list[str]) -> Parts:
        """The channels wanted, after a check of their declared sizes; refuses time bases that differ."""
        places = {text: self.places[Selection.of(text).name] for text in wanted if text != TIME}
        rows = {g: int(self.file.groups[g].channel_group.cycles_nr) for g, _ in places.values()}
        total = sum(NUMBER_BYTES * rows[g] for g, _ in places.values()) + NUMBER_BYTES * sum(rows.values())
        widest = max(
            (rows[g] * int(self.file.groups[g].channel_group.samples_byte_nr) for g in rows), default=0
        )
        if max(total, widest) > self.max_bytes:
            raise too_large(max(total, widest), self.max_bytes)
        time = self._common_time(places)
        out: Parts = {}
        for text in wanted:
            values = time if text == TIME else self._values(text, *places[text])
            if values is None:
                raise Refused(
                    "no channel with a time base is wanted", "map at least one channel", column=TIME
                )
            out[text] = [numbers(values, text)]
        return out

    def _values(self, text: str, group: int, index: int) -> NDArray[Any]:
        signal = self.file.get(group=group, index=index, ignore_invalidation_bits=True)
        if len(signal.samples) != self.file.groups[group].channel_group.cycles_nr:
            raise Refused("it holds fewer values than it declares", _CUT_FIX, column=text)
        invalid = signal.invalidation_bits
        if invalid is not None and np.any(invalid):
            raise Refused("the value is missing", MISSING_FIX, column=text, row=int(np.argmax(invalid)))
        values: NDArray[Any] = signal.samples
        return values

    def _common_time(self, places: dict[str, tuple[int, int]]) -> NDArray[Any] | None:
        first: tuple[str, NDArray[Any]] | None = None
        seen: set[int] = set()
        for text, (group, _) in places.items():
            if group in seen:
                continue
            seen.add(group)
            master = np.asarray(self.file.get_master(group))
            if len(master) != self.file.groups[group].channel_group.cycles_nr:
                raise Refused("its time base holds fewer values than it declares", _CUT_FIX, column=text)
            if first is None:
                first = (text, master)
            elif not np.array_equal(first[1], master):
                raise Refused(
                    f"it is sampled at other times than '{first[0].split('/', 1)[1]}'",
                    "export them on one time base, for instance by MDF.resample of asammdf",
                    column=text,
                )
        return None if first is None else first[1]


def _text(value: Any) -> str | None:
    return value if isinstance(value, str) and value.strip() else None
