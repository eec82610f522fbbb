"""Answers in a few plain lines, for terminals and as headlines."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping
from pathlib import PurePath
from typing import Any

from .results import DiagnosisValues, Estimate, IdentificationValues, Remaining
from .words import EQUATIONS, channel, estimate, listed, lower_first, number, percent, title

WIDTH = 100
"""Columns of a line on a terminal."""


def headline(answer: DiagnosisValues) -> str:
    """The verdict in one plain sentence, with what remains beside the effects that were found."""
    if answer.verdict == "undetermined" and answer.reason:
        return f"Nothing can be said of the motor: {answer.reason}."
    if answer.verdict == "no_mismatch" and answer.remaining:
        these = "these recordings" if answer.recordings else "this recording"
        worst = max(answer.remaining, key=lambda at: at.times)
        return (
            f"The dq-model explains {these} down to the noise, but not the validation run: "
            f"{_left(worst)}, by a parameter that stays open here or by what is missing."
        )
    rest = _rest(answer)
    if rest and answer.verdict == "unknown" and (found := _mostly_explained(answer)):
        return f"{found}; {rest}, so another cause is at work."
    if rest and answer.verdict in {"named", "ambiguous", "partial"}:
        return f"{_verdict(answer).rstrip('.')}; {rest}, so another cause is at work as well."
    return _verdict(answer)


def _rest(answer: DiagnosisValues) -> str:
    """How much more than noise the effects that were found leave, and where; empty where there are none, or
    where they reach it.
    """
    beside = [at for at in answer.remaining if at.beside]
    if not beside:
        return ""
    return _left(max(beside, key=lambda at: at.times))


def _left(at: Remaining) -> str:
    """How much is left of an equation."""
    return f"{number(at.times)} times the noise is left in the {EQUATIONS.get(at.equation, at.equation)}"


def _mostly_explained(answer: DiagnosisValues) -> str:
    """The effects that come nearest, with the share that they explain; empty where that is less than half."""
    nearest = next((at.beside for at in answer.remaining if at.beside), ())
    shares = [c.gain_held_out for c in answer.ranking if c.effect in nearest and c.gain_held_out is not None]
    if not shares or max(shares) < 0.5:
        return ""
    names = listed([lower_first(title(effect)) for effect in nearest])
    verb = "explains" if len(nearest) == 1 else "explain"
    return f"{names[0].upper()}{names[1:]} {verb} {percent(max(shares))} of the mismatch"


def _verdict(answer: DiagnosisValues) -> str:
    """The verdict by itself."""
    names = [lower_first(title(effect)) for effect in answer.effects]
    several = len(answer.recordings) > 1
    these, their = ("these recordings", "their") if several else ("this recording", "its")
    if answer.verdict == "no_mismatch":
        return f"Nothing is missing: the dq-model explains {these} down to {their} noise."
    if answer.verdict in {"named", "partial"}:
        return f"The model leaves out {listed(names or _first(answer))}."
    if answer.verdict == "ambiguous":
        choices = _alternatives(answer)
        certain = listed([names[0] for names in choices if len(names) == 1])
        either = listed([listed(names, "or") for names in choices if len(names) > 1])
        if not either:
            likely = bool(answer.ranking) and answer.ranking[0].probability > 0.5
            leaves = "probably leaves out" if likely else "may leave out"
            return f"The model {leaves} {certain}, but {these} cannot settle it."
        beside = f"{certain}, and " if certain else ""
        return f"The model leaves out {beside}{either}; {these} cannot tell which."
    where = EQUATIONS.get(answer.located[0].equation, "") if answer.located else ""
    if answer.verdict == "unknown":
        return f"Something is missing{f' in the {where}' if where else ''} that is not in the catalogue."
    short = "do not allow" if several else "is too poor"
    poor = f"{these} {short} to say what the model leaves out."
    if where and not answer.interrupted:
        return f"More than the noise is left in the {where}, but {poor}"
    return poor[0].upper() + poor[1:]


def _first(answer: DiagnosisValues) -> list[str]:
    return [lower_first(title(answer.ranking[0].effect))] if answer.ranking else ["something"]


def _alternatives(answer: DiagnosisValues) -> list[list[str]]:
    """For each effect of the model, or the first candidate of none: its title and those of its equals."""
    if not answer.ranking:
        return [["something"]]
    chosen = [candidate for candidate in answer.ranking if candidate.effect in answer.effects]
    each = [dict.fromkeys([c.effect, *c.equivalent_to]) for c in chosen or answer.ranking[:1]]
    return [[lower_first(title(effect)) for effect in effects] for effects in each]


def hung(head: str, text: str) -> str:
    """`text` behind `head`, wrapped to the width of a terminal with the later lines below the first."""
    return textwrap.fill(text, WIDTH, initial_indent=head, subsequent_indent=" " * len(head))


def diagnosis(answer: DiagnosisValues) -> str:
    """A diagnosis as text: the finding, where it sits, candidates, parameters, fit, what is left, what is
    not seen, what next.
    """
    lines = [textwrap.fill(headline(answer), WIDTH)]
    if answer.interrupted:
        lines.append("Interrupted: this is the best so far.")
    for item in answer.data_quality:
        consequence = lower_first(item["consequence"]).rstrip(".")
        text = f"{item['finding'].rstrip('.')}: {consequence}; {lower_first(item['fix'])}"
        lines.append(hung("  ! ", text))
    if answer.located:
        lines += ["", "Where it sits"]
        lines += [hung(f"  {percent(place.share):>6}  ", place.sentence) for place in answer.located[:4]]
    if answer.ranking:
        lines += ["", "Candidates"]
        for candidate in answer.ranking[:5]:
            twins = (
                f"   cannot be told from {', '.join(candidate.equivalent_to)}"
                if candidate.equivalent_to
                else ""
            )
            lines.append(f"  {percent(candidate.probability):>6}  {candidate.effect}{twins}")
    if answer.unmodelled is not None:
        lines += ["", "Unmodelled", hung("  ", answer.unmodelled.sentence)]
    chosen = [c for c in answer.ranking if c.effect in answer.effects]
    found = [(f"{c.effect}.{name}", entry) for c in chosen for name, entry in c.parameters.items()]
    lines += _parameters([*found, *answer.base.items()])
    run = "validation" if answer.fit.get("validation", {}).get("before") else "recording"
    lines += _fit(answer, run)
    lines += _each(answer)
    if answer.remaining:
        lines += ["", "What remains"]
        lines += [hung("  ", at.sentence) for at in answer.remaining]
    if answer.cannot_see:
        what = "these recordings" if answer.recordings else "this recording"
        lines += ["", f"What {what} cannot see"]
        lines += [hung("  ", f"{listed(effects)}: {why}") for why, effects in _by_reason(answer)]
    if answer.next_experiment:
        lines += ["", "Next", hung("  ", answer.next_experiment)]
    return "\n".join(lines)


def _by_reason(answer: DiagnosisValues) -> list[tuple[str, list[str]]]:
    """What cannot be seen, one entry per reason."""
    grouped: dict[str, list[str]] = {}
    for item in answer.cannot_see:
        grouped.setdefault(item["why"], []).append(item["effect"])
    return list(grouped.items())


def _parameters(entries: list[tuple[str, object]]) -> list[str]:
    rows = [
        (name, *estimate(entry), entry.why_none) for name, entry in entries if isinstance(entry, Estimate)
    ]
    if not rows:
        return []
    wide = max(len(row[0]) for row in rows)
    lines = ["", "Parameters"]
    reasons: dict[str, list[str]] = {}
    for name, value, spread, sign, why in rows:
        tail = f" ± {spread}" if spread else ""
        lines.append(f"  {name:<{wide}}  {value}{tail} {sign}".rstrip())
        if why and not spread:
            reasons.setdefault(why, []).append(name)
    lines += [hung("  ", f"no uncertainty for {listed(names)}: {why}") for why, names in reasons.items()]
    return lines


def _fit(answer: DiagnosisValues, run: str) -> list[str]:
    before, after = answer.fit.get(run, {}).get("before", {}), answer.fit.get(run, {}).get("after", {})
    if not before:
        return []
    lines = [
        "",
        f"Measured minus model on the {run}{'s' if run == 'recording' and answer.recordings else ''}, rms",
        f"  {'':<8} {'before':>10} {'after':>10} {'noise':>10}",
    ]
    for name, value in before.items():
        cells = [number(value), number(after.get(name)), number(answer.noise_floor.get(name))]
        lines.append(f"  {name:<8} " + " ".join(f"{cell:>10}" for cell in cells) + f"  {channel(name)[1]}")
    return lines


def _each(answer: DiagnosisValues) -> list[str]:
    """A line for each of several recordings: what is left in its channels, in units of its own noise."""
    lines = []
    for count, entry in enumerate(answer.recordings, 1):
        noise, fit = entry["noise_floor"], entry["fit"]
        cells = [
            f"{name} {number(fit['before'][name] / floor)} to {number(fit['after'][name] / floor)}"
            for name, floor in noise.items()
            if floor and fit["before"].get(name) is not None and fit["after"].get(name) is not None
        ]
        lines.append(hung("  ", f"{recording_name(entry, count)}: {', '.join(cells)}"))
    return ["", "Each recording, rms in units of its noise", *lines] if lines else []


def recording_name(entry: Mapping[str, Any], count: int) -> str:
    """Number and file of one of several recordings."""
    return f"{count}  {PurePath(entry['file']).name}" if entry.get("file") else f"{count}"


def identification(answer: IdentificationValues) -> str:
    """An identification as text."""
    state = (
        "interrupted, best so far"
        if answer.interrupted
        else "converged"
        if answer.converged
        else "not converged"
    )
    lines = [f"{answer.method}: {state} after {answer.evaluations} evaluations, cost {answer.cost:.6g}"]
    lines += _parameters(list(answer.parameters.items()))
    if answer.rms:
        lines += ["", "Measured minus model, rms"]
        lines += [
            f"  {name:<8} {number(value):>10}  {channel(name)[1]}" for name, value in answer.rms.items()
        ]
    if answer.cannot_show:
        lines += ["", "What this recording cannot show"]
        lines += [hung("  ", f"{listed(item['parameters'])}: {item['why']}") for item in answer.cannot_show]
    return "\n".join(lines)
