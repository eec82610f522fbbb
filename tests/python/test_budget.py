"""The budget of the mismatch: shares that add up, said in words, drawn in the report."""

from __future__ import annotations

import pmsm_rs as pm
import pytest
from pmsm_rs.results.budget import judged, sentence, shares
from pmsm_rs.results.findings import Budget

ENTRY = {
    "run": "recording",
    "channel": "i_q",
    "equation": "q",
    "before": 5.4,
    "after": 1.2,
    "parts": [
        {"effect": "dead_time", "alone": 0.8, "beside": 0.61},
        {"effect": "saturation_q", "alone": 0.4, "beside": 0.22},
        {"effect": "iron_loss", "alone": 0.1, "beside": 0.001},
    ],
    "shared": 0.119,
    "unmodelled": 0.0,
    "rest": 0.05,
}


@pytest.fixture(scope="module")
def demo(short_demo: tuple[str, str, str]) -> pm.Diagnosis:
    recording, validation, machine = short_demo
    return pm.diagnose(pm.load(recording, machine), machine, pm.load(validation, machine))


def test_a_budget_is_said_in_one_sentence_without_what_is_nothing() -> None:
    budget = Budget.of(ENTRY)
    assert sentence(budget) == (
        "Of 5.4 times the noise in i_q: inverter dead time 61 %, saturation of the q axis 22 %, "
        "shared by several 12 %, rest 5 %."
    )
    assert [name for name, _ in shares(budget)][-1] == "rest"


def test_a_run_that_the_model_does_not_predict_has_no_shares() -> None:
    worse = Budget.of({**ENTRY, "run": "validation", "after": 7.25, "rest": 1.83})
    assert sentence(worse) == (
        "In i_q the residual grows from 5.4 to 7.25 times the noise: the model does not predict this run."
    )


def test_the_validation_run_is_told_where_there_is_one() -> None:
    here, there = Budget.of(ENTRY), Budget.of({**ENTRY, "run": "validation"})
    assert judged([here, there]) == [there]
    assert judged([here]) == [here]


def test_shares_of_a_diagnosis_add_up_and_stand_in_text_and_report(demo: pm.Diagnosis) -> None:
    assert {budget.run for budget in demo.budget} == {"recording", "validation"}
    for budget in demo.budget:
        whole = sum(part.beside for part in budget.parts) + budget.shared + budget.unmodelled + budget.rest
        assert whole == pytest.approx(1.0)
    told = sentence(judged(demo.budget)[0])
    assert told.split(":")[0] in str(demo)
    page = str(demo.report())
    assert "Budget of the mismatch" in page
