"""A recording at one speed and load pins little down, and accuses nobody."""

from __future__ import annotations

import sys
from pathlib import Path

import pmsm_rs as pm
import pytest
from conftest import ROOT
from pmsm_rs.config import read_machine
from pmsm_rs.results import Diagnosis

pytest.importorskip("numba")


def diagnose(folder: Path, name: str, load: str, seed: int) -> Diagnosis:
    """The sound plant of proof/ at constant speed and load."""
    sys.path.insert(0, str(ROOT))
    from proof.case import make_case
    from proof.machines import MACHINES

    make_case(folder / "open", MACHINES[name], {}, "poor", load, seed, truth_folder=folder / "sealed")
    machine = read_machine(folder / "open" / "machine.toml")
    first, other = (
        pm.load(folder / "open" / f"{n}.parquet", machine=machine) for n in ("recording", "validation")
    )
    return pm.diagnose(first, machine.machine, validation=other)


@pytest.mark.parametrize("load", ["known_constant", "unknown_constant"])
def test_a_sound_machine_at_one_speed_is_not_accused(tmp_path: Path, load: str) -> None:
    answer = diagnose(tmp_path, "hub48", load, 4001)
    assert answer.verdict == "no_mismatch"
    assert any("does not pin down" in finding["finding"] for finding in answer.data_quality)
