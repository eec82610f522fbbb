"""The commands that estimate parameters: identify, track."""

from __future__ import annotations

import click

from . import options, progress, terminal
from .help import Command, codes


@click.command(
    cls=Command,
    short_help="Estimate the parameters of the dq-model.",
    examples=(
        "pmsm-rs identify run.csv --machine machine.toml",
        "pmsm-rs identify run.csv --machine machine.toml --fit r_s,psi_m --method lm --json -",
        "pmsm-rs identify run.csv --machine machine.toml --swarm particles=60,neighbourhood=ring",
    ),
    exits=codes(
        c4="a parameter is not shown or the search has not converged; the answer is still written",
        c130="interrupted; the answer so far is still written",
    ),
)
@click.argument("recording", type=options.RECORDING)
@options.MACHINE
@options.ALLOW_OUTSIDE
@options.fit("Parameters to estimate; by default all that the recording shows.")
@options.method("Particle swarm, least squares, or both.", "pso", "lm", "pso+lm", default="pso+lm")
@click.option(
    "--swarm",
    metavar="NAME=VALUE,...",
    help="Settings of the swarm: particles, iterations, inertia, cognitive, social, velocity_limit, "
    "inertia_schedule, inertia_last, update, neighbourhood.",
)
@options.computing
def identify(
    recording: str,
    machine_file: str,
    allow_outside: bool,
    fit: list[str] | None,
    method: str,
    swarm: str | None,
    json_file: str | None,
    threads: int | None,
    seed: int,
) -> int:
    """Estimate the parameters of the dq-model from RECORDING."""
    from ..atomic import apart
    from ..config.machine_file import read_machine
    from ..config.swarm import Swarm
    from ..io.loader import load
    from ..run import identify as run

    apart([json_file], [recording, machine_file])
    machine = read_machine(machine_file, allow_outside=allow_outside)
    answer = run(
        load(recording, machine),
        machine,
        fit=fit,
        method=method,
        swarm=None if swarm is None else Swarm.parse(swarm),
        seed=seed,
        threads=threads,
        progress=terminal.progress(progress.identification(method)),
    )
    failed = terminal.deliver(lambda: answer, terminal.as_json(json_file, answer.to_json))
    if answer.interrupted or failed:
        return terminal.INTERRUPTED if answer.interrupted else failed
    unsettled = not answer.converged or any(entry.value is None for entry in answer.parameters.values())
    return terminal.NOT_SETTLED if unsettled else 0


@click.command(
    cls=Command,
    short_help="Follow parameters window by window, also live.",
    examples=(
        "pmsm-rs track run.csv --machine machine.toml --window 0.05",
        "pmsm-rs track run.csv --machine machine.toml --fit r_s,psi_m,tau_load --json windows.json",
        "logger | pmsm-rs track - --machine machine.toml >> windows.ndjson",
    ),
    exits=codes(
        c4="not one window could be identified",
        c130="interrupted; windows that were complete are still written",
    ),
)
@click.argument("recording", type=click.Path(dir_okay=False, allow_dash=True), metavar="RECORDING|-")
@options.MACHINE
@options.ALLOW_OUTSIDE
@click.option(
    "--window", type=float, default=0.033, show_default=True, metavar="S", help="Length of a window."
)
@options.fit("Parameters to follow.", default="r_s,tau_load")
@options.method("Warm least squares, the paper's swarm, or both.", "lm", "pso", "pso+lm", default="lm")
@options.computing
def track(
    recording: str,
    machine_file: str,
    allow_outside: bool,
    window: float,
    fit: list[str],
    method: str,
    json_file: str | None,
    threads: int | None,
    seed: int,
) -> int:
    """Follow parameters through RECORDING, window by window.

    With - samples are read from standard input as they come: CSV with a header, or one JSON object per line.
    Each window is written to standard output as one JSON object as soon as it is complete.
    """
    from ..live.command import Request, follow

    request = Request(
        recording,
        machine_file,
        fit,
        window,
        method,
        seed,
        threads,
        json_file,
        silent=terminal.is_silent(),
        allow_outside=allow_outside,
    )
    try:
        return terminal.NOT_SETTLED if follow(request) == 0 else 0
    except KeyboardInterrupt:
        terminal.say("interrupted; the windows that were complete are written")
        return terminal.INTERRUPTED
