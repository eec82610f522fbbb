"""What a command says: progress, a sentence of failure, exit codes."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from contextlib import suppress

import click

from . import process
from .process import INTERRUPTED as INTERRUPTED

INTERNAL, USAGE, REFUSED, NOT_SETTLED = 1, 2, 3, 4


def progress() -> Callable[[str, float], None] | None:
    """Shows how far a computation is; None where standard error is no terminal."""
    if not sys.stderr.isatty():
        return None

    def show(stage: str, fraction: float) -> None:
        # Erases to the end of the line, since stages differ in length.
        with suppress(OSError):
            sys.stderr.write(f"\r{100 * fraction:3.0f} %  {stage}\x1b[K")
            sys.stderr.flush()

    return show


def clear() -> None:
    """Wipes the line of progress."""
    if sys.stderr.isatty():
        with suppress(OSError):
            sys.stderr.write("\r\x1b[K")
            sys.stderr.flush()


def deliver(text: Callable[[], object], *files: Callable[[], object] | None) -> int:
    """Prints the answer, then writes each of `files`, whatever becomes of the others; 0, or the exit code of
    the first that could not be written.

    Each failure is said. On Ctrl-C meanwhile what is complete stays.
    """
    clear()
    codes = [_try(lambda: print_out(text()))]
    try:
        codes += [_try(write) for write in files if write is not None]
    except KeyboardInterrupt:
        say("interrupted before all files were written; run it again")
        return INTERRUPTED
    return next((code for code in codes if code), 0)


def _try(action: Callable[[], object]) -> int:
    try:
        action()
    except Exception as error:
        return said(error)
    return 0


def as_json(json_file: str | None, text: Callable[[], str]) -> Callable[[], object] | None:
    """Writes the answer as JSON, where a file for it was named."""
    if not json_file:
        return None

    def write() -> None:
        from ..atomic import write_text

        write_text(json_file, text())

    return write


def print_out(text: object) -> None:
    """Prints a result and flushes it. Raises OSError where standard output takes it no more."""
    click.echo(text)
    flush()


def flush() -> None:
    """Writes what standard output still holds. Raises OSError where it is refused."""
    try:
        sys.stdout.flush()
    except ValueError:
        raise OSError(9, "it is closed") from None


def flushed(code: int) -> int:
    """`code`, or that of an error where standard output refuses what it still holds."""
    return _try(flush) or code


def say(message: str) -> None:
    """One sentence on standard error, without what could steer the terminal."""
    from ..errors import printable

    process.write_error(printable(message))


def said(error: Exception) -> int:
    """The exit code that goes with an error, which is said."""
    if isinstance(error, BrokenPipeError):
        # The reader of our output has gone; there is nobody left to tell.
        process.discard(sys.stdout)
        return 0
    if isinstance(error, OSError):
        place = os.fsdecode(error.filename) if isinstance(error.filename, str | bytes) else "standard output"
        if error.filename is None:
            process.discard(sys.stdout)
        say(f"{place}: cannot be written or read ({error.strerror}); make room or name another place")
        return USAGE
    told = code(error)
    if told != INTERNAL:
        say(str(error))
        return told
    what = str(error) if _ours(error) else f"{type(error).__name__}: {error}; please report it"
    say(f"internal fault: {' '.join(what.split())}")
    return told


def _ours(error: Exception) -> bool:
    from .._core import PmsmError

    return isinstance(error, PmsmError)


def code(error: Exception) -> int:
    """The exit code that goes with an error."""
    from .. import _core

    codes = (
        (_core.UsageError, USAGE),
        (_core.NotIdentifiableError, NOT_SETTLED),
        (_core.DataError, REFUSED),
        (_core.MachineError, REFUSED),
    )
    return next((code for kind, code in codes if isinstance(error, kind)), INTERNAL)
