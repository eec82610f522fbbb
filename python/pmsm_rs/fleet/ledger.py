"""A ledger of finished work: one JSON object per line, only ever appended to, each on disk before the next.

When a process dies, at most its last line is torn. Such a line is kept, ended, and passed over when the
ledger is read again. Any other line that cannot be used is known by its number.
"""

from __future__ import annotations

import json
import os
import stat
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final, Self

from .._core import DataError, UsageError
from ..errors import refuse

SCHEMA: Final = "pmsm-rs.ledger/1"
_FIRST: Final = json.dumps({"schema": SCHEMA}).encode() + b"\n"
_BEGUN: Final = frozenset(_FIRST[:end] for end in range(1, len(_FIRST)))


class Ledger:
    """The ledger at `path`, made where there is none. `entries` holds what is in it, the last of each key,
    and `damaged` the numbers (from 1) of lines that are no entries.

    Raises UsageError where it cannot be written or another process writes it, DataError where the file is no
    ledger.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        """Reads what is there and keeps the file open for appending."""
        self.path = str(path)
        self.entries: dict[str, Mapping[str, Any]] = {}
        self.damaged: list[int] = []
        self._line_of: dict[str, int] = {}
        try:
            self._file = os.open(self.path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o666)
        except OSError as error:
            raise refuse(
                UsageError,
                f"cannot be written ({error.strerror})",
                file=self.path,
                fix="name a file in a folder that exists and may be written to",
            ) from error
        try:
            if not stat.S_ISREG(os.fstat(self._file).st_mode):
                raise refuse(
                    UsageError, "this is a pipe or a device, no file", file=self.path, fix="name a file"
                )
            self._claim()
            text = Path(self.path).read_bytes()
            for number, entry in self._lines(text):
                self.entries[entry["key"]] = entry
                self._line_of[entry["key"]] = number
            if text and not text.endswith(b"\n"):
                self._write(b"\n")
            if not text.strip() or (text in _BEGUN and _FIRST[:-1] != text):
                self._write(_FIRST)
        except BaseException:
            os.close(self._file)
            raise

    def add(self, key: str, entry: Mapping[str, Any]) -> None:
        """Appends an entry; it is on disk when this returns. Raises UsageError where the disk refuses it."""
        self.entries[key] = {"key": key, **entry}
        self._append(self.entries[key])

    def pass_over(self, key: str) -> None:
        """Counts the entry of `key` among the damaged ones, which it proves to be as it is used."""
        del self.entries[key]
        self.damaged = sorted({*self.damaged, self._line_of[key]})

    def close(self) -> None:
        """Lets go of the file."""
        os.close(self._file)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _append(self, entry: Mapping[str, Any]) -> None:
        text = json.dumps(entry, ensure_ascii=False, allow_nan=False)
        self._write(text.encode(errors="backslashreplace") + b"\n")

    def _write(self, line: bytes) -> None:
        try:
            if os.write(self._file, line) != len(line):
                raise OSError(0, "the disk is full")
            os.fsync(self._file)
        except OSError as error:
            raise refuse(
                UsageError,
                f"cannot be written ({error.strerror})",
                file=self.path,
                fix="make room on the disk and run it again; what is in the ledger is kept",
            ) from error

    def _claim(self) -> None:
        try:
            import fcntl
        except ImportError:
            return
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise refuse(
                UsageError,
                "another process writes this ledger",
                file=self.path,
                fix="wait for it to end, or name another file",
            ) from error

    def _lines(self, text: bytes) -> Iterator[tuple[int, dict[str, Any]]]:
        lines = text.split(b"\n")
        # A process may have died as it wrote the first line, and its successor have ended that.
        torn = lines[0] in _BEGUN and lines[0] != _FIRST[:-1]
        begun = False
        for number, line in enumerate(lines, start=1):
            if not line.strip() or (torn and number == 1):
                continue
            try:
                entry = json.loads(line)
            except (ValueError, RecursionError):
                entry = None
            if isinstance(entry, dict) and entry.get("schema") == SCHEMA:
                begun = True
                continue
            if not begun:
                raise refuse(
                    DataError,
                    f"this is no ledger of schema {SCHEMA}",
                    file=self.path,
                    row=number,
                    place=f"line {number}",
                    fix="name another file",
                )
            if isinstance(entry, dict) and isinstance(entry.get("key"), str):
                yield number, entry
            elif number < len(lines):
                # What stands behind the last line feed is the line that a dying process left.
                self.damaged.append(number)
