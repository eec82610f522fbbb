"""Answers, summaries and the report: the same answer gives the same bytes, and no markup gets in."""

from __future__ import annotations

import copy
import json
import re
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pmsm_rs as pm
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.axes import Axes
from pmsm_rs import Diagnosis, Identification, plot
from pmsm_rs.answers import read_answer
from pmsm_rs.completion import completed
from pmsm_rs.io.formats.remark import Remark
from pmsm_rs.io.reading import Account
from pmsm_rs.results import traces as reduced
from pmsm_rs.results import words
from pmsm_rs.results.estimates import Estimate
from pmsm_rs.view.tables import motor_rows


def estimate(value: float, stderr: float | None, unit: str) -> dict[str, Any]:
    interval = None if stderr is None else [value - 1.96 * stderr, value + 1.96 * stderr]
    why = "the speed hardly changes" if stderr is None else None
    return {"value": value, "stderr": stderr, "ci95": interval, "unit": unit, "why_none": why}


ANSWER: dict[str, Any] = {
    "schema": "pmsm-rs.diagnosis/2",
    "verdict": "named",
    "data_quality": [
        {"finding": "Time jitters.", "consequence": "High orders blur.", "fix": "Use the drive's clock."}
    ],
    "located": [
        {
            "equation": "q",
            "share": 0.83,
            "sentence": "It sits in the q axis.",
            "where": [{"variable": "i_q", "low": 4.0, "high": 11.0, "unit": "A"}],
            "order_electrical": 6,
            "order_mechanical": None,
            "frequency_hz": None,
            "trend": None,
            "p_value": 1e-9,
        },
    ],
    "ranking": [
        {
            "effect": "dead_time",
            "probability": 0.97,
            "sentence": "The inverter loses v_err.",
            "equation": "v_x = v_x* − v_err·sign(i_x)",
            "parameters": {"v_err": estimate(1.06, 0.01, "V")},
            "equivalent_to": [],
            "gain_held_out": 0.41,
        },
        {
            "effect": "rs_thermal_drift",
            "probability": 0.02,
            "sentence": "The winding warms up.",
            "equation": "r_s(T)",
            "parameters": {},
            "equivalent_to": ["dead_time"],
            "gain_held_out": None,
        },
    ],
    "model": {
        "effects": ["dead_time"],
        "base": {"r_s": estimate(0.77, 0.01, "ohm"), "b": estimate(0.002, None, "N m s")},
    },
    "cannot_see": [{"effect": "saturation_q", "why": "i_q stays small.", "power": 0.12}],
    "next_experiment": "Record steps of i_q.",
    "noise_floor": {"i_d": 0.02, "i_q": 0.02},
    "fit": {
        "recording": {"before": {"i_d": 0.31, "i_q": 0.17}, "after": {"i_d": 0.02, "i_q": 0.02}},
        "validation": {"before": {"i_d": 0.33, "i_q": 0.18}, "after": {"i_d": 0.03, "i_q": 0.02}},
    },
    "recording_kind": "full",
    "interrupted": False,
    "version": "1.2.3",
    "seed": 1,
}


IDENTIFICATION: dict[str, Any] = {
    "parameters": {"r_s": estimate(0.77, 0.01, "ohm")},
    "cost": 0.1,
    "history": [1.0, 0.1],
    "method": "pso",
    "evaluations": 300,
    "converged": False,
    "interrupted": False,
    "rms": {"i_d": 0.02},
    "cannot_show": [{"parameters": ["j", "b"], "why": "the speed hardly changes"}],
    "seed": 1,
    "version": "1.2.3",
}


def traces(n: int = 30_000) -> dict[str, dict[str, np.ndarray]]:
    rng = np.random.default_rng(1)
    t = np.arange(n) * 1e-4
    theta = 200.0 * t
    out = {
        "t": t,
        "op_omega_e": 200.0 + 50.0 * np.sin(t),
        "op_i_q": 3.0 * np.sin(4.0 * t),
        "op_i_d": np.zeros(n),
    }
    out |= {"op_theta_e": theta, "op_theta_m": theta / 3.0}
    for name in ("i_d", "i_q"):
        noise = 0.02 * rng.standard_normal(n)
        out |= {
            f"{name}_measured": np.sin(3.0 * t) + 0.3 * np.cos(6.0 * theta) + noise,
            f"{name}_before": np.sin(3.0 * t),
            f"{name}_after": np.sin(3.0 * t) + 0.3 * np.cos(6.0 * theta),
        }
    return {"recording": out, "validation": out}


def diagnosis(**changes: Any) -> Diagnosis:
    return Diagnosis.from_json(json.dumps({**copy.deepcopy(ANSWER), **changes}), traces())


