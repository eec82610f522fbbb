"""The commands that write from a finished answer: export, report."""

from __future__ import annotations

import click

from . import options, terminal
from .help import Command, codes

# Those of `pmsm_rs.export.KINDS`, which a test compares; the help needs no more of the package.
_KINDS = ("machine", "python", "rust", "fmu", "fmu3", "modelica", "motulator", "gem", "mujoco", "c-header")


@click.command(
    cls=Command,
    short_help="Write the model of an answer for another tool.",
    examples=(
        "pmsm-rs export answer.json --to fmu -o motor.fmu",
        "pmsm-rs export answer.json --to c-header -o motor.h",
    ),
)
@click.argument("answer", type=options.FILE, metavar="ANSWER.json")
@click.option("--to", "kind", type=click.Choice(_KINDS), required=True, help="For which tool.")
@click.option("-o", "--output", type=options.OUTPUT, required=True, metavar="FILE", help="Where it goes.")
@click.option(
    "--temperature",
    type=click.FloatRange(-273.0, 1000.0),
    metavar="DEGC",
    help="Temperature of winding and magnets, where the model depends on a measured one.",
)
def export(answer: str, kind: str, output: str, temperature: float | None) -> int:
    """Write the model of ANSWER.json for another tool.

    \b
    - machine: corrected machine file.
    - python: Python module that needs numpy alone.
    - rust: Rust program on the crate pmsm-core.
    - fmu: functional mock-up unit for co-simulation, FMI 2.0.
    - fmu3: functional mock-up unit for co-simulation, FMI 3.0.
    - modelica: Modelica model.
    - motulator: Python module on motulator.
    - gem: parameters for gym-electric-motor.
    - mujoco: MuJoCo joint and actuator.
    - c-header: compensation for a drive, C header in single precision.

    Make ANSWER.json with `pmsm-rs diagnose ... --json ANSWER.json`. What the tool cannot express is
    left out; the command prints it, and the file says so.
    """
    from ..atomic import apart
    from ..errors import unchanged
    from ..export import export as write
    from ..model import Model

    apart([output], [answer])
    given = {} if temperature is None else {"temperature": temperature}
    with unchanged(answer):
        left_out = write(Model.read(answer), kind, output, **given)
    terminal.show("\n".join([f"{output}: {kind}", *left_out]))
    return 0


@click.command(
    cls=Command,
    short_help="Write the report of an answer as one HTML page.",
    examples=(
        "pmsm-rs report answer.json -o report.html",
        "pmsm-rs report answer.json --trajectories curves.parquet -o report.html",
    ),
    exits=codes(c3="trajectories refused", without=(130,)),
)
@click.argument("answer", type=options.FILE, metavar="ANSWER.json")
@click.option(
    "-o", "--output", type=options.OUTPUT, required=True, metavar="OUT.html", help="Where the report goes."
)
@click.option(
    "--trajectories",
    type=options.FILE,
    metavar="T.parquet",
    help="File that `diagnose --trajectories` wrote: adds the pictures over time.",
)
@click.option("--title", metavar="TEXT", help="Heading of the page; by default the name of the answer.")
@options.QUIET
def report(answer: str, output: str, trajectories: str | None, title: str | None) -> int:
    """Write the report of ANSWER.json as one HTML page, without computing anything.

    Make ANSWER.json with `pmsm-rs diagnose ... --json ANSWER.json`. With `--trajectories T.parquet` the same
    command writes what the pictures over time need. `diagnose --report` writes the whole report at once.
    """
    from pathlib import Path

    from ..answers import read_answer
    from ..atomic import apart
    from ..errors import unchanged

    apart([output], [answer, trajectories])
    with unchanged(answer):
        found = read_answer(answer, trajectories)
        found.report(output, title=title or Path(answer).name)
    terminal.show(f"Report: {output}")
    return 0
