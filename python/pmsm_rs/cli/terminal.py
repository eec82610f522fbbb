"""What a command says: progress, a sentence of failure, exit codes."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import NoReturn

import click

INTERNAL, USAGE, REFUSED, NOT_SETTLED, INTERRUPTED = 1, 2, 3, 4, 130


def progress() -> Callable[[str, float], None] | None:
    """Shows how far a computation is; None where standard error is no terminal."""
    if not sys.stderr.isatty():
        return None

    def show(stage: str, fraction: float) -> None:
        # Erases to the end of the line, since stages differ in length.
        sys.stderr.write(f"\r{100 * fraction:3.0f} %  {stage}\x1b[K")
        sys.stderr.flush()

    return show


def clear() -> None:
    """Wipes the line of progress."""
    if sys.stderr.isatty():
        sys.stderr.write("\r\x1b[K")
        sys.stderr.flush()


def finish(json_file: str | None, text: Callable[[], str]) -> None:
    """Wipes the line of progress and writes the answer where a file for it was named."""
    clear()
    if json_file:
        from ..atomic import write_text

        write_text(json_file, text())


def say(message: str) -> None:
    """One sentence on standard error, without what could steer the terminal."""
    from ..errors import printable

    clear()
    click.echo(f"pmsm-rs: {printable(message)}", err=True)


def fail(code: int, message: str) -> NoReturn:
    """Ends the program with one sentence on standard error."""
    say(message)
    sys.exit(code)


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