class Tags(HTMLParser):
    """Open tags that are never closed, and every address a page refers to."""

    VOID = frozenset({"meta", "br", "link", "img", "hr", "input"})

    def __init__(self) -> None:
        super().__init__()
        self.open: list[str] = []
        self.addresses: list[str] = []
        self.problems: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.addresses += [value or "" for name, value in attrs if name in {"src", "href", "xlink:href"}]
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.addresses += [value or "" for name, value in attrs if name in {"src", "href", "xlink:href"}]

    def handle_endtag(self, tag: str) -> None:
        if not self.open or self.open.pop() != tag:
            self.problems.append(tag)


def test_an_answer_survives_json() -> None:
    answer = diagnosis()
    again = Diagnosis.from_json(answer.to_json())
    assert again == answer
    assert json.loads(answer.to_json()) == ANSWER
    assert again.shown is None


def test_the_report_is_one_small_sound_page(tmp_path: Path) -> None:
    diagnosis().report(tmp_path / "r.html", title="Bench <4> & co")
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    assert len(page.encode()) < 1_000_000
    assert "Bench &lt;4&gt; &amp; co" in page
    tags = Tags()
    tags.feed(page)
    assert tags.problems == []
    assert tags.open == []
    assert all(address.startswith(("#", "data:image/png")) for address in tags.addresses), (
        "nothing may be fetched from elsewhere"
    )
    plain = re.sub(r"<(style|script|svg)\b.*?</\1>", "", page, flags=re.DOTALL)
    assert re.findall(r"\bnan\b|\bNone\b", plain) == []


def test_the_report_has_the_same_bytes_every_time(tmp_path: Path) -> None:
    diagnosis().report(tmp_path / "a.html")
    diagnosis().report(tmp_path / "b.html")
    assert (tmp_path / "a.html").read_bytes() == (tmp_path / "b.html").read_bytes()


REMAINING: dict[str, Any] = {
    "equation": "q",
    "beside": ["dead_time"],
    "times_noise": {"recording": 3.1, "validation": 14.8},
    "over": ["i_q"],
    "p_value": 1e-9,
    "sentence": "Beside dead_time the q-axis voltage equation has a residual of 3.1 times the noise in i_q.",
}


def test_what_remains_beside_the_effects_is_told_wherever_the_answer_is_shown(tmp_path: Path) -> None:
    for answer, shown in [(diagnosis(remaining=[REMAINING]), 1), (diagnosis(), 0)]:
        answer.report(tmp_path / "r.html")
        page = (tmp_path / "r.html").read_text(encoding="utf-8")
        for text in [str(answer), page]:
            assert text.count("What remains") == shown
            assert text.count("3.1 times the noise") == shown
        assert len(answer.remaining) == shown
        tags = Tags()
        tags.feed(page)
        assert tags.problems == []


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


def test_a_finding_of_both_runs_is_told_once() -> None:
    def run(*findings: str) -> pm.Recording:
        t = np.arange(20) * 1e-3
        recording = pm.Recording(t=t, omega_m=t, tau_e=t)
        remarks = tuple(Remark(finding, "It is slow.", "Log it again.") for finding in findings)
        recording.account = Account.of_arrays(["t"])
        recording.account = replace(recording.account, remarks=remarks)
        return recording

    data = {"schema": "s", "verdict": "named", "data_quality": []}
    answer = completed(data, [run("It drifts.")], run("It drifts.", "It jumps."))
    assert [item["finding"] for item in answer["data_quality"]] == ["It drifts.", "Validation run: it jumps."]


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


