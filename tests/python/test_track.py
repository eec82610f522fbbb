"""Tracking from Python: windows, streams, state, interruption."""

from __future__ import annotations

import json
import os
import pickle
import signal
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pmsm_rs as pm
import pytest
from conftest import Ran
from pmsm_rs.io.columns import Rule
from pmsm_rs.io.stream import batches

Run = Callable[..., Ran]
RATE = 10e3
WINDOW = 0.033
PER_WINDOW = 330
CONFIG: dict[str, Any] = {
    "duration": 10 * WINDOW,
    "settle": 0.2,
    "seed": 3,
    "machine": "liu_2008",
    "drive": {"f_sample": RATE},
    "sensors": {"noise_i": 0.02, "noise_omega_e": 0.1},
    "reference": {
        "omega_m": {"t": [0.0, 0.1, 0.2, 0.3, 0.33], "value": [60.0, 90.0, 60.0, 90.0, 80.0]},
    },
    "load": {"tau": 8.0, "kind": "unknown_constant"},
    "drift": {"r_s": {"t": [0.0, 0.33], "value": [0.17, 0.2]}},
}
MACHINE = """
[machine]
r_s = 0.19
l_d = 0.0019
l_q = 0.0019
psi_m = 0.19197949109214762
n_p = 4
j = 0.008
b = 0.00115

[load]
kind = "unknown_constant"
"""


@pytest.fixture(scope="module")
def simulated() -> pm.Simulation:
    return pm.simulate(CONFIG)


@pytest.fixture(scope="module")
def columns(simulated: pm.Simulation) -> dict[str, np.ndarray]:
    run = simulated.recording
    return {name: run.column(name)[: 10 * PER_WINDOW] for name in run.names}


@pytest.fixture
def machine_file(tmp_path: Path) -> Path:
    path = tmp_path / "m.toml"
    path.write_text(MACHINE)
    return path


def text(columns: dict[str, np.ndarray], style: str) -> bytes:
    rows = [dict(zip(columns, map(float, row), strict=True)) for row in zip(*columns.values(), strict=True)]
    if style == "csv":
        lines = [",".join(columns), *(",".join(repr(x) for x in row.values()) for row in rows)]
    else:
        lines = [json.dumps(row) for row in rows]
    return "\n".join(lines).encode() + b"\n"


def piped(data: bytes, machine: Path, *arguments: str) -> subprocess.CompletedProcess[bytes]:
    command = [sys.executable, "-c", "from pmsm_rs.cli import main; main()", "track", "-", "--machine"]
    return subprocess.run([*command, str(machine), *arguments], input=data, capture_output=True, check=False)


@pytest.mark.parametrize("method", ["lm", "pso+lm"])
def test_truth_is_followed(simulated: pm.Simulation, method: str) -> None:
    windows = [w for w in pm.track(simulated.recording, simulated.machine, method=method) if w.samples > 100]
    assert len(windows) == 10
    for k, window in enumerate(windows):
        assert (window.window, window.status) == (k, "estimated")
        rows = slice(k * PER_WINDOW, (k + 1) * PER_WINDOW)
        r_s = window.parameters["r_s"]
        assert r_s.value == pytest.approx(simulated.truth.traces["r_s"][rows].mean(), rel=0.02)
        assert window.disturbed_load_torque == pytest.approx(8.0, rel=0.005)
        assert r_s.stderr is not None
        assert json.loads(window.to_json()) == window.data
        assert "r_s" in str(window)


def test_a_recording_a_file_and_a_frame_are_the_same(
    simulated: pm.Simulation, columns: dict[str, np.ndarray], tmp_path: Path
) -> None:
    rec = pm.Recording(columns, load="unknown_constant")
    file = tmp_path / "r.csv"
    file.write_bytes(text(columns, "csv"))
    first = list(pm.track(rec, simulated.machine))
    assert first == list(pm.track(columns, simulated.machine))
    assert first == list(pm.track(file, simulated.machine))


def test_a_tracker_takes_a_recording_as_its_columns(
    simulated: pm.Simulation, columns: dict[str, np.ndarray]
) -> None:
    followed, fed = (pm.Tracker(simulated.machine, window=WINDOW) for _ in range(2))
    assert followed.update(pm.Recording(columns)) == fed.update(columns)
    assert followed.state() == fed.state()


def test_missing_values_are_counted(simulated: pm.Simulation, columns: dict[str, np.ndarray]) -> None:
    holed = {name: column.copy() for name, column in columns.items()}
    holed["i_a"][400:420] = np.nan
    windows = list(pm.track(holed, simulated.machine))
    assert windows[1].samples == PER_WINDOW - 20
    assert "20 rows without a usable value, the first in column 'i_a'" in windows[1].notes[0]["finding"]
    assert not windows[0].notes


