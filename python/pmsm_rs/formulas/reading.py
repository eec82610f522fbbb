"""A formula of an answer as terms again, so that its torque can be computed for another motion."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from .._core import DataError
from ..errors import refuse
from .terms import Term, terms
from .weak_form import Motion

if TYPE_CHECKING:
    from numpy.typing import NDArray

    Array = NDArray[np.float64]


@dataclass(frozen=True)
class Torque:
    """The torque of a formula against positive rotation: its text, names, units and values of its numbers."""

    text: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: tuple[float, ...]
    parts: tuple[Term, ...]

    def at(self, motion: Motion, values: tuple[float, ...] | None = None) -> Array:
        """The torque of a motion in N·m, shape (rows,); `values` replace those of the numbers."""
        values = self.values if values is None else values
        total, begin = np.zeros_like(motion.t), 0
        for term in self.parts:
            middle = begin + len(term.strengths)
            end = middle + len(term.shapes)
            columns = term.columns(motion, tuple(values[middle:end]))
            for strength, column in zip(values[begin:middle], columns, strict=True):
                total = total + strength * column
            begin = end
        return total


def torque(entry: Mapping[str, Any]) -> Torque:
    """From the JSON object of a formula. Raises DataError for a formula that this package does not write."""
    known = terms(_NOWHERE)
    text = entry["formula"]
    for term in known:
        if _named(term, "") == text:
            return _of(entry, [(term, "")])
    for first in known:
        begin = _named(first, "1") + " + "
        if not text.startswith(begin):
            continue
        for second in known:
            if _named(second, "2") == text[len(begin) :]:
                return _of(entry, [(first, "1"), (second, "2")])
    raise refuse(DataError, f"the formula '{text}' is not known", fix="give an answer of this version")


def _named(term: Term, tail: str) -> str:
    names = [name for name, _ in term.strengths] + [shape.name for shape in term.shapes]
    return term.text.format(**{name: name + tail for name in names})


def _of(entry: Mapping[str, Any], parts: list[tuple[Term, str]]) -> Torque:
    names = [
        name + tail
        for term, tail in parts
        for name in [*(name for name, _ in term.strengths), *(shape.name for shape in term.shapes)]
    ]
    numbers = [entry["parameters"][name] for name in names]
    return Torque(
        entry["formula"],
        tuple(names),
        tuple(x["unit"] for x in numbers),
        tuple(float(x["value"]) for x in numbers),
        tuple(term for term, _ in parts),
    )


# The texts of the terms do not depend on the motion, only their grids do.
_ROW = np.linspace(0.0, 1.0, 3)
_NOWHERE = Motion(_ROW, _ROW, _ROW, _ROW, _ROW, False)
