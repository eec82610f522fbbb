"""The border to Rust: stubs, pickling, errors, threads and interrupts."""

from __future__ import annotations

import ast
import json
import os
import pickle
import signal
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pmsm_rs as pm
import pytest
from conftest import Columns
from pmsm_rs import _core
from pmsm_rs.config.machine_file import read_machine
from pmsm_rs.support.demo import recording_files

PACKAGE = Path(pm.__file__).parent


def demo() -> tuple[pm.Recording, pm.Recording, pm.Machine]:
    recording, validation, machine = recording_files()
    return pm.load(recording, machine), pm.load(validation, machine), read_machine(machine).machine


def stubs() -> dict[str, set[str]]:
    """Names in _core.pyi, each with the names of its members."""
    tree = ast.parse((PACKAGE / "_core.pyi").read_text())
    out: dict[str, set[str]] = {}
    for node in tree.body:
        if isinstance(node, ast.ClassDef):
            out[node.name] = {item.name for item in node.body if isinstance(item, ast.FunctionDef)}
        elif isinstance(node, ast.FunctionDef):
            out[node.name] = set()
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            out[node.target.id] = set()
    return out


def test_stubs_cover_every_export() -> None:
    hidden = {"__doc__", "__file__", "__loader__", "__name__", "__package__", "__spec__", "__all__"}
    assert set(stubs()) == {name for name in vars(_core) if name not in hidden}


@pytest.mark.parametrize("name", ["Machine", "Recording"])
def test_stubs_cover_every_member(name: str) -> None:
    kind = getattr(_core, name)
    public = {member for member in vars(kind) if not member.startswith("_")}
    assert public <= stubs()[name]
    assert all(hasattr(kind, member) for member in stubs()[name])


def test_everything_promised_is_there() -> None:
    assert set(dir(pm)) == set(pm.__all__)
    for name in pm.__all__:
        assert getattr(pm, name) is not None
    with pytest.raises(AttributeError, match="nonsense"):
        pm.nonsense  # noqa: B018


@pytest.mark.parametrize(
    "kind", ["DataError", "MachineError", "UsageError", "NotIdentifiableError", "InternalError"]
)
def test_every_error_is_a_pmsm_error(kind: str) -> None:
    assert issubclass(getattr(pm, kind), pm.PmsmError)


def test_a_machine_is_a_value() -> None:
    machine = pm.Machine(n_p=3, r_s=0.9, l_d=0.0096, l_q=0.0213, psi_m=0.193, j=0.0126, b=0.0017, v_dc=540.0)
    assert pickle.loads(pickle.dumps(machine)) == machine
    assert hash(pickle.loads(pickle.dumps(machine))) == hash(machine)
    assert machine != pm.Machine(n_p=3)
    assert "r_s=0.9" in repr(machine)
    assert eval(repr(machine), {"Machine": pm.Machine}) == machine
    with pytest.raises(AttributeError):
        machine.r_s = 1.0  # type: ignore[misc]


@pytest.mark.parametrize(
    "bad",
    [
        {"n_p": 0},
        {"n_p": -3},
        {"n_p": 3, "j": -1.0},
        {"n_p": 3, "r_s": float("nan")},
        {"n_p": 3, "v_dc": 0.0},
    ],
)
def test_absurd_machines_are_refused(bad: dict[str, float]) -> None:
    with pytest.raises(pm.MachineError):
        pm.Machine(**bad)  # type: ignore[arg-type]


def test_a_recording_is_a_value(columns: Columns) -> None:
    recording = pm.Recording(columns, load="known_constant", load_value=1.5)
    again = pickle.loads(pickle.dumps(recording))
    assert (again.load, again.load_value, again.names) == ("known_constant", 1.5, recording.names)
    for name in columns:
        np.testing.assert_array_equal(again.column(name), recording.column(name))
    columns["i_d"][:] = 0.0
    assert np.any(recording.column("i_d")), "a recording keeps a copy"


def test_the_core_names_row_column_and_fix(columns: Columns) -> None:
    columns["i_q"][33] = 1e13
    with pytest.raises(_core.DataError) as caught:
        _core.Recording(columns)
    assert caught.value.row == 33  # type: ignore[attr-defined]
    assert caught.value.column == "i_q"  # type: ignore[attr-defined]
    assert caught.value.fix  # type: ignore[attr-defined]


def test_identification_has_the_same_bits_for_any_number_of_threads() -> None:
    recording, _, machine = demo()
    swarm = pm.Swarm(particles=8, iterations=4)
    answers = {
        pm.identify(recording, machine, fit=["r_s", "psi_m"], swarm=swarm, seed=3, threads=threads).to_json()
        for threads in (1, 2, 4)
    }
    assert len(answers) == 1


def test_a_bare_search_answers_values_alone() -> None:
    recording, _, machine = demo()
    whole, bare = (
        pm.identify(recording, machine, fit=["r_s", "psi_m"], method="lm", uncertainties=asked)
        for asked in (True, False)
    )
    assert bare.cost == whole.cost
    for name, estimate in bare.parameters.items():
        assert estimate.value == whole.parameters[name].value
        assert estimate.stderr is None
        assert estimate.why_none == "uncertainties were not asked for"
    assert not bare.rms
    assert whole.rms


