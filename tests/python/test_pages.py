"""Reports and cards of a notebook: sound pages for every verdict, the same every time, nothing fetched."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from answers import ANSWER, IDENTIFICATION, REMAINING, Tags, diagnosis, traces
from pmsm_rs import Diagnosis, Identification


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
        (
            {
                "verdict": "unknown",
                "ranking": [],
                "model": {"effects": [], "base": {}},
                "cannot_see": [
                    {"effect": "dead_time", "power": 0.0, "why": "the rotor angle was not recorded"},
                    {"effect": "iron_loss", "power": 0.0, "why": "the rotor does not turn"},
                    {"effect": "cogging_torque", "power": 0.0, "why": "the rotor angle was not recorded"},
                ],
            },
            "equation: inverter dead time, which was not asked as the",
        ),
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
