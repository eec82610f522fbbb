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
    from .fleet import Failure, Fleet, diagnose_many
    from .inspecting import Inspection, inspect
    from .loader import load
    from .model import Model
    from .options import DiagnosisOptions
    from .recording import Recording
    from .registry import effects
    from .run import Swarm, diagnose, identify
    from .simulation import Simulation, simulate
    from .systems import SystemFit, identify_system
    from .tracking import Tracker, WindowEstimate, track

_HOME = {
    "DataError": "_core",
    "Diagnosis": "answers",
    "DiagnosisOptions": "options",
    "Failure": "fleet",
    "Fitness": "_core",
    "Fleet": "fleet",
    "Identification": "answers",
    "Inspection": "inspecting",
    "InternalError": "_core",
    "Machine": "_core",
    "MachineError": "_core",
    "Model": "model",
    "NotIdentifiableError": "_core",
    "PmsmError": "_core",
    "Recording": "recording",
    "Simulation": "simulation",
    "Swarm": "run",
    "SystemFit": "systems",
    "Tracker": "tracking",
    "UsageError": "_core",
    "WindowEstimate": "tracking",
    "__version__": "_core",
    "diagnose": "run",
    "diagnose_many": "fleet",
    "effects": "registry",
    "identify": "run",
    "identify_system": "systems",
    "inspect": "inspecting",
    "load": "loader",
    "simulate": "simulation",
    "track": "tracking",
}

__all__ = [
    "DataError",
    "Diagnosis",
    "DiagnosisOptions",
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
    "diagnose",
    "diagnose_many",
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
    value = getattr(import_module(f".{home}", __name__), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
