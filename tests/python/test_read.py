"""What was read stands in every answer, and no headline claims more than was looked at."""

from __future__ import annotations

import html
import json
import pickle
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pmsm_rs as pm
import pytest
from conftest import MACHINE, Columns, Ran, csv_text
from pmsm_rs.view.headline import headline
from pmsm_rs.view.report import chip

Run = Callable[..., Ran]
KNOWN = pm.Machine(n_p=3, r_s=0.9, l_d=0.0096, l_q=0.0213, psi_m=0.193, j=0.0126, b=0.0017)
ALL_CLEAR = "Nothing is missing"


def healthy(seed: int = 1, rows: int = 1500) -> Columns:
    """A motor without a mismatch in its motion: torque, and the speed that follows from it, with noise."""
    rng = np.random.default_rng(seed)
    t, decay = np.arange(rows) * 1e-3, 0.0017 / 0.0126
    omega, torque = np.full(rows, 60.0) * np.exp(-decay * t), np.full(rows, 0.3)
    for size, w in ((0.8, 9.0), (0.5, 23.0)):
        # The solution of j dω/dt = τ - b ω for a sine, from rest.
        gain = size / 0.0126 / (decay**2 + w**2)
        omega += gain * (decay * np.sin(w * t) - w * np.cos(w * t) + w * np.exp(-decay * t))
        torque += size * np.sin(w * t)
    return {"t": t, "tau_e": torque, "omega_m": omega + 0.05 * rng.standard_normal(rows)}


@pytest.fixture(scope="module")
def with_lost_voltages() -> tuple[pm.Recording, pm.Diagnosis]:
    columns = healthy()
    zeros = np.zeros(len(columns["t"]))
    run = pm.load({**columns, "Vsd_K7": zeros, "Vsq_K7": zeros, "Torque_cmd": columns["tau_e"], "x": zeros})
    return run, pm.diagnose(run, KNOWN)


def test_a_recording_without_voltages_gets_no_all_clear(
    with_lost_voltages: tuple[pm.Recording, pm.Diagnosis], tmp_path: Path
) -> None:
    run, answer = with_lost_voltages
    assert answer.verdict == "no_mismatch"
    answer.report(tmp_path / "r.html")
    page = (tmp_path / "r.html").read_text(encoding="utf-8")
    fleet = pm.diagnose_many([run], KNOWN)
    first = "The equation of motion explains the speed down to the noise."
    why = (
        "Nothing was asked of the voltages: the recording has none that were recognised (ignored: Vsd_K7, "
        "Vsq_K7)."
    )
    assert headline(answer).startswith(f"{first} {why}")
    for text in (str(answer), page, answer._repr_html_(), str(fleet)):
        plain = " ".join(text.split())
        assert first in plain
        assert why in plain
        assert ALL_CLEAR not in plain
        assert "Model complete" not in plain
    assert "no mismatch in what was asked" in str(fleet)
    # The line can be copied from wherever it stands.
    for text in (str(answer), html.unescape(page), html.unescape(answer._repr_html_())):
        assert 'v_d = { from = "Vsd_K7", unit = "V" }' in " ".join(text.split())


def test_the_account_is_that_of_the_contract(with_lost_voltages: tuple[pm.Recording, pm.Diagnosis]) -> None:
    read = json.loads(with_lost_voltages[1].to_json())["read"]
    assert read["columns"] == {
        "t": {"from": "t", "unit": "s", "scale": 1.0},
        "omega_m": {"from": "omega_m", "unit": "rad/s", "scale": 1.0},
        "tau_e": {"from": "tau_e", "unit": "N·m", "scale": 1.0},
    }
    assert read["ignored"] == ["Vsd_K7", "Vsq_K7", "Torque_cmd", "x"]
    assert (read["rows"], read["period"]) == (1500, 1e-3)
    asked = read["questions"]
    assert (asked["electrical"], asked["mechanical"]) == (False, True)
    assert "Vsd_K7" in asked["why_not"]
    command = next(entry for entry in read["not_used"] if entry["column"] == "Torque_cmd")
    assert "never the measured load torque" in command["why"]


