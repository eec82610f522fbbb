"""What exports of a model are held against: its own response to the voltages of a recording."""

from __future__ import annotations

import importlib.util
import shutil
import types
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from models import EFFECTS, MAP, model_of, simulated
from pmsm_rs.model import Model

COMPILER = next(filter(None, map(shutil.which, ("cc", "gcc", "clang"))), None)
SHOWN = ("i_d", "i_q", "tau_e", "omega_m", "theta_m")
CASES = (*EFFECTS, "mapped")


@cache
def model_and_recording(name: str) -> tuple[Model, Any]:
    """A model, and a recording of the machine whose voltages drive it; `name` is one of `CASES`."""
    run = simulated(EFFECTS["friction" if name == "mapped" else name])
    return model_of(run, MAP if name == "mapped" else None), run.recording


def drive(recording: Any) -> dict[str, Any]:
    n = 1500
    return {
        "t": recording.column("t")[:n],
        "v_d": recording.column("v_d")[:n],
        "v_q": recording.column("v_q")[:n],
        "tau_load": np.where(np.arange(n) < n // 2, 0.5, 1.0),
    }


def close(got: Any, expected: Any, tolerance: float) -> None:
    for name in SHOWN:
        largest = np.abs(expected[name]).max()
        assert np.abs(np.asarray(got[name]) - expected[name]).max() <= tolerance * largest, name


def module(path: Path) -> types.ModuleType:
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    made = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(made)
    return made
