"""NI TDMS by npTDMS: channels by GROUP/CHANNEL, time from the waveform properties where it has no channel."""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from ..gate import take, within
from ..member import NUMBER, NUMBER_BYTES, Member, Refused, Wanted, kind_of
from . import Parts

_CUT_FIX = "export it again; it may be cut short or damaged"


class Table:
    """The channels of a file."""

    def __init__(self, file: str, max_bytes: int) -> None:
        """Reads the metadata, not the values."""
        from nptdms import TdmsFile

        # An open file, not a name: given a name, the library would trust an index file that lies beside it.
        handle = open(file, "rb")  # noqa: SIM115, stays open as long as the table
        self.size, self.max_bytes = os.fstat(handle.fileno()).st_size, max_bytes
        self.file = TdmsFile.open(handle)
        status = self.file.file_status
        if status.incomplete_final_segment:
            raise Refused("its last segment is not complete", _CUT_FIX)
        self.channels = [
            (group.name, channel)
            for group in self.file.groups()
            for channel in group.channels()
            if len(channel)
        ]
        self.members = [
            Member(
                channel.name,
                group,
                kind=kind_of(channel.dtype),
                shape=(len(channel),),
                unit=_text(channel.properties.get("unit_string"))
                or _text(channel.properties.get("NI_UnitDescription")),
            )
            for group, channel in self.channels
        ]
        self.axis = self._axis()
        if self.axis is not None:
            self.members.append(Member("t", unit="s", shape=(self.axis[2],)))

    def read(self, wanted: list[Wanted]) -> Parts:
        """The channels wanted, after their declared lengths have been checked against the file."""
        chosen = {item.index for item in wanted if item.index < len(self.channels)}
        channels = [self.channels[index][1] for index in chosen]
        if any(len(channel) > self.size for channel in channels):
            raise Refused("it declares more values than the file holds", _CUT_FIX)
        within(
            sum(len(channel) * max(channel.dtype.itemsize, NUMBER_BYTES) for channel in channels),
            self.max_bytes,
        )
        return [[take(self._values(item), item)] for item in wanted]

    def _values(self, item: Wanted) -> Any:
        if item.index == len(self.channels):
            assert self.axis is not None, "t is listed only where there is a time axis"
            start, step, rows = self.axis
            return start + step * np.arange(rows, dtype=np.float64)
        channel = self.channels[item.index][1]
        values = channel[:]
        if len(values) != len(channel):
            raise Refused("it holds fewer values than it declares", _CUT_FIX, column=item.column)
        return values

    def _axis(self) -> tuple[float, float, int] | None:
        """Start (s), step (s) and length of the time axis that all waveforms share, None without one."""
        found = set()
        for _, channel in self.channels:
            if channel.name.lower() in {"t", "time"}:
                return None
            step = channel.properties.get("wf_increment")
            if kind_of(channel.dtype) == NUMBER and isinstance(step, int | float) and step > 0:
                start = channel.properties.get("wf_start_offset", 0.0)
                began = str(channel.properties.get("wf_start_time"))
                found.add((float(start), float(step), len(channel), began))
        if len(found) != 1:
            return None
        start, step, rows, _ = found.pop()
        return start, step, rows


def _text(value: Any) -> str | None:
    return value if isinstance(value, str) and value.strip() else None
