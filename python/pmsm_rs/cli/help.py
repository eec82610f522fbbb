"""Help of commands: what click prints, with examples and exit codes below."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

import click

_CODES: Final = {
    0: "done",
    1: "internal fault; please report it",
    2: "wrong usage",
    3: "recording or machine file refused",
    130: "interrupted",
}


def codes(*, without: Iterable[int] = (), **told: str) -> dict[int, str]:
    """Exit codes with their meanings: the common ones `without` some, and what is `told` of others by names
    such as c4.
    """
    own = {int(name[1:]): words for name, words in told.items()}
    return dict(sorted(({k: words for k, words in _CODES.items() if k not in {*without}} | own).items()))


class Command(click.Command):
    """A command whose help ends with examples, each a line, and with its exit codes."""

    def __init__(
        self, *given: Any, examples: Sequence[str] = (), exits: Mapping[int, str] | None = None, **named: Any
    ) -> None:
        super().__init__(*given, **named)
        self.examples, self.exits = tuple(examples), dict(codes() if exits is None else exits)

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Writes the examples and the exit codes."""
        write_end(formatter, self.examples, self.exits)


class Group(click.Group):
    """Commands listed by what they are for; its help ends as that of a `Command`.

    `sections` maps headings to names of commands; a command that none names stands under `other`.
    """

    def __init__(
        self,
        *given: Any,
        sections: Mapping[str, Sequence[str]],
        other: str = "Other commands",
        examples: Sequence[str] = (),
        exits: Mapping[int, str] | None = None,
        **named: Any,
    ) -> None:
        super().__init__(*given, **named)
        self.sections, self.other = sections, other
        self.examples, self.exits = tuple(examples), dict(codes() if exits is None else exits)

    def list_commands(self, ctx: click.Context) -> list[str]:
        """The names in the order in which they are shown."""
        placed = [name for names in self.sections.values() for name in names if name in self.commands]
        return [*placed, *(name for name in self.commands if name not in placed)]

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """The command that is asked for. Raises UsageError naming the nearest where there is none."""
        if args[0] not in self.commands and not args[0].startswith("-"):
            from ..errors import did_you_mean

            near = did_you_mean(args[0], self.commands)
            raise click.UsageError(f"there is no command '{args[0]}'; {near}", ctx)
        return super().resolve_command(ctx, args)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Writes one list for each section."""
        placed = {name for names in self.sections.values() for name in names}
        rest = {self.other: [name for name in self.commands if name not in placed]}
        wide = max(map(len, self.commands))
        for heading, names in {**self.sections, **rest}.items():
            rows = [
                (f"{name:<{wide}}", self.commands[name].get_short_help_str(formatter.width - wide - 6))
                for name in names
                if name in self.commands and not self.commands[name].hidden
            ]
            if rows:
                with formatter.section(heading):
                    formatter.write_dl(rows)

    def format_epilog(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Writes the examples and the exit codes."""
        write_end(formatter, self.examples, self.exits)


def write_end(formatter: click.HelpFormatter, examples: Sequence[str], exits: Mapping[int, str]) -> None:
    """Writes examples as they stand, and exit codes with their meanings."""
    if examples:
        with formatter.section("Examples"):
            for line in examples:
                formatter.write(f"{'':>{formatter.current_indent}}{line}\n")
    with formatter.section("Exit codes"):
        formatter.write_dl([(str(code), words) for code, words in exits.items()])
