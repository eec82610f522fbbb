"""The report: one page that says what was found, what was read and what to do; safe, and always the same."""

from __future__ import annotations

import base64
import hashlib
import html
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pmsm_rs as pm
import pytest
from answers import ANSWER, REMAINING, Tags, diagnosis, estimate
from pmsm_rs.config.machine_file import read_machine
from pmsm_rs.plot import palette
from pmsm_rs.results import traces
from pmsm_rs.support.demo import recording_files
from pmsm_rs.view import plot_data
from pmsm_rs.view.advice import next_step
from pmsm_rs.view.charts import Axis, Panel
from pmsm_rs.view.corrected import machine_file
from pmsm_rs.view.tables import motor_rows

MACHINE: dict[str, Any] = {
    "n_p": 3,
    "r_s": 0.7,
    "l_d": 0.002,
    "b": 0.0021,
    "v_dc": 300.0,
    "i_rated": 12.0,
    "load": "known_constant",
    "load_value": 1.5,
}
READ: dict[str, Any] = {
    "file": "/bench/Prüfstand <4>/run.csv",
    "modified": "2026-03-04T05:06:07Z",
    "columns": {
        "t": {"from": "t", "unit": "s", "scale": 1.0, "period": 1e-4},
        "i_d": {"from": 'Id "raw"', "unit": "A", "scale": 0.01, "offset": 3.0},
        "omega_e": {"from": "omega_e", "unit": "rad/s", "scale": 1.0},
    },
    "ignored": ["status"],
    "rows": 30_000,
    "period": 1e-4,
    "questions": {"electrical": True, "mechanical": True, "why_not": None},
    "not_used": [],
    "done": [],
}


def full(**changes: Any) -> pm.Diagnosis:
    return diagnosis(**({"machine": MACHINE, "read": READ, "validation": READ} | changes))


@pytest.fixture(scope="module")
def page() -> str:
    return str(full().report(title="Bench 4", command="pmsm-rs diagnose 'a b.csv' --seed 3"))


def words_of(page: str) -> str:
    """What a reader sees as text."""
    body = re.sub(r"<(style|script)\b.*?</\1>", "", page, flags=re.DOTALL)
    return " ".join(html.unescape(re.sub(r"<[^>]+>", " ", body)).split())


def test_the_first_screen_holds_verdict_picture_effects_and_what_to_do(page: str) -> None:
    hero = page[page.index('class="hero"') : page.index("<section")]
    said = words_of(hero)
    assert "The model leaves out inverter dead time." in said
    assert "97 %" in said
    assert "v err = 1.060 ± 0.010 V" in said
    assert "What to do next" in said
    assert "Record steps of i q ." in said
    assert hero.count('role="img"') == 2
    assert "linear scale" in hero or "logarithmic scale" in hero
    assert ">noise</text>" in hero


def test_found_values_stand_beside_the_nameplate_with_interval_and_difference() -> None:
    base = {"r_s": estimate(0.77, 0.01, "ohm"), "l_d": estimate(0.0031, 2e-6, "H")}
    answer = full(model={"effects": ["dead_time"], "base": base})
    r_s, l_d = motor_rows(answer)
    assert (r_s.nameplate, r_s.text, r_s.difference) == ("0.7000", "0.770 ± 0.010 Ω", "+10.0 %")
    assert (l_d.nameplate, l_d.unit, l_d.difference) == ("2.000", "mH", "+55.0 %")
    assert (r_s.is_far, l_d.is_far) == (False, True)
    said = words_of(str(answer.report()))
    assert "0.750 … 0.790" in said


def test_no_difference_is_minus_nothing() -> None:
    answer = full(model={"effects": [], "base": {"r_s": estimate(0.69999, 0.01, "ohm")}})
    assert motor_rows(answer)[0].difference == "0.0 %"


def test_the_page_says_what_was_read(page: str) -> None:
    said = words_of(page[page.index('id="read"') :])
    for told in (
        "/bench/Prüfstand <4>/run.csv",
        "2026-03-04 05:06:07 UTC",
        "30000 rows, one every 0.1 ms",
        "10000 Hz",
        'Id "raw"',
        "0.01, plus 3",
        "Ignored columns status",
        "Validation run",
        "pmsm-rs diagnose 'a b.csv' --seed 3",
    ):
        assert told in said, told


