"""Structures in .mat files: their arrays as columns, with the clocks of those who write such files.

- dSPACE ControlDesk keeps captures as X(k).Data, the sample times of raster k, and Y(k).Name, .Data, .XIndex.
- Simulink keeps logged signals as time and signals(k).values, .label, .blockName.
- Any other structure has its fields by their path, as in `run.motor.i_q`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, Final

from numpy.typing import NDArray

from .member import NUMBER, Member

TIME: Final = "time"
_NO_TIME: Final = "no signal with a sample time is wanted"
_NO_TIME_FIX: Final = "map at least one signal"
_PORT: Final = re.compile(r"/(Out|In)\d*$")


@dataclass(frozen=True)
class Structure:
    """A structure or an array of them: per element its fields, which are structures, texts or arrays."""

    elements: tuple[Mapping[str, Structure | str | Array], ...]

    def first(self, key: str) -> Structure | str | Array | None:
        """The field `key` of the first element."""
        return self.elements[0].get(key) if self.elements else None


@dataclass(frozen=True)
class Array:
    """An array as its file declares it, and its element."""

    member: Member
    body: memoryview
    values: Callable[[], NDArray[Any]]


Column = tuple[Member, memoryview | None]
"""A column and the element that has its values; None for the times that replace those of any clock."""


def columns(name: str, content: Structure) -> Iterator[Column]:
    """The columns of the structure `name`."""
    for find in (_captured, _logged):
        if found := [*find(name, content)]:
            yield from found
            yield Member(TIME, unit="s", stamps=True, why=_NO_TIME, fix=_NO_TIME_FIX), None
            return
    yield from _fields(name, name, content)


def _captured(name: str, content: Structure) -> Iterator[Column]:
    """The signals of a capture by dSPACE ControlDesk, each on the clock of its raster."""
    x, y = content.first("X"), content.first("Y")
    if len(content.elements) != 1 or not isinstance(x, Structure) or not isinstance(y, Structure):
        return
    if not all({"Name", "Data"} <= {*signal} for signal in y.elements):
        return
    for signal in y.elements:
        data, index, unit = signal["Data"], signal.get("XIndex"), signal.get("Unit")
        if isinstance(data, Array):
            raster = _number(index) or 1
            path = str(signal["Name"]).replace('"', "").strip() or "signal"
            stated = unit if isinstance(unit, str) and unit.strip() not in {"", "-"} else None
            own = replace(data.member, name=_PORT.sub("", path), group=name, unit=stated)
            base = f"{name}.X({raster})" if 0 < raster <= len(x.elements) else None
            yield replace(own, base=base), data.body
    for k, axis in enumerate(x.elements, start=1):
        times, unit = axis.get("Data"), axis.get("Unit")
        if isinstance(times, Array):
            base = f"{name}.X({k})"
            path = f"{name}.X.Data" if len(x.elements) == 1 else f"{base}.Data"
            stated = unit if isinstance(unit, str) and unit.strip() else "s"
            yield _times(times, base, path, stated), times.body


def _logged(name: str, content: Structure) -> Iterator[Column]:
    """The signals of a Simulink structure with time."""
    time, signals = content.first("time"), content.first("signals")
    if len(content.elements) != 1 or not isinstance(time, Array) or not isinstance(signals, Structure):
        return
    if not all("values" in signal for signal in signals.elements) or not time.member.needed:
        return
    for k, signal in enumerate(signals.elements, start=1):
        data = signal["values"]
        if isinstance(data, Array):
            texts = [signal.get(key) for key in ("label", "blockName")]
            label = next((t for t in texts if isinstance(t, str) and t.strip()), "")
            path = f"{name}.signals({k}).values"
            own = label.rsplit("/", 1)[-1].strip() or path
            yield replace(data.member, name=own, group=name, header=None, base=name), data.body
    yield _times(time, name, f"{name}.time", "s"), time.body


def _times(data: Array, base: str, path: str, unit: str) -> Member:
    return replace(data.member, name=TIME, group=base, header=path, unit=unit, base=base, stamps=True)


def _fields(group: str, path: str, content: Structure) -> Iterator[Column]:
    """All arrays within a structure by their paths, as MATLAB writes them."""
    for k, element in enumerate(content.elements, start=1):
        own = path if len(content.elements) == 1 else f"{path}({k})"
        for key, value in element.items():
            if isinstance(value, Structure):
                yield from _fields(f"{group}/{key}", f"{own}.{key}", value)
            elif isinstance(value, Array):
                within = group if own == path else f"{group}({k})"
                yield replace(value.member, name=key, group=within, header=f"{own}.{key}"), value.body


def _number(value: Structure | str | Array | None) -> int | None:
    """The whole number in a field, None where it has none."""
    if not isinstance(value, Array) or value.member.kind != NUMBER or not value.member.needed:
        return None
    return int(value.values().reshape(-1)[0])
