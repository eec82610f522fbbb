"""Answers in a few plain lines, for terminals."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Mapping, Sequence
from pathlib import PurePath
from typing import Any, Final

from ..messages import behind
from ..results.budget import judged, sentence
from ..results.estimates import Estimate, IdentificationValues, json_text
from ..results.findings import DiagnosisValues, chosen, compared, leading
from ..results.words import (
    VAGUE,
    channel,
    estimate,
    is_vague,
    listed,
    lower_first,
    number,
    percent,
    with_signs,
)
from .formulas import numbers, of_form, order
from .headline import headline
from .places import places, share_of
from .readout import converted, extent, ignored, origins, reasons

_OF_ONE: Final = re.compile(r"\bits?\b")
"""What shows that a reason speaks of one effect."""
WIDTH = 100
"""Columns of a line on a terminal."""


def hung(head: str, text: str) -> str:
    """`text` behind `head`, wrapped to the width of a terminal with the later lines below the first."""
    # textwrap breaks no line at a no-break space: a number stays with its sign of percent.
    kept = text.replace(" %", "\u00a0%")
    filled = textwrap.fill(kept, WIDTH, initial_indent=head, subsequent_indent=" " * len(head))
    return filled.replace("\u00a0%", " %")


def _said(head: str, text: str) -> str:
    """A sentence of the core behind `head`, wrapped, with the signs of its units."""
    return hung(head, with_signs(text))


def diagnosis(answer: DiagnosisValues) -> str:
    """A diagnosis as text: verdict, headline, what was read, where it sits, candidates, parameters, fit, what
    remains, what is not seen, what next.
    """
    lines = [f"Verdict: {answer.verdict}", _said("", headline(answer))]
    if answer.interrupted:
        lines.append("Interrupted: this is the best so far.")
    lines += [_said("  ! ", finding(item, answer.reason or "")) for item in answer.data_quality]
    lines += _read(answer)
    if found_at := places(answer):
        lines += ["", "Where it sits"]
        lines += [_said(f"  {share_of(place):>6}  ", place.sentence) for place in found_at[:4]]
    if answer.ranking:
        lines += ["", "Candidates, with the probability that the model leaves them out"]
        for candidate in leading(answer, 5):
            twins = (
                f"   cannot be told from {', '.join(candidate.equivalent_to)}"
                if candidate.equivalent_to
                else ""
            )
            lines.append(f"  {percent(candidate.probability):>6}  {candidate.effect}{twins}")
        lines += _ceiling(answer)
    if answer.unmodelled is not None:
        lines += ["", "Unmodelled", _said("  ", answer.unmodelled.sentence)]
    lines += formulas(answer)
    found = [(f"{c.effect}.{name}", entry) for c in chosen(answer) for name, entry in c.parameters.items()]
    lines += _parameters([*found, *answer.base.items()])
    lines += _fit(answer, compared(answer))
    lines += _each(answer)
    budgets = judged(answer.budget)
    if budgets:
        lines += [
            "",
            "Budget of the mismatch" + (", validation run" if budgets[0].run == "validation" else ""),
        ]
        lines += [hung("  ", sentence(budget)) for budget in budgets]
    if answer.remaining:
        lines += ["", "What remains"]
        lines += [_said("  ", at.sentence) for at in answer.remaining]
    if answer.cannot_see:
        what = "these recordings" if answer.recordings else "this recording"
        lines += ["", f"What {what} cannot see"]
        lines += [_said("  ", text) for text in _unseen(answer)]
    if answer.next_experiment:
        lines += ["", "Next", _said("  ", answer.next_experiment)]
    return "\n".join(lines)


def finding(item: Mapping[str, str], reason: str = "") -> str:
    """A finding with consequence and fix, without what the `reason` of the verdict says already. No full stop
    stands before the code.
    """
    parts = [item[part].rstrip(".") for part in ("finding", "consequence", "fix")]
    cause, colon, rest = parts[0].partition(": ")
    if colon and reason and cause in reason and parts[0] not in reason:
        parts[0] = rest
    first, *others = [part for part in parts if not part or part not in reason] or parts
    mark = ": " if first == parts[0] else "; "
    return f"{first}{mark if others else ''}{'; '.join(map(lower_first, others))}{behind(item)}"


def _ceiling(answer: DiagnosisValues) -> list[str]:
    """Why no candidate is more probable, where a limit on names in doubt is what holds them."""
    limits = {answer.options.get(name) for name in ("ceiling_doubtful", "ceiling_unknown")}
    highest = max(candidate.probability for candidate in answer.ranking)
    if highest not in limits:
        return []
    why = "is the most that is given while something else is missing, or another recording is not predicted"
    return [hung(" " * 10, f"{percent(highest)} {why}.")]


def formulas(answer: DiagnosisValues) -> list[str]:
    """Formulas for a torque that has no name; nothing where that was not asked."""
    if answer.formulas is None:
        return []
    if not answer.formulas:
        return ["", "Formula", "  No simple formula describes the torque that remains."]
    run = "validation" if "validation" in answer.formulas[0]["times_noise"] else "recording"
    of = (
        "the validation run" if run == "validation" else "rows of the recording to which they were not fitted"
    )
    before = number(answer.formulas[0]["times_noise"][run]["before"])
    head = (
        f"Hypotheses, no causes. The speed error on {of} is {before} times the noise without a formula, and "
        "with one as many times as stands before it."
    )
    head = f"{head} {order(answer.formulas)}".rstrip()
    lines = ["", "Formulas for the torque that remains", hung("  ", head)]
    for entry in answer.formulas:
        lines.append(f"  {number(entry['times_noise'][run]['after']):>6}  {entry['formula']}")
        lines.append(hung(" " * 10, ", ".join(f"{name} = {value}" for name, value in numbers(entry))))
        form = of_form(entry)
        lines += [hung(" " * 10, form)] if form else []
    return lines


def _read(answer: DiagnosisValues) -> list[str]:
    """Which column became what, and which were not used; once for recordings that were read alike."""
    lines = []
    alike = len({json_text([read["columns"], read["ignored"]]) for read in answer.read}) == 1
    for count, read in enumerate(answer.read[:1] if alike else answer.read, 1):
        of = "" if alike else f"{count}  "
        lines.append(hung(f"  {of}", f"{listed(origins(read))}; {extent(read)}"))
        if read["ignored"]:
            lines.append(hung("  ", f"ignored: {ignored(read)}"))
            lines += [hung("    ", reason) for reason in reasons(read)]
    lines += _converted(answer)
    return ["", "Read", *lines] if lines else []


def _converted(answer: DiagnosisValues | IdentificationValues) -> list[str]:
    """What was converted of the nameplate, one line."""
    clauses = converted(answer.nameplate)
    return [hung("  ", f"nameplate: {'; '.join(clauses)}")] if clauses else []


def _unseen(answer: DiagnosisValues) -> list[str]:
    """What cannot be seen, one sentence per reason. That of the verdict stands in the first sentence."""
    grouped: dict[str, list[str]] = {}
    for item in answer.cannot_see:
        grouped.setdefault(item["why"], []).append(item["effect"])
    told = answer.reason or ""
    return [
        "All effects of the catalogue, for the reason above."
        if len(grouped) == 1 and told.startswith(why)
        else f"{listed(effects)}{', each' if len(effects) > 1 and _OF_ONE.search(why) else ''}: {why}"
        for why, effects in grouped.items()
    ]


def _parameters(entries: Sequence[tuple[str, Estimate]]) -> list[str]:
    rows = [(name, estimate(entry), entry.why_none) for name, entry in entries]
    vague = [name for name, entry in entries if is_vague(name, entry)]
    if not rows:
        return []
    wide = max(len(row[0]) for row in rows)
    lines = ["", "Parameters"]
    reasons: dict[str, list[str]] = {}
    for name, written, why in rows:
        lines.append(f"  {name:<{wide}}  {'–' if name in vague else written}".rstrip())
        if why and not written.spread:
            reasons.setdefault(why, []).append(name)
    lines += [_said("  ", f"no uncertainty for {listed(names)}: {why}") for why, names in reasons.items()]
    if vague:
        lines.append(hung("  ", f"not determined: {listed(vague)}: {VAGUE}"))
    return lines


def _fit(answer: DiagnosisValues, run: str) -> list[str]:
    before, after = answer.fit.get(run, {}).get("before", {}), answer.fit.get(run, {}).get("after", {})
    if not before:
        return []
    lines = [
        "",
        f"Measured minus model on the {_run(answer, run)}, rms",
        f"  {'':<8} {'before':>10} {'after':>10} {'noise':>10}",
    ]
    for name, value in before.items():
        cells = [number(value), number(after.get(name)), number(answer.noise_floor.get(name))]
        lines.append(f"  {name:<8} " + " ".join(f"{cell:>10}" for cell in cells) + f"  {channel(name)[1]}")
    return lines


def _run(answer: DiagnosisValues, run: str) -> str:
    several = "recordings" if answer.recordings else "recording"
    return "validation run" if run == "validation" else several


def _each(answer: DiagnosisValues) -> list[str]:
    """A line for each of several recordings: the residual of its channels, in units of its own noise."""
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
    lines += _converted(answer)
    lines += _parameters(list(answer.parameters.items()))
    if answer.rms:
        lines += ["", "Measured minus model, rms"]
        lines += [
            f"  {name:<8} {number(value):>10}  {channel(name)[1]}" for name, value in answer.rms.items()
        ]
    if answer.cannot_show:
        lines += ["", "What this recording cannot show"]
        lines += [_said("  ", f"{listed(item['parameters'])}: {item['why']}") for item in answer.cannot_show]
    return "\n".join(lines)
