"""The pictures of the report and of notebook cards: what each chart shows of a diagnosis."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from . import budget as mismatch
from . import charts, palette, traces
from .charts import Array, Axis, Panel
from .results import DiagnosisValues
from .tables import FitRow
from .unmodelled import Term, reach
from .words import channel, number, percent
from .words import unit as unit_of

_FEWEST_TURNS: Final = 2
_FEW: Final = 400
"""Points that are drawn as dots; more are a line."""
_BINS: Final = 420
_LAGS: Final = 40
_LINEAR: Final = 12.0
"""Times the noise up to which a linear scale shows the small bars too."""
_REACH: Final = 5.0
"""Standard deviations that a histogram shows."""
_FEWEST: Final = 50
"""Values of a residual of which a distribution says something."""


@dataclass(frozen=True)
class Picture:
    """An inline SVG with what it shows."""

    svg: str
    caption: str


def over_time(answer: DiagnosisValues, name: str, *, width: float = charts.WIDTH) -> Picture:
    """The residual of a channel before and after over the whole run, with a band of twice the noise."""
    trace = _shown(answer)
    noise = answer.noise_floor.get(name)
    symbol, unit = channel(name)
    drawn = [
        (when, *traces.envelope(traces.elapsed(trace), traces.residual(trace, name, when), _BINS))
        for when in ("before", "after")
    ]
    reached = [-3.0 * noise, 3.0 * noise] if noise else []
    caption = f"{symbol}: measured minus model over the whole run"
    t = traces.elapsed(trace)
    panel = Panel(
        Axis.over(float(t[0]), float(t[-1]), "t", "s"),
        Axis.over(*charts.span(*(y for _, _, y in drawn), reached), f"{symbol} measured − model", unit),
        caption,
        width=width,
        marks={"data-plot": "residual", "data-channel": name},
    )
    if noise:
        panel.band(-2 * noise, 2 * noise)
    for when, x, y in drawn:
        few = len(x) < _FEW
        panel.line(x, y, when, width=0.8, line=not few, dots=few)
    if noise:
        panel.edges(-2 * noise, 2 * noise)
    return Picture(panel.svg(), caption)


def stretch(answer: DiagnosisValues, name: str) -> Picture:
    """Measured, before and after, over the stretch where the model without the effects is furthest off."""
    trace = _shown(answer)
    start, stop = traces.worst_window(trace, name)
    symbol, unit = channel(name)
    t = traces.elapsed(trace)[start:stop]
    drawn = [
        (part, *traces.envelope(t, trace[f"{name}_{part}"][start:stop], _BINS))
        for part in ("measured", "before", "after")
    ]
    caption = f"{symbol}: where the model without the effect is furthest off"
    panel = Panel(
        Axis.over(float(t[0]), float(t[-1]), "t", "s"),
        Axis.over(*charts.span(*(y for _, _, y in drawn)), symbol, unit),
        caption,
        marks={"data-plot": "trajectory", "data-channel": name},
    )
    for part, x, y in drawn:
        panel.line(x, y, part, width=1.0)
    return Picture(panel.svg(), caption)


def before_after(answer: DiagnosisValues) -> list[Picture]:
    """Per channel, the residual over time with the noise band, and a stretch of the trajectory itself."""
    if answer.shown is None:
        return []
    names = traces.channels(_shown(answer))
    return [draw(answer, name) for name in names for draw in (over_time, stretch)]


def worst(answer: DiagnosisValues, *, width: float = charts.WIDTH) -> Picture | None:
    """The residual over time of the channel that the model without the effects fails most."""
    if answer.shown is None:
        return None
    return over_time(answer, traces.rated(_shown(answer), answer.noise_floor)[0], width=width)


def located(answer: DiagnosisValues) -> list[Picture]:
    """Where it sits: the telling channel over the operating point, as a map, and by order of the angle."""
    if answer.shown is None or not answer.located:
        return []
    trace = _shown(answer)
    name = _telling(answer, trace)
    noise = answer.noise_floor.get(name)
    variables = [v for v in ("op_i_q", "op_omega_e", "op_i_d") if _varies(trace, v)][:2]
    out = [residual_over(trace, name, variable, noise) for variable in variables]
    if _varies(trace, "op_omega_e") and _varies(trace, "op_i_q"):
        out.append(residual_map(trace, name))
    angle = _telling_angle(answer, trace, name)
    return [*out, order_spectrum(trace, name, angle)] if angle is not None else out


def residual_over(trace: traces.Trace, name: str, variable: str, noise: float | None) -> Picture:
    """Mean of the residual before and after in bins of a variable, shaded by its scatter."""
    symbol, unit = channel(name)
    over, over_unit = channel(variable.removeprefix("op_"))
    drawn = [
        (when, *traces.binned(trace[variable], traces.residual(trace, name, when), 24))
        for when in ("before", "after")
    ]
    edges = [bound for _, _, mean, spread in drawn for bound in (mean - spread, mean + spread)]
    centres = [centre for _, centre, _, _ in drawn]
    caption = f"{symbol}: mean mismatch over {over}, shaded by its scatter"
    panel = Panel(
        Axis.over(*charts.span(*centres, margin=0.02), over, over_unit),
        Axis.over(*charts.span(*edges, [-noise, noise] if noise else []), f"{symbol} measured − model", unit),
        caption,
    )
    if noise:
        panel.band(-noise, noise)
    for when, centre, mean, spread in drawn:
        panel.between(centre, mean - spread, mean + spread, when)
        panel.line(centre, mean, when, dots=True)
    return Picture(panel.svg(), caption)


def residual_map(trace: traces.Trace, name: str) -> Picture:
    """Mean residual before over speed and torque current; cells that were not visited stay empty."""
    symbol, unit = channel(name)
    x, y, mean = traces.mean_map(
        trace["op_omega_e"], trace["op_i_q"], traces.residual(trace, name, "before"), (22, 16)
    )
    caption = f"{symbol}: mean mismatch before, over speed and torque current"
    panel = Panel(
        Axis.over(float(x[0]), float(x[-1]), *channel("omega_e")),
        Axis.over(float(y[0]), float(y[-1]), *channel("i_q")),
        caption,
        bar=True,
    )
    panel.cells(x, y, mean, f"{symbol} measured − model", unit)
    return Picture(panel.svg(), caption)


def order_spectrum(trace: traces.Trace, name: str, angle: str) -> Picture:
    """Amplitude of the residual before and after at whole orders of an angle."""
    symbol, unit = channel(name)
    kind = "mechanical" if angle == "op_theta_m" else "electrical"
    k = traces.orders()
    each = {
        when: traces.amplitudes(trace[angle], traces.residual(trace, name, when), k)
        for when in ("before", "after")
    }
    caption = f"{symbol}: mismatch by order of the {kind} angle"
    top = max(float(values.max()) for values in each.values()) or 1.0
    x = Axis(0.4, float(k[-1]) + 0.6, f"order of the {kind} angle", tuple(map(float, k)), tuple(map(str, k)))
    panel = Panel(x, Axis.over(0.0, 1.05 * top, f"{symbol} amplitude", unit), caption)
    for when, shift in (("before", -0.2), ("after", 0.2)):
        panel.bars(np.asarray(k + shift, dtype=float), each[when], 0.38, when)
    return Picture(panel.svg(), caption)


def unmodelled(term: Term) -> Picture:
    """A term of a map of what no candidate explains: a line over one variable, one for either direction of
    rotation where it depends on that, or colours over two.
    """
    first, *rest = term.variables
    names = [variable["variable"] for variable in term.variables]
    kind = {"d": "missing v_d", "q": "missing v_q"}.get(term.equation, "missing torque")
    unit = unit_of(term.unit)
    axes = [Axis.over(*reach(v), channel(v["variable"])[0], unit_of(v["unit"])) for v in (first, *rest[:1])]
    if rest and rest[0]["basis"] != "direction":
        x, y = (np.linspace(*reach(variable), 49) for variable in term.variables)
        across, up = np.meshgrid((x[1:] + x[:-1]) / 2, (y[1:] + y[:-1]) / 2, indexing="ij")
        panel = Panel(axes[0], axes[1], term.sentence, bar=True)
        panel.cells(x, y, term(**{names[0]: across, names[1]: up}), kind, unit)
        return Picture(panel.svg(), term.sentence)
    x = np.linspace(*reach(first), 181)
    lines: list[tuple[str, str, Array]] = []
    if rest:
        fast = np.full_like(x, 10.0 * rest[0]["width"])
        lines = [
            (role, way, term(**{names[0]: x, names[1]: sign * fast}))
            for role, way, sign in (("after", "forwards", 1.0), ("before", "backwards", -1.0))
        ]
    else:
        lines = [("after", "", term(**{names[0]: x}))]
    caption = term.sentence + (" Blue turns forwards, orange backwards." if rest else "")
    panel = Panel(axes[0], Axis.over(*charts.span(*(y for _, _, y in lines)), kind, unit), caption)
    for role, _, y in lines:
        panel.line(x, y, role, width=1.5)
    return Picture(panel.svg(), caption)


def against_noise(answer: DiagnosisValues) -> list[Picture]:
    """Per channel, the distribution of the residual in units of the noise beside that of white noise, and its
    correlation with itself. Empty where there are too few values.
    """
    if answer.shown is None:
        return []
    trace = _shown(answer)
    out: list[Picture] = []
    for name in traces.channels(trace):
        noise = answer.noise_floor.get(name)
        values = {when: traces.residual(trace, name, when) for when in ("before", "after")}
        count = min(int(np.isfinite(part).sum()) for part in values.values())
        if not noise or count < _FEWEST:
            continue
        out.append(_histogram(name, values, noise))
        if answer.recording_kind != "operating_points":
            out.append(_correlogram(name, values, traces.elapsed(trace), count))
    return out


def _histogram(name: str, values: dict[str, Array], noise: float) -> Picture:
    symbol, _ = channel(name)
    drawn = {when: traces.density(part, noise, _REACH, 41) for when, part in values.items()}
    x = np.linspace(-_REACH, _REACH, 121)
    normal = np.exp(-0.5 * x**2) / np.sqrt(2 * np.pi)
    top = max(float(normal.max()), *(float(y.max()) for _, y in drawn.values()))
    caption = f"{symbol}: distribution of the residual; the dashed line is normal noise"
    beyond = {when: _beyond(part, _REACH * noise) for when, part in values.items()}
    told = [f"{percent(share)} of {when}" for when, share in beyond.items() if share > 0.0]
    if told:
        caption += f"; beyond the picture lie {' and '.join(told)}"
    panel = Panel(
        Axis.over(-_REACH, _REACH, f"{symbol} measured − model in times the noise"),
        Axis.over(0.0, 1.08 * top, "density"),
        caption,
    )
    for when, opacity in (("before", 0.55), ("after", 0.75)):
        centres, y = drawn[when]
        panel.bars(centres, y, float(centres[1] - centres[0]), when, opacity=opacity)
    panel.line(x, normal, "measured", dash=True)
    return Picture(panel.svg(), caption)


def _beyond(values: Array, bound: float) -> float:
    """The share of the finite values whose magnitude is above `bound`."""
    finite = np.abs(values[np.isfinite(values)])
    return float((finite > bound).mean()) if finite.size else 0.0


def _correlogram(name: str, values: dict[str, Array], t: Array, count: int) -> Picture:
    symbol, _ = channel(name)
    lags = min(_LAGS, count // 4)
    each = {when: traces.autocorrelation(part, lags) for when, part in values.items()}
    wide = 1.96 / np.sqrt(count)
    period = float(np.median(np.diff(t)))
    step, unit = (period, "s") if period >= 0.1 else (1e3 * period, "ms")
    caption = f"{symbol}: correlation of the residual with itself; white noise stays within the band"
    low = min(-0.1, -1.5 * wide, *(float(r[1:].min()) for r in each.values()))
    high = max(0.1, 1.5 * wide, *(float(r[1:].max()) for r in each.values()))
    x = np.asarray(np.arange(1, lags + 1) * step, dtype=float)
    panel = Panel(
        Axis.over(0.0, (lags + 0.5) * step, "lag", unit),
        Axis.over(1.05 * low, min(1.0, high * 1.05), f"{symbol} autocorrelation"),
        caption,
    )
    panel.band(-wide, wide)
    panel.edges(-wide, wide)
    for when in ("before", "after"):
        panel.line(x, each[when][1:], when, dots=True, width=1.0)
    return Picture(panel.svg(), caption)


def ratios(rows: Sequence[FitRow]) -> Picture | None:
    """What is left in each channel before and after, in times its noise, as bars; None where no noise is
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
        mismatch.LEFT: palette.LEFT,
    }
    names = [name for entry in mismatch.judged(answer.budget) for name, _ in mismatch.shares(entry)]
    effects = [name for name in dict.fromkeys(names) if name not in plain]
    return dict(zip(effects, palette.PARTS * len(effects), strict=False)) | plain