def test_nothing_is_told_of_what_an_answer_does_not_hold() -> None:
    said = words_of(str(diagnosis().report()))
    for absent in ("Nameplate", "machine file", "Command", "Correlation of", "Date of the file"):
        assert absent not in said


def test_the_correlation_of_parameters_is_shown_where_the_answer_has_it() -> None:
    entry = {"names": ["r_s", "l_d"], "matrix": [[4.0, -0.84], [-0.84, 1.0]]}
    said = words_of(str(full(model=ANSWER["model"] | {"covariance": entry}).report()))
    assert "Correlation of the estimates" in said
    assert "-.42" in said


def test_only_the_page_s_own_style_and_script_may_run(page: str) -> None:
    policy = re.search(r'Content-Security-Policy" content="([^"]+)"', page)
    assert policy is not None
    rules = html.unescape(policy[1])
    assert rules.startswith("default-src 'none'; ")
    assert "unsafe" not in rules
    for element, rule in (("style", "style-src"), ("script", "script-src")):
        [text] = re.findall(rf"<{element}>(.*?)</{element}>", page, flags=re.DOTALL)
        digest = base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
        assert f"{rule} 'sha256-{digest}'" in rules
    markup = re.sub(r"<(style|script)\b.*?</\1>", "", page, flags=re.DOTALL)
    assert re.findall(r"""<[^>]*\s(style|on\w+)\s*=""", markup) == [], "the policy would block it"
    assert re.findall(r"https?://(?!www\.w3\.org/)", page) == []


def test_names_out_of_a_file_are_escaped_wherever_they_stand() -> None:
    evil = "</script><img src=x onerror=alert(1)>"
    columns = {"i_d": {"from": evil, "unit": "A", "scale": 1.0}}
    read = READ | {"file": evil, "ignored": [evil], "columns": columns}
    answer = full(read=read, validation=read, recording_kind=evil, version=evil)
    page = str(answer.report(title=evil, command=evil))
    assert "<img" not in page
    assert page.count("</script>") == 2
    tags = Tags()
    tags.feed(page)
    assert (tags.problems, tags.open) == ([], [])


def test_the_same_answer_gives_the_same_bytes_and_a_small_page(page: str) -> None:
    again = str(full().report(title="Bench 4", command="pmsm-rs diagnose 'a b.csv' --seed 3"))
    assert page == again
    assert len(page.encode()) < 1_500_000
    assert re.findall(r"-0(?:\.0*)?(?![.\d])", words_of(page)) == []


def test_a_place_that_repeats_another_is_told_once() -> None:
    first = {**ANSWER["located"][0], "sentence": "The sensor is off. It sits in the q axis.", "share": 1.0}
    answer = full(located=[first, ANSWER["located"][0]])
    for text in (words_of(str(answer.report())), " ".join(str(answer).split())):
        assert text.count("It sits in the q axis.") == 1


def test_no_place_is_told_where_nothing_is_missing() -> None:
    model = {**ANSWER["model"], "effects": []}
    clean = full(verdict="no_mismatch", remaining=[], model=model)
    for text in (words_of(str(clean.report())), str(clean), clean._repr_html_()):
        assert "Where it sits" not in text
        assert clean.located[0].sentence not in text
    beside = full(verdict="no_mismatch", remaining=[REMAINING], model=model)
    assert "Where it sits" in str(beside)


def test_the_answer_names_its_files_and_machine(tmp_path: Path) -> None:
    recording, _, machine = recording_files()
    run = pm.load(recording, machine)
    short = pm.Recording({name: run.column(name)[:2000] for name in run.names})
    short.file = recording
    answer = pm.diagnose(short, machine)
    [read] = answer.read
    assert read["file"] == recording
    assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ", read["modified"])
    stated = read_machine(machine).machine
    assert answer.data["machine"]["psi_m"] == stated.psi_m
    assert answer.data["machine"]["load"] == "unknown_constant"
    (tmp_path / "new.toml").write_text(machine_file(answer) or "", encoding="utf-8")
    corrected = read_machine(tmp_path / "new.toml")
    assert corrected.machine.n_p == stated.n_p
    found = answer.base["psi_m"].value
    assert found is not None
    assert corrected.machine.psi_m == pytest.approx(found, rel=1e-3)
    assert corrected.machine.psi_m != stated.psi_m


