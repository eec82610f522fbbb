"""Makes a planned case: finds a strength that shows, simulates both runs, keeps the truth apart."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from . import limits, splits
from .bench import EXTRA_NOISE
from .case import account, make_case, nameplate_of, noise_of, refit, write_text
from .machines import MACHINES, another
from .manoeuvres import LOADS, make
from .parameters import Machine
from .plan import Planned, name_of
from .plant import simulate
from .strengths import RULES, Values

# residual over noise that an effect leaves by itself after a re-fit: what is aimed at, log-uniform, and what
# is taken where the aim is out of reach
AIM = {"known": (1.6, 18.0), "whole": (1.3, 30.0), "form": (5.0, 500.0), "beside": (2.0, 30.0)}
TAKEN = {"known": (1.5, 20.0), "whole": (1.25, 33.0), "form": (4.5, 550.0), "beside": (1.9, 33.0)}
# an effect in a limited log is to leave so many times what the sound machine leaves there
AIM["limited"], TAKEN["limited"] = (3.0, 30.0), (2.5, 33.0)
# a whole bench is taken where the plant's own equations leave no more than so many times the least possible
SOLVABLE = 1.2
# what the plant raises where the drive loses the machine, or where no current makes the flux
TOO_STRONG = (RuntimeError, ZeroDivisionError)
FAST_SHARE = 0.25
# effects that a held rotor shows, and how often they are looked for there
AT_STANDSTILL = {"dead_time", "saturation_d", "saturation_q", "rs_thermal_drift"}
LOCKED_SHARE = 0.15
DURATION = (1.7, 2.3)
# loads under which a rotor turns
TURNING = tuple(k for k in LOADS if k != "locked")
# share of full logs of the plant whose voltages stand in the stator, the drive logging its command
HELD_SHARE = 0.15
HELD = ("clean", "single", "pair")
# their equations are stiff: a shorter run tells the strength
STIFF = {"iron_loss", "inter_turn_short"}
STIFF_DURATION = 0.5


@dataclass(frozen=True)
class Setting:
    """Where a case takes place: the machine, the manoeuvre and load by name, the duration in s, the seed."""

    machine: Machine
    manoeuvre: str
    load: str
    duration: float
    seed: int


def seen_in(log: str, severity: float) -> float:
    """Residual over noise in the log of a bench for one in a full log: more noise hides more."""
    return math.sqrt(1.0 + (severity**2 - 1.0) / (1.0 + EXTRA_NOISE**2)) if log == "noisy" else severity


def aim_of(planned: Planned, name: str) -> str:
    """Key of AIM and TAKEN for an effect of a case."""
    if planned.kind == "foreign":
        return "form" if name.startswith("x_") else "beside"
    return planned.kind if planned.kind in ("whole", "limited") else "known"


def left(where: Setting, effects: Values, log: str, duration: float) -> dict[str, float]:
    """Rms per channel that the plain machine leaves in a recording of so many s, every base parameter
    re-fitted, over the noise; in a limited log in the channel's unit."""
    m = make(where.machine, where.manoeuvre, where.load, duration=duration, seed=1000 * where.seed)
    nameplate = nameplate_of(where.machine, where.seed)
    run = simulate(where.machine, effects, m, seed=1000 * where.seed, nameplate=nameplate)
    limited = log in limits.KINDS
    seen = limits.limit(run, log, where.machine, where.seed, 1000 * where.seed) if limited else run
    rms = refit(where.machine, m, seen).rms()
    noise = {k: 1.0 for k in rms} if limited else noise_of(run)[1]
    return {k: v / noise[k] for k, v in rms.items()}


@dataclass(frozen=True)
class Part:
    """An effect of a case: its parameters, and what it leaves by itself over the noise, per channel and in
    the worst one."""

    values: dict[str, float]
    channels: dict[str, float]
    size: float


