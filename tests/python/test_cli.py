"""The command line: exit codes, what goes where, and files that appear whole or not at all."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pmsm_rs as pm
import pyarrow.parquet
import pytest
from conftest import MACHINE, Ran, csv_text, plausible
from pmsm_rs.support.demo import recording_files, sealed

Run = Callable[..., Ran]


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    path = tmp_path / "r.csv"
    path.write_text(csv_text(plausible()))
    return path


@pytest.mark.parametrize(
    "command", [[], ["demo"], ["inspect"], ["identify"], ["diagnose"], ["simulate"], ["design"], ["effects"]]
)
def test_help(command: list[str], run: Run) -> None:
    ran = run(*command, "--help")
    assert ran.code == 0
    assert ran.out.startswith("Usage: pmsm-rs")


def test_version(run: Run) -> None:
    assert run("--version").out.strip() == f"pmsm-rs {pm.__version__}"


@pytest.mark.parametrize(
    "wrong",
    [
        ["digonse"],
        ["diagnose"],
        ["diagnose", "r.csv"],
        ["diagnose", "r.csv", "--machine", "m.toml", "--threads", "0"],
        ["diagnose", "r.csv", "--machine", "m.toml", "--seed", "x"],
        ["identify", "r.csv", "--machine", "m.toml", "--method", "guess"],
        ["identify", "r.csv", "--machine", "m.toml", "--nonsense"],
        ["diagnose", "absent.csv", "--machine", "absent.toml"],
        ["effects", "dead_tim"],
    ],
)
def test_usage_errors(wrong: list[str], run: Run) -> None:
    ran = run(*wrong)
    assert ran.code == 2
    assert ran.out == ""
    assert ran.err.startswith("pmsm-rs: ")
    assert ran.err.count("\n") == 1


@pytest.mark.parametrize(("fit", "words"), [("r_x", "r_s"), ("tau_lode", "tau_load"), (",", "no parameter")])
def test_unknown_parameters_name_the_nearest(
    fit: str, words: str, recording: Path, machine_file: Path, run: Run
) -> None:
    ran = run("identify", recording, "--machine", machine_file, "--fit", fit)
    assert ran.code == 2
    assert words in ran.err


def test_effects_lists_and_shows_the_catalogue(run: Run) -> None:
    ran = run("effects")
    assert ran.code == 0
    catalogue = pm.effects()
    assert all(entry["id"] in ran.out for entry in catalogue)
    for entry in catalogue:
        shown = run("effects", entry["id"])
        assert shown.code == 0
        assert entry["equation"] in shown.out
        assert all(parameter["symbol"] in shown.out for parameter in entry["parameters"])


def test_effects_suggests(run: Run) -> None:
    assert "did you mean 'dead_time'" in run("effects", "dead_tim").err


def test_identify_writes_its_answer(machine_file: Path, tmp_path: Path, run: Run) -> None:
    recording, _, machine = recording_files()
    out = tmp_path / "a.json"
    ran = run(
        "identify", recording, "--machine", machine, "--fit", "r_s,psi_m", "--method", "lm", "--json", out
    )
    assert ran.code in (0, 4), ran.err
    answer = json.loads(out.read_text())
    assert {"r_s", "psi_m"} <= set(answer["parameters"])
    for entry in answer["parameters"].values():
        assert entry["unit"]
        assert entry["stderr"] is not None or entry["why_none"]
    assert "r_s" in ran.out
    assert ran.err == "", "progress belongs on a terminal only"


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> tuple[subprocess.CompletedProcess[str], Path]:
    folder = tmp_path_factory.mktemp("demo")
    code = "from pmsm_rs.cli import main; main(['demo', '--json', 'a.json'])"
    return subprocess.run(
        [sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, check=False
    ), folder


def test_demo_finds_what_was_put_in(demo: tuple[subprocess.CompletedProcess[str], Path]) -> None:
    ran, folder = demo
    assert ran.returncode == 0, ran.stderr
    assert ran.stderr == ""
    assert "\nCompared with what was put in\n" in ran.stdout
    assert "The finding is right." in ran.stdout
    answer = json.loads((folder / "a.json").read_text())
    assert answer["verdict"] == "named"
    assert answer["model"]["effects"] == [sealed()["effect"]]
    page = (folder / "pmsm-rs-demo.html").read_text()
    assert page.startswith("<!doctype html>")


def test_diagnose_writes_json_report_and_trajectories(
    short_demo: tuple[str, str, str], tmp_path: Path, run: Run
) -> None:
    recording, validation, machine = short_demo
    names = {"--json": "a.json", "--report": "a.html", "--trajectories": "a.parquet"}
    outputs = [part for option, name in names.items() for part in (option, tmp_path / name)]
    ran = run("diagnose", recording, "--machine", machine, "--validate", validation, "--seed", "7", *outputs)
    assert ran.code == 0, ran.err
    answer = json.loads((tmp_path / "a.json").read_text())
    assert answer["schema"] == "pmsm-rs.diagnosis/2"
    assert answer["seed"] == 7
    assert set(answer) >= {
        "verdict",
        "data_quality",
        "located",
        "ranking",
        "model",
        "cannot_see",
        "next_experiment",
        "noise_floor",
        "fit",
        "version",
    }
    table = pyarrow.parquet.read_table(tmp_path / "a.parquet")
    assert table.column_names[0] == "t"
    for name, value in answer["fit"]["validation"]["after"].items():
        left = table[f"{name}_measured"].to_numpy() - table[f"{name}_after"].to_numpy()
        assert np.sqrt(np.nanmean(left**2)) == pytest.approx(value, rel=1e-3), "anyone can recompute the fit"
    assert {path.name for path in tmp_path.iterdir()} == set(names.values()), "no temporary file is left"
    assert ran.out.startswith(f"Verdict: {answer['verdict']}\n")
    pages = {}
    for name, curves in (("bare.html", []), ("b.html", ["--trajectories", tmp_path / "a.parquet"])):
        again = run("report", tmp_path / "a.json", *curves, "-o", tmp_path / name, "--title", "Again")
        assert again.code == 0, again.err
        pages[name] = (tmp_path / name).read_text(encoding="utf-8")
    assert "Before and after" in pages["b.html"]
    assert "Before and after" not in pages["bare.html"]
    refused = run("report", tmp_path / "a.json", "--trajectories", recording, "-o", tmp_path / "c.html")
    assert refused.code == 2
    assert "these are not the trajectories" in refused.err


def test_a_report_takes_trajectories_of_a_validation_run_with_fewer_channels(
    short_demo: tuple[str, str, str], tmp_path: Path, run: Run
) -> None:
    recording, validation, machine = short_demo
    motion = pyarrow.parquet.read_table(validation).drop_columns(["v_d", "v_q"])
    pyarrow.parquet.write_table(motion, tmp_path / "motion.parquet")
    names = ["--json", tmp_path / "a.json", "--trajectories", tmp_path / "a.parquet"]
    ran = run("diagnose", recording, "--machine", machine, "--validate", tmp_path / "motion.parquet", *names)
    assert ran.code == 0, ran.err
    answer = json.loads((tmp_path / "a.json").read_text())
    assert {*answer["fit"]["validation"]["after"]} < {*answer["noise_floor"]}
    drawn = run(
        "report", tmp_path / "a.json", "--trajectories", tmp_path / "a.parquet", "-o", tmp_path / "r.html"
    )
    assert drawn.code == 0, drawn.err
    assert "Before and after" in (tmp_path / "r.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("module", ["pmsm_rs", "pmsm_rs.cli"])
def test_the_command_runs_as_a_module(module: str) -> None:
    ran = subprocess.run(
        [sys.executable, "-m", module, "--version"], capture_output=True, text=True, check=False
    )
    assert (ran.returncode, ran.stdout.strip(), ran.stderr) == (0, f"pmsm-rs {pm.__version__}", "")


def test_a_report_is_made_of_an_answer_alone(machine_file: Path, tmp_path: Path, run: Run) -> None:
    ran = run("report", machine_file, "-o", tmp_path / "a.html")
    assert ran.code == 2
    assert "no JSON answer" in ran.err
    assert not (tmp_path / "a.html").exists()


def test_a_missing_machine_file_says_how_one_is_made(recording: Path, run: Run) -> None:
    ran = run("diagnose", recording)
    assert ran.code == 2
    assert "inspect RECORDING --write machine.toml" in ran.err
    assert "[PR018]" in ran.err
    assert "see pmsm-rs diagnose --help" in run("diagnose").err


def test_explain_says_what_is_no_code(run: Run) -> None:
    assert "pmsm-rs effects dead_time shows it" in run("explain", "dead_time").err
    assert "pmsm-rs explain lists all" in run("explain", "PR9999").err


def test_the_recording_is_no_validation_run(machine_file: Path, recording: Path, run: Run) -> None:
    ran = run("diagnose", recording, "--machine", machine_file, "--validate", recording)
    assert ran.code == 2
    assert "the validation run is the recording itself" in ran.err


def test_an_unwritable_answer_is_a_usage_error(machine_file: Path, tmp_path: Path, run: Run) -> None:
    recording, _, machine = recording_files()
    out = tmp_path / "absent" / "a.json"
    ran = run("identify", recording, "--machine", machine, "--fit", "r_s", "--method", "lm", "--json", out)
    assert ran.code == 2
    assert str(out) in ran.err


def test_what_cannot_be_written_is_said_before_anything_is_computed(
    recording: Path, machine_file: Path, tmp_path: Path, run: Run
) -> None:
    for option in ("--json", "--report", "--trajectories"):
        # the recording does not even exist
        ran = run("diagnose", "none.csv", "--machine", str(machine_file), option, str(tmp_path / "no" / "x"))
        assert ran.code == 2
        assert "cannot write there" in ran.err
    machine = ("--machine", str(machine_file))
    one = str(tmp_path / "one")
    for wrong in (
        ("diagnose", str(recording), *machine, "--json", str(recording)),
        ("diagnose", str(recording), *machine, "--json", one, "--report", one),
        ("fleet", str(recording), *machine, "--ledger", str(machine_file)),
        ("demo", "--json", one, "--report", one),
    ):
        ran = run(*wrong)
        assert ran.code == 2
        assert "written over" in ran.err
    assert recording.read_text() == csv_text(plausible())


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="this system has no named pipes")
def test_links_are_followed_and_pipes_written_to(tmp_path: Path) -> None:
    from pmsm_rs import atomic

    (tmp_path / "target").write_text("old")
    (tmp_path / "link").symlink_to(tmp_path / "target")
    atomic.write_text(tmp_path / "link", "new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "target").read_text() == "new"
    os.mkfifo(tmp_path / "pipe")
    reader = os.open(tmp_path / "pipe", os.O_RDONLY | os.O_NONBLOCK)
    atomic.write_text(tmp_path / "pipe", "new")
    assert os.read(reader, 10) == b"new"
    os.close(reader)


def test_a_motor_that_does_nothing_gives_no_confident_answer(
    tmp_path: Path, machine_file: Path, run: Run
) -> None:
    columns = {name: np.zeros_like(values) for name, values in plausible().items()} | {"t": plausible()["t"]}
    (tmp_path / "r.csv").write_text(csv_text(columns))
    outputs = ("--json", tmp_path / "a.json", "--trajectories", tmp_path / "t.parquet")
    ran = run("diagnose", tmp_path / "r.csv", "--machine", machine_file, *outputs)
    assert ran.code == 0
    assert json.loads((tmp_path / "a.json").read_text())["verdict"] == "undetermined"
    assert "no recorded signal" in " ".join(ran.out.split())
    # There is nothing to compare with, which is no mistake of the user's.
    assert "t.parquet is not written" in ran.err
    assert not (tmp_path / "t.parquet").exists()


def test_internal_faults_are_told_apart(monkeypatch: pytest.MonkeyPatch, run: Run) -> None:
    def broken() -> None:
        raise RuntimeError("a wire came loose")

    monkeypatch.setattr("pmsm_rs._core.effects", broken)
    ran = run("effects")
    assert ran.code == 1
    assert "a wire came loose" in ran.err


@cache
def imported(code: str) -> frozenset[str]:
    """The modules that `code` imports into a new Python."""
    asked = f"import json, sys; b = {{*sys.modules}}; {code}; print(json.dumps([*({{*sys.modules}} - b)]))"
    return frozenset(json.loads(subprocess.check_output([sys.executable, "-c", asked])))


@pytest.mark.parametrize("module", ["numpy", "matplotlib", "jinja2", "scipy", "arro3", "pydantic"])
@pytest.mark.parametrize("code", ["import pmsm_rs", "from pmsm_rs.cli import cli"])
def test_nothing_heavy_is_imported_before_it_is_needed(module: str, code: str) -> None:
    assert module not in imported(code)


def test_the_machine_file_is_read_for_every_recording(tmp_path: Path, run: Run) -> None:
    good, bad = tmp_path / "good.csv", tmp_path / "bad.csv"
    good.write_text(csv_text(plausible(), {"i_d": "a"}))
    bad.write_text(csv_text(plausible(), {"i_d": "b"}))
    machine = tmp_path / "m.toml"
    machine.write_text(MACHINE + '\n[columns]\ni_d = "a"\n')
    ran = run("diagnose", good, "--machine", machine, "--validate", bad)
    assert ran.code == 3
    assert f"validation run, {bad}" in ran.err
    with pytest.raises(pm.DataError, match=r"validation run, .*bad\.csv") as caught:
        pm.diagnose(good, machine, validation=bad)
    assert caught.value.file == str(bad)  # type: ignore[attr-defined]
    assert caught.value.code


def test_what_cannot_be_diagnosed_is_answered_all_the_same(tmp_path: Path, run: Run) -> None:
    columns = plausible()
    unfed = {name: values for name, values in columns.items() if not name.startswith("v_")}
    (tmp_path / "r.csv").write_text(csv_text(unfed))
    (tmp_path / "m.toml").write_text("[machine]\nn_p = 3\n")
    out = tmp_path / "answer.json"
    ran = run("diagnose", str(tmp_path / "r.csv"), "--machine", str(tmp_path / "m.toml"), "--json", str(out))
    assert ran.code == 4
    assert ran.out == ""
    answer = pm.Diagnosis.from_json(out.read_text())
    assert answer.verdict == "undetermined"
    assert (answer.effects, answer.ranking, answer.located) == ((), (), ())
    [quality] = answer.data_quality
    assert quality["finding"] == "psi_m is not on the nameplate and this recording does not show it"
    assert quality["fix"] in ran.err
    assert {entry["effect"] for entry in answer.cannot_see} == {entry["id"] for entry in pm.effects()}
