"""The verdict in a sentence or two, which claim only what was looked at."""

from __future__ import annotations

from typing import Any, Final

from ..errors import shown
from ..results.findings import DiagnosisValues, Remaining, chosen
from ..results.words import EQUATIONS, acts_in, listed, lower_first, number, percent, title

_NAMED: Final = 3
"""Columns that a headline names; the findings name the others."""
_EXPLAINED: Final = {
    "mechanical": "The equation of motion explains the speed down to the noise.",
    "electrical": "The voltage equations explain the currents down to the noise.",
    "operating_points": "The steady voltage equations explain the voltages down to the noise.",
    "open_circuit": "The dq-model explains the voltages at the open terminals down to the noise.",
}


def headline(answer: DiagnosisValues) -> str:
    """The verdict in a plain sentence, and one for each question that was not asked."""
    return " ".join(sentences(answer))


def sentences(answer: DiagnosisValues) -> list[str]:
    """The sentences of the headline, that of the verdict first."""
    return [_first_sentence(answer), *not_asked(answer), *_passed_over(answer)]


def is_whole(answer: DiagnosisValues) -> bool:
    """Whether everything could be asked, and no column was left unused that looks as if it belonged."""
    return not not_asked(answer) and not missed(answer)


def not_asked(answer: DiagnosisValues) -> list[str]:
    """A sentence for each question that could not be asked."""
    if not answer.read:
        mechanical = answer.recording_kind == "mechanical"
        return ["Nothing was asked of the voltages: the recording has none."] if mechanical else []
    each = [read["questions"]["why_not"] for read in answer.read]
    if len(set(each)) == 1:
        return [each[0]] if each[0] else []
    return [f"Recording {count}: {lower_first(why)}" for count, why in enumerate(each, 1) if why]


def missed(answer: DiagnosisValues) -> list[dict[str, Any]]:
    """Columns that were not used though nothing else gives what they look like."""
    entries = [entry for read in answer.read for entry in read["not_used"] if entry["missed"]]
    return list({entry["column"]: entry for entry in entries}.values())


def _passed_over(answer: DiagnosisValues) -> list[str]:
    told = " ".join(not_asked(answer))
    entries = [entry for entry in missed(answer) if shown(entry["column"]) not in told]
    if not entries:
        return []
    named = [f"'{shown(entry['column'])}'" for entry in entries[:_NAMED]]
    more = [f"{len(entries) - _NAMED} more"] if len(entries) > _NAMED else []
    kinds = listed(list(dict.fromkeys(_a(entry["quantity"]) for entry in entries)), "or")
    verb, look = ("was", "looks") if len(entries) == 1 else ("were", "look")
    return [f"{listed([*named, *more])} {verb} not used but {look} like {kinds}; [columns] can settle it."]


def _a(quantity: str) -> str:
    return f"{'an' if quantity == 'angle' else 'a'} {quantity}"


def _first_sentence(answer: DiagnosisValues) -> str:
    """The verdict with what remains beside the effects that were found."""
    if answer.verdict == "undetermined" and answer.reason and answer.interrupted:
        return f"{answer.reason[0].upper()}{answer.reason[1:]}."
    if answer.verdict == "undetermined" and answer.reason and _is_of_points(answer):
        told = f"Only parameters can be told: {answer.reason}" if answer.base else answer.reason
        return f"{told[0].upper()}{told[1:]}."
    if answer.verdict == "undetermined" and answer.reason:
        return f"Nothing can be said of what is missing: {answer.reason}."
    if answer.verdict == "no_mismatch" and answer.remaining:
        these = "these recordings" if answer.recordings else "this recording"
        worst = max(answer.remaining, key=lambda at: at.times)
        return (
            f"The dq-model explains {these} down to the noise, but not the validation run: "
            f"{_residual(worst)} there. A parameter that stays open here or missing physics is the cause."
        )
    rest = _rest(answer)
    if rest and answer.verdict == "unknown" and (found := _mostly_explained(answer)):
        return f"{found}; {rest}, so another cause is at work."
    if rest and answer.verdict in {"named", "ambiguous", "partial"}:
        return f"{_verdict(answer).rstrip('.')}; {rest}, so another cause is at work as well."
    return _verdict(answer)


def _is_of_points(answer: DiagnosisValues) -> bool:
    """Whether steady points were read of which nothing was asked but parameters."""
    return answer.recording_kind is not None and not answer.noise_floor


def _rest(answer: DiagnosisValues) -> str:
    """How much more than noise remains beside the effects that were found, and where; empty without any, or
    where they reach the noise.
    """
    beside = [at for at in answer.remaining if at.beside]
    if not beside:
        return ""
    return _residual(max(beside, key=lambda at: at.times))


def _residual(at: Remaining) -> str:
    """How large the residual of an equation is."""
    return (
        f"the {EQUATIONS.get(at.equation, at.equation)} has a residual of {number(at.times)} times the noise"
    )


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
    names = [lower_first(title(effect)) for effect in answer.effects]
    several = len(answer.recordings) > 1
    these, their = ("these recordings", "their") if several else ("this recording", "its")
    if answer.verdict == "no_mismatch":
        if is_whole(answer):
            return f"Nothing is missing: the dq-model explains {these} down to {their} noise."
        part = f"The dq-model explains what was read of {these} down to {their} noise."
        return _EXPLAINED.get(answer.recording_kind or "", part)
    if answer.verdict in {"named", "partial"}:
        further = ["something that is not in the catalogue"]
        more = further if answer.verdict == "partial" and not _rest(answer) else []
        return f"The model leaves out {listed([*(names or _first(answer)), *more])}."
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
        missing = f"Something is missing{f' in the {where}' if where else ''}"
        if not (unseen := _unseen_causes(answer)):
            return f"{missing} that is not in the catalogue."
        why, effects = unseen
        verb = "was" if len(effects) == 1 else "were"
        return f"{missing}: {listed(effects, 'or')}, which {verb} not asked as {why}, or something else."
    poor = f"{these} {'are' if several else 'is'} too poor to say what the model leaves out."
    if where and not answer.interrupted:
        return f"The {where} has a residual of more than the noise, but {poor}"
    return poor[0].upper() + poor[1:]


def _unseen_causes(answer: DiagnosisValues) -> tuple[str, list[str]] | None:
    """Effects in the equation of the mismatch that were not asked, as a quantity was not recorded, and why.

    Of several quantities it is the one that most effects need.
    """
    motion = bool(answer.located) and answer.located[0].equation == "mechanical"
    by_reason: dict[str, list[str]] = {}
    for item in answer.cannot_see:
        here = (acts_in(item["effect"]) == "mechanical") == motion
        if here and item["power"] == 0.0 and item["why"].endswith("recorded"):
            by_reason.setdefault(item["why"], []).append(lower_first(title(item["effect"])))
    if not by_reason or not answer.located:
        return None
    why, effects = max(by_reason.items(), key=lambda entry: len(entry[1]))
    more = len(effects) - _NAMED
    return why, effects if more <= 0 else [*effects[:_NAMED], f"{more} more"]


def _first(answer: DiagnosisValues) -> list[str]:
    return [lower_first(title(answer.ranking[0].effect))] if answer.ranking else ["something"]


def _alternatives(answer: DiagnosisValues) -> list[list[str]]:
    """For each effect of the model, or the first candidate of none: its title and those of its equals."""
    if not answer.ranking:
        return [["something"]]
    each = [dict.fromkeys([c.effect, *c.equivalent_to]) for c in chosen(answer) or answer.ranking[:1]]
    return [[lower_first(title(effect)) for effect in effects] for effects in each]
