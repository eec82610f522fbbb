"""The commands that prepare a report of a fault: doctor."""

from __future__ import annotations

import click

from . import options, terminal
from .help import Command, codes


@click.command(
    cls=Command,
    short_help="Show versions, formats and what is wrong with them.",
    examples=("pmsm-rs doctor", "pmsm-rs doctor --json - > doctor.json"),
    exits=codes(c0="the installation is sound", c1="something is wrong with it", without=(3, 130)),
)
@options.JSON
@options.QUIET
def doctor(json_file: str | None) -> int:
    """Show what this installation is made of, and what is wrong with it.

    Versions, the instruction set and the threads of the core, and the formats that can be read, with what to
    install for the others. Paste it into a bug report; it names no user, host or folder.
    """
    from ..doctor import examine

    found = examine()
    terminal.finish(json_file, found.to_json)
    terminal.show(found)
    return 0 if found.is_sound else terminal.INTERNAL