def test_every_column_that_was_lost_is_a_finding(
    with_lost_voltages: tuple[pm.Recording, pm.Diagnosis],
) -> None:
    findings = with_lost_voltages[1].data_quality
    told = [finding for finding in findings if "was not used" in finding["finding"]]
    assert [finding["fix"].split("add to [columns]: ")[1] for finding in told] == [
        'v_d = { from = "Vsd_K7", unit = "V" }',
        'v_q = { from = "Vsq_K7", unit = "V" }',
    ]


def test_an_answer_on_arrays_and_on_a_pickled_recording_has_its_account() -> None:
    run = pm.Recording(healthy())
    for recording in (run, pickle.loads(pickle.dumps(run))):
        read = json.loads(pm.diagnose(recording, KNOWN).to_json())["read"]
        assert read["columns"]["tau_e"] == {"from": "tau_e", "unit": "N·m", "scale": 1.0}
        assert read["ignored"] == []
        assert read["questions"]["why_not"].startswith("Nothing was asked of the voltages: the recording")


def test_several_recordings_have_an_account_each() -> None:
    runs = [
        pm.load({**healthy(k), **({"Vd_K7": np.zeros(1500), "Vq_K7": np.zeros(1500)} if k == 2 else {})})
        for k in (1, 2)
    ]
    answer = pm.diagnose(runs, KNOWN)
    read = json.loads(answer.to_json())["read"]
    assert [one["ignored"] for one in read] == [[], ["Vd_K7", "Vq_K7"]]
    assert pm.Diagnosis.from_json(answer.to_json()) == answer
    text = " ".join(str(answer).split())
    assert "Recording 1: nothing was asked of the voltages" in text
    assert "Recording 2: nothing was asked of the voltages" in text
    assert ALL_CLEAR not in text
    found = [finding["finding"] for finding in answer.data_quality if "was not used" in finding["finding"]]
    assert [text.split(" was ")[0] for text in found] == [
        "Recording 2: the column 'Vd_K7'",
        "Recording 2: the column 'Vq_K7'",
    ]


def test_what_the_columns_table_made_stands_in_the_answer(tmp_path: Path, run: Run) -> None:
    columns = healthy()
    given = {"iq": columns["tau_e"] / 1.7, "speed_rpm": columns["omega_m"] * 30.0 / np.pi}
    (tmp_path / "r.csv").write_text(csv_text(given, {"iq": "iq [A]"}))
    rules = '[columns]\nt = { period = 0.001 }\ntau_e = { from = "iq [A]", scale = 1.7, unit = "N m" }\n'
    (tmp_path / "m.toml").write_text(f"{MACHINE}\n{rules}temperature = {{ value = 300, unit = 'K' }}\n")
    ran = run("diagnose", tmp_path / "r.csv", "--machine", tmp_path / "m.toml", "--json", tmp_path / "a.json")
    assert ran.code == 0
    read = json.loads((tmp_path / "a.json").read_text())["read"]
    assert read["columns"] == {
        "t": {"from": None, "unit": "s", "scale": 1.0, "period": 0.001},
        "tau_e": {"from": "iq [A]", "unit": "N·m", "scale": 1.7},
        "omega_m": {"from": "speed_rpm", "unit": "rpm", "scale": 1.0},
        "temperature": {"from": None, "unit": "K", "scale": 1.0, "value": 300.0},
    }
    text = " ".join(ran.out.split())
    assert "tau_e from iq [A] times 1.7 (N·m)" in text
    assert "omega_m from speed_rpm (rpm)" in text
    assert "1500 rows, one every 1 ms" in text


