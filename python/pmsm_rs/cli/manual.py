"""Manual pages: the help of the commands in the language of man(7)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import click

from .._core import __version__
from .help import Command, Group

_SITE = "https://github.com/pmsm-rs/pmsm-rs"


def page(group: click.Group, name: str | None = None) -> str:
    """The manual page of the program `group`, or of its command `name`."""
    root = click.Context(group, info_name="pmsm-rs", **group.context_settings)
    return "\n".join(_program(group, root) if name is None else _command(group.commands[name], name, root))


def _program(group: click.Group, root: click.Context) -> Iterator[str]:
    yield _title("pmsm-rs")
    yield from _head("pmsm-rs", group, root)
    yield ".SH COMMANDS"
    for name in group.list_commands(root):
        command = group.commands[name]
        yield from (".TP", rf"\fB{_text(name)}\fR", _text(command.get_short_help_str(200)))
    yield from _options(group, root)
    yield from _end(group)
    yield ".SH SEE ALSO"
    names = [rf"\fB{_text(f'pmsm-rs {name} --help')}\fR" for name in group.list_commands(root)]
    yield ",\n".join([*names, _text(_SITE)])


def _command(command: click.Command, name: str, root: click.Context) -> Iterator[str]:
    yield _title(f"pmsm-rs-{name}")
    context = click.Context(command, info_name=name, parent=root)
    yield from _head(f"pmsm-rs {name}", command, context)
    yield from _options(command, context)
    yield from _end(command)
    yield ".SH SEE ALSO"
    yield rf"\fBpmsm\-rs\fR(1), {_text(_SITE)}"


def _title(name: str) -> str:
    return f'.TH "{_text(name.upper())}" "1" "" "pmsm\\-rs {_text(__version__)}" "pmsm\\-rs"'


def _head(name: str, command: click.Command, context: click.Context) -> Iterator[str]:
    paragraphs = (command.help or "").split("\n\n")
    yield ".SH NAME"
    yield rf"{_text(name.replace(' ', '-'))} \- {_text(command.get_short_help_str(200).rstrip('.'))}"
    yield ".SH SYNOPSIS"
    yield rf"\fB{_text(name)}\fR {_text(' '.join(command.collect_usage_pieces(context)))}"
    yield ".SH DESCRIPTION"
    for paragraph in paragraphs:
        yield from (".PP", _text(" ".join(paragraph.split())))


def _options(command: click.Command, context: click.Context) -> Iterator[str]:
    yield ".SH OPTIONS"
    for parameter in command.get_params(context):
        record = parameter.get_help_record(context)
        if record is not None and isinstance(parameter, click.Option):
            yield from (".TP", rf"\fB{_text(record[0])}\fR", _text(record[1]))


def _end(command: click.Command) -> Iterator[str]:
    examples: Sequence[str] = command.examples if isinstance(command, Command | Group) else ()
    exits: Mapping[int, str] = command.exits if isinstance(command, Command | Group) else {}
    if examples:
        yield from (".SH EXAMPLES", ".nf", *map(_text, examples), ".fi")
    if exits:
        yield ".SH EXIT STATUS"
        for code, words in exits.items():
            yield from (".TP", rf"\fB{code}\fR", _text(words))
    yield ".SH ENVIRONMENT"
    yield from (".TP", r"\fBNO_COLOR\fR", "Where it is set, nothing is coloured.")
    yield from (".TP", r"\fBFORCE_COLOR\fR", "Where it is set, output to files and pipes is coloured, too.")


def _text(words: str) -> str:
    """`words` as man(7) takes them: nothing in them is a request or an escape."""
    out = words.replace("\\", r"\e").replace("-", r"\-").replace("'", r"\(aq").replace("`", r"\(ga")
    return f"\\&{out}" if out.startswith((".", r"\(aq")) else out
