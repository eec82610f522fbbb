"""Voltages and currents of another convention are told by the values that come out beside the nameplate."""

from __future__ import annotations

import math

import numpy as np
import pmsm_rs as pm
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pmsm_rs.config.rules import Rule
from pmsm_rs.io.checks import angle_against_speed
from pmsm_rs.io.conventions import scaled

PLATE = {"r_s": 0.9, "l_d": 0.0096, "l_q": 0.0213, "psi_m": 0.193, "j": 0.0126}
RULES = {name: Rule(f"x_{name}", name[0].upper().replace("I", "A")) for name in ("v_d", "v_q", "i_d", "i_q")}


def values(v: float, i: float) -> dict[str, float]:
    """What comes out of a log whose voltages and currents are `v` and `i` times too large."""
    powers = {"r_s": v / i, "l_d": v / i, "l_q": v / i, "psi_m": v, "j": v * i}
    return {name: PLATE[name] * factor for name, factor in powers.items()}


@pytest.mark.parametrize(
    ("v", "i", "said", "line"),
    [
        (
            math.sqrt(1.5),
            math.sqrt(1.5),
            "voltages and currents",
            'v_d = { from = "x_v_d", unit = "V", scale = 0.816497 }',
        ),
        (1.0, math.sqrt(2.0), "the currents were logged √2 times", "scale = 0.707107"),
        (1.0, math.sqrt(0.5), "the currents were logged divided by √2", "scale = 1.41421"),
        (math.sqrt(3.0), 1.0, "the voltages were logged √3 times", "scale = 0.57735"),
        (1.0 / 540.0, 1.0, "duty cycle", "scale = 540.0"),
    ],
)
@pytest.mark.parametrize("off", [1.0, 1.04])
def test_a_scale_is_told_with_the_lines_that_convert(
    v: float, i: float, said: str, line: str, off: float
) -> None:
    base = values(v, i)
    base["l_d"] *= off
    found = scaled(base, PLATE, RULES, 540.0)
    assert found is not None
    assert said in found["finding"]
    assert line in found["fix"]
    if v == i:
        assert "power-invariant" in found["finding"]


@given(st.lists(st.floats(0.86, 1.16), min_size=5, max_size=5))
def test_a_nameplate_that_is_off_is_no_other_convention(off: list[float]) -> None:
    base = {name: value * factor for (name, value), factor in zip(PLATE.items(), off, strict=True)}
    assert scaled(base, PLATE, RULES, 540.0) is None


def test_few_values_tell_no_scale() -> None:
    base = values(1.0, math.sqrt(2.0))
    assert scaled({name: base[name] for name in ("r_s", "psi_m", "j")}, PLATE, RULES, None) is None


def test_a_diagnosis_tells_the_scale() -> None:
    run = pm.simulate(
        duration=0.6,
        drive={"f_sample": 5e3},
        sensors={"noise_i": 0.02, "noise_omega_e": 0.3},
        reference={
            "omega_m": {"t": [0.0, 0.1, 0.3], "value": [20.0, 80.0, -60.0], "shape": "steps"},
            "i_d": {"t": [0.0, 0.1, 0.2, 0.3, 0.4, 0.5], "value": [-4.0, 3.0] * 3, "shape": "steps"},
        },
        load={"tau": 1.0, "kind": "unknown_constant"},
    )
    columns = {name: run.recording.column(name) for name in run.recording.names}
    for name in ("i_a", "i_b", "i_c"):
        columns[name] = columns[name] / math.sqrt(2.0)
    answer = pm.diagnose(pm.Recording(columns, load="unknown_constant"), run.machine)
    [found] = [f for f in answer.data_quality if "as if the currents were logged" in f["finding"]]
    assert "root mean squares" in found["finding"]
    assert 'i_b = { from = "i_b", unit = "A", scale = 1.41421 }' in found["fix"]


@pytest.mark.parametrize(
    ("factor", "words", "unit"),
    [
        (30.0 / np.pi, "rpm and rad/s", "rpm"),
        (np.pi / 30.0, "rpm and rad/s", "rad/s"),
        (0.5 / np.pi, "turns and rad", "Hz"),
    ],
)
def test_a_speed_in_another_unit_than_it_says_is_told(factor: float, words: str, unit: str) -> None:
    t = np.arange(500) * 1e-3
    columns = {"t": t, "theta_m": 40.0 * t, "omega_m": np.full(500, 40.0 * factor)}
    with pytest.raises(pm.DataError, match=words) as caught:
        angle_against_speed(columns, 4, None)
    assert f'unit = "{unit}"' in str(caught.value)


@pytest.mark.parametrize(("angle", "speed"), [("theta_e", "omega_m"), ("theta_m", "omega_e")])
def test_other_pole_pairs_are_told(angle: str, speed: str) -> None:
    """Of a motor with five pole pairs, where the machine file says two."""
    t = np.arange(500) * 1e-3
    rate = {"theta_e": 50.0, "theta_m": 10.0, "omega_e": 50.0, "omega_m": 10.0}
    columns = {"t": t, angle: rate[angle] * t, speed: np.full(500, rate[speed])}
    with pytest.raises(pm.DataError, match=r"check n_p, which would be 5"):
        angle_against_speed(columns, 2, None)
