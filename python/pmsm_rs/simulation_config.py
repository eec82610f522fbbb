"""The configuration of a simulation: TOML or tables in, everything wrong with it said at once.

Tables and keys, all optional but a reference; units are SI. A schedule is a number, or a table
`{ t = [...], value = [...], shape = "linear" | "steps" }` with times in s.

    duration = 1.0           # s, of the recording
    settle = 0.0             # s that pass before it starts, schedules held at their value for t = 0
    seed = 1                 # of all noise
    machine = "liu_2008"     # a machine that ships with the package, or a machine file, or a table:

    [machine]                # the true motor: file = "..." to start from one; n_p, r_s, l_d, l_q, psi_m, j, b
    [nameplate]              # what the drive believes, where it differs from the machine; same keys
    [drive]                  # v_dc, i_rated, i_limit (A peak), f_sample, delay (1 or 0 periods),
                             # inverter = "averaged" | "switching", hold = "rotor" | "stator", f_sw, substeps
    [control]                # current_bandwidth, speed_bandwidth (Hz), decoupling = true; or single gains
                             # kp_speed, ki_speed, kp_d, ki_d, kp_q, ki_q
    [sensors]                # noise_i (A rms), step_i (A), noise_omega_e (rad/s rms), noise_tau (N m rms),
                             # encoder_counts per revolution, speed = "tachometer" | "encoder",
                             # encoder_bandwidth (Hz), log_theta_m = false
    [reference]              # schedules: omega_m (rad/s) or n (rpm), i_d, i_q (A); without a speed the
                             # currents are controlled alone, with one i_q is added to the speed controller's
    [load]                   # tau: schedule in N m; kind: what the recording knows of it (machine file)
    [drift]                  # schedules that replace r_s, l_d, l_q, psi_m, j or b
    [start]                  # theta_e (rad), omega_m (rad/s) or n (rpm)
    [temperature]            # schedules in degC, which are logged: winding, magnet
    [effects.NAME]           # an effect of the catalogue with its parameters; those left out are typical, but
                             # strengths are zero once one is given
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import BeforeValidator, Field

from ._core import Machine, MachineError, UsageError
from .config import NotNegative, Number, Positive, Table, read_machine, read_toml, validated
from .errors import did_you_mean, refuse
from .run import effects

_SHIPPED = Path(__file__).parent / "machines"
_BASE = ("r_s", "l_d", "l_q", "psi_m", "j", "b")
_PLATE = ("n_p", *_BASE, "v_dc", "i_rated", "f_sample")
_RPM = 2.0 * math.pi / 60.0
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


Schedule = Annotated[dict[str, Any], BeforeValidator(_schedule)]


class _Machine(Table):
    file: str | None = None
    n_p: Annotated[int | None, Field(ge=1)] = None
    r_s: Positive | None = None
    l_d: Positive | None = None
    l_q: Positive | None = None
    psi_m: NotNegative | None = None
    j: Positive | None = None
    b: NotNegative | None = None


class _Drive(Table):
    v_dc: Positive | None = None
    i_rated: Positive | None = None
    i_limit: Positive | None = None
    f_sample: Positive | None = None
    delay: Whole = 1
    inverter: Literal["averaged", "switching"] = "averaged"
    hold: Literal["rotor", "stator"] | None = None
    f_sw: Positive | None = None
    substeps: Annotated[Whole, Field(ge=1, le=1000)] = 1


class _Control(Table):
    current_bandwidth: Positive | None = None
    speed_bandwidth: Positive | None = None
    kp_speed: NotNegative | None = None
    ki_speed: NotNegative | None = None
    kp_d: NotNegative | None = None
    ki_d: NotNegative | None = None
    kp_q: NotNegative | None = None
    ki_q: NotNegative | None = None
    decoupling: bool = True


class _Sensors(Table):
    noise_i: NotNegative = 0.0
    step_i: NotNegative = 0.0
    noise_omega_e: NotNegative = 0.0
    noise_tau: NotNegative = 0.0
    encoder_counts: Annotated[Whole, Field(le=2**31)] = 0
    speed: Literal["tachometer", "encoder"] = "tachometer"
    encoder_bandwidth: Positive | None = None
    log_theta_m: bool = False


class _Reference(Table):
    omega_m: Schedule | None = None
    n: Schedule | None = None
    i_d: Schedule | None = None
    i_q: Schedule | None = None


class _Load(Table):
    tau: Schedule | None = None
    kind: (
        Literal["none", "known_constant", "measured", "unknown_constant", "unknown_piecewise", "locked"]
        | None
    ) = None


class _Drift(Table):
    r_s: Schedule | None = None
    l_d: Schedule | None = None
    l_q: Schedule | None = None
    psi_m: Schedule | None = None
    j: Schedule | None = None
    b: Schedule | None = None


class _Start(Table):
    theta_e: Number = 0.0
    omega_m: Number | None = None
    n: Number | None = None


class _Temperature(Table):
    winding: Schedule | None = None
    magnet: Schedule | None = None


class _Run(Table):
    duration: Positive = 1.0
    settle: NotNegative = 0.0
    seed: Annotated[Whole, Field(le=2**53)] = 1


_T = TypeVar("_T", bound=Table)
_TABLES: dict[str, type[Table]] = {
    "machine": _Machine,
    "nameplate": _Machine,
    "drive": _Drive,
    "control": _Control,
    "sensors": _Sensors,
    "reference": _Reference,
    "load": _Load,
    "drift": _Drift,
    "start": _Start,
    "temperature": _Temperature,
}


@dataclass(frozen=True)
class Configuration:
    """What the core needs: the true machine, the nameplate, and the tables of its settings."""

    machine: Machine
    nameplate: Machine
    settings: dict[str, Any]
    seed: int


def read(
    config: str | os.PathLike[str] | Mapping[str, Any] | None, given: Mapping[str, Any]
) -> Configuration:
    """The configuration in a file or mapping, with the tables and keys of `given` on top of it.

    Raises UsageError naming every wrong entry with the nearest right one.
    """
    file = None if config is None or isinstance(config, Mapping) else str(config)
    folder = Path(file).parent if file else Path()
    content = (
        read_toml(file, "configuration of a simulation", UsageError)
        if file is not None
        else dict(config if isinstance(config, Mapping) else {})
    )
    for key, value in given.items():
        below = content.get(key)
        merge = isinstance(below, Mapping) and isinstance(value, Mapping)
        content[key] = {**below, **value} if merge else value  # type: ignore[dict-item]
    errors: list[str] = []
    built = _build(content, folder, errors)
    if errors or built is None:
        raise refuse(UsageError, "; ".join(errors), file=file, fix="correct the configuration")
    return built


def _build(content: dict[str, Any], folder: Path, errors: list[str]) -> Configuration | None:
    known = (*_Run.model_fields, *_TABLES, "effects")
    errors.extend(f"{key}: unknown key ({did_you_mean(key, known)})" for key in content if key not in known)
    run = validated(_Run, "run", {k: v for k, v in content.items() if k in _Run.model_fields}, errors)
    if isinstance(content.get("machine"), str | os.PathLike):
        content["machine"] = {"file": str(content["machine"])}
    given = content.get("machine", {"file": "liu_2008"})
    true = given if isinstance(given, Machine) else None
    parts = {
        name: validated(
            model, name, content.get(name, {"file": "liu_2008"} if name == "machine" else {}), errors
        )
        for name, model in _TABLES.items()
        if not (name == "machine" and true is not None)
    }
    chosen = _effects(content.get("effects", {}), errors)
    if errors or run is None:
        return None
    assert isinstance(run, _Run)
    drive, reference = _part(parts, "drive", _Drive), _part(parts, "reference", _Reference)
    load, start = _part(parts, "load", _Load), _part(parts, "start", _Start)
    plain = {k: getattr(drive, k) for k in ("v_dc", "i_rated", "f_sample")}
    machine = _machine(true, parts.get("machine"), plain, folder, errors)
    if machine is None:
        return None
    nameplate = _machine(machine, parts["nameplate"], {}, folder, errors, "nameplate")
    speed = _one(reference.omega_m, _rpm(reference.n), "reference", errors)
    if speed is None and reference.i_d is None and reference.i_q is None:
        errors.append("reference: say what the drive is to do: omega_m or n, or i_d and i_q")
    first = _one(start.omega_m, None if start.n is None else start.n * _RPM, "start", errors)
    settings = {
        "manoeuvre": {
            "duration": run.duration,
            "settle": run.settle,
            "omega_m": speed,
            "i_d": reference.i_d,
            "i_q": reference.i_q,
            "tau_load": load.tau,
            "load_kind": load.kind,
            "temperature": _part(parts, "temperature", _Temperature).winding,
            "temperature_magnet": _part(parts, "temperature", _Temperature).magnet,
            "start_theta_e": start.theta_e,
            "start_omega_m": first or 0.0,
        },
        "drive": _drive(drive, _part(parts, "control", _Control), _part(parts, "sensors", _Sensors), errors),
        "drift": {k: v for k, v in _part(parts, "drift", _Drift).model_dump().items() if v is not None},
        "effects": chosen,
    }
    if errors or nameplate is None:
        return None
    return Configuration(machine, nameplate, settings, int(run.seed))


def _part(parts: Mapping[str, Table | None], name: str, kind: type[_T]) -> _T:
    part = parts[name]
    assert isinstance(part, kind)
    return part


def _machine(
    below: Machine | None,
    table: Table | None,
    drive: Mapping[str, float | None],
    folder: Path,
    errors: list[str],
    name: str = "machine",
) -> Machine | None:
    """The machine of a table, on top of the one below it or of the file that it names."""
    values: dict[str, Any] = {}
    if isinstance(table, _Machine):
        values = table.model_dump(exclude={"file"}, exclude_none=True)
        if table.file is not None:
            below = read_machine(_find(table.file, folder)).machine
    for key, value in drive.items():
        if value is not None:
            values[key] = value
    if below is not None:
        values = {k: v for k in _PLATE if (v := getattr(below, k)) is not None} | values
    if "n_p" not in values:
        errors.append(f"{name}.n_p: is missing; give the pole pairs, or file = 'liu_2008'")
        return None
    try:
        return Machine(**values)
    except MachineError as error:
        errors.append(f"{name}: {error}")
        return None


def _find(name: str, folder: Path) -> Path:
    """A machine that ships with the package by its bare name, else a file relative to the configuration."""
    shipped = _SHIPPED / f"{name}.toml"
    if shipped.parent == _SHIPPED and shipped.is_file():
        return shipped
    file = folder / name
    if not file.exists() and not name.endswith(".toml"):
        choices = [path.stem for path in _SHIPPED.glob("*.toml")]
        raise refuse(
            UsageError, f"there is no machine '{name}'", fix=f"{did_you_mean(name, choices)}, or name a file"
        )
    return file


def _drive(drive: _Drive, control: _Control, sensors: _Sensors, errors: list[str]) -> dict[str, Any]:
    if drive.inverter == "switching" and drive.hold == "rotor":
        errors.append("drive.hold: a switching inverter holds its voltage in the stator; leave hold out")
    if drive.inverter == "averaged" and drive.f_sw is not None:
        errors.append("drive.f_sw: only a switching inverter has one; say inverter = 'switching'")
    if (sensors.speed == "encoder") != (sensors.encoder_bandwidth is not None):
        errors.append("sensors.encoder_bandwidth: goes with speed = 'encoder', and only with it; in Hz")
    inverter: dict[str, Any] = {"averaged": {"hold": drive.hold or "rotor"}}
    if drive.inverter == "switching":
        inverter = {"switching": {"f_sw": drive.f_sw}}
    speed: Any = sensors.speed
    if speed == "encoder":
        speed = {"encoder": {"bandwidth": sensors.encoder_bandwidth}}
    return {
        "v_dc": drive.v_dc,
        "i_limit": drive.i_limit,
        "f_sample": drive.f_sample,
        "delay": min(int(drive.delay), 255),
        "inverter": inverter,
        "control": {**control.model_dump(exclude={"decoupling"}), "coupled": not control.decoupling},
        "sensors": {
            **sensors.model_dump(exclude={"encoder_bandwidth"}),
            "encoder_counts": int(sensors.encoder_counts),
            "speed": speed,
        },
        "substeps": int(drive.substeps),
    }


def _effects(content: object, errors: list[str]) -> list[dict[str, Any]]:
    if not isinstance(content, Mapping):
        errors.append("effects: write each effect as a table [effects.NAME]")
        return []
    known = {entry["id"]: [p["name"] for p in entry["parameters"]] for entry in effects()}
    chosen = []
    for effect, parameters in content.items():
        if effect not in known:
            errors.append(f"effects.{effect}: there is no such effect ({did_you_mean(str(effect), known)})")
            continue
        if not isinstance(parameters, Mapping):
            errors.append(f"effects.{effect}: write it as a table [effects.{effect}]")
            continue
        for name, value in parameters.items():
            if name not in known[effect]:
                hint = did_you_mean(str(name), known[effect])
                errors.append(f"effects.{effect}.{name}: unknown key ({hint})")
            elif isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
                errors.append(f"effects.{effect}.{name}: give a finite number, not {value!r}")
        chosen.append({"effect": effect, "parameters": dict(parameters)})
    return chosen


def _rpm(schedule: dict[str, Any] | None) -> dict[str, Any] | None:
    if schedule is None:
        return None
    return {**schedule, "value": [x * _RPM for x in schedule["value"]]}


_U = TypeVar("_U")


def _one(si: _U | None, rpm: _U | None, name: str, errors: list[str]) -> _U | None:
    if si is not None and rpm is not None:
        errors.append(f"{name}.n: omega_m says the same; give one of the two")
    return si if si is not None else rpm
