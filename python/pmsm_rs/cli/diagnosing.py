"""The commands that find what a model leaves out: demo, diagnose, fleet."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import click

from . import options, progress, terminal
from .help import Command, codes

if TYPE_CHECKING:
    from ..answers import Diagnosis

_WHATEVER: Final = "done, whatever the verdict, also `undetermined`"
_NOT_IDENTIFIABLE: Final = "the dq-model itself cannot be determined; the JSON answer says why"

AHEAD: Final = 4
"""Files that are opened side by side at most: each may have a decoder of its own."""


@click.command(
    cls=Command,
    short_help="Diagnose a recording that ships with the package.",
    examples=("pmsm-rs demo", "pmsm-rs demo --report /tmp/demo.html --quiet"),
    exits=codes(c130="interrupted; the answer so far is still written", without=(3,)),
)
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
    """Diagnose a recording that ships with the package, then compare the answer with what was put into it."""
    from ..atomic import apart
    from ..config.machine_file import read_machine
    from ..io.loader import load
    from ..run import diagnose as run
    from ..support.demo import compare, recording_files

    recording, validation, machine_file = recording_files()
    apart([json_file, report_file], [])
    machine = read_machine(machine_file)
    answer = run(
        load(recording, machine),
        machine.machine,
        load(validation, machine),
        seed=seed,
        threads=threads,
        progress=terminal.progress(progress.DIAGNOSIS),
    )

    def draw() -> None:
        answer.report(report_file, title="Demo recording", command=terminal.command_line())
        terminal.show(f"\nReport: {report_file}")

    sealed = "" if answer.interrupted else f"\n\n{compare(answer)}"
    failed = terminal.deliver(
        lambda: f"{answer}{sealed}",
        terminal.as_json(json_file, answer.to_json),
        *(() if answer.interrupted else (draw,)),
    )
    return terminal.INTERRUPTED if answer.interrupted else failed


@click.command(
    cls=Command,
    short_help="Find out which physics the dq-model leaves out.",
    examples=(
        "pmsm-rs diagnose run.csv --machine machine.toml",
        "pmsm-rs diagnose run.csv --machine machine.toml --validate other.csv --report report.html",
        "pmsm-rs diagnose run1.csv run2.csv --machine machine.toml --quiet --json answer.json",
        "pmsm-rs diagnose run.csv --machine machine.toml --json - | jq .verdict",
    ),
    exits=codes(
        c0=_WHATEVER,
        c4=_NOT_IDENTIFIABLE,
        c130="interrupted; the answer so far is still written",
    ),
)
@click.argument("recordings", type=options.RECORDING, nargs=-1, required=True, metavar="RECORDING...")
@options.MACHINE
@options.ALLOW_OUTSIDE
@click.option(
    "--validate",
    "validation",
    type=options.FILE,
    metavar="FILE",
    help="Another run of the same machine, to check the prediction.",
)
@options.JSON
@options.QUIET
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
    help="Write measured and modelled trajectories, for the pictures of `pmsm-rs report`.",
)
@click.option(
    "--options",
    "constants",
    metavar="NAME=VALUE,...",
    help="Thresholds of the diagnosis, such as named=0.95; the answer lists all of them.",
)
@options.THREADS
@options.SEED
def diagnose(
    recordings: tuple[str, ...],
    machine_file: str,
    allow_outside: bool,
    validation: str | None,
    json_file: str | None,
    report_file: str | None,
    trajectories: str | None,
    constants: str | None,
    threads: int | None,
    seed: int,
) -> int:
    """Find out which physics the dq-model of RECORDING leaves out.

    Several recordings of one machine are fitted together. `pmsm-rs inspect RECORDING --write machine.toml`
    makes a machine file.
    """
    from .. import _core
    from ..atomic import apart
    from ..errors import NothingToAsk
    from ..io.formats.ahead import Opening
    from ..io.recording import DEFAULT_MAX_BYTES

    apart([json_file, report_file, trajectories], [*recordings, machine_file, validation])
    files = [*recordings, *([] if validation is None else [validation])]
    ahead = [Opening(file, DEFAULT_MAX_BYTES) for file in files[:AHEAD]]
    # Meanwhile comes what takes long to import.
    from ..config.machine_file import read_machine
    from ..config.options import DiagnosisOptions
    from ..io.loader import load
    from ..run import diagnose as run
    from ..run import of_validation, refused, unanswered

    settings = None if constants is None else DiagnosisOptions.parse(constants)
    machine = read_machine(machine_file, allow_outside=allow_outside)
    try:
        opened = [*ahead, *files[AHEAD:]]
        runs = [load(file, machine) for file in opened[: len(recordings)]]
        other = None
        if validation is not None:
            with of_validation():
                other = load(opened[-1], machine)
    except NothingToAsk as error:
        if len(files) > 1 and not (len(recordings) == 1 and error.of(recordings[0])):
            raise
        answer = unanswered(error, seed=seed)
        return _write(answer, recordings, json_file, report_file, trajectories)
    try:
        answer = run(
            runs,
            machine,
            other,
            options=settings,
            seed=seed,
            threads=threads,
            progress=terminal.progress(progress.DIAGNOSIS),
        )
    except _core.NotIdentifiableError as error:
        write = terminal.as_json(json_file, refused(error, runs, seed=seed).to_json)
        if write is not None:
            write()
        raise
    failed = _write(answer, recordings, json_file, report_file, trajectories)
    return terminal.INTERRUPTED if answer.interrupted else failed


def _write(
    answer: Diagnosis,
    recordings: tuple[str, ...],
    json_file: str | None,
    report_file: str | None,
    trajectories: str | None,
) -> int:
    """Prints the answer and writes the files that were asked for; the exit code."""
    from pathlib import Path

    def draw() -> None:
        if report_file and answer.interrupted:
            # Drawing takes seconds, and whoever interrupts does not want to wait.
            terminal.say(f"{report_file} is not drawn: the search was interrupted")
        elif report_file:
            title = ", ".join(Path(recording).name for recording in recordings)
            answer.report(report_file, title=title, command=terminal.command_line())

    def trace() -> None:
        if trajectories and answer.shown is None:
            terminal.say(f"{trajectories} is not written: no model was simulated on this recording")
        elif trajectories:
            answer.trajectories(trajectories)

    return terminal.deliver(lambda: answer, terminal.as_json(json_file, answer.to_json), trace, draw)


@click.command(
    cls=Command,
    short_help="Diagnose many recordings, each by itself.",
    examples=(
        "pmsm-rs fleet runs/*.parquet --machine machine.toml --ledger fleet.ndjson",
        "pmsm-rs fleet a.csv b.csv --machine machine.toml --jobs 4 --json answers.json",
    ),
    exits=codes(
        c0="done, whatever the verdicts",
        c3="machine file refused, or a recording has no diagnosis; the others have theirs",
        c130="interrupted; what was complete is still written",
    ),
)
@click.argument("recordings", type=options.FILE, nargs=-1, required=True, metavar="RECORDING...")
@options.MACHINE
@options.ALLOW_OUTSIDE
@click.option(
    "--ledger",
    type=options.OUTPUT,
    metavar="FILE",
    help="Append each finished recording to FILE; another run with FILE computes only the rest.",
)
@click.option(
    "--jobs",
    type=click.IntRange(1, 1024),
    metavar="N",
    help="Recordings at a time; by default all processors.",
)
@options.JSON
@options.QUIET
@options.SEED
def fleet(
    recordings: tuple[str, ...],
    machine_file: str,
    allow_outside: bool,
    ledger: str | None,
    jobs: int | None,
    json_file: str | None,
    seed: int,
) -> int:
    """Diagnose every RECORDING by itself; one that is refused does not stop the others."""
    import os
    from concurrent.futures import ThreadPoolExecutor
    from functools import partial

    from ..atomic import apart
    from ..config.machine_file import read_machine
    from ..fleet.recordings import diagnose_many
    from ..results.estimates import json_text

    apart([json_file, ledger], [*recordings, machine_file])
    machine = read_machine(machine_file, allow_outside=allow_outside)
    answers = diagnose_many(
        recordings,
        machine,
        executor=partial(ThreadPoolExecutor, jobs or os.cpu_count() or 1),
        ledger=ledger,
        seed=seed,
        progress=terminal.progress(),
    )
    failed = terminal.deliver(
        lambda: answers, terminal.as_json(json_file, lambda: json_text(answers.to_list()))
    )
    if answers.interrupted:
        return terminal.INTERRUPTED
    for line in answers.damaged:
        terminal.say(
            f"{ledger}, line {line}: it is damaged, so it was passed over; its recording was computed again"
        )
    for failure in answers.failures:
        terminal.say(failure.message)
    return failed or (terminal.REFUSED if answers.failures else 0)