def test_the_corrected_machine_file_is_one_that_is_read(tmp_path: Path) -> None:
    text = machine_file(full())
    assert text is not None
    (tmp_path / "m.toml").write_text(text, encoding="utf-8")
    read = read_machine(tmp_path / "m.toml")
    assert read.machine.r_s == 0.770
    assert read.machine.l_d == 0.002, "what was not found keeps the nameplate's value"
    assert (read.load, read.load_value) == ("known_constant", 1.5)
    rule = read.columns["i_d"]
    assert rule is not None
    assert (rule.source, rule.unit, rule.scale, rule.offset) == ('Id "raw"', "A", 0.01, 3.0)
    assert read.columns["t"].period == 1e-4  # type: ignore[union-attr]
    assert "omega_e" not in read.columns, "a canonical column needs no line"


@pytest.mark.parametrize("value", [-0.001, 0.0])
def test_what_no_motor_has_is_not_put_into_a_machine_file(value: float, tmp_path: Path) -> None:
    base = {"r_s": estimate(value, 0.01, "ohm"), "j": estimate(value, 0.01, "kg m^2")}
    text = machine_file(full(model={"effects": [], "base": base}))
    assert text is not None
    (tmp_path / "m.toml").write_text(text, encoding="utf-8")
    machine = read_machine(tmp_path / "m.toml").machine
    assert (machine.r_s, machine.j) == (0.7, None)
    assert "which no motor has" in text


@pytest.mark.parametrize(
    "verdict", ["no_mismatch", "named", "partial", "ambiguous", "unknown", "undetermined"]
)
@pytest.mark.parametrize("machine", [MACHINE, None])
def test_every_verdict_says_what_to_do_next(verdict: str, machine: dict[str, Any] | None) -> None:
    changes = {"machine": machine} if machine else {}
    step = next_step(diagnosis(verdict=verdict, next_experiment=None, data_quality=[], **changes))
    assert step.endswith(".")
    assert ("machine file" in step) == (machine is not None and verdict in {"no_mismatch", "named"})


@pytest.mark.parametrize("colours", [palette.LIGHT, palette.DARK], ids=["light", "dark"])
def test_the_palette_has_the_contrast_of_wcag_aa(colours: dict[str, str]) -> None:
    assert palette.contrast("#000000", "#ffffff") == pytest.approx(21.0)
    for ground in ("paper", "wash"):
        for role in palette.TEXT:
            assert palette.contrast(colours[role], colours[ground]) >= 4.5, (role, ground)
        for role in ("measured", "before", "after", "noise"):
            assert palette.contrast(colours[role], colours[ground]) >= 3.0, (role, ground)


def test_words_on_the_parts_of_a_bar_can_be_read() -> None:
    for fill in (*palette.PARTS, palette.SHARED, palette.UNNAMED, palette.REST, *palette.DIVERGING):
        assert palette.contrast(palette.ink_on(fill), fill) >= 4.5, fill


