"""The summary of an answer: what it says first, each thing once, and no more than is known."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
from answers import ANSWER, REMAINING, diagnosis, estimate
from hypothesis import given
from hypothesis import strategies as st
from pmsm_rs import Diagnosis
from pmsm_rs.results import words
from pmsm_rs.results.estimates import Estimate
from pmsm_rs.view.tables import motor_rows


@pytest.mark.parametrize("verdict", ["unknown", "named", "ambiguous", "partial"])
def test_the_first_sentence_says_what_remains_beside_the_effects(verdict: str, tmp_path: Path) -> None:
    ranking = [{**ANSWER["ranking"][0], "gain_held_out": 0.93}]
    answer = diagnosis(verdict=verdict, remaining=[REMAINING], ranking=ranking)
    answer.report(tmp_path / "r.html")
    first = " ".join(str(answer).split("\n\n")[0].split())
    for text in [first, (tmp_path / "r.html").read_text(encoding="utf-8")]:
        assert (
            "the q-axis voltage equation has a residual of 14.8 times the noise, so another cause is at work"
            in text
        )


def test_an_effect_that_explains_most_and_leaves_more_than_noise_is_told_with_both_figures() -> None:
    ranking = [{**ANSWER["ranking"][0], "gain_held_out": 0.93, "probability": 0.5}]
    model = {**ANSWER["model"], "effects": []}
    answer = diagnosis(verdict="unknown", remaining=[REMAINING], ranking=ranking, model=model)
    said = "explains 93 % of the mismatch; the q-axis voltage equation has a residual of 14.8 times the noise"
    assert said in " ".join(str(answer).split("\n\n")[0].split())


def test_an_all_clear_that_the_validation_run_does_not_share_says_so_first() -> None:
    answer = diagnosis(verdict="no_mismatch", remaining=[{**REMAINING, "beside": []}])
    first = " ".join(str(answer).split("\n\n")[0].split())
    assert "but not the validation run: the q-axis voltage equation has a residual of 14.8" in first
    assert "Nothing is missing" not in first


def test_an_undetermined_answer_begins_with_its_reason() -> None:
    answer = diagnosis(
        verdict="undetermined", reason="the torque counts with the opposite sign; turn it round"
    )
    assert str(answer).startswith(
        "Verdict: undetermined\nNothing can be said of what is missing: the torque counts with the opposite"
    )


def test_a_finding_that_is_the_reason_is_told_once() -> None:
    quality = [
        {"finding": "the torque is odd", "consequence": "nothing is asked of it", "fix": "turn it round"}
    ]
    reason = "the torque is odd; turn it round"
    text = str(diagnosis(verdict="undetermined", reason=reason, data_quality=quality))
    assert text.count("the torque is odd") == text.count("turn it round") == 1
    assert "  ! nothing is asked of it" in text
    assert "  ! the torque is odd: nothing is asked of it; turn it round" in str(
        diagnosis(data_quality=quality)
    )


def test_a_finding_says_its_cause_only_where_the_reason_does_not() -> None:
    cause = "the rows lie 20 ms apart"
    finding = f"{cause}: only the parameters are asked"
    quality = [{"finding": finding, "consequence": "nothing is said of it", "fix": "log faster"}]
    reason = f"it cannot be checked, as {cause}; log faster"
    text = str(diagnosis(verdict="undetermined", reason=reason, data_quality=quality))
    assert text.count(cause) == 1
    assert "  ! only the parameters are asked: nothing is said of it" in text
    assert f"  ! {finding}: nothing is said of it; log faster" in str(diagnosis(data_quality=quality))


def test_no_full_stop_stands_before_a_code() -> None:
    quality = [
        {"finding": "It drifts.", "consequence": "It is slow.", "fix": "Log it again.", "code": "PR999"},
        {"finding": "it jumps", "consequence": "it is fast", "fix": "log it", "code": "PR998"},
    ]
    text = str(diagnosis(data_quality=quality))
    assert "  ! It drifts: it is slow; log it again [PR999]" in text
    assert "  ! it jumps: it is fast; log it [PR998]" in text
    card = diagnosis(data_quality=quality)._repr_html_()
    assert "It drifts. Log it again [PR999]" in card
    assert "It jumps. Log it [PR998]" in card


def test_the_limit_on_a_name_in_doubt_is_explained() -> None:
    ranking = [{**ANSWER["ranking"][0], "probability": 0.5}]
    limits = {"ceiling_doubtful": 0.5, "ceiling_unknown": 0.4}
    told = "50 % is the most that is given"
    assert told in str(diagnosis(verdict="ambiguous", ranking=ranking, options=limits))
    assert told not in str(diagnosis(options=limits))


def test_units_in_sentences_have_the_signs_of_the_tables() -> None:
    text = str(diagnosis(next_experiment="Hold 3 N m at 0.5 Ohm, 2 V s, 1 N m/A and 4 kg m^2; no N m alone."))
    assert "Hold 3 N·m at 0.5 Ω, 2 V·s, 1 N·m/A and 4 kg·m²; no N m alone." in text


def test_a_reason_that_speaks_of_one_effect_is_told_of_each() -> None:
    why = "at its typical strength it would add nothing"
    cannot_see = [{"effect": name, "why": why, "power": 0.0} for name in ("iron_loss", "dead_time")]
    assert f"iron_loss and dead_time, each: {why}" in str(diagnosis(cannot_see=cannot_see))


def test_a_parameter_that_is_not_determined_has_no_value_in_the_text() -> None:
    base = {"l_q": estimate(0.01, 310.0, "H"), "r_s": estimate(0.5, 0.01, "ohm")}
    answer = diagnosis(model={**ANSWER["model"], "base": base})
    assert re.search(r"l_q +–\n", str(answer))
    assert "not determined: l_q" in str(answer)
    assert "310" not in str(answer)
    row = next(row for row in motor_rows(answer) if row.name == "l_q")
    assert (row.value, row.spread) == ("–", "")
    assert "not determined" in row.why_none


def test_all_effects_of_a_model_are_among_the_candidates_that_are_shown() -> None:
    def candidate(effect: str) -> dict[str, Any]:
        return {**ANSWER["ranking"][0], "effect": effect}

    named = [
        "coulomb_friction", "dead_time", "saturation_q", "voltage_delay", "iron_loss", "cogging_torque",
        "quadratic_drag", "dc_link_sag", "current_offset",
    ]  # fmt: skip
    ranking = [*map(candidate, named), candidate("stribeck_friction")]
    model = {**ANSWER["model"], "effects": {effect: {} for effect in named}}
    text = str(Diagnosis.from_json(json.dumps({**ANSWER, "ranking": ranking, "model": model})))
    listed = text[text.index("Candidates") : text.index("Parameters")]
    assert all(effect in listed for effect in named)
    assert "stribeck_friction" not in listed


@given(
    st.floats(-1e9, 1e9),
    st.floats(1e-12, 1e6) | st.none(),
    st.sampled_from(["ohm", "H", "V s", "N m", "1", "A"]),
)
def test_any_estimate_can_be_written(value: float, stderr: float | None, unit: str) -> None:
    entry = Estimate.of(estimate(value, stderr, unit))
    shown = words.estimate(entry)
    assert shown.value
    assert "e" not in shown.value.replace("inf", "")
    assert (shown.spread == "") == (stderr is None)
    assert not re.search(r"-0(\.0*)?(?![.\d])", f"{shown} {words.interval(entry)}")


def test_certainty_is_never_claimed() -> None:
    assert words.percent(0.9999) == "> 99 %"
    assert words.percent(0.0001) == "< 1 %"
    assert words.percent(1.0) == "100 %"


def test_names_of_persons_and_abbreviations_keep_their_capital_within_a_sentence() -> None:
    said = [words.lower_first(text) for text in ("Coulomb friction", "DC-link sag", "Iron loss", "")]
    assert said == ["Coulomb friction", "DC-link sag", "iron loss", ""]
