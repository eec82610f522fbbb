"""What a command says: its answer, progress, a sentence of failure, exit codes."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from typing import Final, NoReturn, TextIO

import click

from .progress import Bar, Stages, wipe

INTERNAL, USAGE, REFUSED, NOT_SETTLED, INTERRUPTED = 1, 2, 3, 4, 130

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
    return Bar(sys.stderr, stages)


def clear() -> None:
    """Wipes the line of progress."""
    if sys.stderr.isatty():
        wipe(sys.stderr)


def finish(json_file: str | None, text: Callable[[], str]) -> None:
    """Wipes the line of progress and writes the answer where a file for it was named."""
    clear()
    if json_file == STANDARD_OUTPUT:
        # UTF-8, as in a file, whatever the encoding of the terminal.
        click.echo(text().rstrip("\n").encode())
    elif json_file:
        from ..atomic import write_text

        write_text(json_file, text())


def show(answer: object) -> None:
    """Prints an answer as text: nothing where the command is to be quiet or its JSON has standard output."""
    if is_silent():
        return
    colour = is_coloured(sys.stdout)
    text = str(answer)
    click.echo(painted(text) if colour else text, color=colour)


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
    click.echo(f"{name} {printable(message)}", err=True, color=colour)


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
