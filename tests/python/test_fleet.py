"""Many recordings: answers in order, failures in their place, nothing lost with a worker, a ledger."""

from __future__ import annotations

import json
import multiprocessing
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pmsm_rs as pm
import pytest
from conftest import PACKAGE, Ran, csv_text
from pmsm_rs.config.machine_file import MachineFile
from pmsm_rs.fleet import crew
from pmsm_rs.fleet.crew import Task
from pmsm_rs.io.columns import Rule

MACHINE = pm.Machine(n_p=3, r_s=0.9, l_d=0.0096, l_q=0.0213, psi_m=0.193, j=0.0126, b=0.0017)
SPAWN = multiprocessing.get_context("spawn")


def recording(k: int, rows: int = 300) -> pm.Recording:
    """A short mechanical recording, quick to diagnose; another one for each k."""
    rng = np.random.default_rng(k)
    t = np.arange(rows) * 1e-3
    omega = 40.0 + 10.0 * np.sin(8.0 * t) + 0.05 * rng.standard_normal(rows)
    return pm.Recording(t=t, omega_m=omega, tau_e=0.1 + np.gradient(omega, t) * 0.0126)


@pytest.fixture
def files(tmp_path: Path) -> list[Path]:
    """Four recordings, the second one without currents."""
    out = []
    for k in range(4):
        run = recording(k)
        columns = {name: run.column(name) for name in run.names if k != 1 or name != "tau_e"}
        path = tmp_path / f"run{k}.csv"
        path.write_text(csv_text(columns))
        out.append(path)
    return out


def same(first: pm.Fleet, second: pm.Fleet) -> None:
    assert first.names == second.names
    for a, b in zip(first, second, strict=True):
        if isinstance(a, pm.Diagnosis):
            assert isinstance(b, pm.Diagnosis)
            assert a.to_json() == b.to_json()
        else:
            assert a == b


def test_answers_come_in_order_and_are_those_of_a_single_diagnosis() -> None:
    runs = [recording(k) for k in range(3)]
    answers = pm.diagnose_many(runs, MACHINE)
    assert [r.to_json() for r in answers] == [pm.diagnose(run, MACHINE).to_json() for run in runs]
    assert not answers.failures
    assert not answers.interrupted


def test_a_refused_recording_is_a_failure_in_its_place(files: list[Path]) -> None:
    answers = pm.diagnose_many(files, MACHINE)
    assert [isinstance(r, pm.Diagnosis) for r in answers] == [True, False, True, True]
    (failure,) = answers.failures
    assert failure.name == str(files[1])
    assert failure.kind == "DataError"
    assert "is missing" in failure.message
    assert "1 failed" in str(answers)
    assert "DataError" in str(answers)


@pytest.mark.parametrize("kind", ["threads", "processes"])
def test_any_executor_gives_the_same(kind: str, files: list[Path]) -> None:
    expected = pm.diagnose_many(files, MACHINE)
    executor: Executor = (
        ThreadPoolExecutor(2) if kind == "threads" else ProcessPoolExecutor(2, mp_context=SPAWN)
    )
    with executor:
        same(pm.diagnose_many(files, MACHINE, executor=executor), expected)


def test_dask(files: list[Path]) -> None:
    distributed = pytest.importorskip("distributed", reason="dask is not installed")
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=False, dashboard_address=None
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        answers = pm.diagnose_many(files, MACHINE, executor=client.get_executor())
    same(answers, pm.diagnose_many(files, MACHINE))


def test_a_ledger_is_resumed_from(files: list[Path], tmp_path: Path) -> None:
    ledger = tmp_path / "fleet.ndjson"
    first = pm.diagnose_many(files[:2], MACHINE, ledger=ledger)
    assert first.resumed == 0
    second = pm.diagnose_many(files, MACHINE, ledger=ledger)
    assert second.resumed == 2
    same(second, pm.diagnose_many(files, MACHINE))
    lines = [json.loads(line) for line in ledger.read_text().splitlines()]
    assert lines[0] == {"schema": "pmsm-rs.ledger/1"}
    assert {line["name"] for line in lines[1:3]} == {str(file) for file in files[:2]}
    assert len(lines) == 5
    assert len({line["key"] for line in lines[1:]}) == 4


