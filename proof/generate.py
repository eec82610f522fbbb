"""Makes a planned case: finds a strength that shows, simulates both runs, keeps the truth apart."""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .bench import EXTRA_NOISE
from .case import account, make_case, nameplate_of, write_text
from .machines import MACHINES, another
from .manoeuvres import LOADS, make
from .parameters import Machine
from .plan import Planned, name_of
from .plant import simulate
from .strengths import RULES, Values

# residual over noise that an effect leaves after a re-fit: what is aimed at, and what is taken
AIM = (1.6, 18.0)
TAKEN = (1.5, 20.0)
# what the plant raises where the drive loses the machine, or where no current makes the flux
TOO_STRONG = (RuntimeError, ZeroDivisionError)
FAST_SHARE = 0.25
# effects that a held rotor shows, and how often they are looked for there
AT_STANDSTILL = {"dead_time", "saturation_d", "saturation_q", "rs_thermal_drift"}
LOCKED_SHARE = 0.15
DURATION = (1.7, 2.3)
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


def severity(where: Setting, effects: Values, log: str) -> float:
    """Worst channel's residual over noise in the recording, every base parameter re-fitted."""
    duration = min(where.duration, STIFF_DURATION) if STIFF & set(effects) else where.duration
    m = make(where.machine, where.manoeuvre, where.load, duration=duration, seed=1000 * where.seed)
    nameplate = nameplate_of(where.machine, where.seed)
    run = simulate(where.machine, effects, m, seed=1000 * where.seed, nameplate=nameplate)
    return seen_in(log, max(account(where.machine, effects, m, run)["plain_refit"].values()))


def draw(
    where: Setting, name: str, log: str, rng: np.random.Generator
) -> tuple[dict[str, float], float] | None:
    """Parameters of an effect that leave a severity drawn from AIM, and that severity.

    None if no strength up to the rule's greatest leaves one within TAKEN.  The residual of an effect adds to
    the noise in squares, which gives the next strength to try.
    """
    greatest, rule = RULES[name]
    aim = math.exp(rng.uniform(math.log(AIM[0]), math.log(AIM[1])))
    form, s = int(rng.integers(2**32)), 1.0
    for _ in range(5):
        # the same stream each time: only the strength changes
        g = np.random.default_rng(form)
        values = rule(where.machine, s, lambda a, b, g=g: float(g.uniform(a, b)), g)
        try:
            found = severity(where, {name: values}, log)
        except TOO_STRONG:
            found = math.inf
            s *= 0.3
            continue
        if TAKEN[0] <= found <= TAKEN[1] and 0.6 < found / aim < 1.6:
            return values, found
        wanted = s * math.sqrt((aim**2 - 1.0) / max(found**2 - 1.0, 1e-3))
        if s == greatest and wanted > s:
            break
        s = min(greatest, max(0.05 * s, min(20.0 * s, wanted)))
    return (values, found) if TAKEN[0] <= found <= TAKEN[1] else None


def settings(number: int, seed: int, planned: Planned) -> Iterator[Setting]:
    """The planned setting of a case, then others for effects that the planned one does not show."""
    rng = np.random.default_rng([seed, 1, number])
    loads = [k for k in LOADS if k != "locked"]
    machine, load = planned.machine, planned.load
    may_lock = planned.kind in ("single", "clean") and planned.simulator == "plant"
    for attempt in range(12):
        if attempt:
            machine, load = str(rng.choice(list(MACHINES))), str(rng.choice(loads))
        manoeuvre = "fast" if rng.uniform() < FAST_SHARE else "rich"
        locked = rng.uniform() < LOCKED_SHARE and may_lock and set(planned.effects) <= AT_STANDSTILL
        duration = round(float(rng.uniform(*DURATION)), 2)
        case_seed = int(rng.integers(1, 2**31 // 1000))
        own = another(MACHINES[machine], rng)
        if locked and not attempt:
            yield Setting(own, "locked", "locked", duration, case_seed)
        # the strength of a poor case is the one that a rich manoeuvre would show
        yield Setting(own, "rich" if planned.kind == "poor" else manoeuvre, load, duration, case_seed)


def generate(number: int, seed: int, planned: Planned, out: Path) -> dict[str, Any]:
    """Make one case in out/open and out/sealed and return its truth; it depends on `seed`, `number` and
    `planned` alone.

    Raises RuntimeError if no setting shows the effects, ImportError if the simulator is not installed.
    """
    rng = np.random.default_rng([seed, 2, number])
    case, names = name_of(number), planned.effects
    held = (planned.log, planned.simulator) == ("full", "plant") and planned.kind in HELD
    held &= "voltage_delay" not in names and np.random.default_rng([seed, 4, number]).uniform() < HELD_SHARE
    draft = out / f".{case}"
    for where in settings(number, seed, planned):
        if "asymmetric_friction" in names and where.load.startswith("unknown"):
            # Coulomb friction and a constant load are the same equation
            continue
        drawn = [x for name in names if (x := draw(where, name, planned.log, rng)) is not None]
        if len(drawn) < len(names):
            continue
        effects = {name: values for name, (values, _) in zip(names, drawn, strict=True)}
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
            )
        except TOO_STRONG:
            # the validation run, or both effects together, cannot be driven
            continue
        plain = seen_in(planned.log, max(truth["runs"]["recording"]["plain_refit"].values()))
        if planned.kind == "single" and not 0.9 * TAKEN[0] <= plain <= 1.1 * TAKEN[1]:
            # another simulator, or the whole of a stiff run, shows more or less of it
            continue
        truth["kind"], truth["severity"] = planned.kind, round(plain, 4)
        truth["alone"] = {name: round(size, 3) for name, (_, size) in zip(names, drawn, strict=True)}
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