def correlation(names: Sequence[str], matrix: Sequence[Sequence[float]]) -> Picture:
    """The correlation of estimated parameters, as a table of colours with its numbers."""
    cell, left, top = 34.0, 118.0, 10.0
    side = len(names)
    body = []
    for row, name in enumerate(names):
        y = top + row * cell
        body.append(charts.text(left - 8, y + cell / 2 + 3.5, name, anchor="end", role="soft"))
        body.append(
            charts.text(left + row * cell + cell / 2, top + side * cell + 12, str(row + 1), anchor="middle")
        )
        body.append(charts.text(left - 106, y + cell / 2 + 3.5, str(row + 1)))
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


def _shown(answer: DiagnosisValues) -> traces.Trace:
    assert answer.shown is not None, "whoever draws has asked whether there are traces"
    return answer.traces[answer.shown]


def _telling(answer: DiagnosisValues, trace: traces.Trace) -> str:
    """The channel that shows the equation found first, else the one furthest above its noise."""
    ranked = traces.rated(trace, answer.noise_floor)
    direct = {"d": ("i_d", "v_d"), "q": ("i_q", "v_q"), "mechanical": ("omega_e",)}.get(
        answer.located[0].equation, ()
    )
    return next((name for name in direct if name in ranked), ranked[0])


