"""All commands as one group."""

from __future__ import annotations

import click

from .diagnosing import demo, diagnose, fleet
from .identifying import identify, track
from .inspecting import inspect
from .simulating import effects, reproduce, simulate


def _version(context: click.Context, _parameter: click.Parameter, wanted: bool) -> None:
    if wanted and not context.resilient_parsing:
        from .._core import __version__

        click.echo(f"pmsm-rs {__version__}")
        context.exit()


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 110})
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


for _command in (demo, inspect, simulate, identify, track, diagnose, fleet, reproduce, effects):
    cli.add_command(_command)
