"""Units convert there and back, whatever their spelling, and never across dimensions."""

from __future__ import annotations

import math

import numpy as np
import pmsm_rs as pm
import pytest
from conftest import plausible
from hypothesis import given
from hypothesis import strategies as st
from pmsm_rs.io.columns import Rule, assemble
from pmsm_rs.io.frames import frame_source
from pmsm_rs.quantities.canonical import CANONICAL
from pmsm_rs.quantities.units import UNITS, canonical, to_si

EPSILON = float(np.finfo(float).eps)
SMALLEST = float(np.finfo(float).smallest_subnormal)
EVERY_UNIT = [(dimension, unit) for dimension, units in UNITS.items() for unit in units]


@given(st.sampled_from(EVERY_UNIT), st.floats(-1e6, 1e6))
def test_a_value_survives_the_way_to_si_and_back(where: tuple[str, str], value: float) -> None:
    dimension, unit = where
    factor, offset = UNITS[dimension][unit]
    back = (to_si(value, unit, dimension) - offset) / factor
    # four operations, half an epsilon each, on numbers no larger than value and offset together
    size = abs(value) + 2.0 * abs(offset / factor)
    # and the spacing of the smallest numbers, over the factor
    assert abs(back - value) <= 2.0 * EPSILON * size + SMALLEST / factor


@pytest.mark.parametrize(("dimension", "unit"), EVERY_UNIT)
def test_every_unit_is_found_under_its_own_name(dimension: str, unit: str) -> None:
    assert canonical(unit, dimension) == unit
    assert canonical(f" {unit} ", dimension) == unit


@pytest.mark.parametrize(
    ("text", "dimension", "value", "si"),
    [
        ("1/min", "speed", 60.0, 2.0 * math.pi),
        ("RPM", "speed", 30.0, math.pi),
        ("Hz", "speed", 1.0, 2.0 * math.pi),
        ("°", "angle", 180.0, math.pi),
        ("degC", "temperature", 20.0, 20.0),
        ("K", "temperature", 293.15, 20.0),
        ("°F", "temperature", 212.0, 100.0),
        ("Nm", "torque", 2.0, 2.0),
        ("N m", "torque", 2.0, 2.0),
        ("mNm", "torque", 2.0, 2e-3),
        ("µs", "time", 5.0, 5e-6),
        ("mA", "current", 5.0, 5e-3),
        ("A rms", "current", 1.0, math.sqrt(2.0)),
    ],
)
def test_spellings(text: str, dimension: str, value: float, si: float) -> None:
    unit = canonical(text, dimension)
    assert unit is not None
    assert to_si(value, unit, dimension) == pytest.approx(si, rel=1e-12)


@given(st.sampled_from(sorted(CANONICAL)), st.data())
def test_a_column_given_in_any_unit_is_the_same_column(name: str, data: st.DataObject) -> None:
    dimension = CANONICAL[name].dimension
    choices = [unit for unit in UNITS[dimension] if "rms" not in unit]
    unit = data.draw(st.sampled_from(choices))
    factor, offset = UNITS[dimension][unit]
    si = np.linspace(1.0, 5.0, 20)
    source = frame_source({"time": np.arange(20.0), "x": (si - offset) / factor}, 1 << 20)
    rules = {"t": Rule(period=1.0)} | ({name: Rule("x", unit)} if name != "t" else {"t": Rule("x", unit)})
    got = assemble(source, rules)["omega_m" if name == "n" else name]
    # two operations there and some four back, half an epsilon each, on numbers no larger than both together
    assert np.all(np.abs(got - si) <= 3.0 * EPSILON * (si + 2.0 * abs(offset)))


@given(st.permutations(list(plausible(40))))
def test_the_order_of_columns_means_nothing(order: list[str]) -> None:
    columns = plausible(40)
    recording = pm.Recording({name: columns[name] for name in order})
    for name, values in columns.items():
        np.testing.assert_array_equal(recording.column(name), values)


@given(
    st.floats(-1e3, 1e3).filter(lambda x: abs(x) > 1e-3),
    st.floats(-1e3, 1e3),
)
def test_scale_and_offset_act_before_the_unit(scale: float, offset: float) -> None:
    raw = np.linspace(-3.0, 3.0, 20)
    rules = {"t": Rule(period=0.1), "omega_m": Rule("x", "rpm", scale, offset)}
    got = assemble(frame_source({"x": raw}, 1 << 20), rules)["omega_m"]
    size = (np.abs(raw * scale) + abs(offset)) * 2.0 * np.pi / 60.0
    # three operations on either side, half an epsilon each, and a factor that is rounded, too
    error = np.abs(got - (raw * scale + offset) * 2.0 * np.pi / 60.0)
    assert np.all(error <= 4.0 * EPSILON * size)
