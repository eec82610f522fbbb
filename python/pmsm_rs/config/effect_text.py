"""Effects that a user gives as text: a formula, its parameters, and where it acts."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Final

from .. import _core
from .._core import UsageError
from ..errors import clauses, did_you_mean, refuse

SIDES: Final[dict[str, tuple[str, ...]]] = {
    "torque": ("",),
    "voltage": ("d", "q"),
    "flux": ("d", "q"),
    "energy": ("",),
    "angle": ("",),
    "current": ("a", "b", "c"),
}
"""Sides on which a formula may act, and the names of its terms."""
_KEYS: Final = ("unit", "low", "high", "typical", "values", "meaning")
_VALUE: Final = "value"
"""Key of a table with the values of the parameters, where a simulated machine has the effect."""


@dataclass(frozen=True)
class Effect:
    """An effect given as text, as `pmsm_rs.effect` makes it: frozen, and equal where the text is.

    Attributes
    ----------
    name : str
        By which answers call it.
    text : str
        Its definition as JSON text, which files and answers carry.

    Examples
    --------
    >>> import pmsm_rs as pm
    >>> pm.effect("my_brake", torque="k*w", parameters={"k": ("N m s", 0, 1)}).name
    'my_brake'
    """

    name: str
    text: str = field(repr=False)

    @cached_property
    def definition(self) -> dict[str, Any]:
        """The definition: name, side, terms, parameters, and title where there is one."""
        told: dict[str, Any] = json.loads(self.text)
        return told

    @cached_property
    def entry(self) -> dict[str, Any]:
        """Its entry in the catalogue, as `pmsm_rs.effects()` lists those that ship with the package."""
        told: dict[str, Any] = json.loads(_core.effect_of_text(self.text))
        return told

    @property
    def side(self) -> str:
        """Where it acts: torque, voltage, flux, energy, angle or current."""
        return str(self.definition["side"])

    @property
    def equation(self) -> str:
        """Its formulas, each behind the name of what it is."""
        return str(self.entry["equation"])

    @property
    def strengths(self) -> tuple[str, ...]:
        """The parameters at whose zero the effect is absent."""
        return tuple(p["name"] for p in self.entry["parameters"] if p["strength"])

    @classmethod
    def of(cls, definition: Mapping[str, Any]) -> Effect:
        """The effect of a definition.

        Parameters
        ----------
        definition : mapping
            As it stands in an answer, a machine file or a configuration.

        Returns
        -------
        Effect
            The effect.

        Raises
        ------
        UsageError
            For what is wrong with it.
        """
        told = json.loads(_core.effect_of_text(json.dumps(definition, allow_nan=False)))["definition"]
        return cls(str(told["name"]), json.dumps(told, sort_keys=True))


def effect(
    name: str,
    *,
    torque: str | None = None,
    voltage: Sequence[str] | None = None,
    flux: Sequence[str] | None = None,
    energy: str | None = None,
    angle: str | None = None,
    current: Sequence[str] | None = None,
    parameters: Mapping[str, Any],
    title: str | None = None,
    replaces: Sequence[str] = (),
) -> Effect:
    """An effect as text, for `diagnose` and `simulate`.

    One side is given.

    A formula has `+ - * / **`, brackets, `pi`, and sin, cos, tanh, exp, log, sqrt, abs, atan, sign and pow.
    Variables are omega_m (or w), omega_e, theta_m, theta_e, tau_e, t, i_d, i_q, i_a, i_b, i_c, v_d, v_q,
    lambda_d, lambda_q, l_d, l_q, psi_m and n_p, in SI units, each where its side knows it.

    The strength is the first parameter that makes the formula zero at its own zero, or the first few that
    do so together.

    Parameters
    ----------
    name : str
        By which answers call it: letters, digits and underscores.
    torque : str or None, default None
        What is taken from the rotor against positive rotation, N·m.
    voltage : sequence of two str or None, default None
        The pair d, q lost between command and winding, V.
    flux : sequence of two str or None, default None
        The pair d, q added to the magnet's flux, V·s.
    energy : str or None, default None
        What is added to the field energy per 3/2, J: a function of the flux linkage above the magnet's.
    angle : str or None, default None
        Measured minus true electrical angle, rad.
    current : sequence of three str or None, default None
        Measured minus true current of the phases a, b, c, A.
    parameters : mapping
        From a name to (unit, low, high) or (unit, low, high, typical), or to a mapping with these keys and
        `meaning`. With `values`, a list, a parameter is chosen among them and not fitted, such as an order.
    title : str or None, default None
        What answers show; None makes it from the name.
    replaces : sequence of str, default ()
        Effects of the catalogue that are not asked about beside this one.

    Returns
    -------
    Effect
        The effect, to be given to `diagnose` or `simulate`.

    Raises
    ------
    UsageError
        With `problem` and `fix`. Where a formula is wrong, `position` is the number of the character, and
        `term` says which formula.

    Examples
    --------
    >>> import pmsm_rs as pm
    >>> brake = pm.effect("my_brake", torque="k*w", parameters={"k": ("N m s", 0, 1)})
    >>> brake.strengths
    ('k',)
    """
    given = {
        "torque": torque,
        "voltage": voltage,
        "flux": flux,
        "energy": energy,
        "angle": angle,
        "current": current,
    }
    return _built(name, {side: x for side, x in given.items() if x is not None}, parameters, title, replaces)


def _built(
    name: object, sides: Mapping[str, Any], parameters: object, title: object, replaces: object
) -> Effect:
    shown = str(name)[:40]
    if len(sides) != 1:
        raise refuse(
            UsageError,
            f"effect '{shown}' has {len(sides)} sides",
            fix=f"give one of {', '.join(SIDES)}",
        )
    [(side, given)] = sides.items()
    terms = [given] if isinstance(given, str) else list(given) if isinstance(given, Sequence) else []
    if len(terms) != len(SIDES[side]) or not all(isinstance(term, str) for term in terms):
        which = ", ".join(SIDES[side])
        raise refuse(
            UsageError,
            f"effect '{shown}': {side} is not given as text",
            fix=f"give the formulas of {which} as texts" if which else "give one formula as text",
        )
    if not isinstance(parameters, Mapping):
        raise refuse(
            UsageError,
            f"effect '{shown}' has no parameters",
            fix='give them by name, parameters={"k": ("N m s", 0, 1)}',
        )
    each = [_parameter(shown, str(key), value) for key, value in parameters.items()]
    definition: dict[str, Any] = {"name": str(name), "side": side, "terms": terms, "parameters": each}
    if title is not None:
        definition["title"] = str(title)
    if replaces:
        names = [replaces] if isinstance(replaces, str) else replaces
        definition["replaces"] = [str(x) for x in names] if isinstance(names, Sequence) else [str(names)]
    return Effect.of(definition)


def _parameter(effect_name: str, name: str, given: object) -> dict[str, Any]:
    """A parameter as the core reads it."""
    where = f"effect '{effect_name}', parameter '{name[:40]}'"
    if isinstance(given, Mapping):
        for key in given:
            if key not in _KEYS:
                raise refuse(UsageError, f"{where} has no '{key}'", fix=did_you_mean(str(key), _KEYS))
        known = dict(given)
        values = known.get("values")
        if isinstance(values, Sequence) and not isinstance(values, str) and values:
            known = {"low": min(values), "high": max(values), "unit": "1"} | known
    elif isinstance(given, Sequence) and not isinstance(given, str) and len(given) in (3, 4):
        known = dict(zip(_KEYS, given, strict=False))
    else:
        known = {}
    if not {"unit", "low", "high"} <= known.keys():
        raise refuse(UsageError, f"{where} is not complete", fix='give ("unit", low, high)')
    out: dict[str, Any] = {"name": name, "unit": str(known["unit"])}
    try:
        out |= {key: float(known[key]) for key in ("low", "high", "typical") if known.get(key) is not None}
        out["values"] = [float(x) for x in known.get("values") or ()]
    except (TypeError, ValueError):
        raise refuse(UsageError, f"{where} has a bound that is no number", fix="give numbers") from None
    if known.get("meaning") is not None:
        out["meaning"] = str(known["meaning"])
    _check_bounds(where, out)
    return {key: value for key, value in out.items() if value != []}


def _check_bounds(where: str, out: Mapping[str, Any]) -> None:
    numbers = [out["low"], out["high"], out.get("typical", 0.0), *out["values"]]
    if not all(abs(x) < float("inf") for x in numbers):
        raise refuse(UsageError, f"{where} has a bound that is not finite", fix="give finite numbers")


def is_definition(table: object) -> bool:
    """Whether a table of TOML defines an effect, and is not just values of one of the catalogue."""
    return isinstance(table, Mapping) and any(side in table for side in SIDES)


def of_table(name: str, table: Mapping[str, Any]) -> tuple[Effect, dict[str, float]]:
    """The effect that a table `[effects.NAME]` of TOML defines, and the values of its parameters under
    `value`.

    Raises UsageError naming what is wrong.
    """
    known = (*SIDES, "parameters", "title", "replaces", _VALUE)
    for key in table:
        if key not in known:
            raise refuse(UsageError, f"effects.{name}.{key}: unknown key", fix=did_you_mean(str(key), known))
    sides = {side: table[side] for side in SIDES if side in table}
    made = _built(name, sides, table.get("parameters"), table.get("title"), table.get("replaces"))
    values = table.get(_VALUE, {})
    if not isinstance(values, Mapping):
        raise refuse(UsageError, f"effects.{name}.value is no table", fix="write value = { k = 0.1 }")
    return made, dict(values)


def of_tables(content: object, errors: list[str]) -> tuple[Effect, ...]:
    """The effects of the tables `[effects.NAME]` of a machine file; clauses are added to `errors`."""
    if content is None:
        return ()
    if not isinstance(content, Mapping):
        errors.append("effects: write each effect as a table [effects.NAME]")
        return ()
    made = []
    for name, table in content.items():
        if not is_definition(table):
            errors.append(
                f"effects.{str(name)[:40]}: no formula; give one of {', '.join(SIDES)} and parameters"
            )
            continue
        try:
            made.append(of_table(str(name), table)[0])
        except UsageError as error:
            errors.append(str(error))
    return tuple(made)


def together(*each: Iterable[Effect]) -> tuple[Effect, ...]:
    """Effects from several places as one list; equal ones count once.

    Raises UsageError for what is no effect and for two of one name.
    """
    found: dict[str, Effect] = {}
    wrong = []
    for one in (one for some in each for one in some):
        if not isinstance(one, Effect):
            raise refuse(
                UsageError,
                f"a {type(one).__name__} was given where an effect is expected",
                fix="make it by pmsm_rs.effect(...)",
            )
        if found.setdefault(one.name, one) != one:
            wrong.append(f"two effects have the name '{one.name}'")
    if wrong:
        raise refuse(UsageError, clauses(wrong), fix="give each its own name")
    return tuple(found.values())
