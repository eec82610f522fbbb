"""Mistakes of wiring, unit and scale that a recording is made with: what is told of them."""

from __future__ import annotations

import numpy as np
import pmsm_rs as pm
import pytest
from pmsm_rs import demo
from pmsm_rs.config import read_machine

pq = pytest.importorskip("pyarrow.parquet")


@pytest.fixture
def columns() -> dict[str, np.ndarray]:
    """The first half second of the demo recording, an inverter that loses voltage in its dead time."""
    table = pq.read_table(demo.recording_files()[0])
    return {name: table[name].to_numpy()[:5000].astype(float) for name in table.column_names}


def diagnosed(columns: dict[str, np.ndarray]) -> pm.Diagnosis:
    machine = read_machine(demo.recording_files()[2]).machine
    return pm.diagnose(pm.Recording(columns, load="unknown_constant"), machine)


@pytest.mark.parametrize(("one", "other"), [("i_b", "i_c"), ("i_a", "i_b"), ("i_c", "i_a")])
def test_interchanged_phases_are_refused_and_the_column_named(columns, one, other):
    columns[one], columns[other] = columns[other], columns[one]
    with pytest.raises(pm.DataError, match="interchange"):
        diagnosed(columns)


def test_phases_in_another_place_of_the_turn_are_in_order(columns):
    columns["i_a"], columns["i_b"], columns["i_c"] = columns["i_b"], columns["i_c"], columns["i_a"]
    assert diagnosed(columns).verdict != "no_mismatch"


@pytest.mark.parametrize(
    ("scaled", "factor", "said"),
    [(("i_a", "i_b", "i_c"), 10.0, "currents"), (("v_d", "v_q"), 0.001, "voltages")],
)
def test_a_scale_that_the_nameplate_contradicts_is_told(columns, scaled, factor, said):
    for name in scaled:
        columns[name] = columns[name] * factor
    findings = [f for f in diagnosed(columns).data_quality if "nameplate" in f["finding"]]
    assert len(findings) == 1
    assert said in findings[0]["fix"]


def test_a_nameplate_as_it_is_allowed_to_be_is_no_finding(columns):
    assert not [f for f in diagnosed(columns).data_quality if "nameplate" in f["finding"]]
