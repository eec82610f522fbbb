"""Binary files, decoded by a child process so that no damaged file can take this one down."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import weakref
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from ..._core import DataError, InternalError, UsageError
from ...errors import refuse
from .gate import admit
from .member import Member, Refused, Wanted
from .source import Source

DAMAGED: Final = "export it again; it may be cut short or damaged"
# What Python, numpy and the decoder's own threads map before a single value is read.
_OWN_MEMORY: Final = 1 << 30
# What the description of the columns may take per byte of the file: several times what Python's objects take.
_MEMORY_PER_BYTE: Final = 16
# Far below what any sound file has been seen to need.
_BYTES_PER_SECOND: Final = 2_000_000
SLOW: Final = 50_000
"""Bytes per second of logs whose messages Python takes apart one by one."""
# Starting the slowest decoder takes some three seconds of processor time.
_FEWEST_SECONDS: Final = 15


class _Child:
    """The decoder of one file: it starts with the list of columns, and is asked for values."""

    def __init__(
        self,
        file: str,
        decoder: str,
        what: str,
        max_bytes: int,
        speed: int = _BYTES_PER_SECOND,
        given: Mapping[str, str] | None = None,
    ) -> None:
        self.file, self.what = file, what
        size = os.path.getsize(file)
        unpacked = 3 * max_bytes + _OWN_MEMORY
        task = {
            "file": os.path.abspath(file),
            "decoder": decoder,
            "max_bytes": max_bytes,
            "given": dict(given or {}),
            # Little until the sizes that the file declares are known to be within what is allowed.
            "memory": [min(_MEMORY_PER_BYTE * size + _OWN_MEMORY, unpacked), unpacked],
            "seconds": _FEWEST_SECONDS + size // speed,
            "path": [os.path.abspath(entry) for entry in sys.path if entry]
            + [str(Path(__file__).parents[3])],
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
        """The next message. Raises Refused where the decoder refused the file, DataError where it died."""
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
            raise Refused(facts["problem"], facts["fix"], column=facts["column"], row=facts["row"])
        return message

    def damaged(self, why: str) -> DataError:
        """The refusal of a file that cannot be decoded."""
        return refuse(DataError, f"this {self.what} file cannot be read ({why})", file=self.file, fix=DAMAGED)

    def members(self) -> list[Member]:
        """What the file holds; the first answer of the decoder."""
        described = self.message()["members"]
        return [
            Member(**{**member, "shape": None if member["shape"] is None else tuple(member["shape"])})
            for member in described
        ]

    def values(self, wanted: list[Wanted]) -> list[NDArray[np.float64]]:
        """The values of the members wanted. Raises Refused and DataError as `message`."""
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        if self.process.stdin.closed:
            # It was ended when it gave up on other columns.
            raise self.damaged("the decoder gave up on it")
        asked = [[item.index, item.column, item.gaps, *vars(item.part).values()] for item in wanted]
        try:
            self.process.stdin.write(json.dumps(asked).encode() + b"\n")
            self.process.stdin.flush()
        except BrokenPipeError:
            raise self.damaged("the decoder gave up on it") from None
        out = []
        for rows in self.message()["rows"]:
            values = np.empty(rows, dtype="<f8")
            if self.process.stdout.readinto(values.data.cast("B")) != values.nbytes:  # type: ignore[attr-defined]
                raise self.damaged("the decoder gave up on it")
            out.append(values)
        return out


def _end(process: subprocess.Popen[bytes]) -> None:
    process.kill()
    process.communicate()


def open_isolated(
    file: Path,
    decoder: str,
    what: str,
    max_bytes: int,
    *,
    needs: tuple[str | tuple[str, ...], str] | None = None,
    speed: int = _BYTES_PER_SECOND,
    given: Mapping[str, str] | None = None,
) -> Source:
    """The columns of a file that `decoder`, a module of `decoders`, reads in a process of its own.

    `what` names the format to the user; `needs` are the libraries it takes and the extra that brings them.
    `speed` is how many bytes a sound file has at most per second of decoding, and `given` what the decoder is
    told besides. Raises UsageError where a library is not installed and DataError on damage.
    """
    name = str(file)
    libraries = () if needs is None else (needs[0],) if isinstance(needs[0], str) else needs[0]
    missing = next((library for library in libraries if find_spec(library) is None), None)
    if needs is not None and missing is not None:
        raise refuse(
            UsageError,
            f"{missing}, which reads {what} files, is not installed",
            file=name,
            fix=f"install it with: pip install 'pmsm-rs[{needs[1]}]'",
        )
    child = _Child(name, decoder, what, max_bytes, speed, given)
    ended = weakref.finalize(child, _end, child.process)
    try:
        members = child.members()
    except Refused as refused:
        ended()
        raise refuse(DataError, refused.problem, file=name, column=refused.column, fix=refused.fix) from None
    except DataError:
        ended()
        raise

    def fetch(wanted: list[Wanted]) -> list[NDArray[np.float64]]:
        try:
            return child.values(wanted)
        except DataError:
            ended()
            raise

    try:
        return admit(name, members, fetch, max_bytes)
    except DataError:
        ended()
        raise
