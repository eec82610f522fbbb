"""Files that appear whole or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable
from pathlib import Path

from ._core import UsageError
from .errors import refuse


def write(path: str | os.PathLike[str], fill: Callable[[Path], None]) -> None:
    """Lets `fill` write a temporary neighbour of `path`, then renames it into place.

    A crash or an error leaves `path` as it was. Raises UsageError where the folder does not exist or refuses
    the file.
    """
    target = Path(path)
    try:
        handle, name = tempfile.mkstemp(prefix=f".{target.name}.", dir=target.parent)
    except OSError as error:
        raise refuse(
            UsageError,
            f"cannot write there ({error.strerror})",
            file=str(target),
            fix="name a folder that exists and may be written to",
        ) from error
    os.close(handle)
    draft = Path(name)
    try:
        fill(draft)
        # mkstemp makes files private; an answer should have the rights any new file has.
        mask = os.umask(0)
        os.umask(mask)
        draft.chmod(0o666 & ~mask)
        with draft.open("rb+") as done:
            os.fsync(done.fileno())
        draft.replace(target)
    except OSError as error:
        raise refuse(
            UsageError,
            f"cannot be written ({error.strerror})",
            file=str(target),
            fix="name a file that may be written to, on a disk with room",
        ) from error
    finally:
        draft.unlink(missing_ok=True)


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Writes `text` as UTF-8, whole or not at all."""

    def fill(draft: Path) -> None:
        draft.write_bytes(text.encode())

    write(path, fill)
