"""Makes a set of concealed cases nobody has looked at, drawn over effects, machines, manoeuvres, loads and
strengths.

python -m proof.generate --out cases --cases 60 --seed 1          # from the root of the repository

`OUT/open/<case>` is what the tool may see, `OUT/sealed/<case>` the truth.  Case `v007` depends on --cases,
--seed and its number alone: an interrupted run goes on where it stopped and ends with the same files.
Two cases in five are controls (`SHARES`): clean, pairs, unknown, poor.  The rest are single effects of the
catalogue, every one before any twice.
"""

from __future__ import annotations

import argparse
import json
import math
import shutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .case import account, make_case, nameplate_of, write_text
from .effects import CATALOGUE
from .machines import MACHINES
from .manoeuvres import LOADS, make
from .parameters import Machine
from .plant import simulate

SHARES = {"clean": 4 / 30, "pair": 3 / 30, "unknown": 3 / 30, "poor": 2 / 30}
# residual over noise that an effect leaves after a re-fit: what is aimed at, and what is taken
AIM = (1.5, 15.0)
TAKEN = (1.3, 20.0)
# what the plant raises where the drive loses the machine, or where no current makes the flux
TOO_STRONG = (RuntimeError, ZeroDivisionError)
FAST_SHARE = 0.25
DURATION = (1.7, 2.3)
# a pair of these would be one friction curve
FRICTION = {
    "coulomb_friction",
    "stribeck_friction",
    "asymmetric_friction",
    "load_dependent_friction",
    "quadratic_drag",
}

Values = dict[str, dict[str, float]]
Rule = Callable[[Machine, float, Callable[[float, float], float], np.random.Generator], dict[str, float]]


def spread(machine: Machine, s: float, rng: np.random.Generator, size: float, names: str) -> dict[str, float]:
    """Three values of size·s whose mean is zero: a common part would be another machine, not a fault."""
    x = rng.standard_normal(3)
    x -= x.mean()
    x *= size * s / np.abs(x).max()
    return {f"{names}_{phase}": float(v) for phase, v in zip("abc", x, strict=True)}