def test_text_of_an_answer_cannot_become_markup(tmp_path: Path) -> None:
    evil = "<script>alert(1)</script>"
    located = [{**ANSWER["located"][0], "sentence": evil, "trend": evil}]
    ranking = [{**ANSWER["ranking"][0], "sentence": evil, "equation": evil, "equivalent_to": [evil]}]
    quality = [{"finding": evil, "consequence": evil, "fix": evil}]
    answer = diagnosis(
        located=located,
        remaining=[{**REMAINING, "sentence": evil}],
        ranking=ranking,
        data_quality=quality,
        next_experiment=evil,
    )
    answer.report(tmp_path / "r.html", title=evil)
    page = (tmp_path / "r.html").read_text()
    assert "<script>alert" not in page
    assert page.count("<script") == 2, "the data and the script of the page itself"
    assert "<script" not in answer._repr_html_()


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({}, "leaves out"),
        (
            {"verdict": "no_mismatch", "located": [], "ranking": [], "model": {"effects": [], "base": {}}},
            "Nothing is missing",
        ),
        (
            {
                "verdict": "ambiguous",
                "ranking": [{**ANSWER["ranking"][0], "equivalent_to": ["rs_thermal_drift"]}],
                "model": {"effects": [], "base": {}},
            },
            "cannot tell which",
        ),
        (
            {
                "verdict": "ambiguous",
                "ranking": [
                    {**ANSWER["ranking"][0], "effect": "dead_time"},
                    {
                        **ANSWER["ranking"][0],
                        "effect": "saturation_d",
                        "equivalent_to": ["cross_saturation"],
                    },
                ],
                "model": {"effects": ["dead_time", "saturation_d"], "base": {}},
            },
            "leaves out inverter dead time, and saturation of the d axis or cross-saturation; this",
        ),
        (
            {"verdict": "ambiguous", "ranking": [{**ANSWER["ranking"][0], "probability": 0.9}]},
            "probably leaves out",
        ),
        (
            {"verdict": "ambiguous", "ranking": [{**ANSWER["ranking"][0], "probability": 0.5}]},
            "may leave out",
        ),
        ({"verdict": "unknown", "ranking": [], "model": {"effects": [], "base": {}}}, "not in the catalogue"),
        ({"verdict": "partial"}, "and something that is not in the catalogue"),
        (
            {
                "verdict": "undetermined",
                "located": [],
                "ranking": [],
                "model": {"effects": [], "base": {}},
                "noise_floor": {},
                "fit": {"recording": {"before": {}, "after": {}}, "validation": {"before": {}, "after": {}}},
            },
            "This recording is too poor",
        ),
        (
            {"verdict": "undetermined", "ranking": [], "model": {"effects": [], "base": {}}},
            "has a residual of more than the noise, but",
        ),
        ({"interrupted": True}, "leaves out"),
        ({"next_experiment": None, "data_quality": [], "cannot_see": []}, "leaves out"),
        (
            {"fit": {"recording": ANSWER["fit"]["recording"], "validation": {"before": {}, "after": {}}}},
            "leaves out",
        ),
        ({"noise_floor": {}}, "leaves out"),
    ],
)
def test_every_verdict_has_a_report_and_a_summary(changes: dict[str, Any], said: str, tmp_path: Path) -> None:
    for traces_of in (traces(), {}):
        answer = Diagnosis.from_json(json.dumps({**ANSWER, **changes}), traces_of)
        answer.report(tmp_path / "r.html")
        assert said in (tmp_path / "r.html").read_text(encoding="utf-8")
        assert said in str(answer)


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


