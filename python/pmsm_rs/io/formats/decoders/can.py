"""Logs of a CAN bus by python-can, their frames taken apart by cantools and a description of the bus.

A message is a group with the times of its frames. Signals that a multiplexer selects come in fewer frames and
have a time base of their own.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import numpy as np

from ..canlog import READERS, log_kind
from ..gate import take, within
from ..member import NUMBER_BYTES, Member, Refused, Wanted
from . import NO_TIME, NO_TIME_FIX, Parts

TIME: Final = "time"
_DBC_FIX: Final = "correct dbc in [columns]; it names the description of the bus (.dbc, .kcd, .sym or .arxml)"

Id = tuple[int, bool]


class Table:
    """The signals of a log as MESSAGE/SIGNAL."""

    def __init__(self, file: str, max_bytes: int, dbc: str) -> None:
        """Reads all frames that the description knows. Raises Refused where it knows none."""
        self.max_bytes = max_bytes
        self.known = _messages(dbc)
        self.stamps: dict[Id, list[float]] = {}
        self.payloads: dict[Id, list[bytes]] = {}
        count = 0
        for stamp, identity, payload in _frames(file):
            count += 1
            if identity in self.known:
                self.stamps.setdefault(identity, []).append(stamp)
                self.payloads.setdefault(identity, []).append(payload)
        if not self.stamps:
            raise Refused(
                f"none of its {count} frames is described in {dbc}" if count else "it holds no frames",
                _DBC_FIX,
            )
        self.start = min(stamps[0] for stamps in self.stamps.values())
        self.places: list[tuple[Id, str, bool]] = []
        self.members: list[Member] = []
        for identity in self.stamps:
            self._describe(identity)
        self._add(((0, False), "", True), Member(TIME, unit="s", stamps=True, why=NO_TIME, fix=NO_TIME_FIX))

    def read(self, wanted: list[Wanted]) -> Parts:
        """The signals wanted, frame by frame, after a check of what they take."""
        places = [self.places[item.index] for item in wanted]
        within(sum(NUMBER_BYTES * len(self.stamps[identity]) for identity, *_ in places), self.max_bytes)
        asked: dict[Id, dict[tuple[str, bool], list[float]]] = {}
        for identity, signal, is_time in places:
            asked.setdefault(identity, {})[signal, is_time] = []
        for identity, columns in asked.items():
            message = self.known[identity]
            for stamp, payload in zip(self.stamps[identity], self.payloads[identity], strict=True):
                values = message.decode(payload, decode_choices=False, allow_truncated=True)
                for (signal, is_time), column in columns.items():
                    if signal in values:
                        column.append(stamp - self.start if is_time else float(values[signal]))
        return [
            [take(np.array(asked[identity][signal, is_time], dtype=np.float64), item)]
            for (identity, signal, is_time), item in zip(places, wanted, strict=True)
        ]

    def _describe(self, identity: Id) -> None:
        """The signals of a message, and the times of each set of them that comes together."""
        message, rows = self.known[identity], len(self.stamps[identity])
        lead: dict[str, str] = {}
        for signal in message.signals:
            chosen = signal.multiplexer_ids
            base = message.name if not chosen else f"{message.name}[{signal.multiplexer_signal}={chosen[0]}]"
            shape = (rows,) if not chosen else None
            lead.setdefault(base, signal.name)
            member = Member(signal.name, message.name, shape=shape, unit=signal.unit or None, base=base)
            self._add((identity, signal.name, False), member)
        for base, signal in lead.items():
            shape = (rows,) if base == message.name else None
            member = Member(TIME, base, unit="s", shape=shape, base=base, stamps=True)
            self._add((identity, signal, True), member)

    def _add(self, place: tuple[Id, str, bool], member: Member) -> None:
        self.places.append(place)
        self.members.append(member)


def _messages(dbc: str) -> dict[Id, Any]:
    """The messages of a description of the bus by identifier, and whether that is an extended one."""
    from cantools.database import load_file

    try:
        # A description of diagnostics (CDD) has no messages.
        database: Any = load_file(dbc, strict=False)
        return {(each.frame_id, each.is_extended_frame): each for each in database.messages if each.signals}
    except Exception as error:
        lines = str(error).strip().splitlines() or [type(error).__name__]
        raise Refused(f"{dbc} cannot be read ({lines[0][:120]})", _DBC_FIX) from error


def _frames(file: str) -> Iterator[tuple[float, Id, bytes]]:
    """Time (s), identifier and payload of the data frames of a log."""
    import can

    with open(file, "rb") as handle:
        kind = log_kind(handle.read(128))
    assert kind is not None
    with getattr(can, READERS[kind])(file) as reader:
        for frame in reader:
            if not frame.is_error_frame and not frame.is_remote_frame:
                yield frame.timestamp, (frame.arbitration_id, frame.is_extended_id), bytes(frame.data)
