"""The rows of the report's tables: parameters, residuals, what was read, and places."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import PurePath
from typing import Any, Final

from ..errors import shown
from ..quantities.canonical import CANONICAL
from ..results import words
from ..results.budget import judged, shares
from ..results.estimates import Estimate
from ..results.findings import Candidate, DiagnosisValues, Location
from ..results.registry import effects
from ..results.rounding import fixed, is_finite, last_place
from .places import places as located
from .places import share_of
from .readout import extent, ignored, origin, reasons
from .summary import recording_name

MEANINGS: Final = {
    "r_s": "stator resistance",
    "l_d": "d-axis inductance",
    "l_q": "q-axis inductance",
    "psi_m": "magnet flux linkage",
    "j": "inertia",
    "b": "viscous friction",
    "tau_load": "load torque",
}


@dataclass(frozen=True)
class ParameterRow:
    """A parameter as tables show it: `value` ± `spread` in `unit`, which has the power of ten in front, and
    all of that in one as `text`.

    `nameplate` is in the same unit, and `difference` is found minus nameplate in percent of it. `is_far` says
    that it is more than a nameplate is usually off.
    """

    name: str
    meaning: str
    value: str
    spread: str
    unit: str
    interval: str
    why_none: str
    text: str
    nameplate: str = ""
    difference: str = ""
    is_far: bool = False

    @property
    def cells(self) -> tuple[str, ...]:
        """As a line of a spreadsheet."""
        return self.name, self.nameplate, self.value, self.spread, self.unit, self.interval, self.difference


HEADS: Final = ("parameter", "nameplate", "found", "standard error", "unit", "95 % interval", "difference")
"""Of `ParameterRow.cells`."""


def row(name: str, entry: Estimate, meaning: str) -> ParameterRow:
    """The row of an estimate without a nameplate."""
    if words.is_vague(name, entry):
        sign = words.unit(entry.unit)
        return ParameterRow(name, meaning, "–", "", sign, "", f"not determined: {words.VAGUE}", "–")
    shown = words.estimate(entry)
    unit = f"{shown.power} {shown.unit}".strip()
    interval = words.interval(entry)
    why = entry.why_none or ""
    return ParameterRow(name, meaning, shown.value, shown.spread, unit, interval, why, str(shown))


def rows(candidate: Candidate) -> list[ParameterRow]:
    """The parameters of an effect."""
    meanings = _meanings().get(candidate.effect, {})
    return [row(name, entry, meanings.get(name, "")) for name, entry in candidate.parameters.items()]


def motor_rows(answer: DiagnosisValues) -> list[ParameterRow]:
    """The parameters of the motor beside its nameplate, where that is known."""
    plate = answer.data.get("machine", {})
    usual = float(answer.options.get("nameplate_spread", 0.2))
    order = {name: place for place, name in enumerate(MEANINGS)}
    named = sorted(answer.base.items(), key=lambda item: order.get(item[0], len(order)))
    return [_motor_row(name, entry, plate.get(name), usual) for name, entry in named]


def _motor_row(name: str, entry: Estimate, plate: float | None, usual: float) -> ParameterRow:
    found = row(name, entry, _meaning(name))
    if plate is None or entry.value is None or not is_finite(entry.value):
        return found
    if words.is_vague(name, entry):
        return replace(found, nameplate=words.number(plate, 4))
    stated = words.estimate_like(entry, plate)
    difference, far = "", False
    # A value that was held at the nameplate's was not found.
    if plate > 0.0 and (entry.stderr or entry.value != plate):
        share = 100.0 * (entry.value / plate - 1.0)
        spread = 100.0 * entry.stderr / plate if entry.stderr and is_finite(entry.stderr) else 0.0
        # A tenth of a percent is enough to compare with a nameplate.
        most = 1 if abs(share) < 100.0 else 0
        places = min(max(last_place(spread), 0), most) if spread > 0.0 else most
        text = fixed(share, places)
        difference = f"{'+' if share > 0.0 and text.strip('0.') else ''}{text} %"
        far = abs(share) > 100.0 * usual
    return replace(found, nameplate=stated, difference=difference, is_far=far)


def _meaning(name: str) -> str:
    """What a parameter of the machine or of the run is; `_of_2` is that of the second recording."""
    own, _, recording = name.partition("_of_")
    meaning = MEANINGS.get(own, "")
    if part := re.fullmatch(r"(tau|t)_load_(\d+)", own):
        meaning = f"load torque, part {part[2]}" if part[1] == "tau" else f"end of part {part[2]} of the load"
    return f"{meaning}, recording {recording}" if meaning and recording else meaning


@cache
def _meanings() -> dict[str, dict[str, str]]:
    return {
        entry["id"]: {p["name"]: p["meaning"] for p in [*entry["parameters"], *entry["derived"]]}
        for entry in effects()
    }


def spreadsheet(groups: list[tuple[str, list[ParameterRow]]]) -> str:
    """Rows of parameters as text between tabs, those of an effect with its title in front."""
    lines = ["\t".join(HEADS)]
    for title, each in groups:
        for entry in each:
            first, *rest = entry.cells
            lines.append("\t".join([f"{title}: {first}" if title else first, *rest]))
    return "\n".join(lines) + "\n"


@dataclass(frozen=True)
class FitRow:
    """Residuals of one channel, rms, and as multiples of its noise where that is known."""

    symbol: str
    unit: str
    noise: str
    before: str
    after: str
    before_ratio: float | None
    after_ratio: float | None


def fit(answer: DiagnosisValues, run: str) -> list[FitRow]:
    """A row for each channel of a run, "recording" or "validation"."""
    part = answer.fit.get(run, {})
    before, after = part.get("before", {}), part.get("after", {})
    out = []
    for name, value in before.items():
        symbol, unit = words.channel(name)
        floor, left = answer.noise_floor.get(name), after.get(name)
        out.append(
            FitRow(
                symbol,
                unit,
                words.number(floor),
                words.number(value),
                words.number(left),
                value / floor if floor else None,
                left / floor if floor and left is not None else None,
            )
        )
    return out


@dataclass(frozen=True)
class BudgetTable:
    """The share of each channel's mismatch that each cause takes away.

    `heads` are the channel, and times the noise before and after. `rows` are a name and a share for each.
    """

    heads: tuple[tuple[str, str, str], ...]
    rows: tuple[tuple[str, tuple[str, ...]], ...]


def budget_table(answer: DiagnosisValues) -> BudgetTable:
    """The budget of the run that is shown."""
    told = judged(answer.budget)
    heads = tuple((words.channel(b.channel)[0], words.number(b.before), words.number(b.after)) for b in told)
    each = [dict(shares(b)) for b in told]
    names = dict.fromkeys(name for entry in each for name in entry)
    return BudgetTable(
        heads,
        tuple(
            (name, tuple(words.percent(entry[name]) if name in entry else "–" for entry in each))
            for name in sorted(names, key=lambda name: name == "left")
        ),
    )


@dataclass(frozen=True)
class PlaceRow:
    """Where a part of the mismatch sits, and in a few words what the sentence does not say."""

    share: str
    sentence: str
    tags: tuple[str, ...]


def places(answer: DiagnosisValues) -> list[PlaceRow]:
    """The places, none told twice."""
    return [PlaceRow(share_of(at), at.sentence, tuple(_tags(at))) for at in located(answer)]


def _tags(at: Location) -> list[str]:
    equation = words.EQUATIONS.get(at.equation, at.equation)
    out = [] if equation in at.sentence else [equation]
    for item in at.where:
        bounds = f"{words.number(item['low'])} to {words.number(item['high'])} {words.unit(item['unit'])}"
        if f"for {item['variable']} between" not in at.sentence:
            out.append(f"{item['variable']} from {bounds}".rstrip())
    for kind, order in (("electrical", at.order_electrical), ("mechanical", at.order_mechanical)):
        if order is not None:
            out.append(f"{kind} order {order:g}")
    if at.frequency_hz is not None:
        out.append(f"{words.number(at.frequency_hz)} Hz")
    if at.trend and at.trend not in at.sentence:
        out.append(at.trend)
    return out if at.p_value is None else [*out, words.probability(at.p_value)]


def unseen(answer: DiagnosisValues) -> list[tuple[str, str]]:
    """Effects that the recording cannot see, those of one reason together, with the reason and the chance of
    seeing them where there is any. That of the verdict is not told again.
    """
    grouped: dict[str, list[Mapping[str, Any]]] = {}
    for item in answer.cannot_see:
        grouped.setdefault(item["why"], []).append(item)
    if len(grouped) == 1 and (answer.reason or "").startswith(next(iter(grouped))):
        return [("All effects of the catalogue", "For the reason above.")]
    out = []
    for why, items in grouped.items():
        names = words.listed([words.lower_first(words.title(item["effect"])) for item in items])
        chances = sorted({words.percent(item["power"]) for item in items if item.get("power")})
        chance = f" Chance of seeing it: {' to '.join(chances)}." if len(chances) == 1 else ""
        out.append((words.sentence(names)[:-1], words.sentence(why) + chance))
    return out


@dataclass(frozen=True)
class ReadRow:
    """What was read of one file or frame: its `name`, facts by their names, columns with meaning, origin,
    unit and scale, and what was not used.
    """

    name: str
    facts: tuple[tuple[str, str], ...]
    columns: tuple[tuple[str, str, str, str, str], ...]
    ignored: str
    reasons: tuple[str, ...]


def read(answer: DiagnosisValues) -> list[ReadRow]:
    """A row for each recording, and one for the validation run where the answer has it."""
    entries = answer.recordings or ({},) * len(answer.read)
    out = [
        _read(f"Recording {recording_name(entry, count)}" if len(answer.read) > 1 else "Recording", account)
        for count, (account, entry) in enumerate(zip(answer.read, entries, strict=False), 1)
    ]
    other = answer.data.get("validation")
    return [*out, _read("Validation run", other)] if other else out


def _read(name: str, account: Mapping[str, Any]) -> ReadRow:
    period, count = account["period"], account["rows"]
    facts = [("Rows", extent(account))]
    if period > 0.0:
        facts.append(("Rate", f"{words.number(1.0 / period, 4)} Hz"))
        facts.append(("Duration", f"{words.number(period * max(count - 1, 0), 4)} s"))
    if account.get("file"):
        facts.insert(0, ("File", shown(str(PurePath(account["file"])))))
    if account.get("modified"):
        facts.insert(1, ("Date of the file", _moment(account["modified"])))
    columns = tuple(
        (
            own,
            CANONICAL[own].meaning,
            _source(own, entry),
            words.unit(entry["unit"]),
            _scale(entry),
        )
        for own, entry in account["columns"].items()
    )
    return ReadRow(name, tuple(facts), columns, ignored(account), tuple(reasons(account)))


def _moment(text: str) -> str:
    """ "2026-11-28T15:42:03Z" as "2026-11-28 15:42:03 UTC"."""
    return text.replace("T", " ").replace("Z", " UTC")


def _source(own: str, entry: Mapping[str, Any]) -> str:
    return origin(own, {**entry, "scale": 1.0, "offset": None})


def _scale(entry: Mapping[str, Any]) -> str:
    scale, offset = entry["scale"], entry.get("offset")
    return f"{scale:.6g}" + (f", plus {offset:.6g}" if offset else "")


@dataclass(frozen=True)
class RecordingRow:
    """One of several recordings as the report shows it, residuals as multiples of its own noise."""

    name: str
    kind: str
    load: str
    duration: str
    fit: tuple[tuple[str, str, str], ...]


def each(answer: DiagnosisValues) -> list[RecordingRow]:
    """A row for each of several recordings."""
    out = []
    for count, entry in enumerate(answer.recordings, 1):
        noise, before, after = entry["noise_floor"], entry["fit"]["before"], entry["fit"]["after"]
        left = tuple(
            (words.channel(name)[0], words.number(before[name] / floor), words.number(after[name] / floor))
            for name, floor in noise.items()
            if floor and before.get(name) is not None and after.get(name) is not None
        )
        kind, load = (entry[key].replace("_", " ") for key in ("kind", "load"))
        seconds = f"{words.number(entry['duration'])} s"
        out.append(RecordingRow(recording_name(entry, count), kind, load, seconds, left))
    return out