def test_state_goes_on_bit_for_bit_in_another_process(
    simulated: pm.Simulation, columns: dict[str, np.ndarray], tmp_path: Path
) -> None:
    def part(first: int, last: int) -> dict[str, np.ndarray]:
        return {name: column[first:last] for name, column in columns.items()}

    whole = pm.Tracker(simulated.machine, method="pso")
    expected = [*whole.update(columns), *whole.finish()]
    tracker = pm.Tracker(simulated.machine, method="pso")
    got = tracker.update(part(0, 1234))
    state, rest = tmp_path / "state.json", tmp_path / "rest.npz"
    state.write_bytes(tracker.state())
    np.savez(rest, **part(1234, len(columns["t"])))
    code = (
        "import sys, numpy as np, pmsm_rs as pm\n"
        "t = pm.Tracker.restore(open(sys.argv[1], 'rb').read())\n"
        "for w in [*t.update(dict(np.load(sys.argv[2]))), *t.finish()]: print(w.to_json())"
    )
    ran = subprocess.run(
        [sys.executable, "-c", code, str(state), str(rest)], capture_output=True, check=True, text=True
    )
    got += [pm.WindowEstimate.from_json(line) for line in ran.stdout.splitlines()]
    assert got == expected
    assert [w.data for w in got] == [w.data for w in expected]


def test_pickled_trackers_go_on(simulated: pm.Simulation, columns: dict[str, np.ndarray]) -> None:
    tracker = pm.Tracker(simulated.machine)
    tracker.update({name: column[:500] for name, column in columns.items()})
    again = pickle.loads(pickle.dumps(tracker))
    rest = {name: column[500:900] for name, column in columns.items()}
    assert again.update(rest) == tracker.update(rest)
    assert repr(again) == "<Tracker of r_s, tau_load in windows of 0.033 s>"


@pytest.mark.parametrize(
    "wrong",
    [b"", b"{}", b"\xff\xfe", b"null", b'{"schema": "pmsm-rs.tracker/9"}', b"[" * 10000],
)
def test_what_is_no_state_is_refused(wrong: bytes) -> None:
    with pytest.raises(pm.DataError):
        pm.Tracker.restore(wrong)


def test_a_damaged_state_is_refused(simulated: pm.Simulation) -> None:
    state = pm.Tracker(simulated.machine).state()
    assert pm.Tracker.restore(state).state() == state
    with pytest.raises(pm.DataError, match="checksum"):
        pm.Tracker.restore(state.replace(b"0.033", b"0.034"))


@pytest.mark.parametrize(
    "wrong",
    [
        {"fit": ["r_z"]},
        {"fit": []},
        {"fit": {"r_s": (1.0, 0.5)}},
        {"window": 0.0},
        {"window": float("nan")},
        {"method": "guess"},
        {"search": -1.0},
        {"seed": -1},
        {"load": "heavy"},
        {"swarm": pm.Swarm(particles=0)},
    ],
)
def test_settings_that_make_no_sense(wrong: dict[str, Any]) -> None:
    with pytest.raises(pm.UsageError):
        pm.Tracker(pm.Machine(n_p=4, r_s=0.17), **wrong)


def test_batches_must_fit_together(simulated: pm.Simulation, columns: dict[str, np.ndarray]) -> None:
    tracker = pm.Tracker(simulated.machine)
    tracker.update(columns)
    before = tracker.state()
    with pytest.raises(pm.DataError, match="was there before"):
        tracker.update({name: column for name, column in columns.items() if name != "i_a"})
    assert tracker.state() == before


@pytest.mark.skipif(not hasattr(os, "fork"), reason="Ctrl-C is sent as a signal of POSIX")
def test_ctrl_c_takes_nothing_in(simulated: pm.Simulation, columns: dict[str, np.ndarray]) -> None:
    # on one thread minutes of work, on any processor
    swarm = pm.Swarm(particles=2000, iterations=1_000_000)
    tracker = pm.Tracker(simulated.machine, method="pso", swarm=swarm, threads=1)
    before = tracker.state()
    timer = threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT))
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        tracker.update(columns)
    timer.join()
    assert tracker.state() == before


