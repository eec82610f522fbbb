"""The corrected machine file."""

from __future__ import annotations

from typing import TYPE_CHECKING

from ..quantities.parameters import BASE
from .common import commented, header

if TYPE_CHECKING:
    from ..model import Model


def text(model: Model) -> str:
    """The machine file with the values that were found; what the recording does not show is left open."""
    told = model["base"]
    lines = [
        commented(header(model), "#"),
        "",
        "[machine]",
        f"n_p = {int(model.specification['scales']['n_p'])}",
    ]
    for name in BASE:
        entry = told.get(name)
        if entry is None or entry["value"] is None:
            why = (entry or {}).get("why_none") or "the recording does not contain it"
            lines.append(f"# {name}: {why}")
            continue
        error = "" if entry["stderr"] is None else f" ± {entry['stderr']:.2g}"
        note = error or f" ({entry['why_none']})"
        lines.append(f"{name} = {entry['value']!r}  # {entry['unit']}{note}")
    return "\n".join(lines) + "\n"
