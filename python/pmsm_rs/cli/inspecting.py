"""The command that shows what a file is: inspect."""

from __future__ import annotations

import sys

import click

from . import options, terminal
from .help import Command, codes


@click.command(
    cls=Command,
    short_help="Show what a file holds, and write a machine file.",
    examples=(
        "pmsm-rs inspect run.csv",
        "pmsm-rs inspect run.csv --write machine.toml",
        "pmsm-rs inspect run.csv --machine machine.toml --json - | jq .tasks",
    ),
    exits=codes(
        c0="done, also for a file that cannot be diagnosed yet",
        c3="no table in the file, or machine file refused",
    ),
)
@click.argument("file", type=options.RECORDING, metavar="FILE")
@click.option(
    "--machine",
    "machine_file",
    type=options.FILE,
    metavar="M.toml",
    help="What is known already: nameplate, load, column names.",
)
@click.option(
    "--write",
    "written",
    type=options.OUTPUT,
    metavar="machine.toml",
    help="Write the machine file to start from.",
)
@click.option("--force", is_flag=True, help="Let --write replace a file.")
@options.ALLOW_OUTSIDE
@options.JSON
@options.QUIET
def inspect(
    file: str,
    machine_file: str | None,
    written: str | None,
    force: bool,
    allow_outside: bool,
    json_file: str | None,
) -> int:
    """Show what FILE holds: columns, sampling and questions. --write makes a machine file to start from.

    A file that cannot be diagnosed yet is shown as far as possible, with all that is missing or unclear.
    """
    from ..atomic import apart
    from ..inspection.inspect import expect_new
    from ..inspection.inspect import inspect as run
    from ..inspection.text import next_steps, plain, text

    apart([written, json_file], [file, machine_file])
    if written is not None:
        expect_new(written, force=force)
    found = run(file, machine_file, allow_outside=allow_outside)
    blocks = _shows_blocks()
    steps = next_steps(found, machine_file, written)
    told = text(found, blocks=blocks, machine_file=written is None)
    return terminal.deliver(
        lambda: f"{told}\n\n{steps if blocks else plain(steps)}",
        terminal.as_json(json_file, found.to_json),
        None if written is None else lambda: found.write_machine(written, force=force),
    )


def _shows_blocks() -> bool:
    """Whether standard output has signs beyond ASCII."""
    try:
        "▁█·…".encode(getattr(sys.stdout, "encoding", None) or "ascii")
    except (UnicodeEncodeError, LookupError):
        return False
    return True
