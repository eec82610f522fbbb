"""NI TDMS by npTDMS: channels by GROUP/CHANNEL, time from the waveform properties where it has no channel."""

from __future__ import annotations

import os
from typing import Any

import numpy as np

from ..selection import Selection
from . import NUMBER_BYTES, Parts, Refused, describe, numbers, too_large

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
        self.channels = {
            f"{group.name}/{channel.name}": channel
            for group in self.file.groups()
            for channel in group.channels()
        }
        self.columns = [
            describe(
                path,
                unit=_text(channel.properties.get("unit_string"))
                or _text(channel.properties.get("NI_UnitDescription")),
                shape=(len(channel),),
                why=None if channel.dtype.kind in "fiub" else "it holds no plain numbers",
            )
            for path, channel in self.channels.items()
            if len(channel)
        ]
        self.axis = self._axis()
        if self.axis is not None:
            self.columns.append(describe("t", unit="s", shape=(self.axis[2],)))

    def read(self, wanted: list[str]) -> Parts:
        """The channels wanted, after their declared lengths have been checked against the file."""
        chosen = [text for text in wanted if Selection.of(text).name in self.channels]
        lengths = [self.channels[Selection.of(text).name] for text in chosen]
        stored = sum(len(channel) * channel.dtype.itemsize for channel in lengths)
        if any(len(channel) > self.size for channel in lengths):
            raise Refused("it declares more values than the file holds", _CUT_FIX)
        total = max(stored, NUMBER_BYTES * sum(len(channel) for channel in lengths))
        if total > self.max_bytes:
            raise too_large(total, self.max_bytes)
        out: Parts = {}
        for text in wanted:
            channel = self.channels.get(Selection.of(text).name)
            if channel is None:
                assert self.axis is not None, "t is listed only where there is a time axis"
                start, step, rows = self.axis
                out[text] = [start + step * np.arange(rows, dtype=np.float64)]
            else:
                values = channel[:]
                if len(values) != len(channel):
                    raise Refused("it holds fewer values than it declares", _CUT_FIX, column=text)
                out[text] = [numbers(values, text)]
        return out

    def _axis(self) -> tuple[float, float, int] | None:
        """Start (s), step (s) and length of the time axis that all waveforms share, None without one."""
        found = set()
        for path, channel in self.channels.items():
            if path.rsplit("/", 1)[-1].lower() in {"t", "time"}:
                return None
            step = channel.properties.get("wf_increment")
            if len(channel) and channel.dtype.kind in "fiub" and isinstance(step, int | float) and step > 0:
                start = channel.properties.get("wf_start_offset", 0.0)
                began = str(channel.properties.get("wf_start_time"))
                found.add((float(start), float(step), len(channel), began))
        if len(found) != 1:
            return None
        start, step, rows, _ = found.pop()
        return start, step, rows


def _text(value: Any) -> str | None:
    return value if isinstance(value, str) and value.strip() else None
