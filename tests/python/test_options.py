"""The constants on which a verdict rests: given, checked, and echoed in the answer."""

from __future__ import annotations

import json
from dataclasses import asdict

import pmsm_rs as pm
import pytest
from pmsm_rs import _core
from pmsm_rs.support.demo import recording_files


def test_the_options_are_those_of_the_core_with_their_values() -> None:
    assert asdict(pm.DiagnosisOptions()) == json.loads(_core.diagnosis_options())


def test_every_answer_lists_all_options_with_the_values_it_rests_on(
    short_demo: tuple[str, str, str],
) -> None:
    recording, _, machine = short_demo
    options = pm.DiagnosisOptions(named=0.95, most_effects=1)
    answer = pm.diagnose(pm.load(recording, machine), machine, options=options)
    assert answer.options == asdict(options)


def test_options_are_read_from_text() -> None:
    assert pm.DiagnosisOptions.parse("named=0.95, most_effects=3") == pm.DiagnosisOptions(
        named=0.95, most_effects=3
    )


@pytest.mark.parametrize(
    ("text", "named"), [("nmaed=0.9", "named"), ("named=high", "named"), ("named", "named")]
)
def test_a_wrong_option_is_named_with_its_cure(text: str, named: str) -> None:
    with pytest.raises(pm.UsageError, match=named):
        pm.DiagnosisOptions.parse(text)


def test_a_number_with_a_decimal_comma_is_told() -> None:
    with pytest.raises(pm.UsageError, match=r"'95' is a number without a name.*named=0.95"):
        pm.DiagnosisOptions.parse("named=0,95")


@pytest.mark.parametrize(("given", "name"), [("nan", "named"), ("inf", "mismatch"), ("-1", "run_up")])
def test_what_is_no_number_above_zero_is_refused_by_its_name(given: str, name: str) -> None:
    options = pm.DiagnosisOptions.parse(f"{name}={given}")
    with pytest.raises(pm.UsageError, match=f"the option {name} is .*give a finite number above zero"):
        options.with_effects(())


@pytest.mark.parametrize(
    "options",
    [
        pm.DiagnosisOptions(named=1.5),
        pm.DiagnosisOptions(mismatch=float("nan")),
        pm.DiagnosisOptions(run_up=-1.0),
        pm.DiagnosisOptions(most_effects=-3),
    ],
)
def test_an_option_out_of_range_is_refused_before_anything_is_computed(options: pm.DiagnosisOptions) -> None:
    recording, _, machine = recording_files()
    with pytest.raises(pm.UsageError, match="option"):
        pm.diagnose(pm.load(recording, machine), machine, options=options)
