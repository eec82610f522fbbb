"""Mistakes of a log: each does to the columns what it says, and answers are counted as the manual says."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("numba")
pytest.importorskip("pyarrow")
pytest.importorskip("scipy")

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from proof import answers, mistakes  # noqa: E402
from proof.case import write_columns  # noqa: E402
from proof.limits import in_axes  # noqa: E402
from proof.mistake_kinds import Log, made  # noqa: E402
from proof.mistake_kinds import mistakes as all_mistakes  # noqa: E402
from proof.mistake_score import SOUND, Result, headline, markdown, outcome, wilson  # noqa: E402
from proof.plan import together  # noqa: E402

KINDS = all_mistakes(4, 540.0)
STEP = 1e-4
# what differs between two mistakes of one kind
VARIES = r"\b[iv]_[a-dq]\b|\d+°|√?[0-9.]+|\bone row\b|rows|currents of|[abc], [abc], [abc]|large|small"


@pytest.fixture(scope="module")
def log() -> Log:
    """A turning rotor with currents and voltages that differ in every column, 200 rows."""
    t = STEP * np.arange(200)
    theta = 300.0 * t - 2.0 * np.pi * np.rint(300.0 * t / (2.0 * np.pi))
    phases = {f"i_{p}": 4.0 * np.cos(theta - k * 2.0 * np.pi / 3.0 + 0.7) for k, p in enumerate("abc")}
    voltages = {"v_d": -20.0 + np.sin(90.0 * t), "v_q": 60.0 + np.cos(50.0 * t)}
    return {"t": t, **voltages, **phases, "theta_e": theta, "omega_e": 300.0 + np.sin(40.0 * t)}


def undone(wrong: Log, name: str) -> Log:
    """The true columns of a log, but for those that it lacks and rows that it does not hold."""
    mistake = KINDS[name]
    true = dict(wrong)
    for column, (source, factor) in mistake.columns.items():
        true[source] = wrong[column] / factor
    if mistake.turned or mistake.ahead:
        true["theta_e"] = wrong["theta_e"] - mistake.turned - mistake.ahead * STEP * true["omega_e"]
    if mistake.rows:
        last = len(wrong["t"]) - mistake.rows
        true = {k: x[mistake.rows :] if k in mistake.late else x[:last] for k, x in true.items()}
    return true


@pytest.mark.parametrize("name", KINDS)
def test_a_mistake_changes_the_log_and_is_undone(name: str, log: Log) -> None:
    mistake = KINDS[name]
    true = in_axes(log) if mistake.axes else log
    wrong = made(log, mistake)
    changed = {k for k in wrong if len(wrong[k]) < len(log["t"]) or not np.array_equal(wrong[k], true[k])}
    expected = set(mistake.columns) | ({"theta_e"} if mistake.turned or mistake.ahead else set())
    expected = set(true) if mistake.rows else expected
    assert changed == expected - set(mistake.without)
    assert bool(changed) != (mistake.poles > 1)
    assert set(true) - set(wrong) == set(mistake.without)
    back = undone(wrong, name)
    rows = slice(mistake.rows, len(log["t"]) - mistake.rows)
    for column in back:
        off = back[column] - true[column][rows if mistake.rows else slice(None)]
        if column == "theta_e":
            off = off - 2.0 * np.pi * np.rint(off / (2.0 * np.pi))
        assert np.abs(off).max() < 1e-9, column


def test_some_mistakes_by_hand(log: Log) -> None:
    assert np.array_equal(made(log, KINDS["phases-c-a-b"])["i_a"], log["i_c"])
    assert np.array_equal(made(log, KINDS["v-1-row-late"])["v_q"], log["v_q"][:-1])
    assert np.array_equal(made(log, KINDS["v-1-row-late"])["i_a"], log["i_a"][1:])
    rpm = made(log, KINDS["speed-in-rpm"])["omega_e"]
    assert rpm[0] == pytest.approx(300.0 * 60.0 / (2.0 * np.pi))
    assert made(log, KINDS["v-as-modulation-index"])["v_q"][0] == pytest.approx(61.0 / 270.0)


@pytest.mark.parametrize("name", [k for k in KINDS if KINDS[k].words])
def test_the_words_are_those_of_the_tool(name: str) -> None:
    source = (ROOT / "crates/pmsm-core/src/diagnose/wiring/mistakes.rs").read_text(encoding="utf-8")
    for words in KINDS[name].words:
        pieces = re.split(VARIES, words)
        assert all(piece.strip() in source for piece in pieces), pieces


def said(*findings: tuple[str, str, str], **more: Any) -> dict[str, Any]:
    """An answer with these findings: code, finding, fix."""
    quality = [{"code": c, "finding": f, "consequence": "", "fix": x} for c, f, x in findings]
    return {"verdict": "undetermined", "data_quality": quality, "model": {"effects": []}, **more}


def reads(words: str) -> tuple[str, str, str]:
    return ("PR201", f"the log reads as if {words}: with that undone the dq-model has less", "check wiring")


MISFIT = ("PR207", "the best dq-model has a residual of 2 A in i_d", "check units")
NO_LOAD = ("PR223", "the voltages act as if they were held, the log holding its mean", "nothing is wrong")


def test_a_mistake_is_found_where_the_leading_finding_tells_it() -> None:
    mistake = KINDS["minus-v_q"]
    right, wrong = reads("v_q had the opposite sign"), reads("v_d had the opposite sign")
    assert outcome(said(right), "", mistake, ()) == "found"
    assert outcome(said(reads("i_q and v_q had the opposite sign")), "", mistake, ()) == "otherwise"
    assert outcome(said(MISFIT, right), "", mistake, ()) == "below"
    assert outcome(said(NO_LOAD, right, reason=right[1] + "; x"), "", mistake, ()) == "found"
    assert outcome(said(MISFIT, wrong), "", mistake, ()) == "otherwise"
    assert outcome(said(MISFIT), "", mistake, ()) == "not told"
    assert outcome(None, "pmsm-rs: killed", mistake, ()) == "no answer"
    both = reads("v_d had the opposite sign, or v_q had the opposite sign")
    assert outcome(said(both), "", mistake, ()) == "found"


def test_equivalents_count() -> None:
    assert outcome(said(reads("all currents had the opposite sign")), "", KINDS["minus-v"], ()) == "found"
    refusal = (
        "pmsm-rs: run.parquet, column 'i_b': seen from the rotor the phase currents turn back twice as fast"
    )
    assert outcome(None, f"{refusal} as it turns [PR115]", KINDS["swapped-i_a-i_b"], ()) == "found"
    assert outcome(None, f"{refusal} as it turns [PR115]", KINDS["minus-i"], ()) == "otherwise"
    scale = "check the scale of the voltages, or speed and time: the factor may be √3, as line-to-line"
    far = ("PR204", "this comes out far from the nameplate: j at 1.7 times its value there", scale)
    assert outcome(said(far), "", KINDS["v-times-root-3"], ()) == "found"
    assert outcome(said(far), "", KINDS["v-times-root-1.5"], ()) == "otherwise"


def test_an_effect_is_an_equivalent_where_the_machine_does_not_have_it() -> None:
    answer = said(verdict="named", model={"effects": ["encoder_angle_offset"]})
    assert outcome(answer, "", KINDS["angle+30"], ["dead_time"]) == "found"
    assert outcome(answer, "", KINDS["angle+30"], ["encoder_angle_offset"]) == "not told"
    assert outcome(answer | {"verdict": "unknown"}, "", KINDS["angle+30"], ()) == "not told"


def test_any_mistake_is_a_false_one_in_a_sound_log() -> None:
    assert outcome(said(MISFIT, reads("v_q had the opposite sign")), "", None, ()) == "otherwise"
    assert outcome(None, "pmsm-rs: theta_e turns against omega_e [PR111]", None, ()) == "otherwise"
    assert outcome(said(NO_LOAD), "", None, ()) == "not told"


def test_a_line_tells_the_verdict_and_all_mistakes_and_no_folder() -> None:
    answer = said(MISFIT, NO_LOAD, reads("v_q had the opposite sign"))
    assert headline(answer, "") == " | ".join(
        ["undetermined", MISFIT[1], answer["data_quality"][2]["finding"]]
    )
    assert (
        headline(None, "pmsm-rs: /a/b/run.parquet, column 'i_b': it")
        == "pmsm-rs: run.parquet, column 'i_b': it"
    )


def test_shares_have_the_interval_of_wilson() -> None:
    assert wilson(0, 0) == (0.0, 1.0)
    assert wilson(0, 200) == pytest.approx((0.0, 0.01885), abs=1e-4)
    assert wilson(19, 20) == pytest.approx((0.7639, 0.9911), abs=1e-4)


def test_the_table_counts() -> None:
    rows = [
        Result("healthy", "v000", "minus-v", "found", "", 2.0),
        Result("bench", "v002", "minus-v", "below", "what leads", 4.0),
        Result("bench", "v005", "minus-v", "no answer", "ended", 6.0),
        Result("bench", "v002", SOUND, "otherwise", "a false word", 1.0),
    ]
    table = markdown(rows, ("healthy", "bench"), KINDS, {"seed": 7})
    assert "| `minus-v` | 1 / 0 / 0 / 0 | 0 / 1 / 0 / 1 |" in table
    assert "| mistakes found | 1 of 1 (100.0 %), 95 % interval 20.7 to 100.0 % | 0 of 2 (0.0 %)" in table
    assert "1 of 3 (33.3 %)" in table
    assert "- bench v002, `minus-v`, below: what leads" in table
    assert "- bench v002, `sound`, otherwise: a false word" in table
    assert "minus-i`" not in table


def test_a_plan_of_more_machines_begins_with_the_same_ones() -> None:
    few, many = mistakes.planned(2, 5, "scoring"), mistakes.planned(9, 5, "scoring")
    assert many[: len(few)] == few
    assert [p.family for p in few] == [*mistakes.LOGS] * 2
    for bench in many[2::3]:
        assert 3 <= len(bench.effects) <= 7
        assert together(bench.effects)
    assert {p.load for p in many} == set(mistakes.LOADS)


TOOL = """#!{python}
import json, pathlib, sys
told = sys.argv[1:]
pathlib.Path({log!r}).open("a").write(pathlib.Path(told[told.index("--machine") + 1]).read_text())
pathlib.Path(told[told.index("--json") + 1]).write_text(json.dumps(dict(verdict="named")))
"""


def test_the_tool_is_asked_once_and_is_given_the_log_with_the_mistake(
    tmp_path: Path, log: Log, monkeypatch: pytest.MonkeyPatch
) -> None:
    tool, calls = tmp_path / "tool", tmp_path / "calls"
    tool.write_text(TOOL.format(python=sys.executable, log=str(calls)))
    tool.chmod(0o755)
    monkeypatch.setattr(answers, "TOOL", tool)
    opened, sealed = tmp_path / "open" / "v000", tmp_path / "sealed" / "v000"
    opened.mkdir(parents=True)
    sealed.mkdir(parents=True)
    for run in ("recording.parquet", "validation.parquet"):
        write_columns(opened / run, log)
    (opened / "machine.toml").write_text("[machine]\nn_p = 4  # pole pairs\n")
    truth = {"base_true": {"n_p": 4}, "v_dc": 540.0, "components": []}
    (sealed / "truth.json").write_text(json.dumps(truth))
    assert "answered" in mistakes.answer(0, "n_p-times-2", tmp_path, "abc")
    assert mistakes.answer(0, "n_p-times-2", tmp_path, "abc") == ""
    assert "answered" in mistakes.answer(0, SOUND, tmp_path, "abc")
    assert re.findall(r"n_p = \d+", calls.read_text()) == ["n_p = 8", "n_p = 4"]
    row = mistakes.result(0, "n_p-times-2", "healthy", tmp_path)
    assert (row.outcome, row.case, row.said) == ("not told", "v000", "named")
