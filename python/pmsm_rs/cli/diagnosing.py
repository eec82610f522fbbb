"""The commands that find what a model leaves out: demo, diagnose, fleet."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import click

from . import options, terminal

if TYPE_CHECKING:
    from ..answers import Diagnosis

AHEAD: Final = 4
"""Files that are opened side by side at most: each may have a decoder of its own."""


@click.command()
@click.option(
    "--report",
    "report_file",
    type=options.OUTPUT,
    default="pmsm-rs-demo.html",
    show_default=True,
    metavar="OUT.html",
    help="Where the report goes.",
)
@options.computing
def demo(report_file: str, json_file: str | None, threads: int | None, seed: int) -> int:
    """Diagnose a recording that ships with the package, then open the seal on what was put into it."""
    from ..atomic import apart
    from ..config import read_machine
    from ..demo import compare, recording_files
    from ..loader import load
    from ..run import diagnose as run

    recording, validation, machine_file = recording_files()
    apart([json_file, report_file], [])
    machine = read_machine(machine_file)
    answer = run(
        load(recording, machine),
        machine.machine,
        load(validation, machine),
        seed=seed,
        threads=threads,
        progress=terminal.progress(),
    )
    terminal.finish(json_file, answer.to_json)
    answer.report(report_file, title="Demo recording")
    click.echo(answer)
    if not answer.interrupted:
        click.echo("\n" + compare(answer))
    click.echo(f"\nReport: {report_file}")
    return terminal.INTERRUPTED if answer.interrupted else 0


@click.command()
@click.argument("recordings", type=options.FILE, nargs=-1, required=True, metavar="RECORDING...")
@options.MACHINE
@click.option(
    "--validate",
    "validation",
    type=options.FILE,
    metavar="FILE",
    help="Another run of the same machine, to check the prediction.",
)
@options.JSON
@click.option(
    "--report",
    "report_file",
    type=options.OUTPUT,
    metavar="OUT.html",
    help="Write a report as one HTML page.",
)
@click.option(
    "--trajectories",
    type=options.OUTPUT,
    metavar="OUT.parquet",
    help="Write measured and modelled trajectories.",
)
@click.option(
    "--options",
    "constants",
    metavar="NAME=VALUE,...",
    help="Constants on which the verdict rests, such as named=0.95; the answer lists all of them.",
)
@options.THREADS
@options.SEED
def diagnose(
    recordings: tuple[str, ...],
    machine_file: str,
    validation: str | None,
    json_file: str | None,
    report_file: str | None,
    trajectories: str | None,
    constants: str | None,
    threads: int | None,
    seed: int,
) -> int:
    """Find out which physics the dq-model of RECORDING leaves out.

    Several recordings of one machine are fitted together.
    """
    from .. import _core
    from ..atomic import apart
    from ..errors import NothingToAsk
    from ..formats.ahead import Opening
    from ..recording import DEFAULT_MAX_BYTES

    apart([json_file, report_file, trajectories], [*recordings, machine_file, validation])
    files = [*recordings, *([] if validation is None else [validation])]
    ahead = [Opening(file, DEFAULT_MAX_BYTES) for file in files[:AHEAD]]
    # Meanwhile comes what takes long to import.
    from ..config import read_machine
    from ..loader import load
    from ..options import DiagnosisOptions
    from ..run import diagnose as run
    from ..run import refused, unanswered

    settings = None if constants is None else DiagnosisOptions.parse(constants)
    machine = read_machine(machine_file)
    try:
        runs = [load(file, machine) for file in [*ahead, *files[AHEAD:]]]
    except NothingToAsk as error:
        if len(files) > 1 and not (len(recordings) == 1 and error.of(recordings[0])):
            raise
        answer = unanswered(error, seed=seed)
        _write(answer, recordings, json_file, report_file, trajectories)
        return 0
    other = None if validation is None else runs.pop()
    try:
        answer = run(
            runs,
            machine,
            other,
            options=settings,
            seed=seed,
            threads=threads,
            progress=terminal.progress(),
        )
    except _core.NotIdentifiableError as error:
        terminal.finish(json_file, refused(error, runs, seed=seed).to_json)
        raise
    _write(answer, recordings, json_file, report_file, trajectories)
    return terminal.INTERRUPTED if answer.interrupted else 0


def _write(
    answer: Diagnosis,
    recordings: tuple[str, ...],
    json_file: str | None,
    report_file: str | None,
    trajectories: str | None,
) -> None:
    """Writes the files that were asked for, and prints the answer."""
    from pathlib import Path

    terminal.finish(json_file, answer.to_json)
    if trajectories and answer.shown is None:
        terminal.say(f"{trajectories} is not written: no model was simulated on this recording")
    elif trajectories:
        answer.trajectories(trajectories)
    if report_file:
        answer.report(report_file, title=", ".join(Path(recording).name for recording in recordings))
    click.echo(answer)


@click.command()
@click.argument("recordings", type=options.FILE, nargs=-1, required=True, metavar="RECORDING...")
@options.MACHINE
@click.option(
    "--ledger",
    type=options.OUTPUT,
    metavar="FILE",
    help="Append every finished recording to FILE; run again with it, only the rest is computed.",
)
@click.option(
    "--jobs",
    type=click.IntRange(1, 1024),
    metavar="N",
    help="Recordings at a time; by default all processors.",
)
@options.JSON
@options.SEED
def fleet(
    recordings: tuple[str, ...],
    machine_file: str,
    ledger: str | None,
    jobs: int | None,
    json_file: str | None,
    seed: int,
) -> int:
    """Diagnose every RECORDING by itself; one that is refused does not stop the others."""
    import os
    from concurrent.futures import ThreadPoolExecutor

    from ..atomic import apart
    from ..fleet import diagnose_many
    from ..results import json_text

    apart([json_file, ledger], [*recordings, machine_file])
    with ThreadPoolExecutor(jobs or os.cpu_count() or 1) as executor:
        answers = diagnose_many(
            recordings,
            machine_file,
            executor=executor,
            ledger=ledger,
            seed=seed,
            progress=terminal.progress(),
        )
    terminal.finish(json_file, lambda: json_text(answers.to_list()))
    click.echo(answers)
    if answers.interrupted:
        return terminal.INTERRUPTED
    for failure in answers.failures:
        click.echo(f"pmsm-rs: {failure.message}", err=True)
    return terminal.REFUSED if answers.failures else 0
