"""Which parts of a truth an answer names, where it puts what remains, and whether its intervals hold."""

from __future__ import annotations

from typing import Any

import numpy as np

# a part that leaves less by itself is not asked for
STRONG = 2.0
# laws of which one holds the other: either name counts
NESTED = ({"coulomb_friction", "stribeck_friction"},)
# parameters with binding names, in families that share a size
COMPARED: dict[str, tuple[tuple[str, ...], ...]] = {
    "coulomb_friction": (("tau_c",),),
    "stribeck_friction": (("tau_c", "tau_s"), ("w_s",)),
    "quadratic_drag": (("k",),),
    "cogging_torque": (("tau_cog",), ("order_mech",)),
    "cogging_asymmetry": (("tau_slots", "tau_poles"), ("order_slots",)),
    "two_mass_shaft": (("f_antires", "f_res"),),
    "load_torque_pulsation": (("tau_pul",),),
    "gravity_torque": (("tau_g",),),
    "time_varying_load": (("amplitude",), ("f",)),
    "back_emf_harmonics": (("e5_rel", "e7_rel"),),
    "iron_loss": (("r_c",),),
    "dead_time": (("v_err",),),
    "voltage_delay": (("extra_samples",),),
    "dc_link_sag": (("r_source",),),
    "phase_resistance_imbalance": (("r_excess_rel",),),
    "current_offset": (("o_a", "o_b", "o_c"),),
    "encoder_angle_offset": (("offset_el_rad",),),
    "encoder_delay": (("t_delay",),),
    "encoder_eccentricity": (("amplitude_el_rad",),),
    "encoder_harmonics": (("amplitude_1_el_rad", "amplitude_2_el_rad"),),
}


def compare(
    found: dict[str, Any], wanted: dict[str, dict[str, float]], effect: str
) -> tuple[float | None, list[bool]]:
    """Median relative error of an effect's binding parameters, and whether each 95 % interval holds the
    truth."""
    truth, errors, inside = wanted.get(effect, {}), [], []
    for family in COMPARED.get(effect, ()):
        size = max((abs(truth[k]) for k in family if k in truth), default=0.0)
        for name in family:
            value = found.get(name, {}).get("value")
            if name not in truth or value is None or size == 0.0:
                continue
            errors.append(abs(float(value) - truth[name]) / size)
            if interval := found[name].get("ci95"):
                inside.append(bool(interval[0] <= truth[name] <= interval[1]))
    return (float(np.median(errors)) if errors else None), inside


def same(one: str, other: str) -> bool:
    """Whether two names count as one."""
    return one == other or any({one, other} <= group for group in NESTED)


def among(name: str, names: set[str]) -> bool:
    """Whether a name counts as one of the names."""
    return any(same(name, other) for other in names)


def claimed(answer: dict[str, Any]) -> list[str]:
    """Effects of the answer's model."""
    return list((answer.get("model") or {}).get("effects") or ())


def strong_parts(truth: dict[str, Any]) -> list[str]:
    """Known effects that leave at least STRONG times the noise by themselves."""
    return [k for k in truth["components"] if truth.get("alone", {}).get(k, 0.0) >= STRONG]


def found_parts(truth: dict[str, Any], answer: dict[str, Any]) -> int:
    """How many of the strong parts stand in the model, or are listed as equivalent to what stands there."""
    names = set(claimed(answer))
    listed = [r for r in answer.get("ranking") or () if r["effect"] in names]
    names |= {e for r in listed for e in r.get("equivalent_to") or ()}
    return sum(among(part, names) for part in strong_parts(truth))


def posteriors(answer: dict[str, Any], accepted: set[str]) -> list[tuple[float, bool]]:
    """Probability of every effect of the ranking, and whether it is there."""
    ranking = answer.get("ranking") or ()
    return [(float(r.get("probability") or 0.0), among(r["effect"], accepted)) for r in ranking]


def sure_and_wrong(answer: dict[str, Any], accepted: set[str], confident: float) -> list[str]:
    """Effects with a probability above `confident` that are neither there nor equivalent to what is there."""
    return [
        r["effect"]
        for r in answer.get("ranking") or ()
        if float(r.get("probability") or 0.0) > confident
        and not any(among(e, accepted) for e in (r["effect"], *(r.get("equivalent_to") or ())))
    ]


def covered(answer: dict[str, Any], truth: dict[str, Any]) -> list[bool]:
    """Whether each 95 % interval of a named effect that is there, or of the base, holds the truth."""
    names = set(claimed(answer)) & set(truth["components"])
    out = []
    for r in answer.get("ranking") or ():
        if r["effect"] in names:
            out += compare(r.get("parameters") or {}, truth["parameters"], r["effect"])[1]
    return out


def covered_base(answer: dict[str, Any], truth: dict[str, Any]) -> list[bool]:
    """Whether each 95 % interval of a base parameter holds the true value; beside a foreign form, which no
    model holds, there is nothing to ask."""
    if truth.get("foreign"):
        return []
    base = (answer.get("model") or {}).get("base") or {}
    said = {k: v.get("ci95") for k, v in base.items() if k in truth["base_true"]}
    return [bool(ci[0] <= truth["base_true"][k] <= ci[1]) for k, ci in said.items() if ci]


def variables_of(entry: dict[str, Any]) -> set[str]:
    """Variables over which an entry of `remaining`, of `located` or a term of the map says that it acts."""
    out = set(entry.get("over") or ())
    out |= {w["variable"] for w in (*(entry.get("where") or ()), *(entry.get("variables") or ()))}
    orders = {"order_electrical": "theta_e", "order_mechanical": "theta_m", "frequency_hz": "t", "trend": "t"}
    return out | {name for key, name in orders.items() if entry.get(key) is not None}


def located(truth: dict[str, Any], answer: dict[str, Any]) -> tuple[bool, bool] | None:
    """Whether what remains is put into an equation in which a foreign form acts or shows, and there over one
    of its variables; None without a foreign form.

    What counts is the greatest of `remaining` and the terms of the map; an answer without either is judged by
    `located`: by its first entry, or by any where known effects act, too.
    """
    forms = (truth.get("foreign") or {}).values()
    if not forms:
        return None
    equations = {e for form in forms for e in (*form["equations"], *form.get("shows", ()))}
    over = {v for form in forms for v in form["over"]}
    left = sorted(
        answer.get("remaining") or (), key=lambda r: -max((r.get("times_noise") or {0: 0.0}).values())
    )
    terms = ((answer.get("model") or {}).get("unmodelled") or {}).get("terms") or []
    places = [*left[:1], *terms]
    if not places:
        places = (answer.get("located") or [])[: None if truth["components"] else 1]
    right = [p for p in places if p.get("equation") in equations]
    return bool(right), any(variables_of(p) & over for p in right)


def share_off(answer: dict[str, Any]) -> float | None:
    """How far the share that a map takes away lies from the share by the answer's own `fit`; None without a
    map, and beside effects, of which `fit` states no residual.

    The share is that of the squares above the noise, over all channels of the validation run; a channel below
    its noise has none.
    """
    model = answer.get("model") or {}
    stated = (model.get("unmodelled") or {}).get("gain_held_out")
    noise, fit = answer.get("noise_floor") or {}, (answer.get("fit") or {}).get("validation") or {}
    if stated is None or model.get("effects") or not fit:
        return None
    above = {
        when: sum(max((fit[when][c] / noise[c]) ** 2 - 1.0, 0.0) for c in noise)
        for when in ("before", "after")
    }
    return abs(float(stated) - (1.0 - float(above["after"] / above["before"])))