@pytest.mark.parametrize(
    ("low", "high", "texts", "label"),
    [
        (0.0, 1.0, ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"], "i_d in A"),
        (-3.0, 3.0, ["-3", "-2", "-1", "0", "1", "2", "3"], "i_d in A"),
        (0.0, 4e-5, ["0", "10", "20", "30", "40"], "i_d in 10⁻⁶ A"),
        (0.0, 2e6, ["0.0", "0.5", "1.0", "1.5", "2.0"], "i_d in 10⁶ A"),
        (5.0, 5.0, ["4.6", "4.8", "5.0", "5.2", "5.4"], "i_d in A"),
    ],
)
def test_axes_have_round_ticks(low: float, high: float, texts: list[str], label: str) -> None:
    axis = Axis.over(low, high, "i_d", "A")
    assert [text for text in axis.texts] == texts
    assert axis.label == label


def test_a_chart_breaks_its_line_where_a_value_is_missing() -> None:
    panel = Panel(Axis.over(0.0, 3.0, "t", "s"), Axis.over(0.0, 1.0, "i_d", "A"), "a chart of <i_d>")
    panel.line(np.arange(4.0), np.array([0.0, np.nan, 1.0, 1.0]), "before")
    svg = panel.svg()
    [line] = re.findall(r'class="before" d="([^"]+)"', svg)
    assert line.count("M") == 2
    assert "<title>a chart of &lt;i_d&gt;</title>" in svg
    assert "nan" not in svg


def unpacked(signal: dict[str, Any]) -> np.ndarray[Any, Any]:
    whole = np.frombuffer(base64.b64decode(signal["data"]), dtype="<i2").astype(float)
    return np.where(whole == -32768, np.nan, signal["middle"] + whole * signal["step"])


@pytest.mark.parametrize("rows", [1, 999, 8192, 8193, 30_001])
def test_the_data_of_the_time_plots_lose_no_peak(rows: int) -> None:
    answer = full()
    trace = {name: values[:rows].copy() for name, values in answer.traces["recording"].items()}
    trace["i_d_before"][rows // 2] = 17.0
    short = pm.Diagnosis.from_json(answer.to_json(), {"recording": trace})
    packed = plot_data.packed(short)
    assert packed is not None
    signals = packed["channels"]["i_d"]["signals"]
    found = unpacked(signals["before"])
    assert len(found) <= plot_data.POINTS + 2
    assert np.nanmax(found) == pytest.approx(17.0, abs=1e-3)
    assert np.nanmin(found) == pytest.approx(trace["i_d_before"].min(), abs=1e-3)
    assert len(np.frombuffer(base64.b64decode(packed["t"]), dtype="<f4")) == len(found)
    json.dumps(packed, allow_nan=False)


def test_runs_of_rows_keep_their_ends_in_the_order_in_which_they_come() -> None:
    values = np.array([1.0, 5.0, 2.0, 9.0, np.nan, 3.0, np.nan, np.nan, np.nan, 4.0])
    np.testing.assert_array_equal(plot_data.ends(values, 3), [1.0, 5.0, 9.0, 3.0, np.nan, np.nan, 4.0, 4.0])


def test_recordings_that_lie_end_to_end_follow_one_another_in_time() -> None:
    t = traces.elapsed({"t": np.array([0.0, 0.1, 0.2, 0.0, 0.1])})
    np.testing.assert_allclose(t, [0.0, 0.1, 0.2, 0.3, 0.4])


def test_the_autocorrelation_is_that_of_the_textbook() -> None:
    rng = np.random.default_rng(4)
    white = rng.standard_normal(20_000)
    coloured = np.convolve(white, [1.0, 0.5])[:20_000]
    assert np.abs(traces.autocorrelation(white, 5)[1:]).max() < 4 / np.sqrt(20_000)
    np.testing.assert_allclose(traces.autocorrelation(coloured, 2), [1.0, 0.4, 0.0], atol=0.03)
    # From the spectrum as from the sums, with lags up to the last sample.
    short = white[:7] - white[:7].mean()
    sums = [short[: 7 - lag] @ short[lag:] / (short @ short) for lag in range(7)]
    np.testing.assert_allclose(traces.autocorrelation(white[:7], 6), sums, atol=1e-12)
    white[::7] = np.nan
    assert np.isfinite(traces.autocorrelation(white, 5)).all()
    assert not traces.autocorrelation(np.full(9, np.nan), 3).any()


def test_a_value_that_is_too_uncertain_is_not_put_into_a_machine_file(tmp_path: Path) -> None:
    base = {"r_s": estimate(0.77, 0.5, "ohm"), "j": estimate(0.02, 0.015, "kg m^2")}
    text = machine_file(full(model={"effects": [], "base": base}))
    assert text is not None
    (tmp_path / "m.toml").write_text(text, encoding="utf-8")
    machine = read_machine(tmp_path / "m.toml").machine
    assert (machine.r_s, machine.j) == (0.7, None)
    assert "too uncertain" in text


def test_effects_that_cannot_be_seen_for_one_reason_stand_together() -> None:
    why = "the recording has no voltages"
    blind = [{"effect": name, "why": why, "power": 0.0} for name in ("dead_time", "saturation_q")]
    said = words_of(str(full(cannot_see=blind).report()))
    assert "Inverter dead time and saturation of the q axis The recording has no voltages." in said
    alike = full(cannot_see=blind, verdict="undetermined", reason=f"{why} at all")
    assert words_of(str(alike.report())).count(why) == 1


def test_names_of_effects_in_sentences_become_their_titles() -> None:
    blind = [{"effect": "gravity_torque", "why": "it is a load_torque_pulsation here", "power": None}]
    page = str(full(cannot_see=blind).report())
    assert "It is a load torque pulsation here." in words_of(page)
