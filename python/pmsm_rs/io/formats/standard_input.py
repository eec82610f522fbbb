"""A recording that comes on standard input, kept in a file of its own while the program runs: readers go back
and forth.
"""

from __future__ import annotations

import stat
import sys
import tempfile
from functools import lru_cache
from pathlib import Path
from typing import Final

from ..._core import DataError, UsageError
from ...errors import refuse

NAMES: Final = ("/dev/stdin", "/dev/fd/0", "/proc/self/fd/0")
_CHUNK: Final = 1 << 20


def comes_there(file: Path) -> bool:
    """Whether `file` is standard input, and that is a pipe or a terminal: a file is read where it lies."""
    if str(file) not in NAMES:
        return False
    try:
        mode = file.stat().st_mode
    except OSError:
        return True
    return stat.S_ISFIFO(mode) or stat.S_ISSOCK(mode) or (stat.S_ISCHR(mode) and sys.stdin.isatty())


@lru_cache(maxsize=1)
def _folder() -> tempfile.TemporaryDirectory[str]:
    """Removed as the program ends."""
    return tempfile.TemporaryDirectory(prefix="pmsm-rs-")


@lru_cache(maxsize=1)
def kept(max_bytes: int) -> Path:
    """The file in which standard input is kept. Raises UsageError where that is a terminal or closed, and
    DataError on more than `max_bytes` bytes.
    """
    if sys.stdin is None or sys.stdin.isatty():
        raise refuse(
            UsageError,
            "standard input is a terminal or closed",
            file=NAMES[0],
            fix="send the recording into it, as in: pmsm-rs inspect - < run.csv",
        )
    path, size = Path(_folder().name) / "standard_input", 0
    with path.open("wb") as out:
        while chunk := sys.stdin.buffer.read(_CHUNK):
            size += len(chunk)
            if size > max_bytes:
                raise refuse(
                    DataError,
                    f"more than the {max_bytes} bytes allowed come",
                    file=NAMES[0],
                    fix="cut the recording, or raise max_bytes",
                )
            out.write(chunk)
    return path
