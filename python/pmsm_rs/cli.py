"""The command line: results to standard output, errors in one plain sentence to standard error."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any, NoReturn

import click

INTERNAL, USAGE, REFUSED, NOT_SETTLED, INTERRUPTED = 1, 2, 3, 4, 130

_FILE = click.Path(dir_okay=False)
_THREADS = click.option(
    "--threads",
    type=click.IntRange(1, 1024),
    metavar="N",
    help="Processors to use; the answer does not depend on it.",
)
_SEED = click.option(
    "--seed",
    type=click.IntRange(0, 2**63 - 1),
    default=1,
    show_default=True,
    metavar="N",
    help="Seed of all random numbers.",
)
_MACHINE = click.option(
    "--machine",
    "machine_file",
    type=_FILE,
    required=True,
    metavar="M.toml",
    help="Nameplate, load, column names.",
)
_JSON = click.option("--json", "json_file", type=_FILE, metavar="OUT", help="Write the whole answer as JSON.")


def _version(context: click.Context, _parameter: click.Parameter, wanted: bool) -> None:
    if wanted and not context.resilient_parsing:
        from ._core import __version__

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


@cli.command()
@click.option(
    "--report",
    "report_file",
    type=_FILE,
    default="pmsm-rs-demo.html",
    show_default=True,
    metavar="OUT.html",
    help="Where the report goes.",
)
@_JSON
@_THREADS
@_SEED
def demo(report_file: str, json_file: str | None, threads: int | None, seed: int) -> int:
    """Diagnose a recording that ships with the package, then open the seal on what was put into it."""
    from .demo import compare, recording_files
    from .loader import load
    from .run import diagnose as run

    recording, validation, machine_file = recording_files()
    answer = run(
        load(recording, machine_file),
        _nameplate(machine_file),
        load(validation, machine_file),
        seed=seed,
        threads=threads,
        progress=_progress(),
    )
    _clear()
    if json_file:
        _write(json_file, answer.to_json())
    answer.report(report_file, title="Demo recording")
    click.echo(answer)
    if not answer.interrupted:
        click.echo("\n" + compare(answer))
    click.echo(f"\nReport: {report_file}")
    return INTERRUPTED if answer.interrupted else 0


@cli.command()
@click.argument("config", type=_FILE, metavar="CONFIG.toml")
@click.option(
    "-o",
    "--output",
    type=_FILE,
    required=True,
    metavar="RECORDING.parquet",
    help="Where the recording goes (.parquet or .csv).",
)
@click.option("--truth", is_flag=True, help="Write RECORDING.truth.json and .truth.parquet beside it.")
@click.option(
    "--machine-file",
    type=_FILE,
    metavar="M.toml",
    help="Write the machine file that goes with the recording.",
)
@click.option(
    "--seed", type=click.IntRange(0, 2**53), metavar="N", help="Seed of the noise, in place of the file's."
)
def simulate(config: str, output: str, truth: bool, machine_file: str | None, seed: int | None) -> int:
    """Make a recording: a closed-loop drive with any effects, as CONFIG.toml describes it."""
    from .simulation import simulate as run

    made = run(config, progress=_progress(), **({} if seed is None else {"seed": seed}))
    _clear()
    made.write(output)
    if truth:
        made.write_truth(output)
    if machine_file:
        made.write_machine(machine_file)
    click.echo(f"{output}: {len(made.recording)} samples, {made.recording.duration:.6g} s")
    return 0


@cli.command()
@click.argument("recording", type=_FILE)
@_MACHINE
@click.option(
    "--fit",
    metavar="r_s,tau_load,...",
    help="Parameters to estimate; by default all that the recording shows.",
)
@click.option(
    "--method",
    type=click.Choice(["pso", "lm", "pso+lm"]),
    default="pso+lm",
    show_default=True,
    help="Particle swarm, least squares, or both.",
)
@click.option(
    "--swarm",
    metavar="NAME=VALUE,...",
    help="Settings of the swarm: particles, iterations, inertia, cognitive, social, velocity_limit, "
    "inertia_schedule, inertia_last, update, neighbourhood.",
)
@_JSON
@_THREADS
@_SEED
def identify(
    recording: str,
    machine_file: str,
    fit: str | None,
    method: str,
    swarm: str | None,
    json_file: str | None,
    threads: int | None,
    seed: int,
) -> int:
    """Estimate the parameters of the dq-model from RECORDING."""
    from .config import read_machine
    from .loader import load
    from .run import Swarm
    from .run import identify as run

    names = [name.strip() for name in fit.split(",") if name.strip()] if fit is not None else None
    machine = read_machine(machine_file)
    answer = run(
        load(recording, machine),
        machine.machine,
        fit=names,
        method=method,
        swarm=None if swarm is None else Swarm.parse(swarm),
        seed=seed,
        threads=threads,
        progress=_progress(),
    )
    _clear()
    if json_file:
        _write(json_file, answer.to_json())
    click.echo(answer)
    if answer.interrupted:
        return INTERRUPTED
    unsettled = not answer.converged or any(entry.value is None for entry in answer.parameters.values())
    return NOT_SETTLED if unsettled else 0


@cli.command()
@click.argument("recording", type=click.Path(dir_okay=False, allow_dash=True), metavar="RECORDING|-")
@_MACHINE
@click.option(
    "--window", type=float, default=0.033, show_default=True, metavar="S", help="Length of a window."
)
@click.option(
    "--fit",
    default="r_s,tau_load",
    show_default=True,
    metavar="r_s,tau_load,...",
    help="Parameters to follow.",
)
@click.option(
    "--method",
    type=click.Choice(["lm", "pso", "pso+lm"]),
    default="lm",
    show_default=True,
    help="Warm least squares, the paper's swarm, or both.",
)
@_JSON
@_THREADS
@_SEED
def track(
    recording: str,
    machine_file: str,
    window: float,
    fit: str,
    method: str,
    json_file: str | None,
    threads: int | None,
    seed: int,
) -> int:
    """Follow parameters through RECORDING, window by window.

    With - samples are read from standard input as they come, CSV with a header or one JSON object per line,
    and each window is written to standard output as one JSON object as soon as it is complete.
    """
    from .live import Request, follow

    names = [name.strip() for name in fit.split(",") if name.strip()]
    request = Request(recording, machine_file, names, window, method, seed, threads, json_file)
    try:
        return NOT_SETTLED if follow(request) == 0 else 0
    except KeyboardInterrupt:
        _fail(INTERRUPTED, "interrupted; the windows that were complete are written")


@cli.command()
@click.argument("recordings", type=_FILE, nargs=-1, required=True, metavar="RECORDING...")
@_MACHINE
@click.option(
    "--validate",
    "validation",
    type=_FILE,
    metavar="FILE",
    help="Another run of the same machine, which only judges.",
)
@_JSON
@click.option(
    "--report", "report_file", type=_FILE, metavar="OUT.html", help="Write a report as one HTML page."
)
@click.option(
    "--trajectories", type=_FILE, metavar="OUT.parquet", help="Write measured and modelled trajectories."
)
@_THREADS
@_SEED
def diagnose(
    recordings: tuple[str, ...],
    machine_file: str,
    validation: str | None,
    json_file: str | None,
    report_file: str | None,
    trajectories: str | None,
    threads: int | None,
    seed: int,
) -> int:
    """Find out which physics the dq-model of RECORDING leaves out.

    Several recordings of one machine are fitted together.
    """
    from pathlib import Path

    from .config import read_machine
    from .loader import load
    from .run import diagnose as run

    machine = read_machine(machine_file)
    runs = [load(recording, machine) for recording in recordings]
    other = load(validation, machine) if validation is not None else None
    answer = run(runs, machine.machine, other, seed=seed, threads=threads, progress=_progress())
    _clear()
    if json_file:
        _write(json_file, answer.to_json())
    if trajectories:
        answer.trajectories(trajectories)
    if report_file:
        answer.report(report_file, title=", ".join(Path(recording).name for recording in recordings))
    click.echo(answer)
    return INTERRUPTED if answer.interrupted else 0


@cli.command()
@click.argument("recordings", type=_FILE, nargs=-1, required=True, metavar="RECORDING...")
@_MACHINE
@click.option(
    "--ledger",
    type=_FILE,
    metavar="FILE",
    help="Append every finished recording to FILE; run again with it, only the rest is computed.",
)
@click.option(
    "--jobs",
    type=click.IntRange(1, 1024),
    metavar="N",
    help="Recordings at a time; by default all processors.",
)
@_JSON
@_SEED
def fleet(
    recordings: tuple[str, ...],
    machine_file: str,
    ledger: str | None,
    jobs: int | None,
    json_file: str | None,
    seed: int,
) -> int:
    """Diagnose every RECORDING by itself; one that is refused does not stop the others."""
    import json
    import os
    from concurrent.futures import ThreadPoolExecutor

    from .fleet import diagnose_many

    with ThreadPoolExecutor(jobs or os.cpu_count() or 1) as executor:
        answers = diagnose_many(
            recordings, machine_file, executor=executor, ledger=ledger, seed=seed, progress=_progress()
        )
    _clear()
    if json_file:
        _write(json_file, json.dumps(answers.to_list(), indent=2, ensure_ascii=False, allow_nan=False) + "\n")
    click.echo(answers)
    if answers.interrupted:
        return INTERRUPTED
    for failure in answers.failures:
        click.echo(f"pmsm-rs: {failure.message}", err=True)
    return REFUSED if answers.failures else 0


@cli.command()
@click.argument("figures", nargs=-1, metavar="[fig5|fig6|fig7|fig8|all]...")
@click.option(
    "--out", "folder", type=click.Path(file_okay=False), required=True, metavar="DIR", help="Where it goes."
)
def reproduce(figures: tuple[str, ...], folder: str) -> int:
    """Simulate and identify what Liu, Liu & Cartes (2008) show, and draw their figures anew.

    Writes the figures as PNG and SVG, a table of the windows and a page with all results and choices.
    """
    from .paper.reproduce import reproduce as run
    from .paper.tables import lines

    outcome, files = run(figures or ("all",), folder, progress=_progress())
    _clear()
    click.echo(lines(outcome))
    click.echo(f"\n{outcome.seconds:.1f} s; written: {', '.join(str(file) for file in files)}")
    return 0


@cli.command()
@click.argument("name", required=False)
def effects(name: str | None) -> int:
    """Show the catalogue of effects, or one of them with equation, parameters and look-alikes."""
    from .catalogue import entry, overview

    click.echo(overview() if name is None else entry(name))
    return 0


def _nameplate(machine_file: str) -> Any:
    from .config import read_machine

    return read_machine(machine_file).machine


def _write(path: str, text: str) -> None:
    from .atomic import write_text

    write_text(path, text)


def _progress() -> Callable[[str, float], None] | None:
    if not sys.stderr.isatty():
        return None

    def show(stage: str, fraction: float) -> None:
        # Erases to the end of the line, since stages differ in length.
        sys.stderr.write(f"\r{100 * fraction:3.0f} %  {stage}\x1b[K")
        sys.stderr.flush()

    return show


def _clear() -> None:
    if sys.stderr.isatty():
        sys.stderr.write("\r\x1b[K")
        sys.stderr.flush()


def _fail(code: int, message: str) -> NoReturn:
    _clear()
    click.echo(f"pmsm-rs: {message}", err=True)
    sys.exit(code)


def _code(error: Exception) -> int:
    from . import _core

    codes = (
        (_core.UsageError, USAGE),
        (_core.NotIdentifiableError, NOT_SETTLED),
        (_core.DataError, REFUSED),
        (_core.MachineError, REFUSED),
    )
    return next((code for kind, code in codes if isinstance(error, kind)), INTERNAL)


def _ours(error: Exception) -> bool:
    from ._core import PmsmError

    return isinstance(error, PmsmError)


def main(arguments: list[str] | None = None) -> NoReturn:
    """The `pmsm-rs` command.

    Exits with 0 done, 1 internal fault, 2 usage, 3 data refused, 4 not settled, 130 interrupted.
    """
    try:
        code = cli.main(arguments, prog_name="pmsm-rs", standalone_mode=False)
        sys.stdout.flush()
    except click.exceptions.Exit as stop:
        sys.exit(stop.exit_code)
    except click.ClickException as error:
        if isinstance(error, click.exceptions.NoArgsIsHelpError):
            error.show()
            sys.exit(USAGE)
        _fail(USAGE, f"{error.format_message().rstrip('.')}; see pmsm-rs --help")
    except (click.Abort, KeyboardInterrupt):
        _fail(INTERRUPTED, "interrupted before there was a result; run it again")
    except BrokenPipeError:
        # The reader of our output has gone; there is nobody left to tell.
        sys.stderr.close()
        sys.exit(0)
    except Exception as error:
        code = _code(error)
        if code != INTERNAL:
            _fail(code, str(error))
        what = str(error) if _ours(error) else f"{type(error).__name__}: {error}; please report it"
        _fail(INTERNAL, f"internal fault: {' '.join(what.split())}")
    sys.exit(code if isinstance(code, int) else 0)
