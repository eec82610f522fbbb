"""Answers and their files: what was written is read back, and what is no answer is refused."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pmsm_rs as pm
import pytest
from answers import ANSWER, IDENTIFICATION, diagnosis, traces
from pmsm_rs import Diagnosis, Identification
from pmsm_rs.answers import read_answer
from pmsm_rs.completion import completed
from pmsm_rs.io.formats.remark import Remark
from pmsm_rs.io.reading import Account


def test_an_answer_survives_json() -> None:
    answer = diagnosis()
    again = Diagnosis.from_json(answer.to_json())
    assert again == answer
    assert json.loads(answer.to_json()) == ANSWER
    assert again.shown is None


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


def test_an_identification_is_read_back() -> None:
    data = IDENTIFICATION
    answer = Identification.from_json(json.dumps(data))
    assert answer.parameters["r_s"].ci95 is not None
    assert answer.history == (1.0, 0.1)
    assert json.loads(answer.to_json()) == data
    assert "not converged" in str(answer)
    assert "j and b: the speed hardly changes" in str(answer)


@pytest.mark.parametrize("content", [b"\xff\xfe{}", b"no JSON", b"[" * 100_000])
def test_a_file_that_is_no_answer_is_refused(content: bytes, tmp_path: Path) -> None:
    file = tmp_path / "answer.json"
    file.write_bytes(content)
    with pytest.raises(pm.UsageError, match="this is no JSON answer"):
        read_answer(file)
