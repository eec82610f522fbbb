"""Designs the next recording from an answer."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from .._core import Machine, Recording, UsageError
from ..answers import Diagnosis, read_answer
from ..errors import expect_whole, refuse
from ..given import machine_of, recording_of
from ..model import Model
from . import certainty, formula_rivals, limits, rivals
from .bench import Bench, Trial, sampled, thinned
from .comparison import Comparison, Known, Separation
from .outcome import Certainty, Design, Outcome, columns_of
from .questions import UNEXPLAINED, PinDown, TellFormulas, TellModels
from .references import Scales
from .search import Tried, search

if TYPE_CHECKING:
    from ..given import Described, Run
    from ..progress import Progress
    from .rivals import Rival

# Manoeuvres that are tried, and those of them that are compared closely.
TRIES, _FINALISTS = 64, 2
# Times a decisive gain that is enough: a rival does not come back from it by what is not modelled.
_ENOUGH = 60.0
# What a verdict takes where the answer does not say, nats.
_DECISIVE = 5.0
# Rows of a known recording that the rivals are held by.
_ROWS = 4000
# Voltages of the stator have no mean over rows that the rotor would see.
_PHASES = {"v_a", "v_b", "v_c"}
_LOAD = {"none": "none", "measured": "none", "locked": "locked", "known_constant": "known_constant"}


def design(
    answer: Diagnosis | Mapping[str, Any] | str | os.PathLike[str],
    limits: object,
    *,
    recording: Run | Sequence[Run] = (),
    machine: Described | None = None,
    tries: int = TRIES,
    seed: int = 1,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Design:
    """Designs the manoeuvre of the next recording, within limits. It moves no motor.

    Where the answer has rivals, the manoeuvre separates them best: effects that the recording cannot tell
    apart, names whose probabilities overlap, and formulas of an unknown torque. Where it has none, the
    manoeuvre makes the least certain parameters known (D-optimal).

    Parameters
    ----------
    answer : Diagnosis, mapping or path
        A diagnosis, its JSON object or its file.
    limits : path or mapping
        Current (A, peak), speed (rad/s, mechanical; one number, or lowest and highest) and time (s). Where
        they apply also acceleration (rad/s^2), position (rad from the start) and voltage (V, DC link). Every
        rival keeps them in simulation, with a margin of 5 %.
    recording : Recording, path, or sequence of them, default ()
        With it the parameters of the rivals are held by what it shows. Without, they adjust freely, so that
        less separation is promised.
    machine : Machine, MachineFile, path or None, default None
        The nameplate, which `recording` needs.
    tries : int
        Manoeuvres that are compared.
    seed : int, default 1
        The same seed gives the same design for any number of threads.
    threads : int or None, default None
        None uses every processor.
    progress : callable or None, default None
        Is called as progress(stage, fraction) from time to time.

    Returns
    -------
    Design
        References over time, and the expected outcome for each rival.

    Raises
    ------
    DataError
        For what is no answer of this package.
    UsageError
        For what are no limits, where an answer has no model, and where it is of operating points.
    NotIdentifiableError
        Naming the limit that no manoeuvre keeps.

    Examples
    --------
    >>> import pmsm_rs as pm
    >>> from pmsm_rs.support.demo import recording_files
    >>> run, other, machine = recording_files()
    >>> answer = pm.diagnose(run, machine, validation=other)
    >>> design = pm.design(answer, {"current": 10.0, "speed": 100.0, "time": 2.0}, tries=4)
    >>> design.task, sorted(design.references)
    ('pin down', ['i_d_ref', 'i_q_ref', 'omega_m_ref', 't'])
    """
    expect_whole(seed=seed, threads=threads)
    expect_whole(seed=tries)
    found = _answer(answer)
    if found.recording_kind not in ("full", "electrical", "mechanical"):
        raise refuse(
            UsageError,
            "this answer is of operating points, or of a motor that was turned from outside",
            fix="record other points, as next_experiment says; a manoeuvre in time would answer nothing here",
        )
    given = [recording] if isinstance(recording, str | os.PathLike | Recording) else list(recording)
    bench, scales = bench_of(found, limits)
    known = _known(given, machine, bench.whole)
    comparison = Comparison(certainty.noise_of(found.noise_floor), known, threads or os.cpu_count() or 1)
    try:
        return _design(found, bench, scales, comparison, tries=max(2, tries), seed=seed, progress=progress)
    finally:
        comparison.close()


def _design(
    found: Diagnosis,
    bench: Bench,
    scales: Scales,
    comparison: Comparison,
    *,
    tries: int,
    seed: int,
    progress: Progress | None,
) -> Design:
    decisive = float(found.options.get("decisive", _DECISIVE))
    how: dict[str, Any] = {"tries": tries, "seed": seed, "progress": progress}
    formulas = formula_rivals.of(found.data) if found.formulas else []
    if len(formulas) > 1:
        told = TellFormulas(
            bench,
            formulas,
            noise=float(found.noise_floor["omega_e"]),
            load_open=bench.load_kind == "unknown_constant",
        )
        best = search(told, bench.limits, scales, **how)[0]
        return _apart(best, tuple(x.name for x in formulas), bench, decisive, seed)
    models = rivals.of(found)
    if len(models) > 1:
        between = TellModels(bench, models, comparison, enough=_ENOUGH * decisive)
        tried = search(between, bench.limits, scales, **how)
        closer = [(between.closely(x.trials), x) for x in tried[:_FINALISTS]]
        best = max((replace(x, worth=y[0], found=y[1]) for y, x in closer), key=lambda x: x.worth)
        made = _apart(best, tuple(x.name for x in models), bench, decisive, seed)
        return replace(made, explained=tried[0].worth > UNEXPLAINED)
    return _pinned(models[0], bench, scales, comparison, found, how, decisive)


def _pinned(
    rival: Rival,
    bench: Bench,
    scales: Scales,
    comparison: Comparison,
    found: Diagnosis,
    how: Mapping[str, Any],
    decisive: float,
) -> Design:
    model = rival.model
    before = certainty.information(rival, model.names, model.covariance)
    rows = bench.limits.time / bench.period
    asked = PinDown(bench, rival, comparison, before, rows)
    best = search(asked, bench.limits, scales, **how)[0]
    certainties = tuple(Certainty(x.name, x.value, x.before, x.after) for x in best.found.known)
    return Design(
        "pin down",
        best.references.words,
        columns_of(best.references),
        (rival.name,),
        (),
        certainties,
        best.worth,
        decisive,
        dict(best.trials[0].peaks),
        bench.limits.to_dict(),
        how["seed"],
    )


def _apart(
    best: Tried[tuple[Separation, ...]], names: tuple[str, ...], bench: Bench, decisive: float, seed: int
) -> Design:
    trials = dict(zip(names, best.trials, strict=True))
    reached = {limit: max(trial.peaks[limit] for trial in best.trials) for limit in best.trials[0].peaks}
    return Design(
        "tell apart",
        best.references.words,
        columns_of(best.references),
        names,
        tuple(_outcome(x, trials[x.truth]) for x in best.found),
        (),
        best.worth,
        decisive,
        reached,
        bench.limits.to_dict(),
        seed,
    )


def _outcome(seen: Separation, trial: Trial) -> Outcome:
    k = min(seen.at, len(trial.t) - 1)
    return Outcome(
        seen.truth,
        seen.rival,
        seen.nats,
        dict(seen.times),
        seen.channel,
        float(trial.t[k]),
        float(trial.omega_m[k]),
        float(trial.i_d[k]),
        float(trial.i_q[k]),
    )


def _answer(given: object) -> Diagnosis:
    if isinstance(given, Diagnosis):
        return given
    if isinstance(given, Mapping):
        import json

        return Diagnosis.from_json(json.dumps(given))
    if isinstance(given, str | os.PathLike):
        return read_answer(given)
    raise refuse(
        UsageError,
        f"a {type(given).__name__} was given where an answer is expected",
        fix="give a Diagnosis, its JSON object, or the file that --json wrote",
    )


def bench_of(found: Diagnosis, given: object) -> tuple[Bench, Scales]:
    """The bench of an answer within the limits that are `given` as in `design`, and what manoeuvres need to
    know of it. Raises UsageError as `design` does.
    """
    specification = Model(found.data["model"]).specification
    scales, base = specification["scales"], specification["base"]
    stated = found.data.get("machine") or {}
    load = _LOAD.get(stated.get("load") or "", "unknown_constant")
    f_sample = stated.get("f_sample") or 1.0 / scales["period"]
    shown = {
        "i_max": scales["i_max"],
        "omega_m_max": scales["omega_e_max"] / scales["n_p"],
        "v_dc": stated.get("v_dc") or scales["v_dc"],
        "f_sample": f_sample,
        "locked": load == "locked",
    }
    electrical = rivals.reading_of(Model(found.data["model"]))["electrical"]
    if not electrical:
        # The voltage of a drive whose voltages were not recorded limits nothing here.
        shown["v_dc"] = shown["v_dc"] or 1.0
    wanted = limits.read(given, shown)
    torque = 1.5 * scales["n_p"] * max(base["psi_m"], 1e-9)
    about = Scales(torque / max(base["j"], 1e-12), bool(electrical), load == "locked")
    # A delay counts in periods of the log.
    whole = any("voltage_delay" in x.model.effects for x in rivals.of(found))
    return Bench(wanted, load, float(scales["period"]), whole), about


def _known(given: Sequence[Any], machine: object, whole: bool) -> list[Known]:
    if not given:
        return []
    if machine is None:
        raise refuse(
            UsageError, "a recording was given without its machine", fix="give machine= or --machine as well"
        )
    described = machine_of(machine)
    plate = described if isinstance(described, Machine) else described.machine
    return [_held(recording_of(run, described), plate, whole) for run in given]


def _held(recording: Recording, machine: Machine, whole: bool) -> Known:
    """A known recording, on means of rows where it is long and its voltages are those of the rotor's axes."""
    every = -(-len(recording) // _ROWS)
    if whole or every == 1 or _PHASES & set(recording.names):
        return Known(recording, machine)
    t = recording.column("t")
    period = float(t[-1] - t[0]) / (len(recording) - 1)
    return Known(thinned(recording, every), sampled(machine, 1.0 / (every * period)))