def test_operating_points_have_a_report(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    n = 60
    trace = {"t": np.arange(n) * 2.5, "op_omega_e": rng.uniform(0, 900, n), "op_i_q": rng.uniform(-9, 9, n)}
    for name in ("v_d", "v_q"):
        trace |= {f"{name}_{part}": rng.standard_normal(n) for part in ("measured", "before", "after")}
    answer = Diagnosis.from_json(
        json.dumps({**ANSWER, "noise_floor": {"v_d": 0.1, "v_q": 0.1}, "recording_kind": "operating_points"}),
        {"recording": trace, "validation": {}},
    )
    answer.report(tmp_path / "r.html")
    assert "operating points recording" in (tmp_path / "r.html").read_text(encoding="utf-8")


def test_trajectories_hold_what_was_judged(tmp_path: Path) -> None:
    import pyarrow.parquet

    diagnosis().trajectories(tmp_path / "t.parquet")
    table = pyarrow.parquet.read_table(tmp_path / "t.parquet")
    assert table.column_names == [
        "t",
        *(f"i_{x}_{part}" for x in "dq" for part in ("measured", "before", "after")),
    ]
    np.testing.assert_array_equal(table["i_d_measured"].to_numpy(), traces()["validation"]["i_d_measured"])
    with pytest.raises(pm.UsageError):
        Diagnosis.from_json(json.dumps(ANSWER)).trajectories(tmp_path / "u.parquet")


def test_a_figure_of_its_own() -> None:
    figure = diagnosis().plot()
    assert len(figure.axes) == 4
    assert figure._repr_png_().startswith(b"\x89PNG")  # type: ignore[attr-defined]
    with pytest.raises(pm.UsageError, match="without its traces"):
        Diagnosis.from_json(json.dumps(ANSWER)).plot()


PLOTS: list[Callable[..., Axes]] = [
    partial(plot.residual_over_time, name="i_d"),
    partial(plot.trajectory, name="i_d"),
    partial(plot.residual_over, name="i_d", variable="op_i_q"),
    partial(plot.residual_map, name="i_d"),
    partial(plot.order_spectrum, name="i_d"),
]


@pytest.mark.parametrize("draw", PLOTS, ids=lambda draw: draw.func.__name__)
def test_plots_draw_on_the_axes_they_are_given_and_on_their_own(draw: Callable[..., Axes]) -> None:
    from matplotlib import pyplot

    figure, ax = pyplot.subplots()
    assert draw(diagnosis(), ax=ax) is ax
    assert ax.get_xlabel()
    ax.set_title("restyled")
    pyplot.close(figure)
    own = draw(traces()["recording"])
    assert own.get_ylabel()
    pyplot.close(own.figure)
    with pytest.raises(pm.UsageError, match="did you mean 'i_d'"):
        draw(diagnosis(), name="id")


def test_plots_over_what_was_not_logged_say_so() -> None:
    with pytest.raises(pm.UsageError, match="no column 'i_q'; did you mean 'op_i_q'"):
        plot.residual_over(diagnosis(), "i_d", "i_q")
    with pytest.raises(pm.UsageError, match="no column 'op_w'"):
        plot.residual_map(diagnosis(), "i_d", x="op_w")
    with pytest.raises(pm.UsageError, match="no column 'op_theta_x'"):
        plot.order_spectrum(diagnosis(), "i_d", angle="op_theta_x")


def test_the_history_of_a_swarm() -> None:
    from matplotlib import pyplot

    ax = plot.history(Identification.from_json(json.dumps(IDENTIFICATION)))
    np.testing.assert_array_equal(ax.lines[0].get_ydata(), IDENTIFICATION["history"])
    pyplot.close(ax.figure)


def test_answers_in_a_notebook() -> None:
    card = diagnosis()._repr_html_()
    assert "The model leaves out inverter dead time." in card
    assert card.count('role="img"') == 1
    assert len(card) < 100_000
    assert "<svg" not in Diagnosis.from_json(json.dumps(ANSWER))._repr_html_()
    fit = Identification.from_json(json.dumps(IDENTIFICATION))._repr_html_()
    assert "Not converged" in fit
    assert "the speed hardly changes" in fit
    for html in (card, fit):
        tags = Tags()
        tags.feed(html)
        assert (tags.problems, tags.open) == ([], [])


def test_a_report_for_a_notebook_is_the_one_that_is_written(tmp_path: Path) -> None:
    page = diagnosis().report()
    diagnosis().report(tmp_path / "a.html")
    page.save(tmp_path / "b.html")
    assert (tmp_path / "a.html").read_text(encoding="utf-8") == str(page)
    assert (tmp_path / "a.html").read_bytes() == (tmp_path / "b.html").read_bytes()
    assert page._repr_html_().startswith("<iframe srcdoc=")
    assert "<" not in page._repr_html_()[20 : page._repr_html_().index('" title')]


def test_the_order_spectrum_finds_the_order_that_was_put_in() -> None:
    trace = traces()["recording"]
    for angle, order in (("op_theta_e", 6), ("op_theta_m", 18)):
        orders = np.arange(1, 25)
        found = reduced.amplitudes(trace[angle], reduced.residual(trace, "i_d", "before"), orders)
        assert orders[np.argmax(found)] == order
        assert found.max() == pytest.approx(0.3, rel=0.02)


@given(st.integers(1, 5000), st.integers(1, 300), st.integers(0, 2**31))
def test_thinning_loses_no_peak(n: int, bins: int, seed: int) -> None:
    y = np.random.default_rng(seed).standard_normal(n)
    x, thin = reduced.envelope(np.arange(n, dtype=float), y, bins)
    assert len(thin) <= max(2 * bins, n if n <= 2 * bins else 0)
    assert (thin.min(), thin.max()) == (y.min(), y.max())
    assert np.all(np.diff(x) > 0)


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


def test_an_identification_is_read_back() -> None:
    data = IDENTIFICATION
    answer = Identification.from_json(json.dumps(data))
    assert answer.parameters["r_s"].ci95 is not None
    assert answer.history == (1.0, 0.1)
    assert json.loads(answer.to_json()) == data
    assert "not converged" in str(answer)
    assert "j and b: the speed hardly changes" in str(answer)


def test_names_of_persons_and_abbreviations_keep_their_capital_within_a_sentence() -> None:
    said = [words.lower_first(text) for text in ("Coulomb friction", "DC-link sag", "Iron loss", "")]
    assert said == ["Coulomb friction", "DC-link sag", "iron loss", ""]


@pytest.mark.parametrize("content", [b"\xff\xfe{}", b"no JSON", b"[" * 100_000])
def test_a_file_that_is_no_answer_is_refused(content: bytes, tmp_path: Path) -> None:
    file = tmp_path / "answer.json"
    file.write_bytes(content)
    with pytest.raises(pm.UsageError, match="this is no JSON answer"):
        read_answer(file)