def measured(
    where: Setting,
    name: str,
    values: dict[str, float],
    log: str,
    sound: dict[str, float],
    *,
    whole: bool = False,
) -> Part:
    """What an effect leaves by itself in the recording, every base parameter re-fitted.

    sound: what the sound machine leaves in a limited log, which then counts instead of the noise; whole: the
    whole recording even of stiff equations.
    """
    short = name in STIFF and not whole
    seen = left(where, {name: values}, log, min(where.duration, STIFF_DURATION) if short else where.duration)
    found = {k: v / sound.get(k, 1.0) for k, v in seen.items()}
    return Part(values, found, seen_in(log, max(found.values())))


def draw(
    where: Setting, name: str, log: str, rng: np.random.Generator, kind: str, sound: dict[str, float]
) -> Part | None:
    """An effect as strong as AIM[kind] says, log-uniform.

    None if no strength up to the rule's greatest leaves one within TAKEN[kind].  The residual of an effect
    adds to the noise in squares, which gives the next strength to try.
    """
    greatest, rule = RULES[name]
    low, high = TAKEN[kind]
    aim = math.exp(rng.uniform(*map(math.log, AIM[kind])))
    form, s = int(rng.integers(2**32)), 1.0
    best: Part | None = None
    for _ in range(6):
        # the same stream each time: only the strength changes
        g = np.random.default_rng(form)
        values = rule(where.machine, s, lambda a, b, g=g: float(g.uniform(a, b)), g)
        try:
            part = measured(where, name, values, log, sound)
        except TOO_STRONG:
            s *= 0.3
            continue
        if low <= part.size <= high:
            if 0.6 < part.size / aim < 1.6:
                return part
            if best is None or abs(math.log(part.size / aim)) < abs(math.log(best.size / aim)):
                best = part
        wanted = s * math.sqrt((aim**2 - 1.0) / max(part.size**2 - 1.0, 1e-3))
        if s == greatest and wanted > s:
            break
        s = min(greatest, max(0.05 * s, min(20.0 * s, wanted)))
    return best


def parts(where: Setting, planned: Planned, rng: np.random.Generator) -> dict[str, Part] | None:
    """Every effect of a case by itself; None where the setting does not show one."""
    limited = planned.log in limits.KINDS and planned.effects
    sound = left(where, {}, planned.log, where.duration) if limited else {}
    out = {}
    for name in planned.effects:
        kind = aim_of(planned, name)
        found = draw(where, name, planned.log, rng, kind, sound)
        if found is not None and name in STIFF and kind != "known":
            # the short run aimed; what the truth states is measured
            found = measured(where, name, found.values, planned.log, sound, whole=True)
        if found is None or not TAKEN[kind][0] <= found.size <= TAKEN[kind][1]:
            return None
        out[name] = found
    return out


def shows(channels: dict[str, float]) -> list[str]:
    """Equations in which an effect shows: of the worst channel, and of those that show half as much."""
    equation = {"i_d": "d", "i_q": "q", "omega_e": "mechanical"}
    return [equation[k] for k, v in channels.items() if v >= 0.5 * max(channels.values())]


def solvable(run: dict[str, Any]) -> bool:
    """Whether the plant's own equations come back to the noise, or to what noise on their drives leaves."""
    least = {k: max(1.0, v / run["noise_rms"][k]) for k, v in run["least_rms"].items()}
    return all(v <= SOLVABLE * least[k] for k, v in run.get("oracle", {}).items())


