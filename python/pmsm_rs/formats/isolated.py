"""Binary files, decoded by a child process so that no damaged file can take this one down."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import weakref
from collections import Counter
from collections.abc import Iterable
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from .._core import DataError, InternalError, UsageError
from ..errors import refuse
from .selection import Selection
from .source import PLAIN_FIX, Source, complex_fix, matrix_fix, short_names

DAMAGED: Final = "export it again; it may be cut short or damaged"
# What Python, numpy and the decoder's own threads map before a single value is read.
_OWN_MEMORY: Final = 1 << 30
# Far below what any sound file has been seen to need.
_BYTES_PER_SECOND: Final = 2_000_000
_FEWEST_SECONDS: Final = 30


class _Child:
    """The decoder of one file: started with the list of columns, asked once for values."""

    def __init__(self, file: str, decoder: str, what: str, max_bytes: int) -> None:
        self.file, self.what = file, what
        self.known_as: dict[str, str] = {}
        task = {
            "file": os.path.abspath(file),
            "decoder": decoder,
            "max_bytes": max_bytes,
            "memory": 3 * max_bytes + _OWN_MEMORY,
            "seconds": _FEWEST_SECONDS + os.path.getsize(file) // _BYTES_PER_SECOND,
            "path": [os.path.abspath(entry) for entry in sys.path if entry]
            + [str(Path(__file__).parents[2])],
        }
        script = str(Path(__file__).with_name("decoder.py"))
        # No plugin that a file names, and no more threads than one column after the other needs.
        environment = {**os.environ, "HDF5_PLUGIN_PRELOAD": "::", "OPENBLAS_NUM_THREADS": "1"}
        try:
            self.process = subprocess.Popen(
                [sys.executable, "-I", "-S", script, json.dumps(task)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                env=environment,
            )
        except OSError as error:
            raise InternalError(
                f"the decoder could not be started ({error}); check sys.executable"
            ) from error

    def message(self) -> dict[str, Any]:
        """The next message. Raises DataError where the decoder refused the file or died of it."""
        out = self.process.stdout
        assert out is not None
        head = out.read(4)
        text = out.read(int.from_bytes(head, "little")) if len(head) == 4 else b""
        if not text:
            raise self.damaged("the decoder gave up on it")
        message: dict[str, Any] = json.loads(text)
        if "damaged" in message:
            raise self.damaged(message["damaged"])
        if "refused" in message:
            facts = message["refused"]
            row = facts["row"]
            place = None if row is None else f"row {row} (counting from 0)"
            column = self.known_as.get(facts["column"], facts["column"])
            problem, fix = facts["problem"], facts["fix"]
            raise refuse(DataError, problem, file=self.file, row=row, place=place, column=column, fix=fix)
        return message

    def damaged(self, why: str) -> DataError:
        """The refusal of a file that cannot be decoded."""
        return refuse(DataError, f"this {self.what} file cannot be read ({why})", file=self.file, fix=DAMAGED)

    def values(self, known_as: dict[str, str]) -> dict[str, NDArray[np.float64]]:
        """The columns wanted, from the decoder's names for them to the user's; ends the decoder."""
        self.known_as = known_as
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        try:
            self.process.stdin.write(json.dumps(list(known_as)).encode() + b"\n")
            self.process.stdin.flush()
        except BrokenPipeError:
            raise self.damaged("the decoder gave up on it") from None
        out = {}
        for name, rows in self.message()["rows"].items():
            values = np.empty(rows, dtype="<f8")
            if self.process.stdout.readinto(values.data.cast("B")) != values.nbytes:  # type: ignore[attr-defined]
                raise self.damaged("the decoder gave up on it")
            out[known_as[name]] = values
        return out


def _end(process: subprocess.Popen[bytes]) -> None:
    process.kill()
    process.communicate()


def open_isolated(
    file: Path, decoder: str, what: str, max_bytes: int, *, needs: tuple[str, str] | None = None
) -> Source:
    """The columns of a file that `decoder`, a module of `decoders`, reads in a process of its own.

    `what` names the format to the user; `needs` is the library it takes and the extra that brings it. Columns
    of groups go by their own name where that is the only one of its kind, else by GROUP/NAME. Raises
    UsageError where the library is not installed and DataError on damage, on duplicate names, on columns
    wanted that hold no numbers or have gaps, and on more than `max_bytes` bytes.
    """
    name = str(file)
    if needs is not None and find_spec(needs[0]) is None:
        raise refuse(
            UsageError,
            f"{needs[0]}, which reads {what} files, is not installed",
            file=name,
            fix=f"install it with: pip install 'pmsm-rs[{needs[1]}]'",
        )
    child = _Child(name, decoder, what, max_bytes)
    ended = weakref.finalize(child, _end, child.process)
    try:
        listed = child.message()["columns"]
    except DataError:
        ended()
        raise
    paths = [column["path"] for column in listed]
    twice = next((path for path, count in Counter(paths).items() if count > 1), None)
    if twice is not None:
        ended()
        raise refuse(
            DataError, f"two columns are called '{twice}'", file=name, column=twice, fix="rename one of them"
        )
    if not paths:
        ended()
        raise refuse(DataError, "it holds no columns of numbers", file=name, fix=PLAIN_FIX)
    short = short_names(paths)
    facts = {short[column["path"]]: column for column in listed}

    def resolve(wanted: str) -> str | None:
        part = Selection.of(wanted)
        known = part.name if part.name in facts else short.get(part.name)
        if known is None:
            return None
        shape = facts[known]["shape"]
        if shape is not None and not part.fits(tuple(shape)):
            raise refuse(
                DataError,
                f"'{part.name}' has shape {tuple(shape)}, so it has no column {part.column}",
                file=name,
                column=wanted,
                fix="columns count from 0",
            )
        return known + wanted[len(part.name) :]

    def check(column: str) -> str:
        """The decoder's name of a column wanted. Raises DataError where it holds no plain numbers."""
        part = Selection.of(column) if column not in facts else Selection(column)
        fact = facts[part.name]
        if fact["why"] is not None:
            raise refuse(DataError, fact["why"], file=name, column=column, fix=fact["fix"] or PLAIN_FIX)
        if fact["complex"] and part.part is None:
            raise refuse(
                DataError, "it holds complex numbers", file=name, column=column, fix=complex_fix(column)
            )
        shape = tuple(fact["shape"] or ())
        if part.column is None and not part.flat and len([n for n in shape if n != 1]) > 1:
            raise refuse(
                DataError,
                f"it has {len(shape)} dimensions {shape}",
                file=name,
                column=column,
                fix=matrix_fix(column),
            )
        return str(fact["path"]) + column[len(part.name) :]

    def read(wanted: Iterable[str]) -> dict[str, NDArray[np.float64]]:
        chosen = {check(column): column for column in wanted}
        if not chosen:
            return {}
        # Whoever reads a second time gets a decoder of their own.
        reader = child if ended.alive else _Child(name, decoder, what, max_bytes)
        end = ended if ended.alive else weakref.finalize(reader, _end, reader.process)
        try:
            if reader is not child:
                reader.message()
            return reader.values(chosen)
        finally:
            end()

    units = {column: str(fact["unit"]) for column, fact in facts.items() if fact["unit"] is not None}
    return Source(name, tuple(facts), read, units=units, resolve=resolve)
