"""Binary columnar files, decoded by a child process so that no damaged file can take this one down."""

from __future__ import annotations

import json
import subprocess
import sys
import weakref
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from .._core import DataError, InternalError
from ..errors import refuse
from .source import MISSING_FIX, Source

DAMAGED: Final = "export it again; it may be cut short or damaged"
# What Python, numpy and the decoder's own threads map before a single value is read.
_OWN_MEMORY: Final = 1 << 30


class _Child:
    """The decoder of one file: started with the schema, asked once for columns."""

    def __init__(self, file: str, kind: str, what: str, max_bytes: int) -> None:
        self.file, self.what = file, what
        task = {
            "file": file,
            "kind": kind,
            "max_bytes": max_bytes,
            "memory": 3 * max_bytes + _OWN_MEMORY,
            "path": [entry for entry in sys.path if entry],
        }
        script = str(Path(__file__).with_name("decoder.py"))
        try:
            self.process = subprocess.Popen(
                [sys.executable, "-I", "-S", script, json.dumps(task)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
            )
        except OSError as error:
            raise InternalError(
                f"the decoder could not be started ({error}); check sys.executable"
            ) from error

    def message(self) -> dict[str, Any]:
        """The next message. Raises DataError where the decoder found damage or died of it."""
        out = self.process.stdout
        assert out is not None
        head = out.read(4)
        text = out.read(int.from_bytes(head, "little")) if len(head) == 4 else b""
        if not text:
            raise self.damaged("the decoder gave up on it")
        message: dict[str, Any] = json.loads(text)
        if "damaged" in message:
            raise self.damaged(message["damaged"])
        return message

    def damaged(self, why: str) -> DataError:
        """The refusal of a file that cannot be decoded."""
        return refuse(DataError, f"this {self.what} file cannot be read ({why})", file=self.file, fix=DAMAGED)

    def columns(self, wanted: list[str]) -> dict[str, NDArray[np.float64]]:
        """The columns wanted; ends the decoder."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(json.dumps(wanted).encode() + b"\n")
        self.process.stdin.flush()
        message = self.message()
        if "missing" in message:
            row = message["row"]
            raise refuse(
                DataError,
                "the value is missing",
                file=self.file,
                row=row,
                place=f"row {row} (counting from 0)",
                column=message["missing"],
                fix=MISSING_FIX,
            )
        if "too_large" in message:
            raise refuse(
                DataError,
                "it needs more bytes of memory than allowed",
                file=self.file,
                fix="cut the recording, or raise max_bytes",
            )
        out = {}
        for name in wanted:
            values = np.empty(message["rows"], dtype="<f8")
            if self.process.stdout.readinto(values.data.cast("B")) != values.nbytes:  # type: ignore[attr-defined]
                raise self.damaged("the decoder gave up on it")
            out[name] = values
        return out


def _end(process: subprocess.Popen[bytes]) -> None:
    process.kill()
    process.communicate()


def open_isolated(file: Path, kind: str, what: str, max_bytes: int) -> Source:
    """The columns of a file: `kind` is "parquet", "file" (Arrow IPC with a footer) or "stream".

    Raises DataError on damage, on duplicate names, on columns wanted that hold no numbers or have gaps, and
    on more than `max_bytes` bytes.
    """
    name = str(file)
    child = _Child(name, kind, what, max_bytes)
    ended = weakref.finalize(child, _end, child.process)
    try:
        schema = child.message()
    except DataError:
        ended()
        raise
    names: list[str] = schema["names"]
    twice = next((column for column in names if names.count(column) > 1), None)
    if twice is not None:
        ended()
        raise refuse(
            DataError, f"two columns are called '{twice}'", file=name, column=twice, fix="rename one of them"
        )
    numbers = {column for column, plain in zip(names, schema["plain"], strict=True) if plain}

    def read(wanted: Iterable[str]) -> dict[str, NDArray[np.float64]]:
        chosen = list(wanted)
        for column in chosen:
            if column not in numbers:
                raise refuse(
                    DataError,
                    "it holds no plain numbers",
                    file=name,
                    column=column,
                    fix="store one real number per row",
                )
        if not chosen:
            return {}
        # Whoever reads a second time gets a decoder of their own.
        reader = child if ended.alive else _Child(name, kind, what, max_bytes)
        end = ended if ended.alive else weakref.finalize(reader, _end, reader.process)
        try:
            if reader is not child:
                reader.message()
            return reader.columns(chosen)
        finally:
            end()

    return Source(name, tuple(names), read)
