"""Steady operating points of one axis: what two missing things leave together, by formulas of their own."""

from __future__ import annotations

import numpy as np
import pmsm_rs as pm
import pytest

LEVELS = np.array([0.0, -5.0, -9.0, -13.0, -17.0, -21.0])
"""Levels of i_d, A."""
NOISE = 0.005
"""Noise of the voltage, V."""


def grid(v_err: float, bend: float) -> pm.Recording:
    """v_q over levels of i_d and speeds under a small torque current, without the drop over the winding.

    Each phase loses `v_err` against its current, whose fundamental lies along the current vector. The d axis
    has 60 µH, by `bend` µH more for each ampere against the magnet.
    """
    i_d, omega = (x.ravel() for x in np.meshgrid(LEVELS, np.linspace(230.0, 660.0, 7)))
    i_q = np.full_like(i_d, 0.5)
    inductance = 1e-6 * (60.0 - bend * i_d)
    v_q = omega * (2.55e-3 + inductance * i_d) + 4.0 / np.pi * v_err * i_q / np.hypot(i_d, i_q)
    v_q += NOISE * np.random.default_rng(7).standard_normal(v_q.size)
    return pm.Recording(t=np.arange(v_q.size, dtype=float), i_d=i_d, i_q=i_q, omega_e=omega, v_q=v_q)


@pytest.mark.parametrize(
    ("v_err", "bend", "missing"),
    [
        (0.0, 0.0, set()),
        (0.0, 1.5, {"saturation_d"}),
        (0.15, 0.0, {"dead_time"}),
        (0.15, 1.5, {"dead_time", "saturation_d"}),
    ],
)
def test_what_a_grid_of_one_axis_leaves_out_is_named(v_err: float, bend: float, missing: set[str]) -> None:
    answer = pm.diagnose(grid(v_err, bend), pm.Machine(n_p=7))
    assert answer.recording_kind == "operating_points"
    assert set(answer.effects) == missing
    assert answer.verdict == ("named" if missing else "no_mismatch")
    if v_err:
        [found] = [c for c in answer.ranking if c.effect == "dead_time"]
        low, high = found.parameters["v_err"].ci95 or (v_err, v_err)
        assert low < v_err < high
        assert found.parameters["v_err"].value == pytest.approx(v_err, rel=0.3)