# effect -> (greatest s, parameters at strength s); s = 1 is a moderate case in the machine's own units:
# torque against rated torque, voltage against the DC link, inductance and flux against themselves
RULES: dict[str, tuple[float, Rule]] = {
    "coulomb_friction": (5, lambda m, s, u, g: {"tau_c": 0.03 * s * m.tau_rated}),
    "stribeck_friction": (
        5,
        lambda m, s, u, g: {
            "tau_c": 0.02 * s * m.tau_rated,
            "tau_s": 0.02 * s * m.tau_rated * u(1.6, 3.0),
            "w_s": u(0.02, 0.1) * m.w_rated,
        },
    ),
    "asymmetric_friction": (
        5,
        lambda m, s, u, g: {
            "tau_c_pos": 0.03 * s * m.tau_rated,
            "tau_c_neg": 0.03 * s * m.tau_rated * (u(0.2, 0.6) if u(0, 1) < 0.5 else u(1.5, 3.0)),
        },
    ),
    "load_dependent_friction": (5, lambda m, s, u, g: {"mu": 0.05 * s}),
    "quadratic_drag": (8, lambda m, s, u, g: {"k": 0.05 * s * m.tau_rated / m.w_rated**2}),
    "cogging_torque": (
        8,
        lambda m, s, u, g: {
            "tau_cog": 0.02 * s * m.tau_rated,
            "order_mech": float(m.n_p * g.choice([2, 4, 6])),
            "phase": u(-math.pi, math.pi),
            "second_rel": u(0.0, 0.4),
        },
    ),
    "load_torque_pulsation": (
        8,
        lambda m, s, u, g: {
            "tau_pul": 0.03 * s * m.tau_rated,
            "per_rev": float(g.choice([1, 1, 2, 3])),
            "phase": u(-math.pi, math.pi),
        },
    ),
    "time_varying_load": (
        8,
        lambda m, s, u, g: {
            "amplitude": 0.05 * s * m.tau_rated,
            "f": u(1.5, 8.0),
            "phase": u(-math.pi, math.pi),
        },
    ),
    "two_mass_shaft": (
        8,
        lambda m, s, u, g: {
            "f_antires": (f := u(20.0, 80.0)),
            "f_res": f * (1.0 + 0.25 * s),
            "damping": u(0.01, 0.05),
        },
    ),
    "back_emf_harmonics": (
        5,
        lambda m, s, u, g: {
            "phase5": (math.pi if g.choice([-1, 1]) < 0 else 0.0),
            "phase7": (math.pi if (e7 := u(-0.8, 0.8)) < 0 else 0.0),
            "e5_rel": 0.03 * s,
            "e7_rel": abs(e7) * 0.03 * s,
        },
    ),
    "saturation_d": (5, lambda m, s, u, g: {"drop_at_rated": 0.1 * s}),
    "saturation_q": (5, lambda m, s, u, g: {"drop_at_rated": 0.1 * s}),
    "cross_saturation": (5, lambda m, s, u, g: {"psi_drop_at_rated": 0.05 * s}),
    "inductance_harmonics": (5, lambda m, s, u, g: {"rel_6": 0.05 * s, "rel_4": u(0.0, 0.5) * 0.05 * s}),
    "rs_thermal_drift": (3, lambda m, s, u, g: {"rise_at_rated": 0.3 * s, "tau": u(0.5, 2.0)}),
    "magnet_thermal_drift": (
        5,
        lambda m, s, u, g: {"psi_drop_final": 0.04 * s, "tau": u(0.5, 2.0), "speed_share": u(0.0, 0.5)},
    ),
    "iron_loss": (8, lambda m, s, u, g: {"r_c": m.w_rated * m.n_p * m.psi_m / (0.03 * s * m.i_rated)}),
    "dead_time": (6, lambda m, s, u, g: {"v_err": 0.004 * s * m.v_dc}),
    "voltage_delay": (4, lambda m, s, u, g: {"extra_samples": 0.25 * s}),
    "dc_link_sag": (
        5,
        lambda m, s, u, g: {
            "r_source": 0.04 * s * m.v_dc**2 / (m.tau_rated * m.w_rated),
            "c_dc": u(0.5e-3, 3e-3),
        },
    ),
    "phase_resistance_imbalance": (
        8,
        lambda m, s, u, g: {"r_excess_rel": 0.1 * s, "phase_index": float(g.integers(3))},
    ),
    "inter_turn_short": (5, lambda m, s, u, g: {"share": 0.03 * s, "r_fault": u(0.2, 1.0) * m.r_s}),
    "current_offset": (6, lambda m, s, u, g: spread(m, s, g, 0.005 * m.i_rated, "o")),
    "current_gain_imbalance": (6, lambda m, s, u, g: spread(m, s, g, 0.02, "g")),
    "encoder_angle_offset": (8, lambda m, s, u, g: {"offset_el_rad": float(g.choice([-1, 1])) * 0.03 * s}),
    "encoder_eccentricity": (
        6,
        lambda m, s, u, g: {"amplitude_el_rad": 0.03 * s, "phase": u(-math.pi, math.pi)},
    ),
    "x_tight_spot": (
        8,
        lambda m, s, u, g: {
            "tau": 0.1 * s * m.tau_rated,
            "width": u(0.2, 0.5),
            "place": u(-math.pi, math.pi),
        },
    ),
    "x_loose_terminal": (8, lambda m, s, u, g: {"r_extra": 0.3 * s * m.r_s, "f": u(3.0, 15.0)}),
}


@dataclass(frozen=True)
class Setting:
    """Where a case takes place: the machine, the manoeuvre and load by name, the duration in s, the seed."""

    machine: Machine
    manoeuvre: str
    load: str
    duration: float
    seed: int


def dealt(rng: np.random.Generator, cards: Sequence[str]) -> Iterator[str]:
    """The cards in random order, reshuffled whenever all have been dealt."""
    while True:
        for k in rng.permutation(len(cards)):
            yield cards[int(k)]


def plan(cases: int, seed: int) -> list[tuple[str, tuple[str, ...], str, str]]:
    """(kind, effects, machine, load) of every case; the case's own draws come later, from its own stream."""
    rng = np.random.default_rng([seed, 0])
    known = dealt(rng, [k for k in CATALOGUE if not k.startswith("x_")])
    # decks of their own, so that every kind meets all machines and loads and the singles all effects
    others = dealt(rng, [k for k in CATALOGUE if not k.startswith("x_")])
    foreign = dealt(rng, [k for k in CATALOGUE if k.startswith("x_")])
    kinds = [k for k, share in SHARES.items() for _ in range(round(share * cases))]
    kinds += ["single"] * (cases - len(kinds))
    out = []
    for kind in SHARES | {"single": 0.0}:
        machines = dealt(rng, list(MACHINES))
        loads = dealt(rng, [k for k in LOADS if k != "locked"])
        for _ in range(kinds.count(kind)):
            effects: tuple[str, ...] = ()
            if kind == "unknown":
                effects = (next(foreign),)
            elif kind == "pair":
                effects = pair(others)
            elif kind in ("single", "poor"):
                effects = (next(known if kind == "single" else others),)
            out.append((kind, effects, next(machines), next(loads)))
    return [out[int(k)] for k in rng.permutation(cases)]


