"""The commands that prepare a report of a fault: doctor, bundle."""

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
    from ..support.doctor import examine

    found = examine()
    failed = terminal.deliver(lambda: found, terminal.as_json(json_file, found.to_json))
    return failed or (0 if found.is_sound else terminal.INTERNAL)


def _rows(_context: click.Context, _parameter: click.Parameter, text: str | None) -> slice:
    from ..support.bundling import parse_rows

    return slice(None) if text is None else parse_rows(text)


@click.command(
    cls=Command,
    short_help="Pack a recording for a report, without names.",
    examples=(
        "pmsm-rs bundle run.csv --machine machine.toml -o bug.zip",
        "pmsm-rs bundle run.csv --machine machine.toml --answer answer.json --rows 20000:60000 -o bug.zip",
    ),
    exits=codes(without=(130,)),
)
@click.argument("recording", type=options.FILE)
@options.MACHINE
@click.option(
    "-o", "--output", type=options.OUTPUT, required=True, metavar="BUG.zip", help="Where the archive goes."
)
@click.option(
    "--validate", "validation", type=options.FILE, metavar="FILE", help="The validation run, packed as well."
)
@click.option(
    "--answer", type=options.FILE, metavar="A.json", help="What --json of diagnose or identify wrote."
)
@click.option(
    "--rows",
    metavar="N|FIRST:END",
    callback=_rows,
    help="Only the first N rows, or those from FIRST, counting from 0, to before END.",
)
@options.QUIET
def bundle(
    recording: str, machine_file: str, output: str, validation: str | None, answer: str | None, rows: slice
) -> int:
    """Pack RECORDING and its machine file into a small archive for a bug report or a question.

    Names are removed: columns have their canonical names and SI units, times begin at zero. Of the machine
    file remain the parameters, the ratings and the load. The archive gives the same answer as the original,
    if --rows cuts nothing off.
    """
    from ..atomic import apart
    from ..support.bundling import bundle as run

    apart([output], [recording, machine_file, validation, answer])
    terminal.show(run(recording, machine_file, output, validation=validation, answer=answer, rows=rows))
    return 0
