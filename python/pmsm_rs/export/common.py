"""What all exports share: how they name the model, and which of its effects a target cannot express."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

from ..quantities.parameters import BASE

if TYPE_CHECKING:
    from ..model import Model


def header(model: Model) -> list[str]:
    """Lines that say what the model is: its machine, and each effect with its equation and its values."""
    from ..results.registry import of_choice

    specification = model.specification
    base = specification["base"]
    lines = [
        f"Permanent-magnet synchronous motor with {int(specification['scales']['n_p'])} pole pairs, "
        "as pmsm-rs identified it.",
        "SI units; amplitude-invariant Park transform; d axis on the magnet flux; motor convention.",
        ", ".join(f"{name} = {base[name]:.6g} {unit}" for name, unit in BASE.items()),
    ]
    for choice in specification["effects"]:
        about = of_choice(choice)
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
    from ..results.registry import of_choice

    return {x["effect"]: str(of_choice(x)["acts_in"]) for x in model.specification["effects"]}


def not_expressed(model: Model, known: Iterable[str]) -> list[str]:
    """Effects of the model that are not among those which a target knows, the map with them."""
    rest = [name for name in model.effects if name not in set(known)]
    return [*rest, *(["unmodelled map"] if model.specification.get("map") else [])]


def commented(lines: Iterable[str], mark: str) -> str:
    """Lines as comments of a language, none longer than 110 characters."""
    from textwrap import wrap

    wrapped = [part for line in lines for part in (wrap(line, 108 - len(mark)) or [""])]
    return "\n".join(f"{mark} {line}".rstrip() for line in wrapped)
