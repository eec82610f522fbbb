"""The rival models of an answer: each with the parameters that it may adjust, and how far."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..model import Model
from ..results.registry import effect as entry

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from ..results.findings import DiagnosisValues

    Array = NDArray[np.float64]

# Rivals that are compared at most.
MOST = 4
# An effect of less probability is no rival, and beyond the other one what was named has none.
_CREDIBLE, _SURE = 0.05, 0.95
_ELECTRICAL, _MECHANICAL = ("r_s", "l_d", "l_q", "psi_m"), ("j", "b")
# Parameters that count something: which phase, which order.
_COUNTS = ("phase", "order_mech")
# A nameplate value is right to a fifth, which is what a rival may do without any recording.
_NAMEPLATE = 0.2


@dataclass(frozen=True)
class Parameter:
    """A parameter that a rival may adjust: "j" or "coulomb_friction.tau_c", its value, the range within which
    it is expected around that (one standard deviation), and its least value.
    """

    name: str
    value: float
    spread: float
    least: float

    def moved(self, value: float) -> Parameter:
        """The same parameter at another value."""
        return replace(self, value=max(value, self.least))


@dataclass(frozen=True)
class Rival:
    """A model in question, its name, its free parameters, and whether the equation of motion alone is
    compared.
    """

    name: str
    model: Model
    free: tuple[Parameter, ...]
    motion: bool = False

    def at(self, values: Sequence[float] | Array) -> Rival:
        """The rival with other values of its free parameters."""
        free = tuple(p.moved(float(x)) for p, x in zip(self.free, values, strict=True))
        values_of = {p.name: p.value for p in free}
        return replace(self, model=with_values(self.model, values_of), free=free)

    @property
    def values(self) -> Array:
        """Values of the free parameters, shape (n,)."""
        return np.array([p.value for p in self.free])

    @property
    def text(self) -> str:
        """The model as the core reads it."""
        told = dict(self.model.specification)
        if self.motion:
            told["reading"] = {**reading_of(self.model), "electrical": False}
        return json.dumps(told, allow_nan=False)


def reading_of(model: Model) -> dict[str, Any]:
    """How recordings are read for a model: whether it holds for the voltage equations (`electrical`), and for
    the equation of motion (`mechanical`).
    """
    return {"electrical": True, "mechanical": True, **model.specification.get("reading", {})}


def with_values(model: Model, values: Mapping[str, float]) -> Model:
    """The model with other values of some parameters, named as in `Rival`."""
    specification = dict(model.specification)
    base = {name: values.get(name, x) for name, x in specification["base"].items()}
    effects = [
        {
            **choice,
            "parameters": {
                name: values.get(f"{choice['effect']}.{name}", x) for name, x in choice["parameters"].items()
            },
        }
        for choice in specification["effects"]
    ]
    return Model({**model.to_dict(), "specification": {**specification, "base": base, "effects": effects}})


def of(answer: DiagnosisValues) -> list[Rival]:
    """The model of the answer, and those in which something else stands in the place of one of its effects;
    that model alone where it has no rival.

    Rivals are candidates that the recording cannot tell from an effect of the model, or whose probability
    overlaps with it. Where an effect is not certain, the model without it is one, too. Raises UsageError
    where the answer has no model.
    """
    best = Model(answer.data["model"])
    specification = best.specification
    wanted: list[tuple[str, str | None]] = []
    ranked = {candidate.effect: candidate for candidate in answer.ranking}
    for name in best.effects:
        found = ranked.get(name)
        if found is None:
            continue
        wanted += [(name, other) for other in found.equivalent_to]
        alike = entry(name)["look_alikes"]
        if found.probability < _SURE:
            wanted += [
                (name, other.effect)
                for other in answer.ranking
                if other.effect in alike and other.probability >= _CREDIBLE
            ]
            if not any(replaced == name for replaced, _ in wanted):
                wanted.append((name, None))
    chosen = [(a, b) for a, b in dict.fromkeys(wanted) if b is None or b not in best.effects]
    models: dict[str, Model] = {" and ".join(best.effects) or "the dq-model": best}
    for replaced, other in chosen[: MOST - 1]:
        kept = [x for x in specification["effects"] if x["effect"] != replaced]
        if other is not None and other in ranked:
            values = {k: x.value for k, x in ranked[other].parameters.items()}
            kept.append({"effect": other, "parameters": _filled(other, values)})
        name = " and ".join(x["effect"] for x in kept) or "the dq-model"
        if name not in models:
            data = {**best.to_dict(), "effects": [x["effect"] for x in kept], "covariance": None}
            models[name] = Model({**data, "specification": {**specification, "effects": kept}})
    motion = only_motion(list(models.values()))
    return [Rival(name, model, free(model, motion), motion) for name, model in models.items()]


def _filled(effect: str, values: Mapping[str, float | None]) -> dict[str, float]:
    """Values of all parameters in the equations of an effect; those that the answer does not state are
    typical."""
    told = {}
    for p in entry(effect)["parameters"]:
        given = values.get(p["name"])
        told[p["name"]] = float(p["typical"] if given is None else given)
    return told


def plain(rival: Rival) -> Rival:
    """The dq-model of a rival, without any effect."""
    data = rival.model.to_dict()
    specification = {**rival.model.specification, "effects": [], "map": []}
    model = Model({**data, "effects": [], "covariance": None, "specification": specification})
    return Rival("the dq-model", model, free(model, rival.motion), rival.motion)


def only_motion(models: Sequence[Model]) -> bool:
    """Whether the models differ in the equation of motion alone: the voltage equations then say the same of
    all.
    """
    names = {name for m in models for name in m.effects}
    differing = {name for name in names if not all(name in m.effects for m in models)}
    reading = reading_of(models[0])
    both = reading["mechanical"] and reading["electrical"]
    return bool(differing) and both and all(entry(x)["acts_in"] == "mechanical" for x in differing)


def free(model: Model, motion: bool = False) -> tuple[Parameter, ...]:
    """The parameters that a model may adjust; with `motion` those of the equation of motion alone, in which
    the torque of the currents is given.
    """
    specification = model.specification
    reading, scales, base = reading_of(model), specification["scales"], specification["base"]
    names: list[str] = []
    if reading["electrical"] and not motion:
        names += _ELECTRICAL
    if reading["mechanical"]:
        names += _MECHANICAL
    torque, speed = scales["tau_max"], scales["omega_e_max"] / scales["n_p"]
    found = []
    for name in names:
        value = base[name]
        spread = _NAMEPLATE * abs(value)
        if name == "b":
            # No data sheet states it; it may be anything up to a tenth of the torque at full speed.
            spread = max(abs(value), 0.1 * torque / max(speed, 1e-12))
        found.append(Parameter(name, value, max(spread, 1e-12), 0.0 if name == "b" else 1e-3 * value))
    for choice in specification["effects"]:
        about = entry(choice["effect"])
        if motion and about["acts_in"] != "mechanical":
            continue
        for p in about["parameters"]:
            if p["name"] in _COUNTS:
                continue
            value = choice["parameters"][p["name"]]
            spread = max(abs(value), _size(p, scales))
            found.append(
                Parameter(
                    f"{choice['effect']}.{p['name']}",
                    value,
                    spread,
                    0.0 if p["low"] == 0.0 else 1e-3 * abs(value) if p["low"] > 0.0 else -math.inf,
                )
            )
    return tuple(found)


def _size(p: Mapping[str, Any], scales: Mapping[str, Any]) -> float:
    """What a parameter of this unit may be on this motor."""
    torque, speed = scales["tau_max"], max(scales["omega_e_max"] / scales["n_p"], 1e-12)
    of_unit = {
        "N m": torque,
        "N m s": torque / speed,
        "N m s^2": torque / speed**2,
        "V": scales["v_max"],
        "A": scales["i_max"],
    }
    return max(0.1 * float(of_unit.get(p["unit"], abs(p["typical"]))), 1e-12)