def test_only_the_same_question_is_answered_from_the_ledger(files: list[Path], tmp_path: Path) -> None:
    ledger = tmp_path / "fleet.ndjson"
    pm.diagnose_many(files[:1], MACHINE, ledger=ledger)
    assert pm.diagnose_many(files[:1], MACHINE, ledger=ledger, seed=2).resumed == 0
    assert pm.diagnose_many(files[:1], pm.Machine(n_p=3, j=0.01), ledger=ledger).resumed == 0
    files[0].write_text(files[2].read_text())
    assert pm.diagnose_many(files[:1], MACHINE, ledger=ledger).resumed == 0
    assert pm.diagnose_many(files[:1], MACHINE, ledger=ledger).resumed == 1


def test_a_file_beside_the_recording_is_a_part_of_the_question(files: list[Path], tmp_path: Path) -> None:
    def key() -> str:
        rule = Rule(source="C2", file="channel2.csv")
        columns = {"v_b": rule, "temperature": None}
        machine = MachineFile("m.toml", MACHINE, None, None, columns)
        return Task(str(files[0]), "first", files[0], None, machine, 1, 1, 1 << 30).key()

    absent = key()
    (files[0].parent / "channel2.csv").write_text("t,C2\n0,1\n")
    first = key()
    (files[0].parent / "channel2.csv").write_text("t,C2\n0,2\n")
    assert len({absent, first, key()}) == 3


def test_a_torn_line_is_passed_over(files: list[Path], tmp_path: Path) -> None:
    ledger = tmp_path / "fleet.ndjson"
    whole = pm.diagnose_many(files, MACHINE, ledger=ledger)
    text = ledger.read_bytes()
    ledger.write_bytes(text[:-100])
    again = pm.diagnose_many(files, MACHINE, ledger=ledger)
    assert again.resumed == 3
    same(again, whole)
    assert ledger.read_bytes().startswith(text[:-100]), "a ledger is only ever appended to"
    assert pm.diagnose_many(files, MACHINE, ledger=ledger).resumed == 4


def test_what_is_no_ledger_is_not_written_to(files: list[Path], tmp_path: Path) -> None:
    before = files[0].read_bytes()
    with pytest.raises(pm.DataError, match="no ledger"):
        pm.diagnose_many(files, MACHINE, ledger=files[0])
    assert files[0].read_bytes() == before
    with pytest.raises(pm.UsageError, match="cannot be written"):
        pm.diagnose_many(files, MACHINE, ledger=tmp_path / "absent" / "l.ndjson")


@pytest.mark.skipif(not hasattr(os, "fork"), reason="files are locked on POSIX only")
def test_two_processes_do_not_share_a_ledger(files: list[Path], tmp_path: Path) -> None:
    import fcntl

    with (tmp_path / "l.ndjson").open("w") as other:
        fcntl.flock(other, fcntl.LOCK_EX)
        with pytest.raises(pm.UsageError, match="another process"):
            pm.diagnose_many(files, MACHINE, ledger=tmp_path / "l.ndjson")


def die_at_random(task: crew.Task) -> tuple[str, str, str]:
    """A worker that is killed on every seventh recording at first sight, and always on number 3."""
    number = int(Path(str(task.recording)).stem)
    mark = Path(str(task.recording)).with_suffix(".seen")
    first = not mark.exists()
    mark.touch()
    if number == 3 or (first and number % 7 == 0):
        os.kill(os.getpid(), signal.SIGKILL)
    return "failure", "DataError", f"{task.name}: done"


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="this system has no SIGKILL")
@pytest.mark.parametrize("how", ["pool", "function"])
def test_killed_workers_lose_no_recording(how: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(crew, "work", die_at_random)
    names = [tmp_path / f"{k}.csv" for k in range(30)]
    made: list[ProcessPoolExecutor] = []

    def make() -> ProcessPoolExecutor:
        made.append(ProcessPoolExecutor(2, mp_context=SPAWN))
        return made[-1]

    ledger = tmp_path / "l.ndjson"
    answers = pm.diagnose_many(names, MACHINE, executor=make if how == "function" else make(), ledger=ledger)
    assert [failure.name for failure in answers.failures] == [str(name) for name in names]
    kinds = [failure.kind for failure in answers.failures]
    assert [k for k, kind in enumerate(kinds) if kind != "DataError"] == [3]
    assert kinds[3] == "WorkerLost"
    assert "worker was lost" in answers.failures[3].message
    lines = ledger.read_text().splitlines()
    assert len(lines) == 31, "every recording is in the ledger once"


class Broken(Executor):
    """An executor that loses its first answers, as a cluster does whose nodes go away."""

    def __init__(self) -> None:
        self.left = 3

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        self.left -= 1
        if self.left >= 0:
            future.set_exception(RuntimeError("the node went away"))
        else:
            future.set_result(fn(*args, **kwargs))
        return future


def test_what_a_cluster_loses_is_given_to_it_again(files: list[Path]) -> None:
    same(pm.diagnose_many(files, MACHINE, executor=Broken()), pm.diagnose_many(files, MACHINE))


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"recordings": "run.csv"}, "a single one"),
        ({"machine": [MACHINE]}, "4 recordings, 1 machines"),
        ({"validations": [None]}, "1 validations"),
    ],
)
def test_arguments_that_do_not_fit_together(wrong: dict[str, Any], words: str, files: list[Path]) -> None:
    with pytest.raises(pm.UsageError, match=words):
        pm.diagnose_many(**{"recordings": files, "machine": MACHINE, **wrong})


