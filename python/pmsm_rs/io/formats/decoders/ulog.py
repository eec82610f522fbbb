"""PX4 ulog by pyulog: the topics of the flight log, each with its own time stamps."""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from ..gate import take, within
from ..member import BOOLEAN, NUMBER, NUMBER_BYTES, Member, Wanted
from . import NO_TIME, NO_TIME_FIX, Parts

TIME: Final = "time"
_STAMP: Final = "timestamp"
_MICROSECOND: Final = 1e-6


class Table:
    """The fields of a log as TOPIC/FIELD, with the number of the instance where a topic has several."""

    def __init__(self, file: str, max_bytes: int) -> None:
        """Reads the whole log, which it unpacks to about its own size."""
        from pyulog import ULog

        self.max_bytes = max_bytes
        log = ULog(file)
        several = {data.name for data in log.data_list if data.multi_id}
        self.start = min((int(data.data[_STAMP][0]) for data in log.data_list if _rows(data)), default=0)
        self.places: list[tuple[Any, str]] = []
        self.members: list[Member] = []
        for data in log.data_list:
            if not (rows := _rows(data)):
                continue
            group = f"{data.name}_{data.multi_id}" if data.name in several else data.name
            for entry in data.field_data:
                if entry.field_name == _STAMP or entry.type_str == "char":
                    continue
                kind = BOOLEAN if entry.type_str == "bool" else NUMBER
                self._add(data, entry.field_name, Member(entry.field_name, group, kind, (rows,), base=group))
            self._add(data, _STAMP, Member(TIME, group, unit="s", shape=(rows,), base=group, stamps=True))
        if self.members:
            self._add(None, "", Member(TIME, unit="s", stamps=True, why=NO_TIME, fix=NO_TIME_FIX))

    def read(self, wanted: list[Wanted]) -> Parts:
        """The fields wanted, after a check of what they take."""
        within(sum(NUMBER_BYTES * _rows(self.places[item.index][0]) for item in wanted), self.max_bytes)
        return [[take(self._values(item), item)] for item in wanted]

    def _values(self, item: Wanted) -> Any:
        data, name = self.places[item.index]
        values = data.data[name]
        if name != _STAMP:
            return values
        return _MICROSECOND * (values.astype(np.int64) - self.start).astype(np.float64)

    def _add(self, data: Any, name: str, member: Member) -> None:
        self.places.append((data, name))
        self.members.append(member)


def _rows(data: Any) -> int:
    return len(data.data.get(_STAMP, ()))
