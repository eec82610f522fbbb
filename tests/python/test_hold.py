"""Whatever is in the way, a command ends with a documented code and a sentence: full disks, closed streams,
pipes, signals, files outside the folder, and ledgers that are damaged.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import hostile
import numpy as np
import pmsm_rs as pm
import pytest
from conftest import MACHINE, PACKAGE, Ran, csv_text, plausible

Run = Callable[..., Ran]
COMMAND = [
    sys.executable,
    "-c",
    f"import sys; sys.path.insert(0, {str(PACKAGE.parent)!r}); from pmsm_rs.cli import main; main()",
]
needs_devices = pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no /dev/full")


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    path = tmp_path / "r.csv"
    path.write_text(csv_text(plausible()))
    return path


def shell(command: str, *arguments: object, **options: Any) -> subprocess.CompletedProcess[bytes]:
    """`pmsm-rs` with `arguments` in a shell that has it as "$@"."""
    line = ["bash", "-c", command, "bash", *COMMAND, *map(str, arguments)]
    return subprocess.run(line, capture_output=True, check=False, timeout=120, **options)


@needs_devices
@pytest.mark.parametrize(
    ("command", "code", "says"),
    [
        ('"$@" >/dev/full', 2, b"standard output: cannot be written"),
        ('"$@" >&-', 2, b"it is closed"),
        ('"$@" 2>&-', 0, b""),
        ('"$@" 2>/dev/full', 0, b""),
        ('"$@" <&- 2>&- >&-', 2, b""),
        ('"$@" | head -c 1 >/dev/null; exit ${PIPESTATUS[0]}', 0, b""),
    ],
)
def test_standard_streams_that_take_nothing(command: str, code: int, says: bytes, recording: Path) -> None:
    ran = shell(command, "inspect", recording)
    assert ran.returncode == code, ran.stderr
    assert says in ran.stderr
    assert ran.stderr.count(b"\n") <= 1


@needs_devices
def test_an_answer_is_printed_though_its_files_cannot_be_written(recording: Path, run: Run) -> None:
    ran = run("inspect", recording, "--json", "/dev/full", "--write", "/dev/full", "--force")
    assert ran.code == 2
    assert ran.err.count("/dev/full: cannot be written (No space left on device)") == 2
    assert "Columns that are used" in ran.out


@needs_devices
def test_files_are_written_though_the_answer_cannot_be_printed(recording: Path, tmp_path: Path) -> None:
    ran = shell('"$@" >/dev/full', "inspect", recording, "--json", tmp_path / "a.json")
    assert ran.returncode == 2
    assert json.loads((tmp_path / "a.json").read_text())["file"] == str(recording)


@pytest.mark.skipif(sys.platform != "linux", reason="names of files are bytes on Linux")
def test_a_name_that_is_no_text_and_steers_the_terminal(recording: Path, tmp_path: Path) -> None:
    odd = os.fsencode(tmp_path) + b"/\xff\x1b[2J.csv"
    Path(os.fsdecode(odd)).write_bytes(recording.read_bytes())
    (tmp_path / "m.toml").write_text(MACHINE)
    for arguments in (["inspect"], ["fleet", "--machine", tmp_path / "m.toml"]):
        answer = tmp_path / "a.json"
        ran = shell('"$@"', *arguments, os.fsdecode(odd), "--json", answer)
        assert ran.returncode in (0, 3)
        assert b"\x1b" not in ran.stdout + ran.stderr
        assert b"internal" not in ran.stderr
        json.loads(answer.read_bytes())


def test_drafts_have_the_rights_of_new_files(recording: Path, tmp_path: Path, run: Run) -> None:
    plain = tmp_path / "plain"
    plain.touch()
    assert run("inspect", recording, "--json", tmp_path / "a.json").code == 0
    assert (tmp_path / "a.json").stat().st_mode == plain.stat().st_mode
    assert {path.name for path in tmp_path.iterdir()} == {"r.csv", "plain", "a.json"}


def interrupted(number: int, folder: Path, *arguments: object) -> tuple[int, bytes]:
    """Starts a command, signals it as it has begun to import, and gives exit code and standard error."""
    began = folder / "began"
    script = (
        f"import sys; sys.path.insert(0, {str(PACKAGE.parent)!r}); import pathlib, signal\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "from pmsm_rs.cli import main, process\n"
        "prepare = process.prepare\n"
        f"def begun(own): prepare(own); pathlib.Path({str(began)!r}).touch()\n"
        "process.prepare = begun\n"
        "main()\n"
    )
    command = [sys.executable, "-c", script, *map(str, arguments)]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as process:
        while not began.exists() and process.poll() is None:
            time.sleep(0.001)
        process.send_signal(number)
        _, err = process.communicate(timeout=120)
    began.unlink(missing_ok=True)
    return process.returncode, err


@pytest.mark.skipif(os.name == "nt", reason="signals of POSIX")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_while_modules_are_imported(number: int, recording: Path, tmp_path: Path) -> None:
    (tmp_path / "m.toml").write_text(MACHINE)
    given = ["--machine", tmp_path / "m.toml"]
    for arguments in (["inspect", recording], ["diagnose", recording, *given], ["fleet", recording, *given]):
        code, err = interrupted(number, tmp_path, *arguments)
        assert code == 130
        assert b"Traceback" not in err
        assert err.startswith(b"pmsm-rs: interrupted")


def outside(tmp_path: Path) -> tuple[Path, Path]:
    """A recording whose machine file takes a column from another folder, and that machine file."""
    (tmp_path / "in").mkdir()
    recording, other = tmp_path / "in" / "r.csv", tmp_path / "other.csv"
    recording.write_text(csv_text(plausible()))
    other.write_text("t,x\n" + "".join(f"{float(t)!r},24.0\n" for t in plausible()["t"]))
    machine = tmp_path / "m.toml"
    machine.write_text(f'{MACHINE}[columns]\nv_dc = {{ from = "x", unit = "V", file = "../other.csv" }}\n')
    return recording, machine


def test_columns_come_from_the_folder_of_the_recording(tmp_path: Path, run: Run) -> None:
    recording, machine = outside(tmp_path)
    with pytest.raises(pm.MachineError, match=r"outside of the folder.*--allow-outside"):
        pm.load(recording, machine)
    assert pm.load(recording, machine, allow_outside=True).column("v_dc")[0] == 24.0
    assert run("inspect", recording, "--machine", machine).code == 3
    assert run("inspect", recording, "--machine", machine, "--allow-outside").code == 0
    assert run("diagnose", recording, "--machine", machine).code == 3
    (recording.parent / "link.csv").symlink_to(tmp_path / "other.csv")
    machine.write_text(machine.read_text().replace("../other.csv", "link.csv"))
    with pytest.raises(pm.MachineError, match="outside of the folder"):
        pm.load(recording, machine)


def test_standard_input_is_a_recording(recording: Path) -> None:
    for name in ("-", "/dev/stdin"):
        ran = shell('cat "$0" | "$@"'.replace("$0", str(recording)), "inspect", name)
        assert ran.returncode == 0, ran.stderr
        assert b"400 rows" in ran.stdout


def test_pipes_and_devices_are_refused_at_once(recording: Path, tmp_path: Path, run: Run) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    (tmp_path / "m.toml").write_text(MACHINE)
    machine = ("--machine", tmp_path / "m.toml")
    for odd in (pipe, "/dev/zero"):
        for arguments in (
            ("inspect", odd),
            ("inspect", recording, "--machine", odd),
            ("track", odd, *machine),
            ("fleet", recording, *machine, "--ledger", odd),
        ):
            ran = run(*arguments)
            assert (ran.code, "a pipe or a device" in ran.err) == (2, True)
        assert run("fleet", odd, *machine).code == 3


def test_lines_of_a_ledger_that_are_damaged_are_named(recording: Path, tmp_path: Path, run: Run) -> None:
    (tmp_path / "m.toml").write_text(MACHINE)
    ledger = tmp_path / "ledger"
    command = ("fleet", recording, "--machine", tmp_path / "m.toml", "--ledger", ledger)
    assert run(*command).err == ""
    schema, entry = ledger.read_text().splitlines()
    key = json.loads(entry)["key"]
    odd = [
        "[" * 100_000,
        '{"key": 5}',
        "1" * 10_000,
        json.dumps({"key": key, "answer": {"schema": "none"}}),
        '{"key": "torn',
    ]
    ledger.write_text("\n".join([schema, *odd]))
    ran = run(*command)
    assert ran.code == 0
    assert [line.split(":")[1] for line in ran.err.splitlines()] == [
        f" {ledger}, line {number}" for number in (2, 3, 4, 5)
    ]
    assert "torn" not in ran.err


@pytest.mark.parametrize("torn", ['{"sch', '{"schema": "pmsm-rs.ledger/1"}', "\n"])
def test_a_first_line_that_is_torn_is_passed_over(
    torn: str, recording: Path, tmp_path: Path, run: Run
) -> None:
    (tmp_path / "m.toml").write_text(MACHINE)
    ledger = tmp_path / "ledger"
    ledger.write_text(torn)
    command = ("fleet", recording, "--machine", tmp_path / "m.toml", "--ledger", ledger)
    for _ in range(2):
        ran = run(*command)
        assert (ran.code, ran.err) == (0, "")
    assert sum('"key"' in line for line in ledger.read_text().splitlines()) == 1


@pytest.mark.parametrize(
    "command", ['"$@" | true; exit ${PIPESTATUS[0]}', '"$@" 2>&1 | true; exit ${PIPESTATUS[0]}']
)
@pytest.mark.parametrize("arguments", [["effects"], ["--help"], ["explain", "PR001"], ["man"]])
def test_a_reader_that_has_gone_is_no_fault(command: str, arguments: list[str]) -> None:
    ran = shell(command, *arguments)
    assert (ran.returncode, ran.stderr) == (0, b"")


def test_a_disk_that_fills_up_leaves_no_half_of_a_table(recording: Path, tmp_path: Path) -> None:
    drive = Path(__file__).parents[2] / "docs" / "examples" / "drive.toml"
    for name in ("t.parquet", "t.csv"):
        out = tmp_path / name
        ran = shell('ulimit -f 1; "$@"', "simulate", drive, "-o", out)
        assert (ran.returncode, out.exists()) == (2, False)
        assert ran.stderr.startswith(b"pmsm-rs: %s: cannot be written" % os.fsencode(out))
    assert [path.name for path in tmp_path.iterdir()] == ["r.csv"]


@pytest.mark.parametrize("odd", [None, [], {"a": {"b": []}}, "\x1b[2J", [[[]]], 1e308])
@pytest.mark.parametrize(
    "place",
    [("machine", "n_p"), ("ranking", 0, "gain_held_out"), ("model", "base", "r_s", "unit"), ("model",)],
)
def test_an_answer_that_was_changed_is_used_or_refused(
    place: tuple[str | int, ...], odd: object, sealed_answer: str, tmp_path: Path, run: Run
) -> None:
    answer = json.loads(sealed_answer)
    part: Any = answer
    for step in place[:-1]:
        part = part[step]
    part[place[-1]] = odd
    path = tmp_path / "a.json"
    path.write_text(json.dumps(answer))
    for arguments in (["report", path], ["export", path, "--to", "mujoco"]):
        ran = run(*arguments, "-o", tmp_path / "out.xml")
        assert ran.code in (0, 2, 3)
        assert "internal" not in ran.err


@pytest.fixture(scope="module")
def sealed_answer(short_demo: tuple[str, str, str]) -> str:
    """The answer to the demo, as text."""
    recording, _, machine = short_demo
    return pm.diagnose(recording, machine).to_json()


def test_numbers_that_overflow_bring_no_warnings_of_libraries(tmp_path: Path) -> None:
    columns = dict(plausible())
    columns["t"] = 1e308 * np.linspace(-1.0, 1.0, len(columns["t"]))
    (tmp_path / "r.csv").write_text(csv_text(columns))
    ran = shell('"$@"', "inspect", tmp_path / "r.csv")
    assert ran.returncode in (0, 3)
    assert b"Warning" not in ran.stderr


def test_numbers_that_are_lost_in_computing_are_refused(recording: Path, tmp_path: Path) -> None:
    machine = tmp_path / "m.toml"
    machine.write_text(MACHINE + "[drive]\nv_dc = 1e-320\n")
    with pytest.raises(pm.MachineError, match=r"drive.v_dc: 1e-320 is too small to compute with"):
        pm.load(recording, machine)
    machine.write_text(MACHINE)
    with pytest.raises(pm.UsageError, match=r"window is 1e-320; give a length in s, at least 1e-09"):
        pm.Tracker(machine, window=1e-320)


@pytest.mark.parametrize("name", hostile.MACHINES)
def test_hostile_machine_files_get_a_short_answer(name: str, recording: Path, tmp_path: Path) -> None:
    path = hostile.write(tmp_path, name, "toml", hostile.MACHINES[name]())
    try:
        text = str(pm.inspect(recording, path))
    except pm.MachineError as error:
        text = str(error)
        assert str(path) in text
    assert len(text) < 10_000
    assert "\x1b" not in text


@pytest.mark.parametrize(
    "name", [name for name in hostile.RECORDINGS if not {"60", "50", "200", "20"} & set(name.split())]
)
def test_hostile_recordings_get_a_short_answer(name: str, tmp_path: Path) -> None:
    suffix, content = hostile.RECORDINGS[name]
    path = hostile.write(tmp_path, name, suffix, content())
    try:
        text = str(pm.inspect(path))
    except pm.DataError as error:
        text = str(error)
        assert str(path) in text
    assert len(text) < 10_000
    assert "\x1b" not in text


@pytest.mark.parametrize("name", hostile.STREAMS)
def test_hostile_streams_get_a_sentence(name: str, tmp_path: Path) -> None:
    (tmp_path / "m.toml").write_text(MACHINE)
    ran = subprocess.run(
        [*COMMAND, "track", "-", "--machine", str(tmp_path / "m.toml")],
        input=hostile.STREAMS[name](),
        capture_output=True,
        check=False,
        timeout=120,
    )
    assert ran.returncode in (3, 4)
    assert ran.stderr.count(b"\n") <= 1
    assert len(ran.stderr) < 2000
    assert b"\x1b" not in ran.stdout + ran.stderr
