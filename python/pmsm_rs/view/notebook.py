"""How answers look in a notebook: a card of a few lines that carries its own colours, whatever the theme.

Sizes stay small enough to be saved with every cell: one picture at most.
"""

from __future__ import annotations

import html
import os
from collections import Counter
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

from .. import atomic
from ..messages import behind
from ..plot import palette
from ..results import words
from ..results.findings import compared
from . import figures, report, tables
from .headline import headline
from .readout import ignored, origins

if TYPE_CHECKING:
    from ..results.estimates import IdentificationValues
    from ..results.findings import DiagnosisValues

TONES: Final = {tone: palette.LIGHT[tone] for tone in ("good", "found", "doubt", "poor")}
"""Colours of verdicts, dark enough for small letters on white."""
_CELL: Final = "padding:3px 14px 3px 0;text-align:left;vertical-align:top;background:none"


@dataclass(frozen=True)
class Page:
    """A report that a notebook shows and that can be saved; `str` of it is the HTML text.

    Attributes
    ----------
    text : str
        The HTML text.
    """

    text: str

    def save(self, path: str | os.PathLike[str]) -> None:
        """Writes the page, whole or not at all.

        Parameters
        ----------
        path : path
            Where it goes.

        Raises
        ------
        UsageError
            If it cannot be written.
        """
        atomic.write_text(path, self.text)

    def __str__(self) -> str:
        return self.text

    def __repr__(self) -> str:
        return f"<report, {len(self.text.encode()) // 1000} kB of HTML; save(path) writes it>"

    def _repr_html_(self) -> str:
        return (
            f'<iframe srcdoc="{html.escape(self.text)}" title="pmsm-rs report" '
            'style="width:100%;height:720px;border:1px solid #d5dae0;border-radius:8px"></iframe>'
        )


def diagnosis(answer: DiagnosisValues) -> str:
    """The card of a diagnosis."""
    chip, tone = report.chip(answer)
    judged = compared(answer)
    part = answer.fit.get(judged, {})
    fit = [
        (
            words.channel(name)[0],
            [words.number(v) for v in (value, part["after"].get(name), answer.noise_floor.get(name))],
            words.channel(name)[1],
        )
        for name, value in part.get("before", {}).items()
    ]
    notes = [
        words.with_signs(
            f"{words.sentence(item['finding'])} {words.sentence(item['fix']).rstrip('.')}{behind(item)}"
        )
        for item in answer.data_quality
    ]
    if answer.interrupted:
        notes.insert(0, "Interrupted: this is the best so far.")
    if answer.unmodelled is not None:
        notes.append(answer.unmodelled.sentence)
    notes += [
        f"Read: {words.listed(origins(read))}; ignored: {ignored(read) or 'none'}." for read in answer.read
    ]
    named = answer.verdict in {"named", "partial"} and answer.ranking
    return _card(
        chip=f"{chip} · {words.percent(answer.ranking[0].probability)}" if named else chip,
        tone=TONES[tone],
        headline=words.with_signs(headline(answer)),
        notes=notes,
        tables=report.effect_rows(answer),
        fit=fit,
        fit_of=f"Measured minus model on the {'validation run' if judged == 'validation' else judged}",
        fit_heads=["before", "after", "noise"],
        picture=figures.worst(answer, width=470.0),
        closing=f"Next: {answer.next_experiment}" if answer.next_experiment else None,
    )


def identification(answer: IdentificationValues) -> str:
    """The card of an identification."""
    tone = "doubt" if answer.interrupted or not answer.converged else "good"
    chip = "Interrupted" if answer.interrupted else "Converged" if answer.converged else "Not converged"
    notes = [f"{words.listed(item['parameters'])}: {item['why']}" for item in answer.cannot_show]
    rows = [
        tables.row(name, entry, tables.MEANINGS.get(name, "")) for name, entry in answer.parameters.items()
    ]
    reasons = Counter(row.why_none for row in rows if row.why_none)
    for why, count in reasons.items():
        if count > 1:
            notes.append(
                f"No uncertainty for {words.listed([r.name for r in rows if r.why_none == why])}: {why}"
            )
            rows = [replace(row, why_none="") if row.why_none == why else row for row in rows]
    return _card(
        chip=chip,
        tone=TONES[tone],
        headline=f"{len(answer.parameters)} parameters by {answer.method}, {answer.evaluations} evaluations",
        notes=notes,
        tables=[("", rows)] if rows else [],
        fit=[(words.channel(n)[0], [words.number(v)], words.channel(n)[1]) for n, v in answer.rms.items()],
        fit_of="Measured minus model",
        fit_heads=[""],
        picture=None,
        closing=None,
    )


def _card(**content: Any) -> str:
    template = report.template("notebook.html.j2")
    return template.render(
        cell=_CELL, before=palette.LIGHT["before"], after=palette.LIGHT["after"], **content
    )
