"""A closed-loop drive that makes recordings whose truth is known."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import _core, atomic
from .._core import Machine, MachineError, NotIdentifiableError, UsageError
from ..config.nameplate import machine_text
from ..errors import message
from ..io.recording import Recording
from ..progress import Progress
from ..quantities.canonical import ordered
from ..results import tabular
from . import settings as simulation_config


@dataclass(frozen=True)
class Truth:
    """What a simulated recording is the recording of.

    Attributes
    ----------
    base : dict of str to float
        Base parameters at the start, in SI units.
    effects : dict of str to dict
        Parameters of each effect by name and, where they differ, what an identification reports of it.
    scales : dict
        Scales at which the effects' parameters are meant.
    traces : dict of str to ndarray of shape (samples,)
        `i_d`, `i_q` (A), `theta_m` (rad), `omega_m` (rad/s), `tau_e`, `tau_load` (N·m), and each base
        parameter that drifts. `tau_load_disturbed` (N·m) is eq. (4) of Liu, Liu & Cartes (2008).
    """

    base: dict[str, float]
    effects: dict[str, dict[str, float]]
    scales: dict[str, Any]
    traces: dict[str, NDArray[np.float64]]


@dataclass(frozen=True)
class Simulation:
    """A simulated run: the recording as a bench would have it, the nameplate, and the truth.

    Attributes
    ----------
    recording : Recording
        What a bench would have logged.
    machine : Machine
        The nameplate.
    truth : Truth
        Parameters, effects and signals by which it was made, in SI units.
    settings : dict
        The settings, with those that were not given.
    seed : int
        Seed of the noise.

    Examples
    --------
    >>> import pmsm_rs as pm
    >>> made = pm.simulate(reference={"omega_m": 50.0}, effects={"dead_time": {"v_err": 2.0}}, duration=0.2)
    >>> made.truth.effects["dead_time"]["v_err"]
    2.0
    """

    recording: Recording
    machine: Machine
    truth: Truth
    settings: dict[str, Any]
    seed: int

    def write(self, path: str | os.PathLike[str]) -> None:
        """Writes the recording as Parquet, or CSV by its name.

        Parameters
        ----------
        path : path
            Where it goes.

        Raises
        ------
        UsageError
            Where it cannot be written.
        """
        columns = {name: self.recording.column(name) for name in ordered(self.recording.names)}
        tabular.write(path, columns)

    def write_truth(self, path: str | os.PathLike[str]) -> None:
        """Writes the truth beside a recording.

        Parameters and settings go to NAME.truth.json, true signals to NAME.truth.parquet.

        Parameters
        ----------
        path : path
            Name of the recording.

        Raises
        ------
        UsageError
            Where they cannot be written.
        """
        stem = Path(path).with_suffix("")
        text = {
            "schema": "pmsm-rs.truth/1",
            "base": self.truth.base,
            "effects": self.truth.effects,
            "scales": self.truth.scales,
            "settings": self.settings,
            "seed": self.seed,
            "version": _core.__version__,
        }
        t = self.recording.column("t")
        atomic.write_text(f"{stem}.truth.json", json.dumps(text, indent=2) + "\n")
        tabular.write(f"{stem}.truth.parquet", {"t": t, **self.truth.traces})

    def write_machine(self, path: str | os.PathLike[str]) -> None:
        """Writes the machine file with which the recording is read.

        It holds the nameplate and what is known of the load.

        Parameters
        ----------
        path : path
            Where it goes.

        Raises
        ------
        UsageError
            Where it cannot be written.
        """
        text = machine_text(self.machine, self.recording.load, self.recording.load_value)
        atomic.write_text(path, text)

    def __repr__(self) -> str:
        effects = ", ".join(self.truth.effects) or "no effects"
        return f"<Simulation of {len(self.recording)} samples, {self.recording.duration:.6g} s, {effects}>"


def simulate(
    config: str | os.PathLike[str] | Mapping[str, Any] | None = None,
    /,
    *,
    progress: Progress | None = None,
    **tables: Any,
) -> Simulation:
    """Simulates a closed-loop drive, Fig. 4 of Liu, Liu & Cartes (2008).

    Without a machine it is that of the paper's Table 1. The page on simulations has all tables and keys.

    Parameters
    ----------
    config : path, mapping or None, default None
        A TOML file or a mapping.
    progress : callable or None, default None
        Is called as progress(stage, fraction) from time to time.
    **tables : object
        Tables and keys on top of it, as in `simulate(reference={"omega_m": 100.0}, effects={"dead_time":
        {"v_err": 2.0}})`.

    Returns
    -------
    Simulation
        The recording, the nameplate and the truth.

    Raises
    ------
    UsageError
        Naming every wrong entry with the nearest right one, and where the simulation diverges.
    KeyboardInterrupt
        On Ctrl-C.

    Examples
    --------
    >>> import pmsm_rs as pm
    >>> made = pm.simulate(reference={"omega_m": 50.0}, duration=0.2, seed=3)
    >>> made.recording.duration > 0.19
    True
    """
    wanted = simulation_config.read(config, tables)
    try:
        core, truth, traces = _core.simulate(
            wanted.machine, wanted.nameplate, json.dumps(wanted.settings), seed=wanted.seed, progress=progress
        )
    except (MachineError, NotIdentifiableError) as error:
        where = f"{config}: " if isinstance(config, str | os.PathLike) else ""
        raise UsageError(f"{where}{message(error)}") from error
    found = json.loads(truth)
    recording = Recording(
        {name: core.column(name) for name in core.names}, load=core.load, load_value=core.load_value
    )
    return Simulation(
        recording,
        wanted.nameplate,
        Truth(
            {name: entry["value"] for name, entry in found["base"].items()},
            {
                entry["effect"]: {
                    name: value["value"]
                    for name, value in {**entry["outputs"], **entry["parameters"]}.items()
                }
                for entry in found["effects"]
            },
            found["scales"],
            traces,
        ),
        wanted.settings,
        wanted.seed,
    )
