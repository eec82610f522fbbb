"""NI TDMS by npTDMS: channels by GROUP/CHANNEL, time from the waveform properties where it has no channel."""

from __future__ import annotations

import os
from typing import Any, Final, NamedTuple

import numpy as np

from ....quantities.units import canonical
from ..gate import take, within
from ..member import NUMBER, NUMBER_BYTES, Member, Refused, Wanted, kind_of
from . import NO_TIME, NO_TIME_FIX, Parts

_AXIS: Final = "sample times"
_TIMES: Final = frozenset({"t", "time"})
_CUT_FIX: Final = "export it again; it may be cut short or damaged"


class Axis(NamedTuple):
    """The time axis of a waveform: start (s) behind the earliest one, step (s) and length."""

    start: float
    step: float
    rows: int


class Table:
    """The channels of a file, and the sample times of each of their time axes."""

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
        self.axes, of = _axes([channel for _, channel in self.channels])
        clocks = _clocks(self.channels)
        alone = not clocks and any(channel.name.lower() in _TIMES for _, channel in self.channels)
        if clocks or alone:
            self.axes = []
        self.members = [
            Member(
                channel.name,
                group,
                kind=kind_of(channel.dtype),
                shape=(len(channel),),
                unit=_unit(channel) or ("s" if clocks.get(group) == k else None),
                base=group if group in clocks else str(of[k]) if self.axes and of[k] is not None else None,
                stamps=clocks.get(group) == k,
            )
            for k, (group, channel) in enumerate(self.channels)
        ]
        self.members += [
            Member(_AXIS, str(k), unit="s", shape=(axis.rows,), base=str(k), stamps=True)
            for k, axis in enumerate(self.axes)
        ]
        if self.axes or clocks:
            self.members.append(Member("t", unit="s", stamps=True, why=NO_TIME, fix=NO_TIME_FIX))

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
        if item.index >= len(self.channels):
            axis = self.axes[item.index - len(self.channels)]
            return axis.start + axis.step * np.arange(axis.rows, dtype=np.float64)
        channel = self.channels[item.index][1]
        values = channel[:]
        if len(values) != len(channel):
            raise Refused("it holds fewer values than it declares", _CUT_FIX, column=item.column)
        return values


def _axes(channels: list[Any]) -> tuple[list[Axis], list[int | None]]:
    """The different time axes of the waveforms, from the earliest start on, and which of them each channel
    has; none where only some of the waveforms say when they began.
    """
    found: list[tuple[Any, float, float, int] | None] = []
    for channel in channels:
        step = channel.properties.get("wf_increment")
        if kind_of(channel.dtype) != NUMBER or not isinstance(step, int | float) or step <= 0:
            found.append(None)
            continue
        began = channel.properties.get("wf_start_time")
        start = float(channel.properties.get("wf_start_offset", 0.0))
        known = began if isinstance(began, np.datetime64) and not np.isnat(began) else None
        found.append((known, start, float(step), len(channel)))
    each = list(dict.fromkeys(axis for axis in found if axis is not None))
    starts = [began for began, *_ in each if began is not None]
    if starts and len(starts) < len(each):
        return [], [None] * len(channels)
    axes = [
        Axis((began - min(starts)) / np.timedelta64(1, "s") + start if starts else start, step, rows)
        for began, start, step, rows in each
    ]
    return axes, [None if axis is None else each.index(axis) for axis in found]


def _clocks(channels: list[tuple[str, Any]]) -> dict[str, int]:
    """The channel that holds the sample times, per group, where several groups have one in a known unit."""
    out: dict[str, int] = {}
    for k, (group, channel) in enumerate(channels):
        if channel.name.lower() in _TIMES and kind_of(channel.dtype) == NUMBER:
            known = canonical(_unit(channel) or ("s" if channel.name == "t" else ""), "time")
            if group in out or known is None:
                return {}
            out[group] = k
    return out if len(out) > 1 else {}


def _unit(channel: Any) -> str | None:
    texts = (channel.properties.get(key) for key in ("unit_string", "NI_UnitDescription"))
    return next((text for text in texts if isinstance(text, str) and text.strip()), None)