def test_the_command(files: list[Path], machine_file: Path, tmp_path: Path, run: Any) -> None:
    machine_file.write_text("[machine]\nn_p = 3\nj = 0.0126\nb = 0.0017\n")
    arguments = ["fleet", *files, "--machine", machine_file, "--ledger", tmp_path / "l", "--jobs", 2]
    ran: Ran = run(*arguments, "--json", tmp_path / "all.json")
    assert ran.code == 3
    assert ran.err.startswith(f"pmsm-rs: {files[1]}")
    assert ran.err.count("\n") == 1
    entries = json.loads((tmp_path / "all.json").read_text())
    assert [entry["name"] for entry in entries] == [str(file) for file in files]
    assert ["answer" in entry for entry in entries] == [True, False, True, True]
    assert run(*arguments).out == ran.out
    assert run("fleet", files[0], "--machine", machine_file).code == 0


@pytest.fixture
def long_files(tmp_path: Path) -> list[Path]:
    """Enough work for an interruption in the middle."""
    out = []
    for k in range(40):
        run = recording(k, 2000)
        path = tmp_path / f"long{k}.csv"
        path.write_text(csv_text({name: run.column(name) for name in run.names}))
        out.append(path)
    return out


@pytest.mark.skipif(not hasattr(os, "fork"), reason="Ctrl-C is sent as a signal of POSIX")
def test_ctrl_c_leaves_a_ledger_to_go_on_from(long_files: list[Path], machine_file: Path) -> None:
    ledger = machine_file.parent / "l.ndjson"
    command = [
        *(sys.executable, "-c", "from pmsm_rs.cli import main; main()", "fleet", *map(str, long_files)),
        *("--machine", str(machine_file), "--ledger", str(ledger), "--jobs", "2"),
    ]
    environment = {**os.environ, "PYTHONPATH": str(PACKAGE.parent)}
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    ) as process:
        while (not ledger.exists() or ledger.read_bytes().count(b"\n") < 2) and process.poll() is None:
            time.sleep(0.02)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate()
    done = [json.loads(line) for line in ledger.read_text().splitlines()][1:]
    if process.returncode == 0:
        pytest.skip("it was done before the signal came")
    assert process.returncode == 130, err
    assert "Interrupted" in out
    assert 1 <= len(done) < len(long_files)
    assert all(entry["answer"]["interrupted"] is False for entry in done)
    from pmsm_rs.fleet.ledger import Ledger

    with Ledger(ledger) as book:
        assert len(book.entries) == len(done)


@pytest.mark.skipif(not hasattr(signal, "SIGTERM") or os.name == "nt", reason="signals of POSIX")
def test_an_end_in_the_middle_ends_the_processes_of_a_pool_of_its_own(long_files: list[Path]) -> None:
    token = "run"
    made: list[ProcessPoolExecutor] = []

    def make() -> ProcessPoolExecutor:
        made.append(ProcessPoolExecutor(2, mp_context=SPAWN))
        return made[-1]

    tasks = {str(path): Task(token, str(path), path, None, MACHINE, 1, 1, 1 << 30) for path in long_files}
    hands = crew.Crew(make, tasks)
    hands._submit()
    processes = [*(made[0]._processes or {}).values()]
    assert processes
    hands.end()
    for process in processes:
        process.join()
    assert all(process.exitcode == -signal.SIGTERM for process in processes)
    assert token not in crew._STOPS
