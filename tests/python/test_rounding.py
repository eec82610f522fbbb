"""Numbers rounded to their uncertainty: the digits that the rule keeps, and no zero with a sign."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pmsm_rs.io.sampling import Sampling
from pmsm_rs.results import words
from pmsm_rs.results.estimates import Estimate
from pmsm_rs.results.rounding import fixed, last_place, rounded, short, significant
from pmsm_rs.view.readout import extent


@pytest.mark.parametrize(
    ("spread", "places"),
    [
        # The examples of the Review of Particle Physics: 0.827 ± 0.119 and 0.827 ± 0.367 ...
        (0.119, 2),
        (0.367, 1),
        # ... and the limits of the rule, 354 and 949.
        (0.0354, 3),
        (0.0355, 2),
        (0.949, 1),
        (0.951, 1),
        (167.0, -1),
        (1e-3, 4),
        (5e-324, 324),
    ],
)
def test_the_rule_of_the_particle_data_group(spread: float, places: int) -> None:
    assert last_place(spread) == places


@pytest.mark.parametrize(
    ("value", "stderr", "unit", "text"),
    [
        (0.0020998, 1e-7, "N m s", "(2.09980 ± 0.00010)·10⁻³ N·m·s"),
        (0.0020998, 4e-7, "N m s", "(2.0998 ± 0.0004)·10⁻³ N·m·s"),
        (0.827, 0.119, "V", "0.83 ± 0.12 V"),
        (0.827, 0.367, "V", "0.8 ± 0.4 V"),
        (0.00739942, 0.0000021, "H", "7.3994 ± 0.0021 mH"),
        (-0.0047, 0.0091, "A", "-5 ± 9 mA"),
        (4136.2, 167.0, "ohm", "4140 ± 170 Ω"),
        (-0.0004, 0.2, "A", "0.00 ± 0.20 A"),
        (0.0, 0.096, "1", "0.00 ± 0.10"),
        (24.0, None, "1", "24"),
        (1.2e-7, None, "kg m^2", "1.200·10⁻⁷ kg·m²"),
        (0.0001342, None, "N m s", "1.342·10⁻⁴ N·m·s"),
        (0.0052, None, "kg m^2", "5.200·10⁻³ kg·m²"),
    ],
)
def test_estimates_as_they_are_written(value: float, stderr: float | None, unit: str, text: str) -> None:
    assert str(words.estimate(Estimate(value, stderr, None, unit, None))) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        *[(3.12e-5, "3.12·10⁻⁵"), (0.0312, "0.0312"), (14.4, "14.4"), (616.0, "616"), (0.9996, "1.00")],
        *[(-0.004, "-4.00·10⁻³"), (1.23e7, "1.23·10⁷"), (0.0, "0"), (-0.0, "0"), (math.inf, "inf")],
    ],
)
def test_a_power_of_ten_is_written_only_where_it_is_needed(value: float, text: str) -> None:
    assert significant(value, 3) == words.number(value) == text


def test_one_period_is_written_alike_everywhere() -> None:
    assert [short(value) for value in (20.0, 4.28571, 0.1302, 2.8514)] == ["20", "4.286", "0.1302", "2.851"]
    read = {"rows": 5, "period": 4.28571e-3}
    assert extent(read) == "5 rows, one every 4.286 ms"
    assert Sampling.of(np.arange(5) * 4.28571e-3).sentence().startswith("5 rows, one every 4.286 ms")


def test_a_value_alone_has_the_prefix_of_the_tables() -> None:
    told = [
        words.quantity(*each)
        for each in ((2.756e-3, "V s"), (0.192, "V s"), (1.2e-4, "kg m^2"), (1.7e-5, "H"))
    ]
    assert told == ["2.756 mV·s", "0.192 V·s", "1.200·10⁻⁴ kg·m²", "17 µH"]


@pytest.mark.parametrize(
    ("text", "signs"),
    [
        ("psi_m = 2.756 mV s", "psi_m = 2.756 mV·s"),
        ("3.1·10⁻⁵ N m s", "3.1·10⁻⁵ N·m·s"),
        ("14.4 ohm", "14.4 Ω"),
        ("50 mN m against", "50 mN·m against"),
        ("0.03 N m/A", "0.03 N·m/A"),
    ],
)
def test_units_of_the_core_get_their_signs(text: str, signs: str) -> None:
    assert words.with_signs(text) == signs


def test_the_interval_ends_at_the_place_of_the_value_and_has_its_power() -> None:
    entry = Estimate(0.0020998, 4e-7, (0.00209901, 0.00210059), "N m s", None)
    assert words.interval(entry) == "2.0990 … 2.1006"


def test_no_share_is_minus_nothing() -> None:
    assert words.percent(-0.0004) == "0 %"
    assert words.percent(-0.02) == "-2 %"
    assert words.number(-0.0) == "0"
    assert fixed(-0.004, 2) == "0.00"


@given(st.floats(-1e12, 1e12), st.floats(1e-15, 1e9))
def test_rounding_moves_a_value_by_less_than_its_uncertainty(value: float, spread: float) -> None:
    shown = rounded(value, spread)
    assert not shown.value.startswith("-") or float(shown.value) < 0.0
    moved = abs(float(shown.value) * 10.0**shown.exponent - value)
    assert moved <= 0.142 * spread + 1e-9 * abs(value)
    told = float(shown.spread) * 10.0**shown.exponent
    assert math.isclose(told, spread, rel_tol=0.142)
    assert len(shown.spread.replace(".", "").strip("0") or "1") <= 2
