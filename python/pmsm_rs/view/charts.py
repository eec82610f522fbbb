"""Small charts as inline SVG: panels with axes, bands, lines, bars and maps.

Numbers have one decimal of a pixel at most, so the same data give the same bytes. Colours are attributes that
follow the theme of the page, so a strict content security policy lets them pass. Text stays text.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from html import escape
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..plot import palette
from ..results.rounding import fixed, raised
from ..results.words import subscripted

Array = NDArray[np.float64]

WIDTH: Final = 350.0
HEIGHT: Final = 204.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 48.0, 12.0, 8.0, 34.0
_BAR: Final = 54.0
"""Width of a colour bar with its numbers."""


@dataclass(frozen=True)
class Picture:
    """An inline SVG with what it shows."""

    svg: str
    caption: str


@dataclass(frozen=True)
class Axis:
    """A range that is shown, the places of its ticks, and what is written at them: the value without ten to
    the `power`, which the label has.
    """

    low: float
    high: float
    label: str
    ticks: tuple[float, ...]
    texts: tuple[str, ...]
    power: int = 0

    @classmethod
    def over(cls, low: float, high: float, symbol: str, unit: str = "", *, count: int = 5) -> Axis:
        """An axis with about `count` round ticks; a power of ten goes into the label."""
        if not (math.isfinite(low) and math.isfinite(high)):
            low, high = 0.0, 1.0
        if high <= low:
            wide = abs(low) * 0.1 or 1.0
            low, high = low - wide, high + wide
        step = _step((high - low) / count)
        first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
        ticks = tuple(k * step for k in range(first, last + 1))
        exponent = math.floor(math.log10(max(abs(low), abs(high))))
        power = 3 * (exponent // 3) if not -3 <= exponent < 5 else 0
        places = max(power - math.floor(math.log10(step) + 1e-9), 0)
        texts = tuple(fixed(tick, places, power) for tick in ticks)
        sign = " ".join(part for part in (raised(power), unit) if part)
        return cls(low, high, f"{symbol} in {sign}" if sign else symbol, ticks, texts, power)


def decades(low: float, high: float) -> list[float]:
    """1, 2 and 5 times the powers of ten between two positive bounds, fewer of them over several decades."""
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    steps = (1.0, 2.0, 5.0) if last - first <= 3 else (1.0,)
    return [k * 10.0**e for e in range(first, last + 1) for k in steps if low <= k * 10.0**e <= high]


def _step(rough: float) -> float:
    """The first of 1, 2 and 5 times a power of ten that is not far below `rough`."""
    power = 10.0 ** math.floor(math.log10(rough))
    return next(k * power for k in (1, 2, 5, 10) if k * power >= 0.75 * rough)


@dataclass
class Panel:
    """One chart; what is added later is drawn above what was added before.

    `marks` are attributes of the SVG, from which the page's script learns what it shows.
    """

    x: Axis
    y: Axis
    alternative: str
    width: float = WIDTH
    height: float = HEIGHT
    bar: bool = False
    marks: dict[str, str] = field(default_factory=dict)
    _parts: list[str] = field(default_factory=list, init=False)
    _beside: list[str] = field(default_factory=list, init=False)

    @property
    def box(self) -> tuple[float, float, float, float]:
        """Left, top, width and height of the area of the data in pixels."""
        right = _RIGHT + (_BAR if self.bar else 0.0)
        return _LEFT, _TOP, self.width - _LEFT - right, self.height - _TOP - _BOTTOM

    def at(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Data in pixels, kept near the picture."""
        left, top, wide, high = self.box
        across = left + (x - self.x.low) / (self.x.high - self.x.low) * wide
        down = top + (self.y.high - y) / (self.y.high - self.y.low) * high
        return np.clip(across, -1e4, 1e4), np.clip(down, -1e4, 1e4)

    def band(self, low: float, high: float, role: str = "noise") -> None:
        """A horizontal band across the panel."""
        left, _, wide, _ = self.box
        _, (bottom, top) = self.at(np.zeros(2), np.array([low, high]))
        fill = palette.of(role)
        self._parts.append(
            f'<rect class="band" x="{left:g}" y="{_px(top)}" width="{_px(wide)}" '
            f'height="{_px(max(bottom - top, 0.5))}" fill="{fill}" fill-opacity=".28"/>'
        )

    def edges(self, *values: float) -> None:
        """Dashed lines across the panel, as at the edges of a band."""
        left, _, wide, _ = self.box
        _, down = self.at(np.zeros(len(values)), np.array(values))
        self._parts += [
            f'<line class="edge" x1="{left:g}" x2="{_px(left + wide)}" y1="{_px(y)}" y2="{_px(y)}" '
            f'stroke="{palette.of("measured")}" stroke-width=".7" stroke-dasharray="4 3"/>'
            for y in down
        ]

    def line(
        self,
        x: Array,
        y: Array,
        role: str,
        *,
        width: float = 1.3,
        dots: bool = False,
        line: bool = True,
        dash: bool = False,
    ) -> None:
        """A line that is broken where a value is not finite, with dots or of dots alone where asked for."""
        across, down = self.at(x, y)
        colour = palette.of(role)
        if line:
            dashed = ' stroke-dasharray="5 3"' if dash else ""
            self._parts.append(
                f'<path class="{role}" d="{path(across, down)}" fill="none" stroke="{colour}" '
                f'stroke-width="{width:g}" stroke-linejoin="round"{dashed}/>'
            )
        if dots:
            ok = np.isfinite(across) & np.isfinite(down)
            steps = "".join(f"M{_px(a)} {_px(d)}h0" for a, d in zip(across[ok], down[ok], strict=True))
            self._parts.append(
                f'<path class="{role} dots" d="{steps}" stroke="{colour}" stroke-width="3.2" '
                'stroke-linecap="round"/>'
            )

    def between(self, x: Array, low: Array, high: Array, role: str) -> None:
        """A pale band between two lines, broken where they are not finite."""
        ok = np.isfinite(low) & np.isfinite(high)
        for run in np.split(np.arange(len(x)), np.flatnonzero(np.diff(ok.astype(int))) + 1):
            if not run.size or not ok[run[0]]:
                continue
            across, down = self.at(np.append(x[run], x[run][::-1]), np.append(low[run], high[run][::-1]))
            self._parts.append(
                f'<path d="{path(across, down)}z" fill="{palette.of(role)}" fill-opacity=".16"/>'
            )

    def bars(self, x: Array, y: Array, width: float, role: str, *, opacity: float = 1.0) -> None:
        """Upright bars of `width` (in units of x) about `x`, from zero to `y`."""
        left, down = self.at(x - 0.5 * width, y)
        right, base = self.at(x + 0.5 * width, np.zeros(len(x)))
        steps = "".join(
            f"M{_px(a)} {_px(b)}V{_px(d)}H{_px(c)}V{_px(b)}z"
            for a, b, c, d in zip(left, base, right, down, strict=True)
        )
        self._parts.append(
            f'<path class="{role}" d="{steps}" fill="{palette.of(role)}" fill-opacity="{opacity:g}"/>'
        )

    def cells(self, x: Array, y: Array, values: Array, symbol: str, unit: str) -> None:
        """A map with its colour bar: `values` of shape (len(x) - 1, len(y) - 1) between the edges x and y.

        Cells that are not finite stay empty.
        """
        finite = values[np.isfinite(values)]
        peak = float(np.abs(finite).max()) if finite.size else 0.0
        peak = peak or 1.0
        steps = len(palette.DIVERGING)
        level = np.clip(((values / peak + 1.0) / 2.0 * steps), 0, steps - 1)
        across, _ = self.at(x, np.zeros(len(x)))
        _, down = self.at(np.zeros(len(y)), y)
        drawn: dict[int, list[str]] = {}
        for column, row in zip(*np.nonzero(np.isfinite(values)), strict=True):
            a, b, c, d = across[column], down[row + 1], across[column + 1], down[row]
            drawn.setdefault(int(level[column, row]), []).append(
                f"M{_px(a)} {_px(b)}H{_px(c)}V{_px(d)}H{_px(a)}z"
            )
        self._parts += [
            f'<path d="{"".join(paths)}" fill="{palette.DIVERGING[at]}"/>'
            for at, paths in sorted(drawn.items())
        ]
        self._scale(Axis.over(-peak, peak, symbol, unit, count=4), steps)

    def _scale(self, axis: Axis, steps: int) -> None:
        """The colour bar of a map."""
        left, top, wide, high = self.box
        at, each = left + wide + 10.0, high / steps
        for count, fill in enumerate(palette.DIVERGING):
            y = top + high - (count + 1) * each
            self._beside.append(
                f'<rect x="{_px(at)}" y="{_px(y)}" width="8" height="{_px(each + 0.3)}" fill="{fill}"/>'
            )
        for tick, shown in zip(axis.ticks, axis.texts, strict=True):
            y = top + (axis.high - tick) / (axis.high - axis.low) * high
            self._beside.append(text(at + 12, y + 3.4, shown))
        middle = top + high / 2
        self._beside.append(text(self.width - 5, middle, axis.label, anchor="middle", turned=True))

    def note(self, x: float, y: float, words: str, *, anchor: str = "start") -> None:
        """Words at a place of the data."""
        across, down = self.at(np.array([x]), np.array([y]))
        self._beside.append(text(float(across[0]), float(down[0]), words, anchor=anchor))

    def svg(self) -> str:
        """The chart."""
        left, top, wide, high = self.box
        bottom = top + high
        area = f"{left:g} {top:g} {_px(wide)} {_px(high)}"
        # An SVG within the SVG cuts off what lies beyond its edges.
        size = f'x="{left:g}" y="{top:g}" width="{_px(wide)}" height="{_px(high)}"'
        clip = f'<svg class="data" {size} viewBox="{area}">'
        xs, _ = self.at(np.array(self.x.ticks), np.zeros(len(self.x.ticks)))
        _, ys = self.at(np.zeros(len(self.y.ticks)), np.array(self.y.ticks))
        grid = "".join(f"M{left:g} {_px(y)}H{_px(left + wide)}" for y in ys)
        marks = "".join(f"M{_px(x)} {_px(bottom)}v3" for x in xs)
        frame = (
            f'<path class="grid" d="{grid}" stroke="{palette.of("line")}" stroke-width=".8"/>',
            f'<path class="ticks" d="{marks}M{left:g} {_px(bottom)}H{_px(left + wide)}" '
            f'stroke="{palette.of("faint")}" stroke-width=".8" fill="none"/>',
        )
        numbers = [
            '<g class="tx">',
            *(
                text(x, bottom + 14, shown, anchor="middle")
                for x, shown in zip(xs, self.x.texts, strict=True)
            ),
            '</g><g class="ty">',
            *(
                text(left - 5, y + 3.4, shown, anchor="end")
                for y, shown in zip(ys, self.y.texts, strict=True)
            ),
            "</g>",
        ]
        labels = (
            text(left + wide / 2, self.height - 4, self.x.label, anchor="middle", role="soft"),
            text(10, top + high / 2, self.y.label, anchor="middle", role="soft", turned=True),
        )
        body = [frame[0], clip, *self._parts, "</svg>", frame[1], *numbers, *labels, *self._beside]
        return picture(self.width, self.height, self.alternative, body, self._marks(area))

    def _marks(self, area: str) -> dict[str, str]:
        """What the script has to know to draw the panel again; nothing where it need not."""
        if not self.marks:
            return {}
        edges = (self.x.low, self.x.high, self.y.low, self.y.high)
        scales = {
            "data-box": area,
            "data-range": " ".join(f"{edge:.9g}" for edge in edges),
            "data-powers": f"{self.x.power} {self.y.power}",
        }
        return self.marks | scales


