"""What all exports share: how they name the model, and which of its effects a target cannot express."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..model import Model

_BASE = {
    "r_s": "ohm",
    "l_d": "H",
    "l_q": "H",
    "psi_m": "V s",
    "j": "kg m^2",
    "b": "N m s",
}


def header(model: Model) -> list[str]:
    """Lines that say what the model is: its machine, and each effect with its equation and its values."""
    from ..results.registry import effect as entry

    specification = model.specification
    base = specification["base"]
    lines = [
        f"Permanent-magnet synchronous motor with {int(specification['scales']['n_p'])} pole pairs, "
        "as pmsm-rs identified it.",
        "SI units; amplitude-invariant Park transform; d axis on the magnet flux; motor convention.",
        ", ".join(f"{name} = {base[name]:.6g} {unit}" for name, unit in _BASE.items()),
    ]
    for choice in specification["effects"]:
        about = entry(choice["effect"])
        units = {p["name"]: p["unit"] for p in about["parameters"]}
        values = ", ".join(
            f"{name} = {x:.6g}{'' if units.get(name, '1') == '1' else ' ' + units[name]}"
            for name, x in choice["parameters"].items()
        )
        lines.append(f"{choice['effect']}: {about['equation']}; {values}")
    if specification.get("map"):
        lines.append("A smooth map holds what has no name in the catalogue.")
    return lines


def sites(model: Model) -> dict[str, str]:
    """Where each effect acts: electrical, mechanical or sensor."""
    from ..results.registry import effect as entry

    return {name: str(entry(name)["acts_in"]) for name in model.effects}


def not_expressed(model: Model, known: Iterable[str]) -> list[str]:
    """Effects of the model that are not among those which a target knows, the map with them."""
    rest = [name for name in model.effects if name not in set(known)]
    return [*rest, *(["unmodelled map"] if model.specification.get("map") else [])]


def commented(lines: Iterable[str], mark: str) -> str:
    """Lines as comments of a language, none longer than 110 characters."""
    from textwrap import wrap

    wrapped = [part for line in lines for part in (wrap(line, 108 - len(mark)) or [""])]
    return "\n".join(f"{mark} {line}".rstrip() for line in wrapped)
