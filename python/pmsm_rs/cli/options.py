"""Options that several commands share."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any, TypeVar

import click

from . import terminal

_Command = TypeVar("_Command", bound=Callable[..., Any])


class _Output(click.Path):
    """A file that is written: whether it can be is said before anything is computed."""

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> str | bytes | os.PathLike[str]:
        from ..atomic import expect

        path = super().convert(value, param, ctx)
        if path == terminal.STANDARD_OUTPUT:
            if not self.allow_dash:
                self.fail("only --json can go to standard output; name a file.", param, ctx)
            return path
        expect(str(path))
        return path


class _Recording(click.Path):
    """A file that is read; - is standard input."""

    def convert(
        self, value: Any, param: click.Parameter | None, ctx: click.Context | None
    ) -> str | bytes | os.PathLike[str]:
        path = super().convert(value, param, ctx)
        return "/dev/stdin" if path == "-" else path


FILE = click.Path(dir_okay=False)
RECORDING = _Recording(dir_okay=False, allow_dash=True)
OUTPUT = _Output(dir_okay=False)
MACHINE = click.option(
    "--machine",
    "machine_file",
    type=FILE,
    required=True,
    metavar="M.toml",
    help="Machine file: nameplate, load, column names.",
)
ALLOW_OUTSIDE = click.option(
    "--allow-outside",
    is_flag=True,
    help="Let [columns] take columns from files outside of the recording's folder.",
)


def _json(context: click.Context, _parameter: click.Parameter, file: str | None) -> str | None:
    if file == terminal.STANDARD_OUTPUT:
        terminal.take_output(context)
    return file


def _quiet(context: click.Context, _parameter: click.Parameter, wanted: bool) -> None:
    if wanted:
        terminal.keep_quiet(context)


JSON = click.option(
    "--json",
    "json_file",
    type=_Output(dir_okay=False, allow_dash=True),
    metavar="OUT",
    callback=_json,
    help="Write the whole answer as JSON; with - to standard output, in place of the text.",
)
QUIET = click.option(
    "-q",
    "--quiet",
    is_flag=True,
    expose_value=False,
    callback=_quiet,
    help="Print no text and no progress. Files are still written and errors printed.",
)
THREADS = click.option(
    "--threads",
    type=click.IntRange(1, 1024),
    metavar="N",
    help="Processors to use; the answer does not depend on it.",
)
SEED = click.option(
    "--seed",
    type=click.IntRange(0, 2**63 - 1),
    default=1,
    show_default=True,
    metavar="N",
    help="Seed of the swarm's random numbers; a diagnosis only records it.",
)


def computing(command: _Command) -> _Command:
    """The options of a command that computes an answer: --json, --quiet, --threads and --seed."""
    return JSON(QUIET(THREADS(SEED(command))))


def fit(help: str, default: str | None = None) -> Callable[[_Command], _Command]:
    """--fit: a list of names, None where the option is left out and there is no default."""
    return click.option(
        "--fit",
        default=default,
        show_default=default is not None,
        metavar="r_s,tau_load,...",
        callback=_names,
        help=help,
    )


def method(help: str, *choices: str, default: str) -> Callable[[_Command], _Command]:
    """--method: one of the choices."""
    return click.option("--method", type=click.Choice(choices), default=default, show_default=True, help=help)


def _names(_context: click.Context, _parameter: click.Parameter, text: str | None) -> list[str] | None:
    return None if text is None else [name.strip() for name in text.split(",") if name.strip()]
