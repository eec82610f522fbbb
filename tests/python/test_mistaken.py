"""A file that is named in the place of another is told by what it is."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import pyarrow
import pyarrow.parquet
import pytest
from conftest import MACHINE, Ran, csv_text, plausible

Run = Callable[..., Ran]

ANSWER = {"schema": "pmsm-rs.diagnosis/2", "verdict": "named", "budget": [1.0, 2.0], "located": []}


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    path = tmp_path / "run.csv"
    path.write_text(csv_text(plausible()))
    return path


@pytest.fixture
def answer(tmp_path: Path) -> Path:
    path = tmp_path / "a.json"
    path.write_text(json.dumps(ANSWER, indent=2))
    return path


@pytest.mark.parametrize("command", ["diagnose", "identify", "inspect"])
def test_a_machine_file_is_no_recording(command: str, machine_file: Path, run: Run) -> None:
    named = [] if command == "inspect" else ["--machine", machine_file]
    ran = run(command, machine_file, *named)
    assert ran.code == 3
    assert "this is a machine file, not a recording; name the recording [PR050]" in ran.err


def test_an_answer_is_no_recording(answer: Path, machine_file: Path, run: Run) -> None:
    ran = run("diagnose", answer, "--machine", machine_file)
    assert ran.code == 3
    assert "this is an answer of this package, not a recording; name the recording [PR050]" in ran.err


@pytest.mark.parametrize("kind", ["parquet", "csv", "json", "large csv"])
def test_a_recording_is_no_machine_file(kind: str, recording: Path, tmp_path: Path, run: Run) -> None:
    path = tmp_path / f"other.{kind.split()[-1]}"
    columns = plausible()
    if kind == "parquet":
        pyarrow.parquet.write_table(pyarrow.table(columns), path)
    elif kind == "json":
        path.write_text(json.dumps({name: list(values) for name, values in columns.items()}))
    else:
        text = csv_text(columns)
        path.write_text(text if kind == "csv" else text * (1 + (1 << 20) // len(text)))
    ran = run("diagnose", recording, "--machine", path)
    assert ran.code == 3
    assert "this is a recording, not a machine file; name the machine file [PR037]" in ran.err


def test_an_answer_is_no_machine_file(answer: Path, recording: Path, run: Run) -> None:
    ran = run("diagnose", recording, "--machine", answer)
    assert "this is an answer of this package, not a machine file; name the machine file [PR037]" in ran.err


def test_a_machine_file_with_a_slip_is_still_one(recording: Path, tmp_path: Path, run: Run) -> None:
    path = tmp_path / "slip.toml"
    path.write_text(MACHINE + "points = [\n1, 2,\n3, 4,\n")
    ran = run("diagnose", recording, "--machine", path)
    assert "no valid TOML" in ran.err


@pytest.mark.parametrize("entry", ['"omega_e"', '{ from = "omega_e", unit = "rad/s" }'])
def test_interchanged_sides_of_columns_are_told(
    entry: str, recording: Path, tmp_path: Path, run: Run
) -> None:
    path = tmp_path / "m.toml"
    path.write_text(f"{MACHINE}\n[columns]\nspeed = {entry}\n")
    ran = run("diagnose", recording, "--machine", path)
    assert ran.code == 3
    assert 'the two sides are interchanged; write omega_e = "speed"' in ran.err


def test_the_names_of_a_file_are_listed_once(machine_file: Path, tmp_path: Path, run: Run) -> None:
    path = tmp_path / "other.csv"
    path.write_text("alpha,beta\n" + "1,2\n" * 20)
    ran = run("diagnose", path, "--machine", machine_file)
    assert ran.code == 3
    assert "3 things are missing" in ran.err
    assert ran.err.count("'alpha', 'beta'") == 1
