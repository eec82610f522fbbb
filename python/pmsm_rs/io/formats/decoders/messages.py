"""Logs of messages: a topic is a group, and each number of its messages is a column with the topic's times.

The fields of a topic are those of its first message. A message has the time of its header where that is of
the clock of the log, else the time at which it was logged.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, fields, is_dataclass
from typing import Any, Final

import numpy as np

from ..gate import take, within
from ..member import BOOLEAN, NUMBER, NUMBER_BYTES, Member, Refused, Wanted
from . import NO_TIME, NO_TIME_FIX, Parts

TIME: Final = "time"
_LONGEST_ARRAY: Final = 64
"""Values of an array that become columns; longer ones are pictures and scans."""
_DEEPEST: Final = 8
_MOST_FIELDS: Final = 2000
_OTHER_CLOCK: Final = 60 * 1_000_000_000
"""Nanoseconds between header and log from which the header is of another clock, such as that of a
simulation.
"""
_LENGTH_FIX: Final = "log a topic whose messages all have the same fields"

Step = str | int
Path = tuple[Step, ...]


@dataclass(frozen=True)
class Message:
    """A message as it was logged: topic, time (ns), and what unpacks it."""

    topic: str
    logged: int
    unpack: Callable[[], Any]


class Log(ABC):
    """A log of messages. `counts` has the number of messages by topic, None where it is not known, and
    `unknown` says of topics that cannot be unpacked why.
    """

    counts: dict[str, int | None]
    unknown: dict[str, str]

    @abstractmethod
    def messages(self, topics: frozenset[str]) -> Iterator[Message]:
        """The messages of some topics in the order of the log."""


@dataclass
class _Topic:
    """What the first message of a topic shows."""

    kinds: dict[Path, str] = field(default_factory=dict)
    names: dict[Path, str] = field(default_factory=dict)
    by_header: bool = False


class Table:
    """The numbers of the messages of a log as GROUP/FIELD, and the times of each topic."""

    def __init__(self, log: Log, max_bytes: int) -> None:
        """Unpacks the first message of each topic."""
        self.log, self.max_bytes = log, max_bytes
        self.topics, self.start = _first(log)
        self.places: list[tuple[str, Path | None]] = []
        self.members: list[Member] = []
        for topic, shown in self.topics.items():
            count, group = log.counts[topic], topic.strip("/")
            shape = None if count is None else (count,)
            for path, kind in shown.kinds.items():
                name = shown.names[path]
                self._add(topic, path, Member(name, group, kind=kind, shape=shape, base=group))
            if shown.kinds:
                stamps = Member(TIME, group, unit="s", shape=shape, base=group, stamps=True)
                self._add(topic, None, stamps)
        for topic, why in log.unknown.items():
            self._add(topic, None, Member(topic.strip("/"), why=why, fix="log it in another encoding"))
        if any(member.stamps for member in self.members):
            self._add("", None, Member(TIME, unit="s", stamps=True, why=NO_TIME, fix=NO_TIME_FIX))

    def read(self, wanted: list[Wanted]) -> Parts:
        """The fields wanted, message by message, after a check of what they take."""
        asked: dict[str, dict[Path | None, list[float]]] = {}
        for item in wanted:
            topic, path = self.places[item.index]
            asked.setdefault(topic, {})[path] = []
        rows = sum((self.log.counts[topic] or 0) * len(columns) for topic, columns in asked.items())
        within(NUMBER_BYTES * rows, self.max_bytes)
        stamps: dict[str, list[int]] = {topic: [] for topic in asked if self.topics[topic].by_header}
        for message in self.log.messages(frozenset(asked)):
            columns, by_header = asked[message.topic], message.topic in stamps
            content = message.unpack() if by_header or {*columns} != {None} else None
            stamp = message.logged
            if by_header:
                own = _stamp(content)
                stamp = stamp if own is None else own
                stamps[message.topic].append(stamp)
            for path, values in columns.items():
                if path is None:
                    values.append(1e-9 * (stamp - self.start))
                else:
                    values.append(_at(content, path, len(values), self.topics[message.topic].names[path]))
        # Messages that overtook others on their way are put in order.
        order = {topic: np.argsort(own, kind="stable") for topic, own in stamps.items()}
        out: Parts = []
        for item in wanted:
            topic, path = self.places[item.index]
            column = np.array(asked[topic][path], dtype=np.float64)
            out.append([take(column[order[topic]] if topic in order else column, item)])
        return out

    def _add(self, topic: str, path: Path | None, member: Member) -> None:
        self.places.append((topic, path))
        self.members.append(member)


def _first(log: Log) -> tuple[dict[str, _Topic], int]:
    """What the first message of each topic shows, and the time of the first message of all (ns)."""
    left = {topic for topic, count in log.counts.items() if count != 0} - {*log.unknown}
    found: dict[str, _Topic] = {}
    start: int | None = None
    for message in log.messages(frozenset(left)) if left else ():
        start = message.logged if start is None else start
        if message.topic in left:
            content = message.unpack()
            stamp = _stamp(content)
            topic = _Topic(by_header=stamp is not None and abs(stamp - message.logged) < _OTHER_CLOCK)
            for path, name, kind in _numbers(content, (), ""):
                topic.kinds[path], topic.names[path] = kind, name
                if len(topic.kinds) == _MOST_FIELDS:
                    break
            found[message.topic] = topic
            left.discard(message.topic)
            if not left:
                break
    return {topic: found[topic] for topic in log.counts if topic in found}, start or 0


def _numbers(value: Any, path: Path, name: str) -> Iterator[tuple[Path, str, str]]:
    """Path, name and kind of each number within a message."""
    if len(path) > _DEEPEST or path[-2:] == ("header", "stamp"):
        return
    if isinstance(value, bool | np.bool_):
        yield path, name, BOOLEAN
    elif isinstance(value, int | float | np.integer | np.floating):
        yield path, name, NUMBER
    elif isinstance(value, list | tuple | np.ndarray):
        if len(value) <= _LONGEST_ARRAY:
            for k, item in enumerate(value):
                yield from _numbers(item, (*path, k), f"{name}[{k}]")
    else:
        within_it = _parts(value)
        labels = within_it.get("name")
        named = isinstance(labels, list) and labels and all(isinstance(label, str) for label in labels)
        for key, item in within_it.items():
            inner = f"{name}.{key}" if name else key
            arrays = isinstance(item, list | np.ndarray) and key != "name"
            if named and labels is not None and arrays and len(item) == len(labels) <= _LONGEST_ARRAY:
                # The joints of a robot: values by the names beside them.
                for k, label in enumerate(labels):
                    yield from _numbers(item[k], (*path, key, k), f"{inner}[{label}]")
            else:
                yield from _numbers(item, (*path, key), inner)


def _parts(value: Any) -> dict[str, Any]:
    if isinstance(value, dict):
        return {str(key): item for key, item in value.items()}
    if is_dataclass(value):
        return {entry.name: getattr(value, entry.name) for entry in fields(value)}
    return {}


def _at(content: Any, path: Path, row: int, name: str) -> float:
    """The number at `path`. Raises Refused where a message has none there."""
    try:
        for step in path:
            content = (
                content[step]
                if isinstance(step, int) or isinstance(content, dict)
                else getattr(content, step)
            )
        return float(content)
    except (LookupError, AttributeError, TypeError, ValueError):
        raise Refused("a message has no such number", _LENGTH_FIX, column=name, row=row) from None


def _stamp(content: Any) -> int | None:
    """The time of a message in ns by its header, None where it has none or was never set."""
    head = _parts(content)
    stamp = _parts(_parts(head.get("header")).get("stamp") or head.get("timestamp"))
    seconds = stamp.get("sec", stamp.get("secs"))
    rest = next((stamp[key] for key in ("nanosec", "nsec", "nsecs") if key in stamp), None)
    if not isinstance(seconds, int | np.integer) or not isinstance(rest, int | np.integer):
        return None
    whole = int(seconds) * 1_000_000_000 + int(rest)
    return whole or None