def pair(deck: Iterator[str]) -> tuple[str, str]:
    """The next two effects that can act together and are two things."""
    first = next(deck)
    while True:
        second = next(deck)
        both = {first, second}
        if len(both) == 2 and not both <= FRICTION and both != {"iron_loss", "inter_turn_short"}:
            return first, second


def severity(where: Setting, effects: Values) -> float:
    """Worst channel's residual over noise in the recording, every base parameter re-fitted."""
    m = make(where.machine, where.manoeuvre, where.load, duration=where.duration, seed=1000 * where.seed)
    nameplate = nameplate_of(where.machine, where.seed)
    run = simulate(where.machine, effects, m, seed=1000 * where.seed, nameplate=nameplate)
    return max(account(where.machine, effects, m, run)["plain_refit"].values())


def draw(where: Setting, name: str, rng: np.random.Generator) -> tuple[dict[str, float], float] | None:
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
            found = severity(where, {name: values})
        except TOO_STRONG:
            found = math.inf
            s *= 0.3
            continue
        if TAKEN[0] <= found <= TAKEN[1] and 0.6 < found / aim < 1.6:
            return values, found
        wanted = s * math.sqrt((aim**2 - 1.0) / max(found**2 - 1.0, 1e-3))
        if s == greatest and wanted > s:
            return (values, found) if TAKEN[0] <= found <= TAKEN[1] else None
        s = min(greatest, max(0.05 * s, min(20.0 * s, wanted)))
    return (values, found) if TAKEN[0] <= found <= TAKEN[1] else None


def settings(number: int, seed: int, kind: str, machine: str, load: str) -> Iterator[Setting]:
    """The planned setting of a case, then others for effects that the planned one does not show."""
    rng = np.random.default_rng([seed, 1, number])
    loads = [k for k in LOADS if k != "locked"]
    for attempt in range(12):
        if attempt:
            machine, load = str(rng.choice(list(MACHINES))), str(rng.choice(loads))
        manoeuvre = "fast" if kind != "poor" and rng.uniform() < FAST_SHARE else "rich"
        yield Setting(
            MACHINES[machine],
            manoeuvre,
            load,
            round(float(rng.uniform(*DURATION)), 2),
            int(rng.integers(1, 2**31 // 1000)),
        )


def generate(
    number: int, seed: int, planned: tuple[str, tuple[str, ...], str, str], out: Path
) -> dict[str, Any]:
    """Make one case in out/open and out/sealed and return its truth.

    A poor case has the strength that the rich manoeuvre would show.  Raises RuntimeError if no setting shows
    the effects.
    """
    kind, names, machine, load = planned
    rng = np.random.default_rng([seed, 2, number])
    for where in settings(number, seed, kind, machine, load):
        if "asymmetric_friction" in names and where.load.startswith("unknown"):
            # Coulomb friction and a constant load are the same equation
            continue
        found = [draw(where, name, rng) for name in names]
        drawn = [x for x in found if x is not None]
        if len(drawn) < len(names):
            continue
        effects = {name: values for name, (values, _) in zip(names, drawn, strict=True)}
        case, draft = f"v{number:03d}", out / f".v{number:03d}"
        shutil.rmtree(draft, ignore_errors=True)
        try:
            truth = make_case(
                draft / "open",
                where.machine,
                effects,
                "poor" if kind == "poor" else where.manoeuvre,
                where.load,
                where.seed,
                truth_folder=draft / "sealed",
                duration=where.duration,
            )
        except TOO_STRONG:
            # the validation run, or both effects together, cannot be driven
            continue
        truth["alone"] = {name: round(size, 3) for name, (_, size) in zip(names, drawn, strict=True)}
        write_text(draft / "sealed" / "truth.json", json.dumps(truth, indent=1) + "\n")
        shutil.rmtree(out / "open" / case, ignore_errors=True)
        for part in ("open", "sealed"):
            (out / part).mkdir(exist_ok=True)
            (draft / part).rename(out / part / case)
        draft.rmdir()
        return truth
    raise RuntimeError(f"case {number}: no setting shows {' and '.join(names)}")


def main() -> None:
    """Make what is missing of the set, one line per case."""
    ap = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    ap.add_argument("--out", type=Path, required=True)
    ap.add_argument("--cases", type=int, default=60)
    ap.add_argument("--seed", type=int, default=1)
    a = ap.parse_args()
    a.out.mkdir(parents=True, exist_ok=True)
    for number, planned in enumerate(plan(a.cases, a.seed)):
        # sealed is moved last, so a truth in its place means a whole case
        if not (a.out / "sealed" / f"v{number:03d}" / "truth.json").exists():
            truth = generate(number, a.seed, planned, a.out)
            refit = truth["runs"]["recording"]["plain_refit"]
            print(f"v{number:03d} {planned[0]}, {max(refit.values()):.2f} times the noise", flush=True)


if __name__ == "__main__":
    main()
