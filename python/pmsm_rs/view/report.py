"""The report: one self-contained HTML page of a diagnosis."""

from __future__ import annotations

import base64
import hashlib
import json
import math
import re
from functools import cache
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from ..model import Model
from ..plot import palette
from ..results import budget, words
from ..results.findings import Candidate, DiagnosisValues, chosen, compared, leading
from . import bars, figures, plot_data, tables
from .advice import next_step
from .charts import Picture
from .corrected import machine_file
from .formulas import numbers, of_form, order
from .headline import is_whole, sentences
from .readout import converted

if TYPE_CHECKING:
    from jinja2 import Environment, Template

VERDICTS: Final = {
    "no_mismatch": ("Model complete", "good"),
    "named": ("Effect named", "found"),
    "partial": ("Named in part", "found"),
    "ambiguous": ("Ambiguous", "doubt"),
    "unknown": ("Unknown physics", "doubt"),
    "undetermined": ("Undetermined", "poor"),
}
_IN_PART: Final = ("No mismatch in what was asked", "doubt")
_LITERAL: Final = re.compile(r"((?<!\w)'[^']*'(?!\w)|\b\w+ = \{[^{}]*\})")
"""A name in quotes, or a line of TOML."""
_AT_FIRST: Final = 6
"""Effects that the first screen shows."""


def chip(answer: DiagnosisValues) -> tuple[str, str]:
    """The verdict in a word or two, and its tone: only what was asked for as a whole is complete."""
    if answer.verdict == "no_mismatch" and not is_whole(answer):
        return _IN_PART
    return VERDICTS.get(answer.verdict, (answer.verdict, "poor"))


def render(answer: DiagnosisValues, title: str | None = None, command: str | None = None) -> str:
    """The page as HTML text. The same answer, title and command give the same text.

    `command` is the command line that made the answer, which the page shows where it is given.
    """
    label, tone = chip(answer)
    verdict, *beside = sentences(answer)
    judged = compared(answer)
    found = effect_rows(answer)
    motor = tables.motor_rows(answer)
    fit = tables.fit(answer, judged)
    style, script = _style(), _source("report.js")
    return template("report.html.j2").render(
        answer=answer,
        title=title or "Diagnosis",
        command=command,
        policy=_policy(style, script),
        style=style,
        script=script,
        data=_data(answer),
        chip=label,
        tone=tone,
        headline=verdict,
        beside=beside,
        first=_first(answer),
        next_step=next_step(answer),
        overview=figures.worst(answer, width=420.0),
        ratios=bars.ratios(fit),
        fit=fit,
        judged=judged,
        trained=tables.fit(answer, "recording") if judged == "validation" else [],
        read=tables.read(answer),
        nameplate=converted(answer.nameplate),
        places=tables.places(answer),
        located=figures.located(answer),
        budget=bars.budget(answer),
        budget_fills=bars.budget_fills(answer),
        budget_table=tables.budget_table(answer),
        budget_run=next((entry.run for entry in budget.judged(answer.budget)), ""),
        candidates=leading(answer, 8),
        unlisted=max(0.0, 1.0 - sum(c.probability for c in answer.ranking)),
        unmodelled=answer.unmodelled,
        maps=[figures.unmodelled(term) for term in answer.unmodelled.terms] if answer.unmodelled else [],
        effects=found,
        motor=motor,
        plate=any(row.nameplate for row in motor),
        sheet=tables.spreadsheet([*found, ("", motor)]) if found or motor else "",
        machine_file=machine_file(answer),
        correlation=_correlation(answer),
        before_after=figures.before_after(answer),
        against_noise=figures.against_noise(answer),
        shown=answer.shown,
        each=tables.each(answer),
        blind=tables.unseen(answer),
    )


def effect_rows(answer: DiagnosisValues) -> list[tuple[str, list[tables.ParameterRow]]]:
    """The title and the parameters of each effect of the model that has any."""
    return [(words.title(c.effect), tables.rows(c)) for c in chosen(answer) if c.parameters]


def _first(answer: DiagnosisValues) -> list[tuple[Candidate, str, list[tables.ParameterRow]]]:
    """What the first screen shows of effects: those of the model, else the likeliest where none is sure."""
    candidates = chosen(answer)
    if not candidates and answer.verdict in {"named", "partial", "ambiguous"}:
        candidates = list(answer.ranking[:1])
    return [(c, words.title(c.effect), tables.rows(c)) for c in candidates[:_AT_FIRST]]


def _correlation(answer: DiagnosisValues) -> Picture | None:
    """The picture of the correlation of the estimates, where the answer has their covariance and there are
    at least two.
    """
    model = Model(answer.data["model"])
    kept = [k for k, row in enumerate(model.correlation) if math.isfinite(row[k])]
    if len(kept) < 2:
        return None
    matrix = model.correlation[kept][:, kept]
    return bars.correlation([model.names[k] for k in kept], np.nan_to_num(matrix).tolist())


def _data(answer: DiagnosisValues) -> str:
    """The traces for the script as JSON that cannot end its element; empty without any."""
    packed = plot_data.packed(answer)
    if packed is None:
        return ""
    return json.dumps(packed, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")


def _policy(style: str, script: str) -> str:
    """The content security policy: this one style, this one script, and nothing from outside."""

    def digest(text: str) -> str:
        return base64.b64encode(hashlib.sha256(text.encode()).digest()).decode("ascii")

    return (
        f"default-src 'none'; style-src 'sha256-{digest(style)}'; script-src 'sha256-{digest(script)}'; "
        "base-uri 'none'; form-action 'none'"
    )


@cache
def _style() -> str:
    dark = f"@media (prefers-color-scheme:dark){{:root{{{palette.style(palette.DARK)}}}}}"
    paper = f"@media print{{:root{{{palette.style(palette.LIGHT)}}}}}"
    return f":root{{{palette.style(palette.LIGHT)}}}\n{dark}\n{paper}\n{_source('report.css')}"


@cache
def _source(name: str) -> str:
    """The text of a file beside the templates."""
    environment = _environment()
    assert environment.loader is not None, "it has one"
    return environment.loader.get_source(environment, name)[0].strip()


@cache
def template(name: str) -> Template:
    """A template of the package; whatever it fills in is escaped."""
    return _environment().get_template(name)


@cache
def _environment() -> Environment:
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
        sentence=words.sentence,
        typeset=_typeset,
        of_form=of_form,
        numbers=numbers,
        order=order,
    )
    return environment


def _typeset(text: str) -> Any:
    """`text` escaped, its symbols with subscripts and effects by their titles; names in quotes and lines of
    TOML stay as they are, so that they can be copied.
    """
    from markupsafe import Markup, escape

    parts = _LITERAL.split(text)
    plain = [str(escape(words.titled(words.with_signs(part)))) for part in parts[::2]]
    parts[::2] = [words.subscripted(part, "<sub>", "</sub>") for part in plain]
    parts[1::2] = [
        str(escape(part)) if part.startswith("'") else f"<code>{escape(part)}</code>" for part in parts[1::2]
    ]
    return Markup("".join(parts))