@pytest.mark.parametrize("style", ["csv", "ndjson"])
def test_standard_input_becomes_lines_of_json(
    style: str, simulated: pm.Simulation, columns: dict[str, np.ndarray], machine_file: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out.json"
    ran = piped(text(columns, style), machine_file, "--json", str(out))
    assert (ran.returncode, ran.stderr) == (0, b"")
    lines = [json.loads(line) for line in ran.stdout.splitlines()]
    machine = pm.Machine(
        n_p=4, r_s=0.19, l_d=0.0019, l_q=0.0019, psi_m=0.19197949109214762, j=0.008, b=0.00115
    )
    assert lines == [w.data for w in pm.track(columns, machine)]
    written = json.loads(out.read_text())
    assert written["schema"] == "pmsm-rs.track/1"
    assert written["windows"] == lines


def test_windows_are_written_as_they_are_complete(columns: dict[str, np.ndarray], machine_file: Path) -> None:
    command = [sys.executable, "-c", "from pmsm_rs.cli import main; main()", "track", "-", "--machine"]
    data = text(columns, "csv")
    with subprocess.Popen(
        [*command, str(machine_file)], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as child:
        assert child.stdin is not None
        assert child.stdout is not None
        lines = data.split(b"\n")
        child.stdin.write(b"\n".join(lines[: PER_WINDOW + 10]) + b"\n")
        child.stdin.flush()
        assert json.loads(child.stdout.readline())["window"] == 0
        child.stdin.write(b"\n".join(lines[PER_WINDOW + 10 :]))
        child.stdin.close()
        assert [json.loads(line)["window"] for line in child.stdout] == list(range(1, 10))
        assert child.wait() == 0


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (lambda lines: [*lines[:500], b"1,2,x"], "line 501: the line has 3 fields"),
        (lambda lines: [*lines[:500], lines[500].replace(b",", b",oops", 1)], "line 501, column 'v_d'"),
        (lambda lines: [*lines[:500], lines[500][:20]], "line 501: the line has"),
    ],
)
def test_a_bad_line_is_refused_after_what_was_complete(
    spoil: Callable[[list[bytes]], list[bytes]],
    says: str,
    columns: dict[str, np.ndarray],
    machine_file: Path,
) -> None:
    ordered = {name: columns[name] for name in ("t", "v_d", "v_q", "i_a", "i_b", "i_c", "theta_e", "omega_e")}
    ran = piped(b"\n".join(spoil(text(ordered, "csv").splitlines())), machine_file)
    assert ran.returncode == 3
    assert says in ran.stderr.decode()
    assert ran.stderr.count(b"\n") == 1
    assert len(ran.stdout.splitlines()) == 2


@pytest.mark.parametrize(
    ("data", "says"),
    [
        (b"", "nothing came"),
        (b"1,2,3\n4,5,6\n", "line 1: this is no header"),
        (b"t,t,i_d\n0,0,1\n", "column 't': two columns are called 't'"),
        (b'{"t": 0, "i_d": 1}\n{"t": 1}\n', "line 2, column 'i_d': is missing"),
        (b'{"t": 0, "i_d": 1}\n{"t": 1, "i_d": "a"}\n', "line 2, column 'i_d'"),
        (b'{"t": 0, "i_d": 1}\n{"t": 1, "i_d"', "line 2: this is no JSON"),
        (b"[1, 2]\n", "line 1: this is no JSON object"),
        (b"t,i_d\n", "no sample came behind the header"),
        (b"x" * (1 << 21), "longer than any sample"),
    ],
)
def test_streams_that_are_none(data: bytes, says: str, machine_file: Path) -> None:
    ran = piped(data, machine_file)
    assert ran.returncode == 3
    assert says in ran.stderr.decode()


class Pipe:
    """A reader that has these parts to give, one at a time."""

    def __init__(self, *parts: bytes) -> None:
        self.parts = list(parts)

    def read1(self, _size: int) -> bytes:
        return self.parts.pop(0) if self.parts else b""


def test_a_stream_without_time_goes_on_where_the_last_lot_ended() -> None:
    rules = {"t": Rule(period=0.5)}
    got = list(batches(Pipe(b"i_d,i_q\n1,2\n", b"3,4\n5,", b"6\n"), rules))
    assert [b["t"].tolist() for b in got] == [[0.0], [0.5], [1.0]]


def test_units_and_names_of_a_stream_are_those_of_a_file() -> None:
    parts = Pipe(b"# a logger\ntime [ms];i_d;n [rpm]\n0;1,5;6", b"0\n1;;120\n\n", b"2;nan;180")
    got = list(batches(parts, None))
    assert np.concatenate([b["t"] for b in got]) == pytest.approx([0.0, 1e-3, 2e-3])
    assert np.concatenate([b["i_d"] for b in got]) == pytest.approx([1.5, np.nan, np.nan], nan_ok=True)
    assert np.concatenate([b["omega_m"] for b in got]) == pytest.approx(np.array([2, 4, 6]) * np.pi)


def test_the_command_on_a_file(
    columns: dict[str, np.ndarray], machine_file: Path, tmp_path: Path, run: Run
) -> None:
    file = tmp_path / "r.csv"
    file.write_bytes(text(columns, "csv"))
    ran = run("track", str(file), "--machine", str(machine_file), "--json", str(tmp_path / "o.json"))
    assert (ran.code, ran.err) == (0, "")
    assert ran.out.count("r_s ") >= 10
    assert "10 windows" in ran.out.splitlines()[-1]
    assert len(json.loads((tmp_path / "o.json").read_text())["windows"]) == 10


def test_nothing_to_estimate_is_exit_code_4(machine_file: Path) -> None:
    ran = piped(b"t,v_d,v_q,i_d,i_q,omega_e\n0,1,1,1,1,1\n0.001,1,1,1,1,1\n", machine_file)
    assert ran.returncode == 4
    assert json.loads(ran.stdout)["status"] == "skipped"
