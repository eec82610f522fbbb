"""The pictures of the report and of notebook cards: what each chart shows of a diagnosis."""

from __future__ import annotations

from typing import Final

import numpy as np

from ..results import traces
from ..results.findings import DiagnosisValues
from ..results.unmodelled import Term, reach
from ..results.words import channel, percent
from ..results.words import unit as unit_of
from . import charts
from .charts import Array, Axis, Panel, Picture
from .places import places

_FEWEST_TURNS: Final = 2
_FEW: Final = 400
"""Points that are drawn as dots; more are a line."""
_BINS: Final = 420
_LAGS: Final = 40
_REACH: Final = 5.0
"""Standard deviations that a histogram shows."""
_FEWEST: Final = 50
"""Values of a residual of which a distribution says something."""


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
    if answer.shown is None or not places(answer):
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
    kind = term.quantity
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
