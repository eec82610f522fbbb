"""The nameplate as it stands on a data sheet, converted to the parameters of the model in SI units.

A resistance or inductance between two lines is twice that of a phase of the equivalent star, be the winding a
star or a delta.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final

from ..errors import did_you_mean, shown
from ..quantities.compound import EXAMPLES, compound, suggested
from ..quantities.parameters import BASE
from ..results.words import number
from .flux import BARE, FLUX, Given, agree, ambiguous, contradiction, flux, matching, peak
from .schema import Number, Table, validated

QUANTITIES: Final[dict[str, tuple[str, str]]] = {
    "r_s": ("resistance", "ohm"),
    "r_ll": ("resistance", "ohm"),
    "l_d": ("inductance", "H"),
    "l_q": ("inductance", "H"),
    "l_ll": ("inductance", "H"),
    "psi_m": ("flux linkage", "V·s"),
    "k_t": ("torque constant", "N·m/A"),
    "k_e": ("voltage constant", "V·s"),
    "kv": ("speed constant", "rpm/V"),
    "tau_rated": ("torque", "N·m"),
    "i_rated": ("current", "A"),
    "i_0": ("current", "A"),
    "n_0": ("speed", "rpm"),
    "j": ("inertia", "kg·m²"),
    "b": ("viscous friction", "N·m·s"),
}
"""Per key of [machine] the quantity, a key of compound.EXAMPLES, and the unit of a number without one."""
CANONICAL: Final = ("n_p", "r_s", "l_d", "l_q", "psi_m", "j", "b")
"""Keys that the model has itself."""
_GEAR: Final = (
    "a gear ratio is not taken, as it does not say which columns are of the output side. "
    'Scale those to the motor in [columns], as in omega_m = { from = "speed", scale = 9.0, unit = "rpm" }, '
    "theta_m likewise and tau_m by the inverse"
)


_SI: Final = {
    "n_p": "1",
    **BASE,
    "b_at_most": BASE["b"],
    "i_rated": "A",
    "omega_m": "rad/s",
    "tau_friction": "N m",
}
"""Units of what an entry comes to, as answers write them."""


class _Stated(Table):
    value: Number
    unit: str


@dataclass(frozen=True)
class Converted:
    """An entry of a nameplate that was not given as a parameter of the model in SI units.

    `gives` holds what it comes to, SI values by name; `taken` says whether the machine has them from it, and
    `why` why it has not.
    """

    key: str
    value: float
    unit: str
    gives: tuple[tuple[str, float], ...]
    taken: bool
    why: str | None = None

    def entry(self) -> dict[str, Any]:
        """Its JSON object."""
        return {
            "from": self.key,
            "value": self.value,
            "unit": self.unit,
            "gives": {name: {"value": value, "unit": _SI[name]} for name, value in self.gives},
            "taken": self.taken,
            "why": self.why,
        }


@dataclass
class Settled:
    """A nameplate in SI units: `values` by the model's names, checked by nobody yet, `i_rated` in A peak, and
    what was converted.
    """

    values: dict[str, object] = field(default_factory=dict)
    i_rated: float | None = None
    converted: list[Converted] = field(default_factory=list)

    def take(self, given: Given, **gives: float) -> None:
        """Takes what an entry gives."""
        self.values |= gives
        self.told(given, True, None, **gives)

    def told(self, given: Given, taken: bool, why: str | None, **gives: float) -> None:
        """Notes an entry that was converted."""
        self.converted.append(Converted(given.key, given.value, given.unit, tuple(gives.items()), taken, why))


def settled(table: Mapping[str, object], errors: list[str]) -> Settled:
    """The nameplate in a table [machine], with clauses added to `errors` for what is wrong, in doubt or
    contradicts itself.
    """
    out = Settled({key: value for key, value in table.items() if key in CANONICAL})
    known = (*CANONICAL, *QUANTITIES, "poles")
    for key in table:
        if key in ("gear", "gear_ratio"):
            errors.append(f"machine.{key}: {_GEAR}")
        elif key not in known:
            errors.append(f"machine.{key}: unknown key ({did_you_mean(key, known)})")
    if "tau_rated" in table and "i_rated" not in table:
        errors.append("machine.tau_rated: it needs i_rated in [machine], the current at that torque")
    _poles(table, out, errors)
    n_p = out.values.get("n_p")
    pairs = n_p if isinstance(n_p, int) and not isinstance(n_p, bool) and n_p > 0 else None
    given: dict[str, Given] = {}
    for key in QUANTITIES:
        if key in table and (key not in CANONICAL or isinstance(table[key], Mapping)):
            out.values.pop(key, None)
            if (read := _given(key, table[key], pairs, errors)) is not None:
                given[key] = read
    for key in (key for key in given if key in CANONICAL):
        out.take(given[key], **{key: given[key].si})
    _between_lines(given, out, errors)
    if pairs is not None:
        _flux(given, pairs, out, errors)
        _rated(given, pairs, out)
        _no_load(given, pairs, out)
    return out


def _poles(table: Mapping[str, object], out: Settled, errors: list[str]) -> None:
    if "poles" not in table:
        return
    poles, n_p = table["poles"], table.get("n_p")
    if not isinstance(poles, int) or isinstance(poles, bool) or poles < 2 or poles % 2:
        errors.append(f"machine.poles: the number of poles is even, not {poles!r}; n_p counts pairs")
    elif n_p is not None and n_p != poles // 2:
        errors.append(
            f"machine.poles: {poles} poles are {poles // 2} pairs, and n_p = {n_p!r}; leave one out"
        )
    elif n_p is None:
        out.take(Given("poles", poles, "", poles), n_p=poles // 2)


def _given(key: str, content: object, n_p: int | None, errors: list[str]) -> Given | None:
    """An entry with its unit and reading, None with a clause in `errors` where it has none."""
    quantity, plain = QUANTITIES[key]
    path = f"machine.{key}"
    is_number = isinstance(content, int | float) and not isinstance(content, bool)
    if not is_number and not isinstance(content, Mapping):
        value, unit = _apart(content) or ("...", EXAMPLES[quantity][0])
        errors.append(f'{path}: write it as {key} = {{ value = {value}, unit = "{shown(unit)}" }}')
        return None
    stated = validated(_Stated, path, {"value": content, "unit": plain} if is_number else content, errors)
    if stated is None:
        return None
    known = compound(stated.unit, quantity)
    if key not in CANONICAL and stated.value * (known.factor if known else 1.0) <= 0.0:
        errors.append(f"{path}: input should be greater than 0, not {stated.value!r}")
        return None
    readings = matching(key, known.words) if known else []
    if known is None or (known.words and not readings):
        hint = suggested(stated.unit, quantity)
        errors.append(f"{path}.unit: '{shown(stated.unit)}' is no unit of {quantity} ({hint})")
        return None
    if len(readings) > 1:
        units = BARE[key] if is_number else (stated.unit,)
        errors.append(f"{path}: {ambiguous(key, stated.value, units, known.words, quantity, n_p)}")
        return None
    return Given(key, stated.value, stated.unit, stated.value * known.factor, *readings)


def _apart(content: object) -> tuple[str, str] | None:
    """Number and unit of a text that holds both, None where it does not."""
    found = re.fullmatch(r"\s*([+-]?[0-9.]+(?:e[+-]?[0-9]+)?)\s*(\S.*)", str(content), re.IGNORECASE)
    return (found[1], found[2]) if found and isinstance(content, str) else None


def _between_lines(given: Mapping[str, Given], out: Settled, errors: list[str]) -> None:
    """Half of what is measured between two lines is that of a phase."""
    if (r_ll := given.get("r_ll")) is not None:
        half, r_s = r_ll.si / 2.0, out.values.get("r_s")
        if r_s is None:
            out.take(r_ll, r_s=half)
        elif _differ(half, r_s):
            errors.append(f"machine.r_ll: it gives r_s = {number(half, 4)} ohm, not {r_s!r}; leave one out")
        else:
            out.told(r_ll, False, "r_s is given", r_s=half)
    if (l_ll := given.get("l_ll")) is not None:
        half, l_d, l_q = l_ll.si / 2.0, out.values.get("l_d"), out.values.get("l_q")
        if l_d is None and l_q is None:
            out.take(l_ll, l_d=half, l_q=half)
        elif l_d is None or l_q is None:
            errors.append("machine.l_ll: beside one of l_d and l_q it says nothing of the other; give both")
        elif _differ(half, l_d, l_q):
            errors.append(
                f"machine.l_ll: half of it, {number(half, 4)} H, is not between l_d and l_q; leave it out"
            )
        else:
            out.told(l_ll, False, "l_d and l_q are given")


def _differ(value: float, *others: object) -> bool:
    """Whether `value` is neither near one of `others` nor between them; False where they are no numbers."""
    plain = [float(other) for other in others if isinstance(other, int | float) and other > 0]
    if len(plain) < len(others):
        return False
    return not (min(plain) <= value <= max(plain) or any(agree(value, other) for other in plain))


def _flux(given: Mapping[str, Given], n_p: int, out: Settled, errors: list[str]) -> None:
    """The flux linkage of the constants that give it, which have to agree."""
    psi_m = out.values.get("psi_m")
    constants = [given[key] for key in FLUX if key in given]
    if isinstance(psi_m, int | float) and not isinstance(psi_m, bool) and psi_m > 0:
        constants.insert(0, given.get("psi_m") or Given("psi_m", psi_m, "V s", float(psi_m)))
    if not constants:
        return
    first, *others = constants
    if first.key != "psi_m":
        out.take(first, psi_m=flux(first, n_p))
    for other in others:
        value = flux(other, n_p)
        if agree(value, flux(first, n_p)):
            out.told(other, False, f"{first.key} is given", psi_m=value)
        else:
            errors.append(f"machine: {contradiction(first, other, n_p)}")


def _rated(given: Mapping[str, Given], n_p: int, out: Settled) -> None:
    """Rated torque over rated current is a torque constant, which holds the reluctance torque, too."""
    tau, current = given.get("tau_rated"), given.get("i_rated")
    if current is not None:
        out.i_rated = peak(current)
        out.told(current, True, None, i_rated=out.i_rated)
    if tau is None or out.i_rated is None:
        return
    psi_m = tau.si / (1.5 * n_p * out.i_rated)
    if out.values.get("psi_m") is None and not any(key in given for key in ("psi_m", *FLUX)):
        out.take(tau, psi_m=psi_m)
    else:
        out.told(tau, False, "it holds reluctance torque, and the flux is given otherwise", psi_m=psi_m)


def _no_load(given: Mapping[str, Given], n_p: int, out: Settled) -> None:
    """One point of no load says how large the friction is, not how it divides."""
    current, speed = given.get("i_0"), given.get("n_0")
    if speed is not None:
        out.told(speed, False, "one point does not tell viscous from Coulomb friction", omega_m=speed.si)
    psi_m = out.values.get("psi_m")
    if current is None:
        return
    if not isinstance(psi_m, int | float):
        out.told(current, False, "without a flux it gives no torque")
        return
    tau = 1.5 * n_p * psi_m * peak(current)
    gives = {"tau_friction": tau} | ({} if speed is None else {"b_at_most": tau / speed.si})
    out.told(current, False, "one point does not tell viscous from Coulomb friction", **gives)
