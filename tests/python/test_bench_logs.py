"""Logs as benches keep them: what they lack is not blamed on the motor, and hides nothing that is there."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from concealed import diagnosed

pytest.importorskip("numba")


def test_a_filtered_speed_of_a_heavy_rotor_is_no_mismatch(tmp_path: Path) -> None:
    from proof.machines import HUB

    heavy = replace(HUB, j=2.0 * HUB.j)
    answer = diagnosed(tmp_path, heavy, {}, "rich", "known_constant", 4001, degraded="speed_filter")
    assert answer.verdict == "no_mismatch"
    assert any("low-pass filtered at 25" in f["finding"] for f in answer.data_quality)


def test_two_sensors_that_disagree_are_told_with_what_they_have_in_common(tmp_path: Path) -> None:
    from proof.machines import PUMP

    gains = {"current_gain_imbalance": {"g_a": 0.06, "g_b": -0.02, "g_c": -0.04}}
    answer = diagnosed(tmp_path, PUMP, gains, "rich", "known_constant", 4002, degraded="two_currents")
    assert (answer.verdict, answer.model["effects"]) == ("named", ["current_gain_imbalance"])
    found = answer.ranking[0].parameters
    assert found["g_a"].value == pytest.approx(1.06, abs=2e-3)
    assert found["g_b"].value == pytest.approx(0.98, abs=2e-3)
    # no sensor, no error
    assert found["g_c"].value == 1.0
