"""What inspection shows: all of it as JSON, and as text that any terminal can show and no name can steer."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pmsm_rs as pm
import pytest
from conftest import Columns, Ran
from inspected import written
from pmsm_rs.inspection.text import plain, text
from pmsm_rs.io.sampling import Sampling
from pmsm_rs.io.signals import STRETCHES, course
from pmsm_rs.plot.sparkline import ASCII, sparkline
from pmsm_rs.support.demo import recording_files

Run = Callable[..., Ran]


def test_the_next_command_can_be_copied_however_long_a_path_is(
    columns: Columns, tmp_path: Path, run: Run
) -> None:
    folder = tmp_path / ("long " * 40).strip()
    folder.mkdir()
    file = written(columns, folder)
    ran = run("inspect", file)
    assert ran.code == 0, ran.err
    assert f"inspect '{file}' --write machine.toml" in ran.out


def test_json_holds_all_of_it(columns: Columns, tmp_path: Path, run: Run) -> None:
    log = {**columns, "gaps": np.where(columns["t"] < 0.3, np.nan, 1.0)}
    file, out = written(log, tmp_path), tmp_path / "a.json"
    assert run("inspect", file, "--json", out).code == 0
    answer = json.loads(out.read_text())
    assert answer["schema"] == "pmsm-rs.inspection/1"
    assert answer["ready"] is True
    assert answer["questions"] == {"electrical": True, "mechanical": True, "why_not": {}}
    assert {entry["column"] for entry in answer["columns"]} == {*log}
    assert answer["columns"][-1]["course"][0] is None
    assert answer["sampling"][0]["rate"] == pytest.approx(1e3)
    assert answer["machine_file"] == pm.inspect(file).machine_file


def test_the_demo_recording_can_be_diagnosed_with_what_is_written(tmp_path: Path, run: Run) -> None:
    recording, _, machine = recording_files()
    ran = run("inspect", recording, "--machine", machine)
    assert ran.code == 0
    assert "A waveform with voltages, currents and motion." in ran.out
    assert "n_p = 4" in ran.out
    assert f"pmsm-rs diagnose {recording} --machine {machine}" in ran.out


def test_gaps_and_jitter_of_the_clock_are_told() -> None:
    even = np.arange(1000) * 1e-4
    assert Sampling.of(even).sentence() == "1000 rows, one every 0.1 ms (10 kHz), 99.9 ms in all, no gaps"
    torn = np.where(even > 0.05, even + 1.0, even)
    assert "1 gap of 1 s at t = 0.05 s" in Sampling.of(torn).sentence()
    assert Sampling.of(torn).gaps == 1
    assert "time does not go forward at 1 row" in Sampling.of(np.array([0.0, 1.0, 2.0, 1.5])).sentence()
    assert "steps of" in Sampling.of(np.array([0.0, 1.0, 2.2, 3.2, 4.2])).sentence()
    assert "without a sample rate" in Sampling.of(np.zeros(1)).sentence()


def test_sparklines() -> None:
    assert sparkline([0.0, 3.5, 7.0], 0.0, 7.0) == "▁▅█"
    assert sparkline([0.0, float("nan"), 7.0], 0.0, 7.0, ASCII) == "_ #"
    assert sparkline([1.0, 1.0], 1.0, 1.0) == "constant"
    assert sparkline([], None, None) == ""
    assert sparkline([-1.7e308, 1.7e308], -1.7e308, 1.7e308) == "▁█"
    assert course(np.arange(1000.0))[-1] == 999.0
    assert len(course(np.arange(1000.0))) == STRETCHES
    assert len(course(np.arange(3.0))) == 3


def test_a_terminal_without_other_signs_gets_ascii(
    columns: Columns, tmp_path: Path, run: Run, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = written({**columns, "ω/β": columns["i_q"]}, tmp_path)
    found = pm.inspect(file)
    assert text(found, blocks=False).isascii()
    assert plain("Ω·°ш") == "ohm.deg\\u0448"
    monkeypatch.setattr("pmsm_rs.cli.inspecting._shows_blocks", lambda: False)
    assert run("inspect", file).out.isascii()


def test_names_cannot_steer_the_terminal(columns: Columns, tmp_path: Path, run: Run) -> None:
    evil = "a\x1b[31mb\u202e"
    found = pm.inspect({**columns, evil: columns["i_q"], f"omega_{evil}": columns["i_q"]})
    shown = str(found) + found.machine_file
    assert "\x1b" not in shown
    assert "\u202e" not in shown
    tomllib.loads(found.machine_file)


def test_many_columns_are_cut_short_in_text_and_whole_in_json(columns: Columns) -> None:
    log = {**columns, **{f"signal {k}": columns["i_q"] for k in range(300)}}
    found = pm.inspect(log)
    assert len(found.columns) == 307
    assert "and 260 more" in str(found)
    assert len(str(found).splitlines()) < 120
    assert len(json.loads(found.to_json())["columns"]) == 307