def test_diagnosis_has_the_same_bits_for_any_number_of_threads() -> None:
    recording, validation, machine = demo()
    answers = [pm.diagnose(recording, machine, validation, seed=3, threads=threads) for threads in (1, 3)]
    assert answers[0].to_json() == answers[1].to_json()
    for name, values in answers[0].traces["validation"].items():
        np.testing.assert_array_equal(values, answers[1].traces["validation"][name])


def test_bounds_are_honoured() -> None:
    recording, _, machine = demo()
    answer = pm.identify(recording, machine, fit={"r_s": (0.5, 0.9)}, method="pso", swarm=pm.Swarm(10, 10))
    value = answer.parameters["r_s"].value
    assert value is not None
    assert 0.5 <= value <= 0.9
    assert list(answer.history) == sorted(answer.history, reverse=True)


@pytest.mark.parametrize(
    "bad", [{"r_s": (1.0, 0.5)}, {"r_s": (0.0, float("inf"))}, {"r_s": (1.0,)}, {"r_t": None}, {}]
)
def test_bad_bounds_are_usage_errors(bad: dict[str, object]) -> None:
    recording, _, machine = demo()
    with pytest.raises(pm.UsageError):
        pm.identify(recording, machine, fit=bad)  # type: ignore[arg-type]


@pytest.mark.parametrize("threads", [1, None])
def test_a_failing_progress_callback_is_not_swallowed(threads: int | None) -> None:
    recording, validation, machine = demo()

    def progress(stage: str, fraction: float) -> None:
        raise LookupError(stage)

    with pytest.raises(LookupError):
        pm.diagnose(recording, machine, validation, threads=threads, progress=progress)


def test_a_machine_file_is_taken_for_its_machine() -> None:
    file, _, machine_file = recording_files()
    recording = pm.load(file, machine_file)
    one, two = (
        pm.identify(recording, machine, fit=["r_s"], method="lm")
        for machine in (machine_file, read_machine(machine_file).machine)
    )
    assert one.to_json() == two.to_json()
    with pytest.raises(pm.UsageError, match=r"none\.toml"):
        pm.identify(recording, "none.toml", fit=["r_s"], method="lm")


@pytest.mark.skipif(not hasattr(os, "fork"), reason="Ctrl-C is sent as a signal of POSIX")
@pytest.mark.parametrize("threads", [1, None])
def test_ctrl_c_gives_the_best_so_far(threads: int | None) -> None:
    assert threading.current_thread() is threading.main_thread()
    recording, validation, machine = demo()
    told: list[float] = []

    def progress(stage: str, fraction: float) -> None:
        assert stage
        told.append(fraction)
        if len(told) == 1:
            os.kill(os.getpid(), signal.SIGINT)

    answer = pm.diagnose(recording, machine, validation, threads=threads, progress=progress)
    assert told
    assert all(0.0 <= fraction <= 1.0 for fraction in told)
    assert answer.interrupted
    # what was not tried is neither missing from the catalogue nor absent
    assert answer.verdict == "undetermined"
    assert json.loads(answer.to_json())["interrupted"] is True


@pytest.mark.skipif(not hasattr(os, "fork"), reason="Ctrl-C is sent as a signal of POSIX")
def test_ctrl_c_on_the_command_line_writes_the_best_so_far(tmp_path: Path) -> None:
    recording, validation, machine = recording_files()
    # The signal comes with the first word of progress, so that nothing depends on how fast this machine is.
    code = (
        "import os, signal, sys\n"
        "from pmsm_rs.cli import main, terminal\n"
        "stop = lambda stage, fraction: os.kill(os.getpid(), signal.SIGINT)\n"
        "terminal.progress = lambda stages=None: stop\n"
        "main(sys.argv[1:])\n"
    )
    arguments = ["diagnose", recording, "--machine", machine, "--validate", validation, "--json", "a.json"]
    ran = subprocess.run(
        [sys.executable, "-c", code, *arguments], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert ran.returncode == 130, ran.stderr
    assert json.loads((tmp_path / "a.json").read_text())["interrupted"] is True
    assert "best so far" in ran.stdout
    assert [path.name for path in tmp_path.iterdir()] == ["a.json"]


@pytest.mark.parametrize(("seed", "threads"), [(-1, None), (2**63, None), (1.5, 1), (1, 0), (1, -1)])
def test_what_is_no_count_is_refused(columns: Columns, seed: int, threads: int | None) -> None:
    recording, machine = pm.Recording(columns), pm.Machine(n_p=3)
    for ask in (pm.diagnose, pm.identify):
        with pytest.raises(pm.UsageError, match="give a whole number from"):
            ask(recording, machine, seed=seed, threads=threads)  # type: ignore[operator]
    with pytest.raises(pm.UsageError, match="give a whole number from"):
        pm.Tracker(machine, seed=seed, threads=threads)


def test_what_is_no_recording_is_refused_with_the_way_to_one(columns: Columns) -> None:
    recording, machine = pm.Recording(columns), pm.Machine(n_p=3)
    words = r"a list was given where a Recording is expected.*pmsm_rs\.load"
    with pytest.raises(pm.UsageError, match=words):
        pm.identify([recording], machine)  # type: ignore[arg-type]
    with pytest.raises(pm.UsageError, match=words):
        pm.diagnose([recording, [1.0]], machine)  # type: ignore[list-item]
    with pytest.raises(pm.UsageError, match=words):
        pm.diagnose(recording, machine, [recording])  # type: ignore[arg-type]
    with pytest.raises(pm.UsageError, match="a dict was given"):
        pm.identify(columns, machine)  # type: ignore[arg-type]
