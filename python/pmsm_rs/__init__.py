"""Finds out what a model of a permanent-magnet synchronous motor leaves out, from recordings of the motor.

Everything is in SI units, the rotor frame has its d axis on the magnet flux, the Park transform keeps
amplitudes, and a positive i_q drives with positive speed::

    import pmsm_rs as pm

    print(pm.inspect("run.csv"))
    recording = pm.load("run.csv", machine="machine.toml")
    other = pm.load("other.csv", machine="machine.toml")
    answer = pm.diagnose(recording, pm.Machine(n_p=3, r_s=0.9), validation=other)
    print(answer.verdict)
    answer.report("report.html")
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ._core import (
        DataError,
        Fitness,
        InternalError,
        Machine,
        MachineError,
        NotIdentifiableError,
        PmsmError,
        UsageError,
        __version__,
    )
    from .answers import Diagnosis, Identification
    from .config.effect_text import Effect, effect
    from .config.options import DiagnosisOptions
    from .config.swarm import Swarm
    from .experiments.design import design
    from .experiments.outcome import Design
    from .fleet.recordings import Failure, Fleet, diagnose_many
    from .inspection.inspect import Inspection, inspect
    from .io.loader import load
    from .io.recording import Recording
    from .live.tracker import Tracker, track
    from .live.window import WindowEstimate
    from .model import Model
    from .results.registry import effects
    from .run import diagnose, identify
    from .simulation.drive import Simulation, simulate
    from .systems import SystemFit, identify_system

_HOME = {
    "DataError": "_core",
    "Design": "experiments.outcome",
    "Diagnosis": "answers",
    "DiagnosisOptions": "config.options",
    "Effect": "config.effect_text",
    "Failure": "fleet.recordings",
    "Fitness": "_core",
    "Fleet": "fleet.recordings",
    "Identification": "answers",
    "Inspection": "inspection.inspect",
    "InternalError": "_core",
    "Machine": "_core",
    "MachineError": "_core",
    "Model": "model",
    "NotIdentifiableError": "_core",
    "PmsmError": "_core",
    "Recording": "io.recording",
    "Simulation": "simulation.drive",
    "Swarm": "config.swarm",
    "SystemFit": "systems",
    "Tracker": "live.tracker",
    "UsageError": "_core",
    "WindowEstimate": "live.window",
    "__version__": "_core",
    "design": "experiments.design",
    "diagnose": "run",
    "diagnose_many": "fleet.recordings",
    "effect": "config.effect_text",
    "effects": "results.registry",
    "identify": "run",
    "identify_system": "systems",
    "inspect": "inspection.inspect",
    "load": "io.loader",
    "simulate": "simulation.drive",
    "track": "live.tracker",
}

__all__ = [
    "DataError",
    "Design",
    "Diagnosis",
    "DiagnosisOptions",
    "Effect",
    "Failure",
    "Fitness",
    "Fleet",
    "Identification",
    "Inspection",
    "InternalError",
    "Machine",
    "MachineError",
    "Model",
    "NotIdentifiableError",
    "PmsmError",
    "Recording",
    "Simulation",
    "Swarm",
    "SystemFit",
    "Tracker",
    "UsageError",
    "WindowEstimate",
    "__version__",
    "design",
    "diagnose",
    "diagnose_many",
    "effect",
    "effects",
    "identify",
    "identify_system",
    "inspect",
    "load",
    "simulate",
    "track",
]


def __getattr__(name: str) -> Any:
    # Names are fetched on first use, so that neither `import pmsm_rs` nor `pmsm-rs --help` pays for
    # what it does not need.
    home = _HOME.get(name)
    if home is None:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    # It gives errors of the core their codes.
    import_module(".errors", __name__)
    value = getattr(import_module(f".{home}", __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