def test_a_load_torque_and_a_speed_alone_answer_nothing(tmp_path: Path, run: Run) -> None:
    columns = healthy()
    columns["tau_m"] = columns.pop("tau_e")
    (tmp_path / "r.csv").write_text(csv_text({**columns, "Current (A)": columns["tau_m"]}))
    (tmp_path / "m.toml").write_text(MACHINE)
    files = ["--json", tmp_path / "a.json", "--report", tmp_path / "a.html"]
    ran = run("diagnose", tmp_path / "r.csv", "--machine", tmp_path / "m.toml", *files)
    assert ran.code == 0
    answer = pm.Diagnosis.from_json((tmp_path / "a.json").read_text())
    assert answer.verdict == "undetermined"
    [read] = answer.read
    assert (read["questions"]["electrical"], read["questions"]["mechanical"]) == (False, False)
    assert "Current (A)" in headline(answer)
    assert (tmp_path / "a.html").is_file()
    fleet = pm.diagnose_many([tmp_path / "r.csv"], tmp_path / "m.toml")
    assert [result.to_json() for result in fleet.answers.values()] == [answer.to_json()]
    with pytest.raises(pm.DataError, match="that of the load"):
        pm.load(tmp_path / "r.csv", tmp_path / "m.toml")
    # As a validation run it is refused.
    (tmp_path / "good.csv").write_text(csv_text(healthy()))
    more = ["--machine", tmp_path / "m.toml", "--validate", tmp_path / "r.csv"]
    assert run("diagnose", tmp_path / "good.csv", *more).code == 3


def answered(verdict: str, kind: str, **read: Any) -> pm.Diagnosis:
    """An answer of which only the headline matters."""
    account: dict[str, Any] = {
        "columns": {},
        "ignored": [],
        "rows": 100,
        "period": 1e-3,
        "questions": {"electrical": True, "mechanical": True, "why_not": None},
        "not_used": [],
    }
    empty: dict[str, Any] = {name: [] for name in ("data_quality", "located", "ranking", "cannot_see")}
    return pm.Diagnosis.of(
        {
            "verdict": verdict,
            "read": account | read,
            "model": {"effects": ["dead_time"] if verdict == "named" else [], "base": {}},
            "next_experiment": None,
            "noise_floor": {},
            "fit": {},
            "recording_kind": kind,
            "seed": 1,
            "version": "1",
            **empty,
        }
    )


LOST = {"column": "phi_K7", "quantity": "angle", "why": "it looks like an angle", "use": None, "missed": True}


@pytest.mark.parametrize("kind", ["full", "electrical", "mechanical", "operating_points", "open_circuit"])
def test_only_a_recording_that_was_asked_everything_gets_an_all_clear(kind: str) -> None:
    complete = answered("no_mismatch", kind)
    assert headline(complete) == f"{ALL_CLEAR}: the dq-model explains this recording down to its noise."
    assert chip(complete) == ("Model complete", "good")
    unasked = {"electrical": True, "mechanical": False, "why_not": "Nothing was asked of the motion: held."}
    for part in (
        answered("no_mismatch", kind, questions=unasked),
        answered("no_mismatch", kind, not_used=[LOST]),
    ):
        assert ALL_CLEAR not in headline(part)
        assert chip(part)[1] != "good"
    assert "'phi_K7' was not used but looks like an angle" in headline(
        answered("no_mismatch", kind, not_used=[LOST])
    )


@pytest.mark.parametrize("verdict", ["named", "unknown", "undetermined"])
def test_every_verdict_says_what_was_not_asked(verdict: str) -> None:
    why = "Nothing was asked of the motion: the rotor is held."
    unasked = {"electrical": True, "mechanical": False, "why_not": why}
    assert headline(answered(verdict, "electrical", questions=unasked)).endswith(why)


def test_a_name_cannot_reach_the_terminal_as_a_command() -> None:
    lost = {**LOST, "column": "\x1b[31mphi" + "x" * 500}
    text = str(answered("no_mismatch", "full", not_used=[lost], ignored=[lost["column"]]))
    assert "\x1b" not in text
    assert "x" * 100 not in text
