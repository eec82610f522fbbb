"""All commands as one group."""

from __future__ import annotations

import click

from .completing import completion, man
from .designing import design
from .diagnosing import demo, diagnose, fleet
from .exporting import export, report
from .help import Group, codes
from .identifying import identify, track
from .inspecting import inspect
from .reporting import bundle, doctor
from .simulating import effects, explain, reproduce, simulate


def _version(context: click.Context, _parameter: click.Parameter, wanted: bool) -> None:
    if wanted and not context.resilient_parsing:
        from .._core import __version__

        click.echo(f"pmsm-rs {__version__}")
        context.exit()


@click.group(
    cls=Group,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110},
    sections={
        "Start here": ("demo", "inspect", "diagnose", "report"),
        "Parameters": ("identify", "track"),
        "Many recordings": ("fleet",),
        "The model": ("export", "design"),
        "Simulation": ("simulate", "reproduce"),
        "Questions and faults": ("explain", "doctor", "bundle"),
        "Reference": ("effects", "completion", "man"),
    },
    examples=(
        "pmsm-rs inspect run.csv --write machine.toml",
        "pmsm-rs diagnose run.csv --machine machine.toml --validate other.csv --report report.html",
    ),
    exits=codes(
        c0="done; of a diagnosis whatever the verdict, also `undetermined`",
        c4="parameters cannot be determined, or a search did not converge; the JSON answer says why",
    ),
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
    *(demo, inspect, diagnose, report, identify, track, fleet, export, design, simulate, reproduce),
    *(explain, doctor, bundle, effects, completion, man),
):
    cli.add_command(_command)
