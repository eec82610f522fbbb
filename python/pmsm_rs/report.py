"""The report: one self-contained HTML page of a diagnosis."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any

from . import budget, figures, plot, words
from .headline import headline, is_whole
from .quantities import CANONICAL
from .readout import converted, extent, ignored, origin, reasons
from .registry import effects
from .results import Candidate, DiagnosisValues, Estimate, Location
from .summary import recording_name

if TYPE_CHECKING:
    from jinja2 import Template

VERDICTS = {
    "no_mismatch": ("Model complete", "good"),
    "named": ("Effect named", "found"),
    "partial": ("Named in part", "found"),
    "ambiguous": ("Ambiguous", "doubt"),
    "unknown": ("Unknown physics", "doubt"),
    "undetermined": ("Undetermined", "poor"),
}
_LITERAL = re.compile(r"((?<!\w)'[^']*'(?!\w)|\b\w+ = \{[^{}]*\})")
"""A name in quotes, or a line of TOML."""
_IN_PART = ("No mismatch in what was asked", "doubt")


def chip(answer: DiagnosisValues) -> tuple[str, str]:
    """The verdict in a word or two, and its tone: only what was asked for as a whole is complete."""
    if answer.verdict == "no_mismatch" and not is_whole(answer):
        return _IN_PART
    return VERDICTS.get(answer.verdict, (answer.verdict, "poor"))


@dataclass(frozen=True)
class ParameterRow:
    """A parameter as the report shows it."""

    name: str
    meaning: str
    value: str
    spread: str
    unit: str
    interval: str
    why_none: str


@dataclass(frozen=True)
class FitRow:
    """Residuals of one channel in units of its noise, and as bars of a logarithmic scale."""

    symbol: str
    unit: str
    noise: str
    before: str
    after: str
    before_ratio: float | None
    after_ratio: float | None
    before_bar: float
    after_bar: float


def render(answer: DiagnosisValues, title: str | None = None) -> str:
    """The page as HTML text. The same answer and title give the same text."""
    label, tone = chip(answer)
    judged = "validation" if answer.fit.get("validation", {}).get("before") else "recording"
    return template("report.html.j2").render(
        answer=answer,
        title=title or "Diagnosis",
        chip=label,
        tone=tone,
        headline=headline(answer),
        leading=_leading(answer),
        read=[
            (recording_name(entry, count), _origins(read), extent(read), ignored(read), reasons(read))
            for count, (read, entry) in enumerate(_each_read(answer), 1)
        ],
        nameplate=converted(answer.nameplate),
        candidates=[(c, words.title(c.effect), rows(c)) for c in answer.ranking[:8]],
        unlisted=max(0.0, 1.0 - sum(c.probability for c in answer.ranking)),
        effects=[
            (words.title(c.effect), rows(c))
            for c in answer.ranking
            if c.effect in answer.effects and c.parameters
        ],
        base=[row(name, entry, _meaning(name)) for name, entry in answer.base.items()],
        judged=judged,
        fit=_fit(answer, judged),
        each=_each(answer),
        trained=_fit(answer, "recording") if judged == "validation" else [],
        located=figures.located(answer) if answer.located else [],
        budget=figures.budget(answer),
        budget_run=next((entry.run for entry in budget.judged(answer.budget)), ""),
        unmodelled=answer.unmodelled,
        maps=figures.unmodelled(answer),
        before_after=figures.before_after(answer),
        shown=answer.shown,
        places=_places(answer.located),
        blind=[(item, words.title(item["effect"])) for item in answer.cannot_see],
        colours={"before": plot.BEFORE, "after": plot.AFTER, "measured": plot.MEASURED, "noise": plot.NOISE},
    )


def _each_read(answer: DiagnosisValues) -> list[tuple[Mapping[str, Any], Mapping[str, Any]]]:
    """What was read of each recording, with its entry of several."""
    return list(zip(answer.read, answer.recordings or [{}] * len(answer.read), strict=False))


def _origins(read: Mapping[str, Any]) -> list[tuple[str, str, str, str]]:
    """Canonical column, its meaning, where it came from, and the unit it had there."""
    return [
        (name, CANONICAL[name].meaning, origin(name, entry), entry["unit"])
        for name, entry in read["columns"].items()
    ]


MEANINGS = {
    "r_s": "stator resistance",
    "l_d": "d-axis inductance",
    "l_q": "q-axis inductance",
    "psi_m": "magnet flux linkage",
    "j": "inertia",
    "b": "viscous friction",
    "tau_load": "load torque",
}


def _places(located: Iterable[Location]) -> list[tuple[Location, str, str]]:
    """Places with the words for their equation and operating points."""
    return [(at, words.EQUATIONS.get(at.equation, at.equation), _where(at.where)) for at in located]


def _meaning(name: str) -> str:
    """What a parameter of the machine or of the run is; `_of_2` is that of the second recording."""
    own, _, recording = name.partition("_of_")
    meaning = MEANINGS.get(own, "")
    return f"{meaning}, recording {recording}" if meaning and recording else meaning


@cache
def template(name: str) -> Template:
    """A template of the package; whatever it fills in is escaped."""
    import jinja2

    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("pmsm_rs"),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters.update(
        percent=words.percent,
        number=words.number,
        effect=words.title,
        probability=words.probability,
        typeset=_typeset,
    )
    return environment.get_template(name)


def _typeset(text: str) -> str:
    """`text` escaped, its symbols with subscripts; names in quotes and lines of TOML stay as they are, so
    that they can be copied.
    """
    from markupsafe import Markup, escape

    parts = _LITERAL.split(text)
    parts[::2] = [words.subscripted(str(escape(part)), "<sub>", "</sub>") for part in parts[::2]]
    parts[1::2] = [
        str(escape(part)) if part.startswith("'") else f"<code>{escape(part)}</code>" for part in parts[1::2]
    ]
    return Markup("".join(parts))


def _leading(answer: DiagnosisValues) -> Candidate | None:
    named = answer.verdict in {"named", "partial", "ambiguous"} and answer.ranking
    return answer.ranking[0] if named else None


def rows(candidate: Candidate) -> list[ParameterRow]:
    meanings = _meanings().get(candidate.effect, {})
    return [row(name, entry, meanings.get(name, "")) for name, entry in candidate.parameters.items()]


@cache
def _meanings() -> dict[str, dict[str, str]]:
    return {entry["id"]: {p["name"]: p["meaning"] for p in entry["parameters"]} for entry in effects()}


def row(name: str, entry: Estimate, meaning: str) -> ParameterRow:
    value, spread, unit = words.estimate(entry)
    return ParameterRow(name, meaning, value, spread, unit, words.interval(entry), entry.why_none or "")


def _fit(answer: DiagnosisValues, run: str) -> list[FitRow]:
    import math

    part = answer.fit.get(run, {})
    before, after = part.get("before", {}), part.get("after", {})
    ratios = {
        name: (
            before[name] / floor if floor else None,
            after[name] / floor if floor and name in after else None,
        )
        for name in before
        for floor in [answer.noise_floor.get(name)]
    }
    peak = max([2.0, *(r for pair in ratios.values() for r in pair if r)])

    def bar(ratio: float | None) -> float:
        # Logarithmic from the noise itself (a sliver) to the worst channel (the full width).
        return 0.0 if not ratio else round(4 + 96 * max(0.0, math.log(ratio)) / math.log(peak), 1)

    rows = []
    for name, value in before.items():
        symbol, unit = words.channel(name)
        first, second = ratios[name]
        rows.append(
            FitRow(
                symbol,
                unit,
                words.number(answer.noise_floor.get(name)),
                words.number(value),
                words.number(after.get(name)),
                first,
                second,
                bar(first),
                bar(second),
            )
        )
    return rows


@dataclass(frozen=True)
class RecordingRow:
    """One of several recordings as the report shows it, residuals as multiples of its own noise."""

    name: str
    kind: str
    load: str
    duration: str
    fit: tuple[tuple[str, str, str], ...]


def _each(answer: DiagnosisValues) -> list[RecordingRow]:
    rows = []
    for count, entry in enumerate(answer.recordings, 1):
        noise, before, after = entry["noise_floor"], entry["fit"]["before"], entry["fit"]["after"]
        fit = tuple(
            (words.channel(name)[0], words.number(before[name] / floor), words.number(after[name] / floor))
            for name, floor in noise.items()
            if floor and before.get(name) is not None and after.get(name) is not None
        )
        kind, load = (entry[key].replace("_", " ") for key in ("kind", "load"))
        seconds = f"{words.number(entry['duration'])} s"
        rows.append(RecordingRow(recording_name(entry, count), kind, load, seconds, fit))
    return rows


def _where(ranges: tuple[Any, ...]) -> str:
    parts = []
    for item in ranges:
        bounds = f"{words.number(item['low'])} to {words.number(item['high'])} {words.unit(item['unit'])}"
        parts.append(f"{item['variable']} from {bounds}".rstrip())
    return words.listed(parts)
