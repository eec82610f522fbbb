"""The commands that make recordings and show what there is: simulate, reproduce, effects."""

from __future__ import annotations

import click

from . import options, progress, terminal
from .help import Command, codes


@click.command(
    cls=Command,
    short_help="Make a recording of a drive with any of the effects.",
    examples=(
        "pmsm-rs simulate drive.toml -o run.parquet --machine-file machine.toml",
        "pmsm-rs simulate drive.toml -o run.csv --truth --seed 7",
    ),
)
@click.argument("config", type=options.FILE, metavar="CONFIG.toml")
@click.option(
    "-o",
    "--output",
    type=options.OUTPUT,
    required=True,
    metavar="RECORDING.parquet",
    help="Where the recording goes (.parquet or .csv).",
)
@click.option("--truth", is_flag=True, help="Write RECORDING.truth.json and .truth.parquet beside it.")
@click.option(
    "--machine-file",
    type=options.OUTPUT,
    metavar="M.toml",
    help="Write the machine file that goes with the recording.",
)
@click.option(
    "--seed", type=click.IntRange(0, 2**53), metavar="N", help="Seed of the noise, in place of the file's."
)
@options.QUIET
def simulate(config: str, output: str, truth: bool, machine_file: str | None, seed: int | None) -> int:
    """Make a recording: a closed-loop drive with any effects, as CONFIG.toml describes it."""
    from ..atomic import apart
    from ..simulation.drive import simulate as run

    apart([output, machine_file], [config])
    made = run(
        config, progress=terminal.progress(progress.SIMULATION), **({} if seed is None else {"seed": seed})
    )
    terminal.clear()
    made.write(output)
    if truth:
        made.write_truth(output)
    if machine_file:
        made.write_machine(machine_file)
    terminal.show(f"{output}: {len(made.recording)} samples, {made.recording.duration:.6g} s")
    return 0


@click.command(
    cls=Command,
    short_help="Reproduce the figures of Liu, Liu & Cartes (2008).",
    examples=("pmsm-rs reproduce all --out paper", "pmsm-rs reproduce fig5 fig6 --out paper"),
    exits=codes(without=(3,)),
)
@click.argument("figures", nargs=-1, metavar="[fig5|fig6|fig7|fig8|all]...")
@click.option(
    "--out", "folder", type=click.Path(file_okay=False), required=True, metavar="DIR", help="Where it goes."
)
@options.QUIET
def reproduce(figures: tuple[str, ...], folder: str) -> int:
    """Simulate and identify what Liu, Liu & Cartes (2008) show, and draw their figures again.

    Writes the figures as PNG and SVG, a table of the windows and a page with all results and choices.
    """
    from ..paper.reproduce import reproduce as run
    from ..paper.tables import lines

    outcome, files = run(figures or ("all",), folder, progress=terminal.progress())
    terminal.clear()
    written = ", ".join(str(file) for file in files)
    terminal.show(f"{lines(outcome)}\n\n{outcome.seconds:.1f} s; written: {written}")
    return 0


def _codes(_context: click.Context, _parameter: click.Parameter, begin: str) -> list[str]:
    from ..messages import entries

    return [code for code in entries() if code.startswith(begin.upper())]


@click.command(
    cls=Command,
    short_help="Say what an error or finding means and what to do.",
    examples=("pmsm-rs explain PR072", "pmsm-rs explain"),
    exits=codes(without=(3, 130)),
)
@click.argument("code", required=False, shell_complete=_codes)
def explain(code: str | None) -> int:
    """Say what the error or finding CODE means: why it appears and what to do. Without CODE, list all.

    The code stands behind the message, as in [PR072]. The entries are those of the manual.
    """
    from ..catalogue import messages

    terminal.show(messages(code))
    return 0


def _names(_context: click.Context, _parameter: click.Parameter, begin: str) -> list[str]:
    from ..results.registry import effects

    return [entry["id"] for entry in effects() if entry["id"].startswith(begin)]


@click.command(
    cls=Command,
    short_help="Show the catalogue of effects, or one of them.",
    examples=("pmsm-rs effects", "pmsm-rs effects dead_time", "pmsm-rs effects --machine machine.toml"),
    exits=codes(c3="machine file refused", without=(130,)),
)
@click.argument("name", required=False, shell_complete=_names)
@click.option(
    "--machine",
    "machine_file",
    type=options.FILE,
    metavar="M.toml",
    help="Also show the effects that this machine file gives as text.",
)
def effects(name: str | None, machine_file: str | None) -> int:
    """Show the catalogue of effects, or one of them with equation, parameters and look-alikes."""
    from ..catalogue import entry, overview
    from ..config.machine_file import read_machine

    own = () if machine_file is None else read_machine(machine_file).effects
    terminal.show(overview(own) if name is None else entry(name, own))
    return 0
