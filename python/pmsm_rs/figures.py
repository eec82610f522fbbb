"""The plots of the report as inline SVG: small, the same bytes every time, text left as text."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

from . import budget as mismatch
from . import plot, traces
from .words import channel

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from .results import DiagnosisValues

_STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "svg.hashsalt": "pmsm-rs",
    "font.family": "sans-serif",
    "font.size": 9.0,
    "axes.edgecolor": "#aab2ba",
    "axes.labelcolor": "#4a5560",
    "axes.linewidth": 0.7,
    "xtick.color": "#5d6873",
    "ytick.color": "#5d6873",
    "xtick.major.width": 0.7,
    "ytick.major.width": 0.7,
    "path.simplify": True,
    "figure.facecolor": "none",
    "axes.facecolor": "none",
}
_SIZE = (4.7, 2.5)
_FEWEST_TURNS = 2


@dataclass(frozen=True)
class Picture:
    """An inline SVG with what it shows."""

    svg: str
    caption: str


def draw(paint: Callable[..., Axes], alternative: str) -> str:
    """The SVG of one panel that `paint` draws; `alternative` says in words what it shows."""
    from matplotlib.figure import Figure

    with _style():
        figure = Figure(figsize=_SIZE, layout="constrained")
        paint(ax=figure.subplots())
        out = io.StringIO()
        figure.savefig(
            out, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None}
        )
    svg = out.getvalue()
    svg = svg[svg.index("<svg") :]
    # Names such as patch_3 would repeat from figure to figure within one page, and nothing refers to them.
    svg = re.sub(r' id="[a-z0-9]+_\d+"', "", svg)
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r"font: ([\d.]+)px 'sans-serif'(, sans-serif)?", r"font: \1px var(--sans)", svg)
    svg = re.sub(r"font-family: 'sans-serif'(, sans-serif)?", "font-family: var(--sans)", svg)
    head, body = svg.split(">", 1)
    view = re.search(r'viewBox="[^"]*"', head)
    assert view is not None, "matplotlib always writes a viewBox"
    title = f"<title>{_escape(alternative)}</title>"
    open_tag = '<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" role="img"'
    return re.sub(r"\n\s*", "\n", f"{open_tag} {view.group()}>{title}{body}").strip()


@contextmanager
def _style() -> Iterator[None]:
    import matplotlib

    with matplotlib.rc_context(_STYLE):
        yield


def _escape(text: str) -> str:
    return text.replace("&", "&amp;").replace("<", "&lt;").replace(">", "&gt;")


def located(answer: DiagnosisValues) -> list[Picture]:
    """Where it sits: the telling channel over the operating point, as a map, and by order of the angle."""
    if answer.shown is None:
        return []
    trace = answer.traces[answer.shown]
    worst = _telling(answer, trace)
    symbol = channel(worst)[0]
    noise = answer.noise_floor.get(worst)
    out = []
    for variable in [v for v in ("op_i_q", "op_omega_e", "op_i_d") if _varies(trace, v)][:2]:
        over = channel(variable.removeprefix("op_"))[0]
        paint = partial(plot.residual_over, source=trace, name=worst, variable=variable, noise=noise)
        out.append(_picture(paint, f"{symbol}: mean mismatch over {over}, shaded by its scatter"))
    if _varies(trace, "op_omega_e") and _varies(trace, "op_i_q"):
        paint = partial(plot.residual_map, source=trace, name=worst)
        out.append(_picture(paint, f"{symbol}: mean mismatch before, over speed and torque current"))
    angle = _telling_angle(answer, trace, worst)
    if angle is not None:
        kind = "mechanical" if angle == "op_theta_m" else "electrical"
        paint = partial(plot.order_spectrum, source=trace, name=worst, angle=angle)
        out.append(_picture(paint, f"{symbol}: mismatch by order of the {kind} angle"))
    return out


def _picture(paint: Callable[..., Axes], caption: str) -> Picture:
    return Picture(draw(paint, caption), caption)


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


def residual(answer: DiagnosisValues, name: str) -> Picture:
    """The residual of a channel over time, with the noise band."""
    paint = partial(plot.residual_over_time, source=answer, name=name)
    return _picture(paint, f"{channel(name)[0]}: measured minus model over the whole run")


def before_after(answer: DiagnosisValues) -> list[Picture]:
    """Per channel, the residual over time with the noise band, and a stretch of the trajectory itself."""
    if answer.shown is None:
        return []
    trace = answer.traces[answer.shown]
    out = []
    for name in traces.channels(trace):
        symbol = channel(name)[0]
        out.append(residual(answer, name))
        stretch = partial(plot.trajectory, source=trace, name=name)
        out.append(
            _picture(stretch, f"{symbol}: the stretch where the model without the effect is furthest off")
        )
    return out


def budget(answer: DiagnosisValues) -> list[Picture]:
    """Which share of the mismatch each effect takes away, where anything was explained."""
    told = mismatch.judged(answer.budget)
    if not told:
        return []
    words = " ".join(mismatch.sentence(entry) for entry in told)
    return [_picture(partial(mismatch.draw, told), words)]


def unmodelled(answer: DiagnosisValues) -> list[Picture]:
    """The map of what no candidate explains, term by term."""
    terms = answer.unmodelled.terms if answer.unmodelled is not None else ()
    return [_picture(partial(plot.unmodelled, term), term.sentence) for term in terms]


def _varies(trace: traces.Trace, variable: str) -> bool:
    import numpy as np

    if variable not in trace:
        return False
    values = trace[variable][np.isfinite(trace[variable])]
    return bool(values.size) and float(np.ptp(values)) > 0.02 * max(float(np.max(np.abs(values))), 1e-12)


def _turns(trace: traces.Trace, angle: str) -> float:
    import numpy as np

    if angle not in trace:
        return 0.0
    values = trace[angle][np.isfinite(trace[angle])]
    steps = np.abs(np.diff(np.unwrap(values)))
    # Where the angle moves by more than half a turn of order 14 between samples, no order can be told
    # from another.
    return float(steps.sum() / (2 * np.pi)) if steps.size and float(np.median(steps)) < np.pi / 14 else 0.0
