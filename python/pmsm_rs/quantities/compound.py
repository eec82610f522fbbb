"""Units of a nameplate: plain ones and ratios, with the words beside them that say which amplitude is meant.

Conversions of inertia follow from 1 ozf = 0.2780138509537812 N and 1 lb = 0.45359237 kg (NIST SP 811,
appendix B.8).
"""

from __future__ import annotations

import re
from functools import lru_cache
from typing import Final, NamedTuple

from ..errors import did_you_mean
from .units import RMS, UNITS, canonical

_INCH, _FOOT, _POUND, _OUNCE = 0.0254, 0.3048, 0.45359237, 0.45359237 / 16.0
_TORQUE = {name: unit.factor for name, unit in UNITS["torque"].items()}

_SIMPLE: Final[dict[str, dict[str, float]]] = {
    "resistance": {"ohm": 1.0, "ohms": 1.0, "mohm": 1e-3, "mohms": 1e-3},
    "inductance": {"h": 1.0, "mh": 1e-3, "uh": 1e-6},
    "flux linkage": {"vs": 1.0, "mvs": 1e-3, "vs/rad": 1.0, "mvs/rad": 1e-3, "wb": 1.0, "mwb": 1e-3},
    "inertia": {
        "kgm2": 1.0,
        "kgcm2": 1e-4,
        "kgmm2": 1e-6,
        "gm2": 1e-3,
        "gcm2": 1e-7,
        "gmm2": 1e-9,
        **dict.fromkeys(("ozins2", "ozfins2", "inozs2"), _TORQUE["ozf·in"]),
        **dict.fromkeys(("lbins2", "lbfins2", "inlbs2"), _TORQUE["lbf·in"]),
        **dict.fromkeys(("lbfts2", "lbffts2", "ftlbs2"), _TORQUE["lbf·ft"]),
        "kgfcms2": _TORQUE["kgf·cm"],
        "kgfms2": 100.0 * _TORQUE["kgf·cm"],
        "gfcms2": _TORQUE["gf·cm"],
        **dict.fromkeys(("ozin2", "inoz2"), _OUNCE * _INCH**2),
        **dict.fromkeys(("lbin2", "lbmin2"), _POUND * _INCH**2),
        **dict.fromkeys(("lbft2", "lbmft2"), _POUND * _FOOT**2),
    },
}
_RATIOS: Final = {
    "viscous friction": ("torque", "speed"),
    "torque constant": ("torque", "current"),
    "voltage constant": ("voltage", "speed"),
    "speed constant": ("speed", "voltage"),
}
EXAMPLES: Final[dict[str, tuple[str, ...]]] = {
    "resistance": ("ohm", "mohm"),
    "inductance": ("H", "mH", "uH"),
    "flux linkage": ("V·s", "mV·s", "Wb", "mWb"),
    "inertia": ("kg·m²", "kg·cm²", "g·cm²", "oz·in·s²", "lb·in·s²", "lb·in²"),
    "viscous friction": ("N·m·s/rad", "N·m/krpm", "mN·m/rpm", "oz·in/krpm"),
    "torque constant": ("N·m/A rms", "N·m/A peak", "oz·in/A rms"),
    "voltage constant": (
        "V/krpm line-to-line rms",
        "V s/rad line-to-line rms",
        "V/krpm line-to-line peak",
        "V/krpm phase peak",
    ),
    "speed constant": ("rpm/V",),
    "current": ("A rms", "A peak"),
    "torque": tuple(UNITS["torque"]),
    "speed": ("rpm", "rad/s"),
}
"""Units that a message offers, by quantity."""

