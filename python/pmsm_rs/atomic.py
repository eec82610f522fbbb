"""Files that appear whole or not at all."""

from __future__ import annotations

import errno
import os
import secrets
import stat
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path

from ._core import UsageError
from .errors import refuse

# Bytes of a name that the name of its draft keeps; the system allows 255 in all.
_LONGEST = 200


def expect(path: str | os.PathLike[str]) -> None:
    """Raises UsageError where `path` cannot be written, before anything is computed for it."""
    mode = _mode(path)
    if mode is not None and stat.S_ISDIR(mode):
        raise _no_place(path, os.strerror(errno.EISDIR))
    if mode is not None and not stat.S_ISREG(mode):
        return
    folder = Path(os.path.realpath(path)).parent
    if not folder.is_dir():
        raise _no_place(path, os.strerror(errno.ENOENT))
    if not os.access(folder, os.W_OK):
        raise _no_place(path, os.strerror(errno.EACCES))


def apart(outputs: Iterable[str | None], inputs: Iterable[str | None]) -> None:
    """Raises UsageError where an output is one of the inputs or another output."""
    taken = {os.path.realpath(path) for path in inputs if path is not None}
    for path in outputs:
        if path is None:
            continue
        if os.path.realpath(path) in taken:
            raise refuse(UsageError, "it would be written over", file=str(path), fix="name another file")
        # A device or a pipe takes what it is given, one after the other.
        if (mode := _mode(path)) is None or stat.S_ISREG(mode):
            taken.add(os.path.realpath(path))


def write(path: str | os.PathLike[str], fill: Callable[[Path], None]) -> None:
    """Lets `fill` write a temporary neighbour of `path`, then renames it into place.

    A crash or an error leaves `path` as it was. What is no file, such as a pipe or a device, is written to,
    and so is what a link leads to. Raises UsageError where the folder does not exist or refuses the file.
    """
    mode = _mode(path)
    through = mode is not None and not stat.S_ISREG(mode) and not stat.S_ISDIR(mode)
    target = Path(path) if through else Path(os.path.realpath(path))
    folder = Path(tempfile.gettempdir()) if through else target.parent
    # The system gives it the rights that any new file has; its name is no other's.
    draft = folder / f".{os.fsencode(target.name)[:_LONGEST].decode(errors='replace')}.{secrets.token_hex(8)}"
    try:
        os.close(os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600 if through else 0o666))
    except OSError as error:
        raise _no_place(path, error.strerror) from error
    try:
        fill(draft)
        if through:
            with target.open("wb") as pipe:
                pipe.write(draft.read_bytes())
            return
        with draft.open("rb+") as done:
            os.fsync(done.fileno())
        draft.replace(target)
    except OSError as error:
        raise refuse(
            UsageError,
            f"cannot be written ({error.strerror})",
            file=str(path),
            fix="name a file that may be written to, on a disk with room",
        ) from error
    finally:
        draft.unlink(missing_ok=True)


def write_text(path: str | os.PathLike[str], text: str) -> None:
    """Writes `text` as UTF-8, whole or not at all."""

    def fill(draft: Path) -> None:
        # Half a character, as a name may hold it, is written as JSON and TOML escape it.
        draft.write_bytes(text.encode(errors="backslashreplace"))

    write(path, fill)


def _mode(path: str | os.PathLike[str]) -> int | None:
    """What stands at `path`, behind links; None where nothing does."""
    try:
        return os.stat(path).st_mode
    except OSError:
        return None


def _no_place(path: str | os.PathLike[str], why: str | None) -> UsageError:
    return refuse(
        UsageError,
        f"cannot write there ({why})",
        file=str(path),
        fix="name a folder that exists and may be written to",
    )
