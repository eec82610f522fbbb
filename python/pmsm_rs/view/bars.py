"""The bars of the report: times the noise, the budget of the mismatch, and the correlation of parameters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from ..plot import palette
from ..results import budget as mismatch
from ..results.findings import DiagnosisValues
from ..results.words import channel, number, percent
from . import charts
from .charts import Axis, Picture
from .tables import FitRow

_LINEAR: Final = 12.0
"""Times the noise up to which a linear scale shows the small bars too."""


def ratios(rows: Sequence[FitRow]) -> Picture | None:
    """The residual of each channel before and after, in times its noise, as bars; None where no noise is
    known. The scale is linear, and logarithmic where one channel stands far above the others.
    """
    known = [row for row in rows if row.before_ratio]
    if not known:
        return None
    every = [ratio for row in known for ratio in (row.before_ratio, row.after_ratio) if ratio]
    log = max(every) > _LINEAR
    low, high = (0.5, 1.35 * max(every)) if log else (0.0, 1.18 * max(2.0, *every))
    left, right, top, each, thick = 40.0, 20.0, 20.0, 36.0, 11.0
    wide, bottom = charts.WIDTH - left - right, top + each * len(known)

    def at(ratio: float) -> float:
        if log:
            return left + wide * float(np.log(max(ratio, low) / low) / np.log(high / low))
        return left + wide * (ratio - low) / (high - low)

    ticks = charts.decades(low, high) if log else list(Axis.over(low, high, "").ticks)
    noise, faint = palette.of("noise"), palette.of("faint")
    body = [
        f'<rect x="{left:g}" y="{top:g}" width="{at(1.0) - left:.1f}" height="{bottom - top:g}" '
        f'fill="{noise}" fill-opacity=".28"/>'
    ]
    for tick in ticks:
        body.append(
            f'<path d="M{at(tick):.1f} {top:g}V{bottom + 3:g}" stroke="{palette.of("line")}" '
            'stroke-width=".8"/>'
        )
        body.append(charts.text(at(tick), bottom + 14, f"{tick:g}", anchor="middle"))
    for count, row in enumerate(known):
        y = top + each * count + (each - 2 * thick - 2) / 2
        body.append(charts.text(left - 6, y + thick + 4.5, row.symbol, anchor="end", role="ink", bold=True))
        pairs = (("before", row.before_ratio), ("after", row.after_ratio))
        for line, (role, ratio) in enumerate(pairs):
            if ratio is None:
                continue
            edge, up = max(at(ratio), left + 1.0), y + line * (thick + 2)
            body.append(
                f'<rect x="{left:g}" y="{up:g}" width="{edge - left:.1f}" height="{thick:g}" '
                f'fill="{palette.of(role)}"/>'
            )
            body.append(charts.text(edge + 4, up + thick - 2, f"{number(ratio)}×", role="soft"))
    body.append(
        f'<path d="M{at(1.0):.1f} {top - 3:g}V{bottom:g}" stroke="{palette.of("measured")}" '
        'stroke-width=".9" stroke-dasharray="4 3"/>'
    )
    body.append(charts.text(at(1.0), top - 7, "noise", anchor="middle", role="soft"))
    body.append(f'<path d="M{left:g} {bottom:g}H{left + wide:g}" stroke="{faint}" stroke-width=".8"/>')
    scale = "logarithmic scale" if log else "linear scale"
    label = f"rms of measured − model in times the noise, {scale}"
    body.append(charts.text(left + wide / 2, bottom + 28, label, anchor="middle", role="soft"))
    told = "; ".join(
        f"{row.symbol} {row.before_ratio:.3g} before"
        + (f", {row.after_ratio:.3g} after" if row.after_ratio is not None else "")
        for row in known
    )
    caption = f"Times the noise in each channel: {told}"
    return Picture(charts.picture(charts.WIDTH, bottom + 34, caption, body), caption)


def budget(answer: DiagnosisValues) -> Picture | None:
    """One bar per channel, divided by what takes which share of its mismatch away; None without a budget."""
    told = mismatch.judged(answer.budget)
    if not told:
        return None
    fills = budget_fills(answer)
    left, right, top, each, thick = 40.0, 10.0, 6.0, 40.0, 24.0
    wide, bottom = charts.WIDTH - left - right, top + each * len(told)
    body = []
    for count, entry in enumerate(told):
        y, x = top + each * count + (each - thick) / 2, left
        symbol = channel(entry.channel)[0]
        body.append(charts.text(left - 6, y + thick / 2 + 4, symbol, anchor="end", role="ink", bold=True))
        parts = mismatch.shares(entry)
        whole = sum(share for _, share in parts) or 1.0
        for name, share in parts:
            size = wide * share / whole
            body.append(
                f'<rect x="{x:.1f}" y="{y:g}" width="{size:.1f}" height="{thick:g}" fill="{fills[name]}" '
                f'stroke="{palette.of("faint")}" stroke-width=".7"/>'
            )
            if size > 26.0:
                words = percent(share)
                ink = palette.ink_on(fills[name])
                body.append(charts.text(x + size / 2, y + thick / 2 + 3.5, words, anchor="middle", fill=ink))
            x += size
    for tick in range(0, 101, 20):
        x = left + wide * tick / 100
        body.append(f'<path d="M{x:g} {bottom:g}v3" stroke="{palette.of("faint")}" stroke-width=".8"/>')
        body.append(charts.text(x, bottom + 14, str(tick), anchor="middle"))
    body.append(
        charts.text(left + wide / 2, bottom + 28, "share of the mismatch in %", anchor="middle", role="soft")
    )
    caption = " ".join(mismatch.sentence(entry) for entry in told)
    return Picture(charts.picture(charts.WIDTH, bottom + 34, caption, body), caption)


def budget_fills(answer: DiagnosisValues) -> dict[str, str]:
    """The fill of each part of the budget by its name."""
    plain = {
        mismatch.SHARED: palette.SHARED,
        mismatch.UNNAMED: palette.UNNAMED,
        mismatch.REST: palette.REST,
    }
    names = [name for entry in mismatch.judged(answer.budget) for name, _ in mismatch.shares(entry)]
    effects = [name for name in dict.fromkeys(names) if name not in plain]
    return dict(zip(effects, palette.PARTS * len(effects), strict=False)) | plain


def correlation(names: Sequence[str], matrix: Sequence[Sequence[float]]) -> Picture:
    """The correlation of estimated parameters, as a table of colours with its numbers."""
    cell, left, top = 34.0, 40.0 + 6.4 * max(map(len, names)), 10.0
    side = len(names)
    body = []
    for row, name in enumerate(names):
        y = top + row * cell
        body.append(charts.text(left - 8, y + cell / 2 + 3.5, name, anchor="end", role="soft"))
        body.append(
            charts.text(left + row * cell + cell / 2, top + side * cell + 12, str(row + 1), anchor="middle")
        )
        body.append(charts.text(12.0, y + cell / 2 + 3.5, str(row + 1)))
        for column in range(side):
            value = float(matrix[row][column])
            last = len(palette.DIVERGING) - 1
            fill = palette.DIVERGING[round((min(max(value, -1.0), 1.0) + 1.0) / 2.0 * last)]
            x = left + column * cell
            body.append(
                f'<rect x="{x:g}" y="{y:g}" width="{cell - 1:g}" height="{cell - 1:g}" fill="{fill}"/>'
            )
            shown = f"{value:.2f}".replace("0.", ".").replace("-.00", ".00")
            body.append(
                charts.text(
                    x + cell / 2 - 0.5, y + cell / 2 + 3, shown, anchor="middle", fill=palette.ink_on(fill)
                )
            )
    caption = "Correlation of the estimated parameters"
    return Picture(charts.picture(left + side * cell + 8, top + side * cell + 20, caption, body), caption)
