"""The tables of a simulation's configuration: which keys each has, and what may stand there."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field

from ..config.machine_file import LoadKind, Plate, Ratings
from ..config.schema import NotNegative, Number, Positive, Table
from ..errors import did_you_mean

Whole = Annotated[float, Field(ge=0, multiple_of=1, allow_inf_nan=False)]


def _schedule(given: object) -> dict[str, Any]:
    """A schedule as a table, whatever way it was written."""
    if isinstance(given, int | float) and not isinstance(given, bool):
        given = {"t": [0.0], "value": [given]}
    if not isinstance(given, Mapping):
        raise ValueError("write a number or { t = [...], value = [...] }")
    wrong = [key for key in given if key not in ("t", "value", "shape")]
    if wrong:
        raise ValueError(f"unknown key '{wrong[0]}' ({did_you_mean(str(wrong[0]), ('t', 'value', 'shape'))})")
    points = {key: _numbers(key, given.get(key)) for key in ("t", "value")}
    if len(points["t"]) != len(points["value"]):
        raise ValueError(f"there are {len(points['t'])} times and {len(points['value'])} values")
    if not points["t"]:
        raise ValueError("there is no point in it")
    if any(later <= sooner for sooner, later in zip(points["t"], points["t"][1:], strict=False)):
        raise ValueError("the times must increase; two points close together make a jump")
    shape = given.get("shape", "linear")
    if shape not in ("linear", "steps"):
        raise ValueError(f"shape '{shape}' is not known ({did_you_mean(str(shape), ('linear', 'steps'))})")
    return {**points, "shape": shape}


def _numbers(key: str, given: object) -> list[float]:
    try:
        values = [float(x) for x in given]  # type: ignore[attr-defined]
    except (TypeError, ValueError):
        raise ValueError(f"{key} must be a list of numbers") from None
    if not all(map(math.isfinite, values)):
        raise ValueError(f"{key} must be finite")
    return values


# A table of times, values and shape, from that or from a number.
Schedule = Annotated[dict[str, Any], BeforeValidator(_schedule)]


class Machine(Plate):
    """[machine] and [nameplate]: parameters, on top of those of a machine file."""

    file: str | None = None


class Drive(Ratings):
    """[drive]: the inverter and what limits it."""

    i_limit: Positive | None = None
    delay: Whole = 1
    inverter: Literal["averaged", "switching"] = "averaged"
    hold: Literal["rotor", "stator"] | None = None
    f_sw: Positive | None = None
    substeps: Annotated[Whole, Field(ge=1, le=1000)] = 1


class Control(Table):
    """[control]: bandwidths in Hz, or single gains."""

    current_bandwidth: Positive | None = None
    speed_bandwidth: Positive | None = None
    kp_speed: NotNegative | None = None
    ki_speed: NotNegative | None = None
    kp_d: NotNegative | None = None
    ki_d: NotNegative | None = None
    kp_q: NotNegative | None = None
    ki_q: NotNegative | None = None
    decoupling: bool = True


class Sensors(Table):
    """[sensors]: noise, resolution, and where the speed comes from."""

    noise_i: NotNegative = 0.0
    step_i: NotNegative = 0.0
    noise_omega_e: NotNegative = 0.0
    noise_tau: NotNegative = 0.0
    encoder_counts: Annotated[Whole, Field(le=2**31)] = 0
    speed: Literal["tachometer", "encoder"] = "tachometer"
    encoder_bandwidth: Positive | None = None
    log_theta_m: bool = False


class Reference(Table):
    """[reference]: what the drive is to do."""

    omega_m: Schedule | None = None
    n: Schedule | None = None
    i_d: Schedule | None = None
    i_q: Schedule | None = None


class Load(Table):
    """[load]: the torque of the load, and what the recording knows of it."""

    tau: Schedule | None = None
    kind: LoadKind | None = None


class Drift(Table):
    """[drift]: parameters that change in time."""

    r_s: Schedule | None = None
    l_d: Schedule | None = None
    l_q: Schedule | None = None
    psi_m: Schedule | None = None
    j: Schedule | None = None
    b: Schedule | None = None


class Start(Table):
    """[start]: angle and speed at the beginning."""

    theta_e: Number = 0.0
    omega_m: Number | None = None
    n: Number | None = None


class Temperature(Table):
    """[temperature]: what is logged, degC."""

    winding: Schedule | None = None
    magnet: Schedule | None = None


class Run(Table):
    """The keys above all tables."""

    duration: Positive = 1.0
    settle: NotNegative = 0.0
    seed: Annotated[Whole, Field(le=2**53)] = 1
