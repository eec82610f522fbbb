"""MCAP by mcap: messages in JSON, and those of ROS 1 and 2 by rosbags."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, Final

from ..member import Refused
from . import messages
from .messages import Log, Message

_ROS: Final = {("cdr", "ros2msg"), ("cdr", "ros2idl"), ("ros1", "ros1msg")}


class Table(messages.Table):
    """The topics of an MCAP file."""

    def __init__(self, file: str, max_bytes: int) -> None:
        """Reads the summary, or the whole file where it has none."""
        super().__init__(_Log(file), max_bytes)


class _Log(Log):
    """The channels of the file by their topic."""

    def __init__(self, file: str) -> None:
        from mcap.reader import make_reader

        self.handle = open(file, "rb")  # noqa: SIM115, stays open as long as the log
        self.reader = make_reader(self.handle)
        summary = self.reader.get_summary()
        if summary is None or not summary.channels:
            # A logger that was cut off leaves none.
            channels, schemas = {}, {}
            for schema, channel, _ in self.reader.iter_messages():
                channels[channel.id] = channel
                if schema is not None:
                    schemas[schema.id] = schema
            statistics = None
        else:
            channels, schemas, statistics = summary.channels, summary.schemas, summary.statistics
        self.unpackers: dict[int, Callable[[bytes], Any]] = {}
        self.counts: dict[str, int | None] = {}
        self.unknown: dict[str, str] = {}
        needed = {}
        for channel in channels.values():
            schema = schemas.get(channel.schema_id)
            how = (channel.message_encoding, "" if schema is None else schema.encoding)
            count = None if statistics is None else statistics.channel_message_counts.get(channel.id, 0)
            known = self.counts.get(channel.topic, 0)
            self.counts[channel.topic] = None if known is None or count is None else known + count
            if channel.message_encoding == "json":
                self.unpackers[channel.id] = json.loads
            elif how in _ROS and schema is not None:
                needed[channel.id] = (schema, channel.message_encoding)
            else:
                self.unknown[channel.topic] = f"its messages are encoded as '{how[0]}', which is not read"
        if needed:
            self.unpackers |= _of_ros(needed)

    def messages(self, topics: frozenset[str]) -> Iterator[Message]:
        """The messages of some topics in the order of their times."""
        for _, channel, message in self.reader.iter_messages(topics=sorted(topics)):
            unpack, data = self.unpackers[channel.id], message.data
            yield Message(channel.topic, message.log_time, partial(unpack, data))


def _of_ros(needed: dict[int, tuple[Any, str]]) -> dict[int, Callable[[bytes], Any]]:
    """What unpacks the messages of channels with types of ROS. Raises Refused without rosbags."""
    try:
        from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
    except ImportError:
        raise Refused(
            "it holds messages of ROS, and rosbags is not installed",
            "install it with: pip install 'pmsm-rs[ros]'",
        ) from None
    types: dict[str, Any] = {}
    for schema, _ in needed.values():
        text = schema.data.decode("utf-8")
        if schema.encoding == "ros2idl":
            types.update(get_types_from_idl(text))
        else:
            types.update(get_types_from_msg(text, _full(schema.name)))
    store = get_typestore(Stores.EMPTY)
    store.register(types)
    return {
        channel: _unpacker(store.deserialize_ros1 if encoding == "ros1" else store.deserialize_cdr, schema)
        for channel, (schema, encoding) in needed.items()
    }


def _unpacker(unpack: Callable[[bytes, str], Any], schema: Any) -> Callable[[bytes], Any]:
    name = _full(schema.name)
    return lambda data: unpack(data, name)


def _full(name: str) -> str:
    """The name of a type as rosbags has it, with `msg` between package and type."""
    package, _, kind = name.partition("/")
    return name if kind.startswith("msg/") else f"{package}/msg/{kind}"
