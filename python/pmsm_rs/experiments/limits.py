"""What a bench bears during a designed manoeuvre: the tables [limits], [drive] and [load] of a TOML file."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from pydantic import BeforeValidator

from .._core import UsageError
from ..config.machine_file import read_toml
from ..config.schema import Number, Positive, Table, validated
from ..errors import clauses, did_you_mean, refuse

# Time of a manoeuvre that is written to a file of references, s.
_LONGEST = 600.0


def _range(given: object) -> object:
    """Lowest and highest value, from a pair or from a size that holds for both directions."""
    if isinstance(given, int | float) and not isinstance(given, bool):
        given = (-abs(float(given)), abs(float(given)))
    if not isinstance(given, list | tuple) or len(given) != 2:
        raise ValueError("write a number for both directions, or [lowest, highest]")
    try:
        low, high = (float(x) for x in given)
    except (TypeError, ValueError):
        raise ValueError("lowest and highest must be numbers") from None
    if not (math.isfinite(low) and math.isfinite(high) and low <= 0.0 <= high and low < high):
        raise ValueError("the motor starts at rest: lowest must not be above 0 and highest not below 0")
    return (low, high)


Range = Annotated[tuple[float, float], BeforeValidator(_range)]


class _Limits(Table):
    current: Positive | None = None
    speed: Range | None = None
    acceleration: Positive | None = None
    position: Range | None = None
    voltage: Positive | None = None
    time: Positive | None = None


class _Drive(Table):
    f_sample: Positive | None = None
    current_bandwidth: Positive | None = None
    speed_bandwidth: Positive | None = None


class _Load(Table):
    torque: Number = 0.0


_TABLES: dict[str, type[Table]] = {"limits": _Limits, "drive": _Drive, "load": _Load}


@dataclass(frozen=True)
class Limits:
    """Limits of a manoeuvre.

    `current` is the peak of the current vector (A), `speed` the lowest and highest mechanical speed (rad/s).
    `acceleration` is the largest one (rad/s^2), None for what the current gives. `position` is the lowest and
    highest angle from the start (rad), None for a shaft that turns freely. `voltage` is that of the DC link
    (V), `time` the length (s). `f_sample` and the bandwidths are those of the drive (Hz); a bandwidth of None
    is that of `pmsm_rs.simulate`. `load_torque` is a constant load, N·m.
    """

    current: float
    speed: tuple[float, float]
    acceleration: float | None
    position: tuple[float, float] | None
    voltage: float
    time: float
    f_sample: float
    current_bandwidth: float | None
    speed_bandwidth: float | None
    load_torque: float

    def to_dict(self) -> dict[str, Any]:
        """As the JSON object of a design."""
        return {
            "current": self.current,
            "speed": list(self.speed),
            "acceleration": self.acceleration,
            "position": None if self.position is None else list(self.position),
            "voltage": self.voltage,
            "time": self.time,
        }


def read(given: object, shown: Mapping[str, Any]) -> Limits:
    """The limits in a TOML file or a mapping of its tables; a mapping without tables is that of [limits].

    `shown` is what the recording has shown: i_max, omega_m_max, v_dc and f_sample, and `locked` for a rotor
    that is held. Raises UsageError naming every entry that is wrong or missing.
    """
    file = str(given) if isinstance(given, str | os.PathLike) else None
    if file is not None:
        content: dict[str, Any] = read_toml(file, "file of limits", UsageError)
    elif isinstance(given, Mapping):
        content = dict(given)
        if content and not any(isinstance(entry, Mapping) for entry in content.values()):
            content = {"limits": content}
    else:
        raise refuse(
            UsageError,
            f"a {type(given).__name__} was given where limits are expected",
            fix="give the name of a TOML file, or a mapping with current, speed and time",
        )
    errors = [f"{key}: unknown table ({did_you_mean(key, _TABLES)})" for key in content if key not in _TABLES]
    parts = {name: validated(kind, name, content.get(name, {}), errors) for name, kind in _TABLES.items()}
    limits, drive, load = parts["limits"], parts["drive"], parts["load"]
    if isinstance(limits, _Limits) and isinstance(drive, _Drive) and isinstance(load, _Load):
        found = _settled(limits, drive, load, shown, errors)
        if found is not None and not errors:
            return found
    raise refuse(UsageError, clauses(errors), file=file, fix="correct the limits")


def _settled(
    limits: _Limits, drive: _Drive, load: _Load, shown: Mapping[str, Any], errors: list[str]
) -> Limits | None:
    hint = f"; the recording reached {shown['i_max']:.3g} A" if shown["i_max"] else ""
    if limits.current is None:
        errors.append(f"limits.current: is missing; give the peak of the current in A{hint}")
    speed = limits.speed
    if speed is None and shown["locked"]:
        speed = (-1e-9, 1e-9)
    if speed is None:
        errors.append(
            "limits.speed: is missing; give it in rad/s, mechanical, as one number or [lowest, highest]; "
            f"the recording reached {shown['omega_m_max']:.3g} rad/s"
        )
    if limits.time is None or limits.time > _LONGEST:
        errors.append(f"limits.time: give the length of the manoeuvre, at most {_LONGEST:.0f} s")
    voltage = limits.voltage or shown["v_dc"]
    if not voltage:
        errors.append("limits.voltage: is missing; give the voltage of the DC link in V")
    if limits.current is None or speed is None or limits.time is None or not voltage:
        return None
    return Limits(
        limits.current,
        speed,
        limits.acceleration,
        limits.position,
        voltage,
        limits.time,
        drive.f_sample or shown["f_sample"],
        drive.current_bandwidth,
        drive.speed_bandwidth,
        load.torque,
    )
