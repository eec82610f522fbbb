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
                             # strengths are zero once one is given; or an effect as text, as in a machine
                             # file, with value = {...}
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from .._core import Machine, MachineError, UsageError
from ..config.effect_text import Effect, is_definition, of_table
from ..config.machine_file import Plate, Ratings, read_machine, read_toml
from ..config.schema import Table, validated
from ..errors import clauses, did_you_mean, message, refuse
from ..results.registry import effects
from . import setting_tables as tables

_SHIPPED = Path(__file__).parents[1] / "machines"
_PLATE = (*Plate.model_fields, *Ratings.model_fields)
_RPM = 2.0 * math.pi / 60.0
_T = TypeVar("_T", bound=Table)
_TABLES: dict[str, type[Table]] = {
    "machine": tables.Machine,
    "nameplate": tables.Machine,
    "drive": tables.Drive,
    "control": tables.Control,
    "sensors": tables.Sensors,
    "reference": tables.Reference,
    "load": tables.Load,
    "drift": tables.Drift,
    "start": tables.Start,
    "temperature": tables.Temperature,
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
    given, exact = _of_model(given, content)
    for key, value in given.items():
        below = content.get(key)
        merge = isinstance(below, Mapping) and isinstance(value, Mapping)
        content[key] = {**below, **value} if merge else value  # type: ignore[dict-item]
    errors: list[str] = []
    built = _build(content, folder, errors)
    if errors or built is None:
        raise refuse(UsageError, clauses(errors), file=file, fix="correct the configuration")
    built.settings.update(exact)
    return built


def _of_model(
    given: Mapping[str, Any], content: Mapping[str, Any]
) -> tuple[Mapping[str, Any], dict[str, Any]]:
    """The tables with the model of an answer, where one is given as effects, spelt out: its effects, and its
    machine where no other is named. With them come the settings that only such a model has.
    """
    specification = getattr(given.get("effects"), "specification", None)
    if not isinstance(specification, Mapping):
        return given, {}
    scales = specification["scales"]
    chosen = {_key(entry): entry["parameters"] for entry in specification["effects"]}
    spelt: dict[str, Any] = {**given, "effects": chosen}
    if "machine" not in given and "machine" not in content:
        spelt["machine"] = {"n_p": int(scales["n_p"]), **specification["base"]}
        drive = {"v_dc": scales["v_dc"] or None, "i_limit": scales["i_max"] or None}
        told = {name: value for name, value in drive.items() if value is not None}
        spelt["drive"] = {**told, **dict(content.get("drive", {})), **dict(given.get("drive", {}))}
    return spelt, {"map": list(specification.get("map", ())), "scales": scales}


def _key(entry: Mapping[str, Any]) -> str | Effect:
    """What names an effect of a model: its id, or the effect itself where it was given as text."""
    definition = entry.get("definition")
    return str(entry["effect"]) if definition is None else Effect.of(definition)


def _build(content: dict[str, Any], folder: Path, errors: list[str]) -> Configuration | None:
    known = (*tables.Run.model_fields, *_TABLES, "effects")
    errors.extend(f"{key}: unknown key ({did_you_mean(key, known)})" for key in content if key not in known)
    run = validated(
        tables.Run, "run", {k: v for k, v in content.items() if k in tables.Run.model_fields}, errors
    )
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
    assert isinstance(run, tables.Run)
    drive, reference = _part(parts, "drive", tables.Drive), _part(parts, "reference", tables.Reference)
    load, start = _part(parts, "load", tables.Load), _part(parts, "start", tables.Start)
    plain = {k: getattr(drive, k) for k in Ratings.model_fields}
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
            "temperature": _part(parts, "temperature", tables.Temperature).winding,
            "temperature_magnet": _part(parts, "temperature", tables.Temperature).magnet,
            "start_theta_e": start.theta_e,
            "start_omega_m": first or 0.0,
        },
        "drive": _drive(
            drive, _part(parts, "control", tables.Control), _part(parts, "sensors", tables.Sensors), errors
        ),
        "drift": {k: v for k, v in _part(parts, "drift", tables.Drift).model_dump().items() if v is not None},
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
    if isinstance(table, tables.Machine):
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
        errors.append(f"{name}: {message(error)}")
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


def _drive(
    drive: tables.Drive, control: tables.Control, sensors: tables.Sensors, errors: list[str]
) -> dict[str, Any]:
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
    for key, given in content.items():
        effect, parameters, definition = key, given, None
        try:
            if isinstance(key, str) and key not in known and is_definition(given):
                key, parameters = of_table(key, given)
        except UsageError as error:
            errors.append(str(error))
            continue
        if isinstance(key, Effect):
            effect, definition = key.name, {"definition": key.definition}
            known[effect] = [p["name"] for p in key.definition["parameters"]]
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
        chosen.append({"effect": effect, "parameters": dict(parameters), **(definition or {})})
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
