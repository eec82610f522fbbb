"""What a command says: its answer, progress, a sentence of failure, exit codes."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from contextlib import suppress
from typing import Final, TextIO

import click

from . import process
from .process import INTERRUPTED as INTERRUPTED
from .progress import Bar, Stages, wipe

INTERNAL, USAGE, REFUSED, NOT_SETTLED = 1, 2, 3, 4

STANDARD_OUTPUT: Final = "-"
"""The name by which --json means standard output."""

_QUIET: Final = "pmsm_rs.quiet"
_TAKEN: Final = "pmsm_rs.taken"


def keep_quiet(context: click.Context) -> None:
    """From now on the command prints no text and no progress."""
    context.meta[_QUIET] = True


def take_output(context: click.Context) -> None:
    """From now on standard output is that of the JSON answer alone."""
    context.meta[_TAKEN] = True


def is_silent() -> bool:
    """Whether the answer is not to be printed as text."""
    return _is(_QUIET) or _is(_TAKEN)


def _is(state: str) -> bool:
    context = click.get_current_context(silent=True)
    return context is not None and bool(context.meta.get(state))


def is_coloured(stream: TextIO) -> bool:
    """Whether `stream` gets colours: terminals do, unless NO_COLOR is set; FORCE_COLOR gives them to any."""
    if os.environ.get("NO_COLOR"):
        return False
    if os.environ.get("FORCE_COLOR", "0") != "0":
        return True
    return os.environ.get("TERM") != "dumb" and stream.isatty()


def progress(stages: Stages | None = None) -> Callable[[str, float], None] | None:
    """Shows how far a computation is, by its `stages` where they are known; None where standard error is no
    terminal or the command is to be quiet.
    """
    if not sys.stderr.isatty() or _is(_QUIET):
        return None
    bar = Bar(sys.stderr, stages)

    def show_stage(stage: str, fraction: float) -> None:
        with suppress(OSError):
            bar(stage, fraction)

    return show_stage


def clear() -> None:
    """Wipes the line of progress."""
    if sys.stderr.isatty():
        with suppress(OSError):
            wipe(sys.stderr)


def deliver(text: Callable[[], object], *files: Callable[[], object] | None) -> int:
    """Prints the answer, then writes each of `files`, whatever becomes of the others; 0, or the exit code of
    the first that could not be written.

    Each failure is said. On Ctrl-C meanwhile what is complete stays.
    """
    clear()
    codes = [_try(lambda: show(text()))]
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
    """Writes the answer as JSON, where a file for it was named or standard output is its own."""
    if not json_file:
        return None

    def write() -> None:
        if json_file == STANDARD_OUTPUT:
            # UTF-8, as in a file, whatever the encoding of the terminal.
            print_out(text().rstrip("\n").encode())
            return
        from ..atomic import write_text

        write_text(json_file, text())

    return write


def command_line() -> str | None:
    """The command as it was typed, None outside of one."""
    import shlex

    context = click.get_current_context(silent=True)
    if context is None or not isinstance(context.obj, tuple):
        return None
    return shlex.join(["pmsm-rs", *context.obj])


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


def show(answer: object) -> None:
    """Prints an answer as text: nothing where the command is to be quiet or its JSON has standard output."""
    if is_silent():
        return
    colour = is_coloured(sys.stdout)
    text = str(answer)
    click.echo(painted(text) if colour else text, color=colour)
    flush()


def painted(text: str) -> str:
    """`text` with its first sentence, its headings and its warnings set off by colours."""
    lines = text.split("\n")
    out: list[str] = []
    head = True
    for before, line in zip(["", *lines], lines, strict=False):
        if not line:
            head = False
            out.append(line)
        elif line.startswith("  ! "):
            out.append(f"  {click.style('!', fg='yellow', bold=True)}{line[3:]}")
            head = False
        elif line[0] == " ":
            out.append(line)
            head = False
        elif head:
            out.append(click.style(line, bold=True))
        else:
            out.append(line if before else click.style(line, fg="cyan", bold=True))
    return "\n".join(out)


def say(message: str) -> None:
    """One sentence on standard error, without what could steer the terminal."""
    from ..errors import printable

    clear()
    colour = is_coloured(sys.stderr)
    name = click.style("pmsm-rs:", fg="red", bold=True) if colour else "pmsm-rs:"
    process.write_error(printable(message), name)


def said(error: BaseException) -> int:
    """The exit code that goes with an error, which is said."""
    if isinstance(error, BrokenPipeError):
        # The reader of our output has gone; there is nobody left to tell.
        process.discard(sys.stdout)
        return 0
    if isinstance(error, OSError):
        place = os.fsdecode(error.filename) if isinstance(error.filename, str | bytes) else "standard output"
        if error.filename is None:
            process.discard(sys.stdout)
        say(f"{place}: cannot be written or read ({error.strerror}); make room or name another place [PR004]")
        return USAGE
    told = code(error)
    if told != INTERNAL:
        say(str(error))
        return told
    what = str(error) if _ours(error) else f"{type(error).__name__}: {error}; please report it [PR195]"
    say(f"internal fault: {' '.join(what.split())}")
    return told


def _ours(error: BaseException) -> bool:
    from .._core import PmsmError

    return isinstance(error, PmsmError)


def code(error: BaseException) -> int:
    """The exit code that goes with an error."""
    from .. import _core

    codes = (
        (_core.UsageError, USAGE),
        (_core.NotIdentifiableError, NOT_SETTLED),
        (_core.DataError, REFUSED),
        (_core.MachineError, REFUSED),
    )
    return next((code for kind, code in codes if isinstance(error, kind)), INTERNAL)