def settings(
    number: int, seed: int, planned: Planned, split: str, loads: Sequence[str] = TURNING
) -> Iterator[Setting]:
    """The planned setting of a case, then others, of these loads, for effects that the planned one does not
    show."""
    rng = np.random.default_rng([seed, 1, number])
    machine, load = planned.machine, planned.load
    # a held rotor hides what a limited log does to angle and speed
    may_lock = planned.kind in ("single", "clean") and planned.simulator == "plant"
    may_lock &= planned.log not in limits.KINDS
    for attempt in range(12):
        if attempt:
            machine, load = str(rng.choice(splits.machines(split))), str(rng.choice(loads))
        manoeuvre = "fast" if rng.uniform() < FAST_SHARE else "rich"
        locked = rng.uniform() < LOCKED_SHARE and may_lock and set(planned.effects) <= AT_STANDSTILL
        duration = round(float(rng.uniform(*DURATION)), 2)
        case_seed = int(rng.integers(1, 2**31 // 1000))
        own = another(MACHINES[machine], rng)
        if locked and not attempt:
            yield Setting(own, "locked", "locked", duration, case_seed)
        # the strength of a poor case is the one that a rich manoeuvre would show
        yield Setting(own, "rich" if planned.kind == "poor" else manoeuvre, load, duration, case_seed)


def generate(
    number: int,
    seed: int,
    planned: Planned,
    out: Path,
    split: str = "scoring",
    loads: Sequence[str] = TURNING,
) -> dict[str, Any]:
    """Make one case in out/open and out/sealed and return its truth; it depends on the arguments alone.

    loads: from which a load is drawn where the planned setting does not show the effects.
    Raises RuntimeError if no setting shows the effects, ImportError if the simulator is not installed.
    """
    rng = np.random.default_rng([seed, 2, number])
    case, names = name_of(number), planned.effects
    held = (planned.log, planned.simulator) == ("full", "plant") and planned.kind in HELD
    held &= "voltage_delay" not in names and np.random.default_rng([seed, 4, number]).uniform() < HELD_SHARE
    draft = out / f".{case}"
    for where in settings(number, seed, planned, split, loads):
        if "asymmetric_friction" in names and where.load.startswith("unknown"):
            # Coulomb friction and a constant load are the same equation
            continue
        if (drawn := parts(where, planned, rng)) is None:
            continue
        effects = {name: part.values for name, part in drawn.items()}
        shutil.rmtree(draft, ignore_errors=True)
        try:
            truth = make_case(
                draft / "open",
                where.machine,
                effects,
                "poor" if planned.kind == "poor" else where.manoeuvre,
                where.load,
                where.seed,
                truth_folder=draft / "sealed",
                duration=where.duration,
                degraded=None if planned.log == "full" else planned.log,
                stator_hold=held,
                log_command=held,
                simulator=planned.simulator,
                solve=planned.kind == "whole",
            )
        except TOO_STRONG:
            # the validation run, or both effects together, cannot be driven
            continue
        if not all(solvable(run) for run in truth["runs"].values()):
            continue
        plain = seen_in(planned.log, max(truth["runs"]["recording"]["plain_refit"].values()))
        if planned.kind == "single" and not 0.9 * TAKEN["known"][0] <= plain <= 1.1 * TAKEN["known"][1]:
            # another simulator, or the whole of a stiff run, shows more or less of it
            continue
        truth["kind"], truth["severity"] = planned.kind, round(plain, 4)
        truth["alone"] = {name: round(part.size, 3) for name, part in drawn.items()}
        for name in truth["foreign"]:
            truth["foreign"][name]["shows"] = shows(drawn[name].channels)
        truth["family"], truth["split"] = planned.family, split
        write_text(draft / "sealed" / "truth.json", json.dumps(truth, indent=1) + "\n")
        shutil.rmtree(out / "open" / case, ignore_errors=True)
        for part in ("open", "sealed"):
            (out / part).mkdir(exist_ok=True)
            (draft / part).rename(out / part / case)
        draft.rmdir()
        return truth
    shutil.rmtree(draft, ignore_errors=True)
    raise RuntimeError(f"{case}: no setting shows {' and '.join(names)}")


def is_made(number: int, out: Path) -> bool:
    """Whether the case is complete: its sealed folder is the last to be moved into place."""
    return (out / "sealed" / name_of(number) / "truth.json").exists()


def warm_up() -> None:
    """Run the plant and the plain machine once, so that what numba compiles lies in its cache."""
    machine = MACHINES["servo"]
    m = make(machine, "rich", "none", duration=0.05, seed=1)
    account(machine, {}, m, simulate(machine, {}, m, seed=1))
