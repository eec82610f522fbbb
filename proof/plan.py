"""What the cases of a set are, drawn from its seed alone before any of them is made."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from . import bench, limits, splits
from .effects import CATALOGUE, ONE_LOAD, ONE_OF
from .manoeuvres import LOADS
from .strengths import RULES

Slot = tuple[str, str, str]
# family -> (kind, log, simulator) -> cases of a set of 600; the first three families make up half of it
FAMILIES: dict[str, dict[Slot, float]] = {
    "singles": {
        ("single", "full", "plant"): 96.0,
        ("single", "full", "motulator"): 15.0,
        ("single", "full", "gym-electric-motor"): 6.0,
    },
    "pairs": {("pair", "full", "plant"): 24.0},
    "bench": {("single", "bench", "plant"): 60.0, ("clean", "bench", "plant"): 15.0},
    "clean": {
        ("clean", "full", "plant"): 30.0,
        ("clean", "full", "motulator"): 6.0,
        ("clean", "full", "gym-electric-motor"): 6.0,
    },
    "poor": {("poor", "full", "plant"): 18.0},
    "unknown": {("unknown", "full", "plant"): 24.0},
    "whole": {("whole", "full", "plant"): 100.0},
    "foreign": {("foreign", "full", "plant"): 50.0, ("foreign beside", "full", "plant"): 50.0},
    "limits": {("clean", "limits", "plant"): 70.0, ("limited", "limits", "plant"): 30.0},
}
# effects that are drawn: those for which `strengths` says how strong
KNOWN = tuple(k for k in CATALOGUE if k in RULES and not k.startswith("x_"))
# what a limited log can show: the ringing of a shaft does not pass a slow or a coarse one
SHOWN = tuple(k for k in KNOWN if k != "two_mass_shaft")
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
# of these one holds the other: a whole bench has at most one, and may have a drag beside it
DRY = ("coulomb_friction", "stribeck_friction", "asymmetric_friction")
# forms whose dry friction or second mass would be one curve, or one state, with these
BESIDE = {
    "x_angle_friction": DRY,
    "x_root_friction": ("quadratic_drag",),
    "x_dahl_presliding": DRY,
    "x_converter_skew": ("voltage_delay",),
}
# number of parts of a whole bench, and of known effects beside a foreign form
PARTS, COMPANIONS = (3, 7), (1, 3)
# effects that cannot act in one simulated machine, or are one curve
APART = (DRY, ONE_OF, ONE_LOAD)


@dataclass(frozen=True)
class Planned:
    """One case before it is made.

    kind: clean, single, pair, unknown, poor, whole, foreign or limited; effects: names; machine and load:
    names of the first setting tried; log: "full", a kind of bench.KINDS or of limits.KINDS; simulator:
    "plant", "motulator" or "gym-electric-motor"; family: one of FAMILIES.
    """

    kind: str
    effects: tuple[str, ...]
    machine: str
    load: str
    log: str
    simulator: str
    family: str = "singles"


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


def together(names: Sequence[str]) -> bool:
    """Whether these effects can act in one machine and are each a thing of its own."""
    there = set(names)
    apart = any(len(there & set(group)) > 1 for group in APART)
    return not apart and not any(there & set(BESIDE.get(name, ())) for name in there)


def chosen(deck: Iterator[str], count: int, first: tuple[str, ...] = ()) -> tuple[str, ...]:
    """`first` and the next `count` effects of a deck that can act together with what is there."""
    names = list(first)
    while len(names) < len(first) + count:
        name = next(deck)
        if name not in names and together([*names, name]):
            names.append(name)
    return tuple(names)


def counted(cases: int, families: Sequence[str]) -> dict[tuple[str, Slot], int]:
    """Cases per family and slot, by largest remainder, so that they add up."""
    shares = {(f, slot): share for f in families for slot, share in FAMILIES[f].items()}
    wanted = {k: cases * share / sum(shares.values()) for k, share in shares.items()}
    counts = {k: int(x) for k, x in wanted.items()}
    for k in sorted(wanted, key=lambda k: counts[k] - wanted[k])[: cases - sum(counts.values())]:
        counts[k] += 1
    return counts


def plan(
    cases: int, seed: int, families: Sequence[str] = tuple(FAMILIES), split: str = "scoring"
) -> list[Planned]:
    """All cases of the set of `cases`, `seed`, families and split, in the order in which they are made.

    Every deck has an order of its own, so that each kind meets all machines and loads, the singles all
    effects, and the bench-like logs all loggers.  The order is random: what an interrupted run has made is a
    fair sample.  Raises ValueError for fewer than one case, an unknown family or split.
    """
    if cases < 1:
        raise ValueError("a set has at least one case")
    if not families or (unknown := [f for f in families if f not in FAMILIES]):
        raise ValueError(f"no family {', '.join(unknown) or 'given'}; there are {', '.join(FAMILIES)}")
    rng = np.random.default_rng([seed, 0])
    decks = {key: dealt(rng, KNOWN) for key in ("full", "bench", "others", "whole", "companions")}
    decks |= {who: dealt(rng, names) for who, names in OFFERED.items()}
    decks["limits"] = dealt(rng, SHOWN)
    decks["forms"] = dealt(rng, splits.forms(split))
    loggers = {"bench": dealt(rng, bench.KINDS), "limits": dealt(rng, limits.KINDS)}
    out = []
    for (family, (kind, log, simulator)), count in counted(cases, families).items():
        machines = dealt(rng, splits.machines(split))
        loads = dealt(rng, [k for k in LOADS if k != "locked"])
        for _ in range(count):
            names: tuple[str, ...] = ()
            if kind in ("unknown", "foreign", "foreign beside"):
                names = (next(decks["forms"]),)
                if kind == "foreign beside":
                    names = chosen(decks["companions"], int(rng.integers(*COMPANIONS, endpoint=True)), names)
            elif kind == "whole":
                names = chosen(decks["whole"], int(rng.integers(*PARTS, endpoint=True)))
            elif kind == "pair":
                names = pair(decks["others"])
            elif kind == "poor":
                names = (next(decks["others"]),)
            elif kind in ("single", "limited"):
                names = (next(decks[log if simulator == "plant" else simulator]),)
            logger = next(loggers[log]) if log in loggers else "full"
            out.append(
                Planned(kind.split()[0], names, next(machines), next(loads), logger, simulator, family)
            )
    return [out[int(k)] for k in rng.permutation(len(out))]
