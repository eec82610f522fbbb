"""Bags of ROS 1 (.bag) and the storage files of ROS 2 (.db3) by rosbags."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

from . import messages
from .messages import Log, Message


class Table(messages.Table):
    """The topics of a bag."""

    def __init__(self, file: str, max_bytes: int) -> None:
        """Reads the connections of the bag and the types of their messages."""
        super().__init__(_Log(Path(file)), max_bytes)


class _Log(Log):
    """The connections of a bag by their topic; a bag of ROS 2 without types has those of its releases."""

    def __init__(self, file: Path) -> None:
        from rosbags.interfaces import MessageDefinitionFormat
        from rosbags.rosbag1 import Reader
        from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader
        from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

        with file.open("rb") as handle:
            is_first = handle.read(7) == b"#ROSBAG"
        self.reader: Any = Reader(file) if is_first else Sqlite3Reader(file)
        self.reader.open()
        types: dict[str, Any] = {}
        for connection in self.reader.connections:
            kind, text = connection.msgdef.format, connection.msgdef.data
            if kind == MessageDefinitionFormat.MSG:
                types.update(get_types_from_msg(text, connection.msgtype))
            elif kind == MessageDefinitionFormat.IDL:
                types.update(get_types_from_idl(text))
        store = get_typestore(Stores.EMPTY if types else Stores.LATEST)
        if types:
            store.register(types)
        self.unpack: Callable[[bytes, str], Any] = (
            store.deserialize_ros1 if is_first else store.deserialize_cdr
        )
        self.counts: dict[str, int | None] = {}
        self.unknown: dict[str, str] = {}
        for connection in self.reader.connections:
            topic = connection.topic
            self.counts[topic] = (self.counts.get(topic) or 0) + connection.msgcount
            if connection.msgtype not in store.fielddefs:
                self.unknown[topic] = f"the bag does not describe its type {connection.msgtype}"

    def messages(self, topics: frozenset[str]) -> Iterator[Message]:
        """The messages of some topics in the order of their times."""
        wanted = [each for each in self.reader.connections if each.topic in topics]
        for connection, logged, data in self.reader.messages(wanted):
            yield Message(connection.topic, logged, partial(self.unpack, data, connection.msgtype))