def picture(
    width: float, height: float, alternative: str, body: Iterable[str], marks: dict[str, str] | None = None
) -> str:
    """An SVG of `width` by `height`, with `alternative` for those who do not see it."""
    more = "".join(f' {name}="{escape(value)}"' for name, value in (marks or {}).items())
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}" role="img"{more} '
        'font-family="var(--pm-sans,system-ui,sans-serif)" font-size="10">'
        f"<title>{escape(alternative)}</title>{''.join(body)}</svg>"
    )


def text(
    x: float,
    y: float,
    words: str,
    *,
    anchor: str = "start",
    role: str = "faint",
    turned: bool = False,
    fill: str | None = None,
    bold: bool = False,
) -> str:
    """Words at a place in pixels, their symbols with subscripts; `turned` reads from bottom to top."""
    shown = subscripted(
        escape(words), '<tspan dy="2.5" font-size="8">', '</tspan><tspan dy="-2.5">\u200b</tspan>'
    )
    turn = f' transform="rotate(-90 {_px(x)} {_px(y)})"' if turned else ""
    weight = ' font-weight="600"' if bold else ""
    colour = fill or palette.of(role)
    return (
        f'<text x="{_px(x)}" y="{_px(y)}" fill="{colour}" text-anchor="{anchor}"{turn}{weight}>{shown}</text>'
    )


def path(x: Array, y: Array) -> str:
    """The `d` of a line through points in pixels, broken where one is not finite."""
    out: list[str] = []
    pen = "M"
    for across, down in zip(np.round(x, 1).tolist(), np.round(y, 1).tolist(), strict=True):
        if across != across or down != down:
            pen = "M"
            continue
        out.append(f"{pen}{across:g} {down:g}")
        pen = "L"
    return "".join(out)


def _px(value: float) -> str:
    return f"{round(float(value), 1) + 0.0:g}"


def span(*values: Array | Sequence[float], margin: float = 0.04) -> tuple[float, float]:
    """The range of all finite values with a margin to both sides."""
    finite = [part[np.isfinite(part)] for part in map(np.asarray, values)]
    every = np.concatenate(finite) if finite else np.empty(0)
    if not every.size:
        return 0.0, 1.0
    low, high = float(every.min()), float(every.max())
    wide = (high - low) * margin
    return low - wide, high + wide
