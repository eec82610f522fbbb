"""What an answer says of the mistake that a log was made with, and what all answers amount to."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any

from .mistake_kinds import Mistake
from .summary import Rate

# codes of findings that tell a mistake: of wiring or shift, sign of the torque, scale or unit
MISTAKEN = ("PR201", "PR202", "PR203", "PR204", "PR212")
# codes with which a log is refused as one that was made with a mistake
REFUSED = ("PR110", "PR111", "PR112", "PR113", "PR114", "PR115", "PR117")
READS_AS, UNDONE = "the log reads as if ", ": with that undone"
NAMING = ("named", "partial", "ambiguous")
# what becomes of a mistake; the first two are right
OUTCOMES = ("found", "below", "otherwise", "not told", "no answer")
SOUND = "sound"
# quantile of the normal distribution for 95 %
Z = 1.959964


@dataclass(frozen=True)
class Told:
    """A finding, or the refusal of a log: its code, what it says, and what to do."""

    code: str
    finding: str
    fix: str = ""

    @property
    def words(self) -> list[str]:
        """The mistakes that it says the log reads as if made with; most findings say none."""
        text = self.finding.partition(READS_AS)[2].partition(UNDONE)[0]
        return text.split(", or ") if text else []


@dataclass(frozen=True)
class Result:
    """One answer: kind and number of the log, name of the mistake (SOUND: none), one of OUTCOMES, what the
    answer leads with, and seconds of processor."""

    log: str
    case: str
    mistake: str
    outcome: str
    said: str
    seconds: float


def tellings(answer: Mapping[str, Any] | None, refusal: str) -> list[Told]:
    """The findings of an answer, the leading one first, or the refusal of a log without an answer.

    The leading finding is the reason of the verdict where it has one, else the first of `data_quality`.
    refusal: the last line of standard error, with its code in brackets at the end.
    """
    if answer is None:
        text, _, code = refusal.rstrip("]").rpartition(" [")
        return [Told(code, text)] if code in REFUSED else []
    findings = list(answer.get("data_quality") or ())
    reason = answer.get("reason") or ""
    findings.sort(key=lambda f: not (reason and reason.startswith(f["finding"])))
    return [Told(f.get("code") or "", f["finding"], f.get("fix") or "") for f in findings]


def tells(told: Told, mistake: Mistake) -> bool:
    """Whether a finding tells a mistake."""
    if any(words in mistake.words for words in told.words):
        return True
    text = f"{told.finding}; {told.fix}"
    return any(told.code == code and all(p in text for p in parts) for code, *parts in mistake.findings)


def is_mistake(told: Told) -> bool:
    """Whether a finding tells any mistake."""
    return told.code in MISTAKEN or told.code in REFUSED


def outcome(
    answer: Mapping[str, Any] | None, refusal: str, mistake: Mistake | None, own: Iterable[str]
) -> str:
    """One of OUTCOMES for the answer on a log with a mistake, or on a sound one.

    found: the leading finding tells it, or an effect of the model that the machine does not have by itself
    (own: those that it has) is its equivalent; below: another finding tells it; otherwise: another mistake is
    told, which in a sound log any mistake is; no answer: the run ended without one, and not by refusing the
    log.
    """
    told = tellings(answer, refusal)
    if answer is None and not told:
        return "no answer"
    if mistake is not None:
        said = answer or {}
        named = (said.get("model") or {}).get("effects") or () if said.get("verdict") in NAMING else ()
        if any(tells(each, mistake) for each in told[:1]) or set(named) & (set(mistake.effects) - set(own)):
            return "found"
        if any(tells(each, mistake) for each in told):
            return "below"
    return "otherwise" if any(map(is_mistake, told)) else "not told"


def headline(answer: Mapping[str, Any] | None, refusal: str) -> str:
    """What an answer leads with, and the mistakes that it tells, in one line; files without their folder."""
    if answer is None:
        return re.sub(r"\S*/(\S+\.parquet)", r"\1", refusal)
    effects = ", ".join((answer.get("model") or {}).get("effects") or ())
    told = tellings(answer, refusal)
    texts = [t.finding for k, t in enumerate(told) if k == 0 or is_mistake(t)]
    return " | ".join([f"{answer.get('verdict')}{': ' if effects else ''}{effects}", *texts])


def wilson(count: int, of: int) -> tuple[float, float]:
    """The 95 % interval of a share by Wilson; (0, 1) where nothing was counted."""
    if not of:
        return 0.0, 1.0
    share, z2 = count / of, Z * Z / of
    middle = (share + 0.5 * z2) / (1.0 + z2)
    half = Z * math.sqrt(share * (1.0 - share) / of + 0.25 * z2 / of) / (1.0 + z2)
    return max(0.0, middle - half), min(1.0, middle + half)


def share(rows: Sequence[Result], question: Callable[[Result], bool]) -> str:
    """How many of the results, with the share and its interval."""
    count = sum(map(question, rows))
    low, high = wilson(count, len(rows))
    interval = f", 95 % interval {100.0 * low:.1f} to {100.0 * high:.1f} %" if rows else ""
    return f"{Rate(count, len(rows))}{interval}"


def cell(rows: Sequence[Result]) -> str:
    """Counts of the outcomes."""
    counts = [sum(r.outcome == name for r in rows) for name in OUTCOMES]
    return " / ".join([*map(str, counts[:3]), str(sum(counts[3:]))]) if rows else "–"


def seconds(rows: Sequence[Result]) -> str:
    """Seconds of processor: median and longest."""
    spent = [r.seconds for r in rows]
    return f"{median(spent):.1f} s in the median, {max(spent):.1f} s at most" if spent else "–"


def markdown(
    rows: Sequence[Result], logs: Sequence[str], kinds: Mapping[str, Mistake], facts: Mapping[str, object]
) -> str:
    """The table of all results: mistakes by kind of log, shares, misses and the answers that count."""
    made = [r for r in rows if r.mistake != SOUND]
    sound = [r for r in rows if r.mistake == SOUND]
    lines = [", ".join(f"{name} {value}" for name, value in facts.items()) + ".", ""]
    lines += ["Found by the leading finding / told below it / another mistake told / none told.", ""]
    lines += [f"| mistake | {' | '.join(logs)} |", f"|---|{'---|' * len(logs)}"]
    for name in kinds:
        cells = [cell([r for r in made if (r.mistake, r.log) == (name, log)]) for log in logs]
        if any(c != "–" for c in cells):
            lines.append(f"| `{name}` | {' | '.join(cells)} |")
    lines += ["", f"| | {' | '.join(logs)} | all |", f"|---|{'---|' * (len(logs) + 1)}"]
    by_log = [(log,) for log in logs] + [tuple(logs)]

    def line(title: str, of: Sequence[Result], count: Callable[[Sequence[Result]], str]) -> str:
        groups = [[r for r in of if r.log in group] for group in by_log]
        return f"| {title} | {' | '.join(map(count, groups))} |"

    lines += [
        line("mistakes found", made, lambda g: share(g, lambda r: r.outcome == "found")),
        line("mistakes told anywhere", made, lambda g: share(g, lambda r: r.outcome in OUTCOMES[:2])),
        line(
            "sound logs with a false mistake", sound, lambda g: share(g, lambda r: r.outcome == "otherwise")
        ),
        line("processor, logs with a mistake", made, seconds),
        line("processor, sound logs", sound, seconds),
    ]
    missed = [r for r in made if r.outcome != "found"]
    false = [r for r in sound if r.outcome in ("otherwise", "no answer")]
    for title, of in (("Not found", missed), ("Sound logs with a false mistake or no answer", false)):
        if of:
            lines += ["", f"## {title}", ""]
            lines += [f"- {r.log} {r.case}, `{r.mistake}`, {r.outcome}: {r.said}" for r in of]
    told = {r.mistake for r in made}
    reasons = [f"- `{name}`: {kind.why}" for name, kind in kinds.items() if kind.why and name in told]
    if reasons:
        lines += ["", "## Why other answers count, too", "", *reasons]
    return "\n".join(lines) + "\n"
