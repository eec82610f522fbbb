"""A recording at one speed and load pins little down, and accuses nobody."""

from __future__ import annotations

from pathlib import Path

import pytest
from concealed import diagnosed

pytest.importorskip("numba")


@pytest.mark.parametrize("load", ["known_constant", "unknown_constant"])
def test_a_sound_machine_at_one_speed_is_not_accused(tmp_path: Path, load: str) -> None:
    from proof.machines import HUB

    answer = diagnosed(tmp_path, HUB, {}, "poor", load, 4001, duration=1.0)
    assert answer.verdict == "no_mismatch"
    assert any("does not pin down" in finding["finding"] for finding in answer.data_quality)
