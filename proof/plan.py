"""What the cases of a set are, drawn from its seed alone before any of them is made."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from . import bench
from .effects import CATALOGUE
from .machines import MACHINES
from .manoeuvres import LOADS

# (kind, log, simulator) -> share of a set; single effects on full logs of the own plant take the rest
SHARES = {
    ("clean", "full", "plant"): 0.10,
    ("clean", "full", "motulator"): 0.02,
    ("clean", "full", "gym-electric-motor"): 0.02,
    ("pair", "full", "plant"): 0.08,
    ("unknown", "full", "plant"): 0.08,
    ("poor", "full", "plant"): 0.06,
    ("clean", "bench", "plant"): 0.05,
    ("single", "bench", "plant"): 0.20,
    ("single", "full", "motulator"): 0.05,
    ("single", "full", "gym-electric-motor"): 0.02,
}
REST = ("single", "full", "plant")
KNOWN = tuple(k for k in CATALOGUE if not k.startswith("x_"))
FOREIGN = tuple(k for k in CATALOGUE if k.startswith("x_"))
# what the other simulators have equations of their own for
OFFERED = {
    "motulator": ("saturation_q", "saturation_d", "two_mass_shaft", "quadratic_drag", "coulomb_friction"),
    "gym-electric-motor": ("coulomb_friction", "quadratic_drag"),
}
# a pair of these would be one friction curve
FRICTION = {
    "coulomb_friction",
    "stribeck_friction",
    "asymmetric_friction",
    "load_dependent_friction",
    "quadratic_drag",
}


@dataclass(frozen=True)
class Planned:
    """One case before it is made.

    kind: clean, single, pair, unknown or poor; effects: names; machine and load: names of the first setting
    tried; log: "full" or a kind of bench.KINDS; simulator: "plant", "motulator" or "gym-electric-motor".
    """

    kind: str
    effects: tuple[str, ...]
    machine: str
    load: str
    log: str
    simulator: str


def name_of(number: int) -> str:
    """Name of a case, which is the name of its folders."""
    return f"v{number:03d}"


def dealt(rng: np.random.Generator, cards: Sequence[str]) -> Iterator[str]:
    """The cards in random order, reshuffled whenever all have been dealt."""
    while True:
        for k in rng.permutation(len(cards)):
            yield cards[int(k)]


def pair(deck: Iterator[str]) -> tuple[str, str]:
    """The next two effects that can act together and are two things."""
    first = next(deck)
    while True:
        second = next(deck)
        both = {first, second}
        if len(both) == 2 and not both <= FRICTION and both != {"iron_loss", "inter_turn_short"}:
            return first, second


def plan(cases: int, seed: int) -> list[Planned]:
    """All cases of the set of `cases` and `seed`, in the order in which they are made.

    Every deck has an order of its own, so that each kind meets all machines and loads, the singles all
    effects, and the bench-like logs all loggers.  The order is random: what an interrupted run has made is a
    fair sample.  Raises ValueError for fewer than one case.
    """
    if cases < 1:
        raise ValueError("a set has at least one case")
    rng = np.random.default_rng([seed, 0])
    counts = {slot: round(share * cases) for slot, share in SHARES.items()}
    counts[REST] = max(cases - sum(counts.values()), 0)
    effects = {
        ("single", "plant", "full"): dealt(rng, KNOWN),
        ("single", "plant", "bench"): dealt(rng, KNOWN),
        **{("single", who, "full"): dealt(rng, names) for who, names in OFFERED.items()},
    }
    others, foreign = dealt(rng, KNOWN), dealt(rng, FOREIGN)
    out = []
    for (kind, log, simulator), count in counts.items():
        machines = dealt(rng, list(MACHINES))
        loads = dealt(rng, [k for k in LOADS if k != "locked"])
        loggers = dealt(rng, bench.KINDS)
        for _ in range(count):
            names: tuple[str, ...] = ()
            if kind == "unknown":
                names = (next(foreign),)
            elif kind == "pair":
                names = pair(others)
            elif kind == "poor":
                names = (next(others),)
            elif kind == "single":
                names = (next(effects[kind, simulator, log]),)
            logger = next(loggers) if log == "bench" else "full"
            out.append(Planned(kind, names, next(machines), next(loads), logger, simulator))
    return [out[int(k)] for k in rng.permutation(len(out))][:cases]