_WORDS: Final = tuple(
    (word, re.compile(rf"(?<![A-Za-z])(?:{pattern})(?![A-Za-z])", re.IGNORECASE))
    for word, pattern in (
        ("line-to-line", r"line[\s-]*(?:to)?[\s-]*line|phase[\s-]*(?:to)?[\s-]*phase|ph-ph|l-l|ll"),
        ("phase", r"(?:line|phase)[\s-]*(?:to)?[\s-]*neutral|l-n|(?:per\s+)?phase|ph"),
        ("rms", r"r\.?m\.?s\.?|eff"),
        ("peak", r"peak|pk|amplitude"),
    )
)
_ATTACHED: Final = re.compile(r"(?<=[AV])(?=(?:rms|eff|pk|peak|ll|l-l|ph)(?![A-Za-z]))", re.IGNORECASE)
_POWER: Final = re.compile(r"[x×·*\s]*(?:10\s*(?:\^|\*\*)?\s*([-−⁻][0-9⁰¹²³⁴-⁹]+)|1e(-[0-9]+))[x×·*\s]*")
"""A power of ten in front of a unit or behind it, as in ×10⁻⁴ kg·m²."""
_DIGITS: Final = str.maketrans("−⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "--0123456789")
_SIGNS: Final = str.maketrans({"²": "2", "µ": "u", "μ": "u", "\u2126": "ohm", "\u03a9": "ohm"})


class Compound(NamedTuple):
    """SI value = value · factor; `words` are those of line-to-line, phase, rms and peak that stand beside."""

    factor: float
    words: frozenset[str]


@lru_cache(maxsize=1024)
def compound(text: str, quantity: str) -> Compound | None:
    """What `text` says as a unit of `quantity`, a key of EXAMPLES; None where it says nothing known.

    Speeds are mechanical. Hz is none of them, as it may be electrical.
    """
    text, power = _without_power(text)
    rest, words = _ATTACHED.sub(" ", text.replace("_", " ")), set()
    for word, pattern in _WORDS:
        rest, count = pattern.subn(" ", rest)
        words.update([word] if count else [])
    rest = re.sub(r"[(\[]\s*[)\]]|,", " ", rest)
    rest = re.sub(r"(?<=[A-Za-z])-(?=[A-Za-z])", "·", re.sub(r"\bper\b", "/", rest)).strip()
    factor = _ratio(rest, *_RATIOS[quantity]) if quantity in _RATIOS else _plain(rest, quantity)
    return None if factor is None else Compound(power * factor, frozenset(words))


def _without_power(text: str) -> tuple[str, float]:
    """`text` without a power of ten at its start or end, and that power."""
    for found in _POWER.finditer(text):
        rest = text[: found.start()] + text[found.end() :]
        exponent = int((found[1] or found[2]).translate(_DIGITS))
        if (
            rest.strip()
            and "" in (text[: found.start()].strip(), text[found.end() :].strip())
            and exponent > -19
        ):
            return rest, 10.0**exponent
    return text, 1.0


def suggested(text: str, quantity: str) -> str:
    """A clause on which units `quantity` may have, nearest first."""
    return did_you_mean(text, EXAMPLES[quantity])


def _ratio(text: str, above: str, below: str) -> float | None:
    """The factor of a unit of `above` over one of `below`, or of one times s/rad."""
    for at in (match.start() for match in re.finditer("/", text)):
        over, under = _plain(text[:at], above), _plain(text[at + 1 :], below)
        if over is not None and under is not None:
            return over / under
    product = re.fullmatch(r"(.+?)[\s·*.]*s(?:/rad)?", text)
    return _plain(product[1], above) if product and below == "speed" else None


def _plain(text: str, quantity: str) -> float | None:
    """The factor of a unit that is no ratio, None where it is not known."""
    bare = text.strip()
    bare = bare[1:-1] if bare.startswith("(") and bare.endswith(")") else bare
    if bare.startswith("M") and quantity != "speed":
        # It would be mega, which nobody means; read as milli it would be a guess.
        return None
    if quantity in _SIMPLE:
        plain = re.sub(r"[\s*·.⋅^()]", "", bare.translate(_SIGNS))
        return _SIMPLE[quantity].get(re.sub(r"sec(?=2|$|/)", "s", plain.lower()))
    name = canonical(bare, quantity)
    thousand = re.match(r"(?:1000|k)\s*(?=\S)", bare)
    if name is None and thousand and quantity == "speed":
        rest = _plain(bare[thousand.end() :], quantity)
        return None if rest is None else 1e3 * rest
    return None if name is None or name in RMS or name == "Hz" else UNITS[quantity][name].factor
