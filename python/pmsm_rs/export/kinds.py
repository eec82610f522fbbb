"""The tools for which a model can be written."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .._core import UsageError
from ..errors import refuse
from . import drive_header, fmu, machine_file, modelica, python_module, rust_snippet, simulators
from .fmi2 import FMI2
from .fmi3 import FMI3

if TYPE_CHECKING:
    from ..model import Model

    Made = tuple[str | bytes, list[str]]
    Maker = Callable[[Model, Path, Mapping[str, Any]], Made]


@dataclass(frozen=True)
class Kind:
    """An export: what it is, the usual suffix of its file, the names of its options, and what makes it.

    `make` returns the content of the file, and sentences that say what is not in it.
    """

    said: str
    suffix: str
    options: tuple[str, ...]
    make: Maker


def _temperature(options: Mapping[str, Any]) -> dict[str, float]:
    if "temperature" not in options:
        return {}
    value = options["temperature"]
    if isinstance(value, bool) or not isinstance(value, int | float) or not -273.15 < value < 1000.0:
        raise refuse(UsageError, f"the temperature is {value!r}", fix="give degC, such as 80")
    return {"temperature": float(value)}


def _identifier(path: Path) -> str:
    """The name of a file as an identifier of programming languages."""
    name = re.sub(r"\W", "_", path.name.split(".")[0], flags=re.ASCII)
    return name if name and not name[0].isdigit() else f"motor_{name}"


def _whole(make: Callable[[Model], str]) -> Maker:
    """Of a text that holds all of the model and has no options."""
    return lambda model, _path, _options: (make(model), [])


def _unit(version: fmu.Version) -> Maker:
    """Of a functional mock-up unit."""
    return lambda model, path, options: fmu.content(
        model, version, _identifier(path), **_temperature(options)
    )


KINDS: dict[str, Kind] = {
    "machine": Kind("corrected machine file", ".toml", (), _whole(machine_file.text)),
    "python": Kind(
        "Python module that needs numpy alone",
        ".py",
        ("temperature",),
        lambda model, _path, options: (python_module.text(model, **_temperature(options)), []),
    ),
    "rust": Kind("Rust program on the crate pmsm-core", ".rs", (), _whole(rust_snippet.text)),
    "fmu": Kind(
        "functional mock-up unit for co-simulation, FMI 2.0",
        ".fmu",
        ("temperature",),
        _unit(FMI2),
    ),
    "fmu3": Kind(
        "functional mock-up unit for co-simulation, FMI 3.0",
        ".fmu",
        ("temperature",),
        _unit(FMI3),
    ),
    "modelica": Kind(
        "Modelica model",
        ".mo",
        ("temperature",),
        lambda model, path, options: (modelica.text(model, _identifier(path), **_temperature(options)), []),
    ),
    "motulator": Kind(
        "Python module on motulator", ".py", (), lambda model, _path, _options: simulators.motulator(model)
    ),
    "gem": Kind(
        "parameters for gym-electric-motor",
        ".py",
        (),
        lambda model, _path, _options: simulators.gym_electric_motor(model),
    ),
    "mujoco": Kind(
        "MuJoCo joint and actuator", ".xml", (), lambda model, _path, _options: simulators.mujoco(model)
    ),
    "c-header": Kind(
        "compensation for a drive as a C header in single precision",
        ".h",
        (),
        lambda model, path, _options: drive_header.text(model, prefix=_identifier(path).lower()),
    ),
}
