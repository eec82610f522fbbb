"""Judges one answer by its sealed truth.

How a case counts, by what was put in (`kind` of the truth):

single   one effect of the catalogue. *Named*: verdict "named" and the effect is first. *First*: first under
         "named" or "ambiguous". *In the first two*: among the first two of the ranking under either
         verdict. Where the truth lists look-alikes (`indistinguishable`), naming one of them, or an
         ambiguous set that holds the effect or one of them, is right. *Identifiable*: no look-alikes, a
         severity of at least 1.5 in the log that the tool got, not shortened. Severity is the plain
         machine's residual over the noise with every base parameter re-fitted, in the worst channel.
pair     right if both are in `model.effects`; one of two is counted apart.
clean    nothing was put in. Right: "no_mismatch". A false alarm is "named", "ambiguous" or "unknown";
         "undetermined" is neither.
unknown  something outside the catalogue. Right: "unknown", or a name the truth accepts.
poor     constant speed and load, which hides most effects. Right: "ambiguous" with the effect in the set;
         the right name; "no_mismatch" where the severity is below 1.15.

*Wrong with confidence*: verdict "named" with a first probability above 0.5 for an effect that is neither
there nor accepted, in a case of any kind. *Ambiguity is honest*: the set of an ambiguous answer holds an
effect that is there. *Right equation*: the first of `located` is one in which the effect acts; cases with
an effect, poor ones left out. *Parameter error*: median over the parameters whose names answers guarantee,
of |found − true| over the greatest true value of their family; the effect's own case and first place only.
*Covered*: share of their 95 % intervals that hold the truth. *Held out*: rms of measured minus the
trajectory file's model on the validation run over the least that true equations leave there (the noise
really added; in the speed also what noisy currents and a noisy load torque do to a free run), in the worst
channel, "before" and "after"; full logs only. It is computed here and never taken from the answer; a
trajectory that knows the noise (correlated with it, or below it) is flagged as copied. *Calibration*: the
probability of the first of the ranking against whether that effect is there or accepted, in every case
whose ranking is not empty.

A case without an answer counts as wrong. Cases with `degraded` in the truth are bench-like logs and are
counted apart from full ones.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq

from .reference import park

CHANNELS = ("i_d", "i_q", "omega_e")
IDENTIFIABLE = 1.5
# a mismatch that hides in the noise
INVISIBLE = 1.15
CONFIDENT = 0.5
# a free run below the noise, or one that follows it, was not simulated
COPIED_BELOW, COPIED_CORRELATION = 0.9, 0.15
# parameters with binding names, in families that share a size
COMPARED: dict[str, tuple[tuple[str, ...], ...]] = {
    "coulomb_friction": (("tau_c",),),
    "stribeck_friction": (("tau_c", "tau_s"), ("w_s",)),
    "quadratic_drag": (("k",),),
    "cogging_torque": (("tau_cog",), ("order_mech",)),
    "two_mass_shaft": (("f_antires", "f_res"),),
    "load_torque_pulsation": (("tau_pul",),),
    "time_varying_load": (("amplitude",), ("f",)),
    "back_emf_harmonics": (("e5_rel", "e7_rel"),),
    "iron_loss": (("r_c",),),
    "dead_time": (("v_err",),),
    "voltage_delay": (("extra_samples",),),
    "dc_link_sag": (("r_source",),),
    "phase_resistance_imbalance": (("r_excess_rel",),),
    "current_offset": (("o_a", "o_b", "o_c"),),
    "encoder_angle_offset": (("offset_el_rad",),),
    "encoder_eccentricity": (("amplitude_el_rad",),),
}


@dataclass
class Judged:
    """What became of one case; None where a question does not arise.  See the module for the meanings."""

    case: str
    kind: str
    effect: str
    severity: float
    manoeuvre: str
    load: str
    machine: str
    log: str
    simulator: str
    verdict: str
    first: str | None
    probability: float
    right: bool
    wrong_confident: bool
    identifiable: bool | None = None
    named_first: bool | None = None
    first_two: bool | None = None
    one_of_two: bool | None = None
    false_alarm: bool | None = None
    ambiguity_honest: bool | None = None
    equation_right: bool | None = None
    parameter_error: float | None = None
    intervals: list[bool] = field(default_factory=list)
    first_right: bool | None = None
    held_out_before: float | None = None
    held_out_after: float | None = None
    copied: bool | None = None
    cpu_seconds: float | None = None
    seconds: float | None = None
    memory_mb: float | None = None
    said: str = ""


def read(path: Path) -> dict[str, Any]:
    """A JSON object; an empty one where there is no file or it is not JSON."""
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return found if isinstance(found, dict) else {}


def judge(case: str, truth: dict[str, Any], answer: dict[str, Any], cost: dict[str, Any]) -> Judged:
    """Judge the answer (empty if there is none) of a case, all but what needs its trajectories."""
    ranking = answer.get("ranking") or []
    verdict = str(answer.get("verdict", "no answer"))
    first = ranking[0]["effect"] if ranking else None
    probability = float(ranking[0].get("probability") or 0.0) if ranking else 0.0
    near = {first, *ranking[0].get("equivalent_to", ())} if ranking else set()
    there = set(truth["components"])
    accepted = there | set(truth["indistinguishable"]) | set(truth["also_accept"])
    said_name = verdict in ("named", "ambiguous")
    row = Judged(
        case=case,
        kind=truth["kind"],
        effect=truth["effect"],
        severity=float(truth["severity"]),
        manoeuvre=truth["manoeuvre"],
        load=truth["load"],
        machine=truth["machine"],
        log=truth.get("degraded", "full"),
        simulator=truth["source"],
        verdict=verdict,
        first=first,
        probability=probability,
        right=False,
        wrong_confident=verdict == "named" and first not in accepted and probability > CONFIDENT,
        first_right=first in accepted if ranking else None,
        cpu_seconds=cost.get("cpu_seconds"),
        seconds=cost.get("seconds"),
        memory_mb=cost.get("memory_mb"),
        said=str(cost.get("said", "")),
    )
    if row.kind == "clean":
        row.right = verdict == "no_mismatch"
        row.false_alarm = verdict in ("named", "ambiguous", "unknown")
    elif row.kind == "unknown":
        row.right = verdict == "unknown" or (said_name and first in accepted)
    elif row.kind == "pair":
        claimed = set((answer.get("model") or {}).get("effects") or ())
        row.right, row.one_of_two = there <= claimed, bool(there & claimed)
    elif row.kind == "poor":
        row.right = (
            (verdict == "ambiguous" and bool(there & near))
            or (verdict == "named" and first in there)
            or (verdict == "no_mismatch" and row.severity < INVISIBLE)
        )
    else:
        twins = accepted - there
        row.identifiable = not twins and row.severity >= IDENTIFIABLE and not truth.get("shortened")
        row.named_first = said_name and first in there
        row.first_two = said_name and bool(there & {r["effect"] for r in ranking[:2]})
        row.right = (verdict == "named" and first in accepted) or (
            bool(twins) and verdict == "ambiguous" and bool(accepted & near)
        )
    if verdict == "ambiguous":
        row.ambiguity_honest = bool(accepted & near)
    if truth["accept"] and row.kind != "poor":
        located = answer.get("located") or [{}]
        row.equation_right = located[0].get("equation") in {x for v in truth["accept"].values() for x in v}
    if row.kind == "single" and row.named_first:
        row.parameter_error, row.intervals = compare(
            ranking[0].get("parameters") or {}, truth["parameters"], first
        )
    return row


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


def columns(path: Path) -> dict[str, np.ndarray]:
    """A parquet file as float64 arrays (n,)."""
    table = pq.read_table(path)
    return {name: table[name].to_numpy().astype(float) for name in table.column_names}


def held_out(
    trajectories: dict[str, np.ndarray],
    measured: dict[str, np.ndarray],
    clean: dict[str, np.ndarray],
    floor: dict[str, float],
) -> tuple[float | None, float | None, bool]:
    """Residual over noise of the worst channel before and after, and whether measurements were copied.

    measured: the validation log; clean: its a, b, c and omega without noise; floor: the least rms that true
    equations leave per channel.  Both residuals are None where the trajectories have no channel of them.
    """
    theta = measured["theta_e"]
    truth = dict(zip(CHANNELS[:2], park(clean["a"], clean["b"], clean["c"], theta), strict=True))
    seen = dict(
        zip(CHANNELS[:2], park(measured["i_a"], measured["i_b"], measured["i_c"], theta), strict=True)
    )
    truth["omega_e"], seen["omega_e"] = clean["omega"], measured["omega_e"]
    worst: dict[str, float | None] = {"before": None, "after": None}
    copied = False
    for when in worst:
        for channel in CHANNELS:
            model = trajectories.get(f"{channel}_{when}")
            if model is None or not np.isfinite(model).any():
                continue
            if len(model) != len(theta):
                model = np.interp(measured["t"], trajectories["t"], model, left=np.nan, right=np.nan)
            ok = np.isfinite(model)
            rms = float(np.sqrt(np.mean((seen[channel] - model)[ok] ** 2)))
            worst[when] = max(rms / floor[channel], worst[when] or 0.0)
            if when == "after" and ok.mean() > 0.5:
                noise, error = (seen[channel] - truth[channel])[ok], (model - truth[channel])[ok]
                follows = error.std() > 0.0 and np.corrcoef(noise, error)[0, 1] > COPIED_CORRELATION
                below = rms < COPIED_BELOW * np.sqrt(np.mean(noise**2))
                copied = copied or bool(below or follows)
    return worst["before"], worst["after"], copied


def judge_case(case: str, out: Path) -> Judged:
    """Judge a case of the set in `out` from its files.  Raises FileNotFoundError if it has no truth."""
    truth = json.loads((out / "sealed" / case / "truth.json").read_text(encoding="utf-8"))
    stem = out / "answers" / case
    row = judge(case, truth, read(stem.with_suffix(".json")), read(stem.with_suffix(".cost.json")))
    if row.log == "full" and stem.with_suffix(".parquet").exists():
        with np.load(out / "sealed" / case / "clean.npz") as clean:
            row.held_out_before, row.held_out_after, row.copied = held_out(
                columns(stem.with_suffix(".parquet")),
                columns(out / "open" / case / "validation.parquet"),
                {k: clean[k].astype(float) for k in clean.files},
                truth["runs"]["validation"]["least_rms"],
            )
    return row
