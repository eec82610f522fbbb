"""The command line: results to standard output, errors in one plain sentence to standard error."""

from __future__ import annotations

import io
import os
import sys
from typing import NoReturn

import click

from . import terminal
from .completing import completion, man
from .diagnosing import demo, diagnose, fleet
from .exporting import export
from .help import Group, codes
from .identifying import identify, track
from .inspecting import inspect
from .reporting import bundle, doctor
from .simulating import effects, reproduce, simulate
from .terminal import INTERNAL, INTERRUPTED, USAGE


def _version(context: click.Context, _parameter: click.Parameter, wanted: bool) -> None:
    if wanted and not context.resilient_parsing:
        from .._core import __version__

        click.echo(f"pmsm-rs {__version__}")
        context.exit()


@click.group(
    cls=Group,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
    sections={
        "Start here": ("demo", "inspect", "diagnose"),
        "Parameters": ("identify", "track"),
        "Many recordings": ("fleet",),
        "The model": ("export",),
        "Simulation": ("simulate", "reproduce"),
        "Questions and faults": ("doctor", "bundle"),
        "Reference": ("effects", "completion", "man"),
    },
    examples=(
        "pmsm-rs inspect run.csv --write machine.toml",
        "pmsm-rs diagnose run.csv --machine machine.toml --validate other.csv --report report.html",
    ),
    exits=codes(c4="not identifiable, or not settled; the JSON answer says why"),
)
@click.option(
    "--version",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_version,
    help="Show the version and exit.",
)
def cli() -> None:
    """Finds out what a motor model leaves out, from recordings of the motor.

    Start with `pmsm-rs demo`; it needs no files.
    """


for _command in (
    *(demo, inspect, diagnose, identify, track, fleet, export, simulate, reproduce),
    *(doctor, bundle, effects, completion, man),
):
    cli.add_command(_command)


def _ours(error: Exception) -> bool:
    from .._core import PmsmError

    return isinstance(error, PmsmError)


def main(arguments: list[str] | None = None) -> NoReturn:
    """The `pmsm-rs` command.

    Exits with 0 done, 1 internal fault, 2 usage, 3 data refused, 4 not settled, 130 interrupted.
    """
    # A command ends soon: until then its allocator, which looks here when the core is loaded, keeps what was
    # freed; else the system would clear the same memory for every fit anew.
    os.environ.setdefault("MIMALLOC_PURGE_DELAY", "-1")
    for stream in (sys.stdout, sys.stderr):
        # A sign that the encoding of the terminal lacks is no reason to lose the answer.
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")
    try:
        code = cli.main(arguments, prog_name="pmsm-rs", standalone_mode=False)
        sys.stdout.flush()
    except click.exceptions.Exit as stop:
        sys.exit(stop.exit_code)
    except click.ClickException as error:
        if isinstance(error, click.exceptions.NoArgsIsHelpError):
            error.show()
            sys.exit(USAGE)
        message = error.format_message().rstrip(".")
        terminal.fail(USAGE, f"{message}{' See' if message.endswith('?') else '; see'} pmsm-rs --help")
    except (click.Abort, KeyboardInterrupt):
        terminal.fail(INTERRUPTED, "interrupted before there was a result; run it again")
    except BrokenPipeError:
        # The reader of our output has gone; there is nobody left to tell.
        sys.stderr.close()
        sys.exit(0)
    except Exception as error:
        code = terminal.code(error)
        if code != INTERNAL:
            terminal.fail(code, str(error))
        what = str(error) if _ours(error) else f"{type(error).__name__}: {error}; please report it"
        terminal.fail(INTERNAL, f"internal fault: {' '.join(what.split())}")
    sys.exit(code if isinstance(code, int) else 0)
