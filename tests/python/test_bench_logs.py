"""Logs as benches keep them: what they lack is not blamed on the motor, and hides nothing that is there."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pmsm_rs as pm
import pytest
from conftest import ROOT
from pmsm_rs.config import read_machine
from pmsm_rs.results import Diagnosis

pytest.importorskip("numba")


def diagnose(folder: Path, name: str, effects: dict[str, Any], load: str, log: str) -> Diagnosis:
    """The plant of proof/, logged by a lesser logger."""
    sys.path.insert(0, str(ROOT))
    from proof.case import make_case
    from proof.machines import MACHINES

    sealed = folder / "sealed"
    make_case(folder / "open", MACHINES[name], effects, "rich", load, 4002, truth_folder=sealed, degraded=log)
    machine = read_machine(folder / "open" / "machine.toml")
    first, other = (
        pm.load(folder / "open" / f"{n}.parquet", machine=machine) for n in ("recording", "validation")
    )
    return pm.diagnose(first, machine.machine, validation=other)


def test_a_filtered_speed_of_a_heavy_rotor_is_no_mismatch(tmp_path: Path) -> None:
    answer = diagnose(tmp_path, "hub48", {}, "unknown_piecewise", "speed_filter")
    assert answer.verdict == "no_mismatch"
    assert any("low-pass filtered at 25" in f["finding"] for f in answer.data_quality)


def test_two_sensors_that_disagree_are_told_with_what_they_have_in_common(tmp_path: Path) -> None:
    gains = {"g_a": 0.06, "g_b": -0.02, "g_c": -0.04}
    answer = diagnose(tmp_path, "pump2k", {"current_gain_imbalance": gains}, "known_constant", "two_currents")
    assert (answer.verdict, answer.model["effects"]) == ("named", ["current_gain_imbalance"])
    found = answer.ranking[0].parameters
    assert found["g_a"].value == pytest.approx(1.06, abs=2e-3)
    assert found["g_b"].value == pytest.approx(0.98, abs=2e-3)
    # no sensor, no error
    assert found["g_c"].value == 1.0
