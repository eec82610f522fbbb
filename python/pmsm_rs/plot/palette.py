"""The colours of report and notebook, by role: on light paper, and in the dark.

`before` and `after` are those of Okabe and Ito, which people with colour-deficient sight tell apart. Text has
a contrast of 4.5 to its ground and lines of data one of 3, the levels of WCAG 2.2 AA; a test computes them.
"""

from __future__ import annotations

from typing import Final

LIGHT: Final = {
    "paper": "#ffffff",
    "wash": "#f4f6f8",
    "line": "#e0e5ea",
    "ink": "#1b1f24",
    "soft": "#45505b",
    "faint": "#5a656f",
    "measured": "#1b1f24",
    "before": "#d55e00",
    "after": "#0072b2",
    "noise": "#7d8790",
    "good": "#00785a",
    "found": "#0068a3",
    "doubt": "#935600",
    "poor": "#56616b",
}
DARK: Final = {
    "paper": "#171b20",
    "wash": "#0e1115",
    "line": "#2d343c",
    "ink": "#e9edf1",
    "soft": "#b9c2cb",
    "faint": "#9aa5b0",
    "measured": "#e9edf1",
    "before": "#ff8b3d",
    "after": "#56b4f0",
    "noise": "#828d98",
    "good": "#3fc99b",
    "found": "#63b9f2",
    "doubt": "#eeb25a",
    "poor": "#aab4be",
}
TEXT: Final = ("ink", "soft", "faint", "good", "found", "doubt", "poor")
"""Roles of words, which stand on `paper` and on `wash`."""
PARTS: Final = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#f0e442", "#d55e00")
"""Fills of the parts of a whole, the same on light and dark paper; each has an outline in `faint`."""
SHARED: Final = "#b8c0c8"
UNNAMED: Final = "#6b7480"
REST: Final = "#e3e7ea"
MAP: Final = ("#7f3b08", "#b35806", "#e08214", "#fdb863", "#fee0b6", "#f7f7f7", "#d8daeb", "#b2abd2")
_MAP_END: Final = ("#8073ac", "#542788", "#2d004b")
DIVERGING: Final = (*reversed(_MAP_END), *reversed(MAP))
"""Fills of a map from its lowest to its highest value (ColorBrewer's PuOr), nothing in the middle."""


def of(role: str) -> str:
    """A colour as SVG and CSS write it: that of the page's theme, on light paper where there is none."""
    return f"var(--pm-{role},{LIGHT[role]})"


def style(colours: dict[str, str]) -> str:
    """The declarations of a theme."""
    return ";".join(f"--pm-{role}:{colour}" for role, colour in colours.items())


def luminance(colour: str) -> float:
    """Relative luminance of "#rrggbb" by WCAG 2.2."""
    parts = [int(colour[at : at + 2], 16) / 255.0 for at in (1, 3, 5)]
    linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one: str, other: str) -> float:
    """Contrast of two colours by WCAG 2.2, from 1 to 21."""
    low, high = sorted((luminance(one), luminance(other)))
    return (high + 0.05) / (low + 0.05)


def ink_on(fill: str) -> str:
    """Black or white, whichever is read better on `fill`."""
    return max(("#000000", "#ffffff"), key=lambda ink: contrast(ink, fill))
