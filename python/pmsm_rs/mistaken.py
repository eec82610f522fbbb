"""Files named in the place of another: a recording, a machine file and an answer, told by their beginning."""

from __future__ import annotations

import re
import tomllib
from typing import Any, Final

from ._core import DataError
from .errors import refuse

HEAD: Final = 1 << 16
"""Bytes of a file from which `is_recording` and `is_answer` tell what it is."""

MAGIC: Final = (
    (b"PAR1", "parquet"),
    (b"ARROW1", "feather"),
    (b"PK\x03\x04", "npz"),
    (b"MATLAB 5.0", "mat"),
    (b"MATLAB 7.3", "hdf5"),
    (b"\x89HDF", "hdf5"),
    (b"MDF ", "mdf"),
    (b"UnFinMF ", "mdf"),
    (b"TDSm", "tdms"),
    (b"\xff\xff\xff\xff", "feather"),
    (b"ULog\x01\x12\x35", "ulog"),
    (b"#ROSBAG V2", "rosbag"),
    (b"SQLite format 3\0", "rosbag"),
    (b"\x89MCAP", "mcap"),
)
"""First bytes of the formats of recordings that are no text, and the readers of these formats."""

_OWN: Final = "pmsm-rs."
"""How the schema of every JSON file of this package begins."""
_ANSWER: Final = re.compile(rb'\s*\{.*?"schema"\s*:\s*"pmsm-rs\.', re.DOTALL)
_JSON: Final = re.compile(rb'\s*(?:\{|\[\s*\{)\s*"')
_SAMPLE: Final = re.compile(r"\s*[-+.\d][^\s,;]*(?:\s*[,;\t ]\s*[-+.\d][^\s,;]*)+\s*[,;]?\s*")
"""A line of two numbers at least, as the rows of a table are."""
_FEWEST: Final = 3
_MACHINE: Final = re.compile(r"^\s*\[machine\]", re.MULTILINE)


def is_recording(head: bytes) -> bool:
    """Whether a file that is no TOML and begins with `head` is a recording: of a known format, JSON or
    a table.
    """
    if any(head.startswith(magic) for magic, _ in MAGIC) or _JSON.match(head):
        return True
    lines = head.decode("utf-8", errors="replace").splitlines()
    return sum(_SAMPLE.fullmatch(line) is not None for line in lines) >= _FEWEST


def is_answer(head: bytes) -> bool:
    """Whether a file that begins with `head` is JSON that this package has written."""
    return _ANSWER.match(head) is not None


def is_machine_file(text: str) -> bool:
    """Whether a text is TOML with a table [machine]."""
    if _MACHINE.search(text) is None:
        return False
    try:
        return isinstance(tomllib.loads(text).get("machine"), dict)
    except (tomllib.TOMLDecodeError, RecursionError):
        return False


def no_recording(what: str, file: str) -> DataError:
    """That `file` is `what`, such as "a machine file", where a recording is expected."""
    return refuse(DataError, f"this is {what}, not a recording", file=file, fix="name the recording")


def expect_no_answer(content: Any, file: str) -> None:
    """Raises DataError where the `content` of a JSON file is one that this package has written."""
    first = content[0] if isinstance(content, list) and content else content
    schema = first.get("schema") if isinstance(first, dict) else None
    if isinstance(schema, str) and schema.startswith(_OWN):
        raise no_recording("an answer of this package", file)
