"""Recordings to and from xarray, and settings as those of estimators."""

from __future__ import annotations

import numpy as np
import pmsm_rs as pm
import pytest
from conftest import Columns

xr = pytest.importorskip("xarray")


def test_a_recording_becomes_a_dataset_and_comes_back(columns: Columns) -> None:
    run = pm.Recording(columns, load="known_constant", load_value=0.3)
    made = run.to_xarray()
    assert made["i_q"].attrs["units"] == "A"
    assert made["i_q"].dims == ("t",)
    assert made.attrs == {"load": "known_constant", "load_value": 0.3}
    again = pm.load(made)
    assert sorted(again.names) == sorted(run.names)
    for name in run.names:
        np.testing.assert_array_equal(again.column(name), run.column(name))


def test_the_unit_of_a_variable_counts(columns: Columns) -> None:
    made = pm.Recording(columns).to_xarray()
    made["i_q"] = ("t", 1e3 * columns["i_q"], {"units": "mA"})
    np.testing.assert_allclose(pm.load(made).column("i_q"), columns["i_q"])


def test_variables_of_more_dimensions_are_passed_over(columns: Columns) -> None:
    made = pm.Recording(columns).to_xarray()
    made["grid"] = (("t", "k"), np.zeros((len(columns["t"]), 2)))
    assert sorted(pm.load(made).names) == sorted(columns)


@pytest.mark.parametrize("made", [pm.Swarm(particles=12), pm.DiagnosisOptions(most_effects=2)])
def test_settings_can_be_taken_apart_and_put_together(made: pm.Swarm | pm.DiagnosisOptions) -> None:
    assert type(made)(**made.get_params()) == made
    assert made.get_params(deep=False) == made.get_params()
