"""The catalogue of effects as the core knows it."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from .. import _core
from .._core import UsageError
from ..errors import did_you_mean, refuse


def effects() -> list[dict[str, Any]]:
    """Gives the catalogue of effects.

    Returns
    -------
    list of dict
        Per effect id, title, sentence, equation, acts_in, source, parameters, derived, look_alikes and
        fingerprint. `derived` are results that an answer gives beside or in place of parameters: name, unit,
        meaning.

    Examples
    --------
    >>> import pmsm_rs as pm
    >>> {entry["id"]: entry for entry in pm.effects()}["dead_time"]["parameters"][0]["unit"]
    'V'
    """
    catalogue: list[dict[str, Any]] = json.loads(_core.effects())
    return catalogue


def of_choice(choice: Mapping[str, Any]) -> dict[str, Any]:
    """The entry of an effect of a model, be it of the catalogue or given as text with its `definition`."""
    definition = choice.get("definition")
    if definition is None:
        return effect(str(choice["effect"]))
    told: dict[str, Any] = json.loads(_core.effect_of_text(json.dumps(definition)))
    return told


def effect(name: str) -> dict[str, Any]:
    """One entry of the catalogue by its id. Raises UsageError naming the nearest ids."""
    known = {entry["id"]: entry for entry in effects()}
    if name not in known:
        raise refuse(UsageError, f"there is no effect '{name}'", fix=did_you_mean(name, known))
    return known[name]
