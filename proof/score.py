"""Judges one answer by its sealed truth.

How a case counts, by what was put in (`kind` of the truth):

single   one effect of the catalogue. *Named*: verdict "named" and the effect is first. *First*: first under
         "named", "partial" or "ambiguous". *In the first two*: among the first two of the ranking under
         these verdicts. Where the truth lists look-alikes (`indistinguishable`), naming one of them, or an
         ambiguous set that holds the effect or one of them, is right. *Identifiable*: no look-alikes, a
         severity of at least 1.5 in the log that the tool got, not shortened. Severity is the plain
         machine's residual over the noise with every base parameter re-fitted, in the worst channel.
pair     right if both are in `model.effects`; one of two is counted apart.
whole    three to seven effects. Right: every strong part (2 times the noise by itself) is found, no name is
         wrong, and the verdict is "named" or "partial".
foreign  a form outside the catalogue, 5 to 500 times the noise, alone or beside known effects. Right alone:
         "unknown", or names that the truth accepts. Right beside: every strong known effect and no wrong
         name under "partial", or under "named" where a name that the truth accepts for the form is among
         them.
unknown  a form outside the catalogue of the strength of singles. Right: "unknown", or a name the truth
         accepts.
clean    nothing was put in. Right: "no_mismatch" without a false alarm, which is any verdict but
         "no_mismatch" and "undetermined", or a probability above 0.5 under any verdict.
limited  an effect that shows in a limited log. Right: it is found, or an ambiguous set holds it, and no name
         is wrong with confidence.
poor     constant speed and load, which hides most effects. Right: "ambiguous" with the effect in the set;
         the right name; "no_mismatch" where the severity is below 1.15.

*Found* is a strong part that stands in the model, or is listed as equivalent to what stands there; of nested
frictions either name counts. *Wrong with confidence*: a probability above 0.5 for an effect that is neither
there nor accepted nor equivalent to what is, under any verdict, in a case of any kind. *Ambiguity is honest*:
the set of an ambiguous answer holds an effect that is there. *Right equation*: the first of `located` is one
in which the effect acts; cases with an effect, poor ones left out; foreign forms: see `parts.located`.
*Parameter error*: median over the parameters whose names answers guarantee, of |found − true| over the
greatest true value of their family; the effect's own case and first place only. *Covered*: share of 95 %
intervals that hold the truth. *Held out*: rms of measured minus the trajectory file's model on the validation
run over the least that true equations leave there (the noise really added; in the speed also what noisy
currents and a noisy load torque do to a free run), in the worst channel, "before" and "after"; *remaining* is
"after" over the noise alone; full logs only. It is computed here and never taken from the answer; a
trajectory that knows the noise (correlated with it, or below it) is flagged as copied. *Calibration*: the
probability of every effect of a ranking against whether that effect is there or accepted. *Share of a map*:
see `parts.share_off`.

A case without an answer counts as wrong. Cases with `degraded` in the truth are bench-like or limited logs
and are counted apart from full ones.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from .heldout import columns, held_out
from .parts import (
    among,
    claimed,
    compare,
    covered,
    covered_base,
    found_parts,
    located,
    posteriors,
    share_off,
    strong_parts,
    sure_and_wrong,
)

IDENTIFIABLE = 1.5
# a mismatch that hides in the noise
INVISIBLE = 1.15
CONFIDENT = 0.5
# verdicts that name
NAMING = ("named", "partial", "ambiguous")


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
    family: str = ""
    known: int = 0
    strong: int = 0
    found: int = 0
    names: int = 0
    names_right: int = 0
    posteriors: list[tuple[float, bool]] = field(default_factory=list)
    base_intervals: list[bool] = field(default_factory=list)
    foreign_equation: bool | None = None
    foreign_variable: bool | None = None
    mapped: bool = False
    share_off: float | None = None
    remaining: float | None = None
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
    said_name = verdict in NAMING
    wrong = sure_and_wrong(answer, accepted, CONFIDENT)
    names = claimed(answer)
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
        wrong_confident=bool(wrong),
        first_right=first in accepted if ranking else None,
        family=truth.get("family", truth["kind"]),
        known=len(there),
        strong=len(strong_parts(truth)),
        found=found_parts(truth, answer),
        names=len(names),
        names_right=sum(among(name, accepted) for name in names),
        posteriors=posteriors(answer, accepted),
        intervals=covered(answer, truth),
        base_intervals=covered_base(answer, truth),
        mapped=bool((answer.get("model") or {}).get("unmodelled")),
        share_off=share_off(answer),
        cpu_seconds=cost.get("cpu_seconds"),
        seconds=cost.get("seconds"),
        memory_mb=cost.get("memory_mb"),
        said=str(cost.get("said", "")),
    )
    all_found, none_wrong = row.found == row.strong, row.names_right == row.names
    if row.kind == "clean":
        row.false_alarm = verdict not in ("no_mismatch", "undetermined", "no answer") or bool(wrong)
        row.right = verdict == "no_mismatch" and not row.false_alarm
    elif row.kind == "unknown":
        row.right = verdict == "unknown" or (said_name and first in accepted)
    elif row.kind == "foreign" and not there:
        row.right = not wrong and (verdict == "unknown" or (said_name and bool(names) and none_wrong))
    elif row.kind == "foreign":
        form_named = verdict == "named" and any(among(name, set(truth["also_accept"])) for name in names)
        row.right = (verdict == "partial" or form_named) and all_found and none_wrong and not wrong
    elif row.kind == "whole":
        row.right = verdict in ("named", "partial") and all_found and none_wrong and not wrong
    elif row.kind == "limited":
        row.right = (
            not wrong and said_name and (bool(there & near) or all(among(k, set(names)) for k in there))
        )
    elif row.kind == "pair":
        model = set(names)
        row.right, row.one_of_two = there <= model, bool(there & model)
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
        places = answer.get("located") or [{}]
        row.equation_right = places[0].get("equation") in {x for v in truth["accept"].values() for x in v}
    if truth.get("foreign"):
        row.foreign_equation, row.foreign_variable = located(truth, answer) or (None, None)
    if row.kind == "single" and row.named_first:
        row.parameter_error = compare(ranking[0].get("parameters") or {}, truth["parameters"], first)[0]
    return row


def judge_case(case: str, out: Path) -> Judged:
    """Judge a case of the set in `out` from its files.  Raises FileNotFoundError if it has no truth."""
    truth = json.loads((out / "sealed" / case / "truth.json").read_text(encoding="utf-8"))
    stem = out / "answers" / case
    row = judge(case, truth, read(stem.with_suffix(".json")), read(stem.with_suffix(".cost.json")))
    if row.log == "full" and stem.with_suffix(".parquet").exists():
        with np.load(out / "sealed" / case / "clean.npz") as clean:
            run = truth["runs"]["validation"]
            found = held_out(
                columns(stem.with_suffix(".parquet")),
                columns(out / "open" / case / "validation.parquet"),
                {k: clean[k].astype(float) for k in clean.files},
                run["least_rms"],
                run["noise_rms"],
            )
        row.held_out_before, row.held_out_after = found.before, found.after
        row.remaining, row.copied = found.remaining, found.copied
    return row
