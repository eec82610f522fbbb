"""The command that designs the next recording: design."""

from __future__ import annotations

import click

from . import options, progress, terminal
from .help import Command, codes


@click.command(
    cls=Command,
    short_help="Design the next recording: a manoeuvre that tells rivals apart.",
    examples=(
        "pmsm-rs design answer.json --limits limits.toml -o trajectory.csv",
        "pmsm-rs design answer.json --limits limits.toml -o next.csv --recording run.csv --machine m.toml",
    ),
    exits=codes(c4="no manoeuvre keeps the limits"),
)
@click.argument("answer", type=options.FILE, metavar="ANSWER.json")
@click.option(
    "--limits",
    "limits_file",
    type=options.FILE,
    required=True,
    metavar="LIMITS.toml",
    help="Limits of the bench: current, speed and time; also acceleration, position, voltage.",
)
@click.option(
    "-o",
    "--output",
    type=options.OUTPUT,
    required=True,
    metavar="TRAJECTORY.csv",
    help="Where the references go (.csv or .parquet); what is expected goes to a .json beside it.",
)
@click.option(
    "--recording",
    "recordings",
    type=options.FILE,
    multiple=True,
    metavar="RUN",
    help="The recording of the answer: it constrains the parameters of the rivals. May be repeated.",
)
@click.option(
    "--machine", "machine_file", type=options.FILE, metavar="M.toml", help="Machine file of the recording."
)
@click.option(
    "--tries",
    type=click.IntRange(2, 10_000),
    default=64,
    show_default=True,
    metavar="N",
    help="Manoeuvres that are compared.",
)
@click.option(
    "--seed",
    type=click.IntRange(0, 2**53),
    default=1,
    show_default=True,
    metavar="N",
    help="Seed of the search.",
)
@options.THREADS
@options.QUIET
def design(
    answer: str,
    limits_file: str,
    output: str,
    recordings: tuple[str, ...],
    machine_file: str | None,
    tries: int,
    seed: int,
    threads: int | None,
) -> int:
    """Design the next recording from ANSWER.json: it writes files and moves no motor.

    The manoeuvre separates the rivals of the answer best: effects that the recording cannot tell apart, names
    whose probabilities overlap, formulas of an unknown torque. Without rivals it is chosen for the least
    certain parameters. Every rival keeps the limits in simulation.

    LIMITS.toml has a table [limits] with current (A, peak), speed (rad/s, mechanical; one number, or lowest
    and highest) and time (s). It may have acceleration (rad/s^2), position (rad from the start) and voltage
    (V, DC link), too.

    Make ANSWER.json with `pmsm-rs diagnose ... --json ANSWER.json`.
    """
    from ..atomic import apart
    from ..experiments.design import design as run
    from ..experiments.outcome import beside_of

    apart([output, str(beside_of(output))], [answer, limits_file, machine_file, *recordings])
    made = run(
        answer,
        limits_file,
        recording=recordings,
        machine=machine_file,
        tries=tries,
        seed=seed,
        threads=threads,
        progress=terminal.progress(progress.DESIGN),
    )
    terminal.clear()
    written = made.write(output)
    terminal.show(f"{made}\n\n{' and '.join(map(str, written))}")
    return 0