def _telling_angle(answer: DiagnosisValues, trace: traces.Trace, name: str) -> str | None:
    """The angle of which the mismatch is a function: the one that was located, else the one with the
    higher peak.
    """
    turning = [angle for angle in ("op_theta_e", "op_theta_m") if _turns(trace, angle) >= _FEWEST_TURNS]
    if not turning:
        return None
    first = answer.located[0]
    if first.order_electrical is None and first.order_mechanical is not None and "op_theta_m" in turning:
        return "op_theta_m"
    if first.order_electrical is not None:
        return turning[0]
    before = traces.residual(trace, name, "before")
    return max(
        turning, key=lambda angle: float(traces.amplitudes(trace[angle], before, traces.orders()).max())
    )


def _varies(trace: traces.Trace, variable: str) -> bool:
    if variable not in trace:
        return False
    values = trace[variable][np.isfinite(trace[variable])]
    return bool(values.size) and float(np.ptp(values)) > 0.02 * max(float(np.max(np.abs(values))), 1e-12)


def _turns(trace: traces.Trace, angle: str) -> float:
    if angle not in trace:
        return 0.0
    values = trace[angle][np.isfinite(trace[angle])]
    steps = np.abs(np.diff(np.unwrap(values)))
    # Where the angle moves by more than half a turn of order 14 between samples, no order can be told
    # from another.
    return float(steps.sum() / (2 * np.pi)) if steps.size and float(np.median(steps)) < np.pi / 14 else 0.0
