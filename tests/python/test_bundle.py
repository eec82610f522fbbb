"""`pmsm-rs bundle`: an archive without names that gives the same answer as the original."""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pmsm_rs as pm
import pytest
from conftest import Columns, Ran, csv_text
from pmsm_rs.support.demo import recording_files
from test_captures import NAMEPLATE, terminals

Run = Callable[..., Ran]
ROWS = 2000
SECRETS = ("acme", "Acme", "gearbox", "Prüfstand", "secret_flag", "Iq_cmd_acme", "1700000000", "bench 7")
HEADER = {"t": "time_s", "v_d": "Vd_ref", "v_q": "acme_uq", "i_a": "Ia", "i_b": "Ib", "i_c": "Ic"}
MACHINE = """
# Acme gearbox, Prüfstand 4
[machine]
poles = 8
r_s = { value = 1240, unit = "mohm" }
l_d = 0.0081577
l_q = 0.0070576
psi_m = 0.15895
j = 0.0044298
b = 0.00088934

[drive]
v_dc = 540
i_rated = 8
f_sample = 10000

[acme]
customer = "bench 7"

[columns]
t = "time_s"
v_d = "Vd_ref"
v_q = { from = "acme_uq", unit = "mV" }
i_a = "Ia"
i_b = "Ib"
i_c = "Ic"
theta_e = "theta_e"
omega_e = "omega_e"
"""


@pytest.fixture
def bench(tmp_path: Path) -> tuple[Path, Path]:
    """A log and its machine file as they lie on somebody's disk."""
    whole = pm.load(recording_files()[0])
    columns = {name: whole.column(name)[:ROWS] for name in whole.names}
    columns["t"] = 1_700_000_000.0 + columns["t"]
    columns["v_q"] = 1e3 * columns["v_q"]
    columns["secret_flag"] = np.arange(ROWS) % 2.0
    columns["Iq_cmd_acme"] = np.ones(ROWS)
    folder = tmp_path / "acme"
    folder.mkdir()
    (folder / "gearbox.csv").write_text(csv_text(columns, HEADER))
    (folder / "gearbox.toml").write_text(MACHINE)
    return folder / "gearbox.csv", folder / "gearbox.toml"


def opened(archive: Path, folder: Path) -> Path:
    with zipfile.ZipFile(archive) as file:
        file.extractall(folder)
    return folder


def rounded(value: object) -> object:
    """Numbers of an answer to six digits: times from zero differ in the last ones."""
    if isinstance(value, dict):
        return {name: rounded(part) for name, part in value.items()}
    if isinstance(value, list):
        return [rounded(part) for part in value]
    return float(f"{value:.6g}") if isinstance(value, float) else value


def test_the_bundle_gives_the_same_answer(bench: tuple[Path, Path], tmp_path: Path, run: Run) -> None:
    recording, machine = bench
    given = run("diagnose", recording, "--machine", machine, "--json", tmp_path / "answer.json")
    assert given.code == 0, given.err
    made = run(
        *("bundle", recording, "--machine", machine, "--answer", tmp_path / "answer.json"),
        *("-o", tmp_path / "bug.zip"),
    )
    assert made.code == 0, made.err
    folder = opened(tmp_path / "bug.zip", tmp_path / "bug")
    ran = run("diagnose", folder / "recording.parquet", "--machine", folder / "machine.toml", "--json", "-")
    assert ran.code == 0, ran.err
    first, second = json.loads((tmp_path / "answer.json").read_text()), json.loads(ran.out)
    assert second["verdict"] == "named"
    for part in ("verdict", "model", "ranking", "fit", "noise_floor", "located", "cannot_see"):
        assert rounded(first[part]) == rounded(second[part]), part
    packed = json.loads((folder / "answer.json").read_text())
    assert packed["model"] == first["model"]


def test_no_name_is_left_in_it(bench: tuple[Path, Path], tmp_path: Path, run: Run) -> None:
    recording, machine = bench
    run("diagnose", recording, "--machine", machine, "--json", tmp_path / "answer.json")
    assert any(secret in (tmp_path / "answer.json").read_text() for secret in SECRETS)
    ran = run(
        *("bundle", recording, "--machine", machine, "--answer", tmp_path / "answer.json"),
        *("--validate", recording, "-o", tmp_path / "bug.zip"),
    )
    assert ran.code == 0, ran.err
    names = {"recording.parquet", "validation.parquet", "machine.toml", "answer.json", "about.json"}
    with zipfile.ZipFile(tmp_path / "bug.zip") as archive:
        assert set(archive.namelist()) == names
        for name in names:
            content = archive.read(name)
            for secret in SECRETS:
                assert secret.encode() not in content, (name, secret)
    for words in (
        "recording: its name and folder",
        "recording: names of 6 columns",
        "recording: 2 columns that are not used",
        "recording: the time at which it begins",
        "machine file: comments",
        "machine file: [acme]",
        "machine file: [columns]",
        "machine file: machine.poles",
        "answer: 'read'",
        "recording.parquet   2000 rows of t, v_d, v_q, i_a, i_b, i_c, theta_e, omega_e",
    ):
        assert words in ran.out, ran.out
    assert "validation.parquet" in ran.out.split("Next")[1]


def test_the_machine_file_is_reduced_to_known_keys(
    bench: tuple[Path, Path], tmp_path: Path, run: Run
) -> None:
    recording, machine = bench
    run("bundle", recording, "--machine", machine, "-o", tmp_path / "bug.zip")
    folder = opened(tmp_path / "bug.zip", tmp_path / "bug")
    from pmsm_rs.config.machine_file import read_machine

    old, new = read_machine(machine), read_machine(folder / "machine.toml")
    assert (new.machine, new.load, new.load_value) == (old.machine, old.load, old.load_value)
    assert new.columns == {}
    assert new.converted == ()


def test_the_same_recording_gives_the_same_bytes(bench: tuple[Path, Path], tmp_path: Path, run: Run) -> None:
    recording, machine = bench
    for name in ("a.zip", "b.zip"):
        run("bundle", recording, "--machine", machine, "-o", tmp_path / name)
    assert (tmp_path / "a.zip").read_bytes() == (tmp_path / "b.zip").read_bytes()


@pytest.mark.parametrize(
    ("rows", "first", "count"), [("500", 0, 500), ("100:600", 100, 500), ("1900:", 1900, 100), (":50", 0, 50)]
)
def test_rows_limit_it(
    rows: str, first: int, count: int, bench: tuple[Path, Path], tmp_path: Path, run: Run
) -> None:
    recording, machine = bench
    ran = run("bundle", recording, "--machine", machine, "--rows", rows, "-o", tmp_path / "bug.zip")
    assert ran.code == 0, ran.err
    assert f"{ROWS - count} of {ROWS} rows" in ran.out
    folder = opened(tmp_path / "bug.zip", tmp_path / "bug")
    cut, whole = pm.load(folder / "recording.parquet"), pm.load(recording, machine)
    assert len(cut) == count
    assert np.array_equal(cut.column("i_a"), whole.column("i_a")[first : first + count])
    assert cut.column("t")[0] == 0.0
    assert cut.duration == pytest.approx((count - 1) * 1e-4, rel=1e-3)


@pytest.mark.parametrize(
    ("rows", "code", "words"),
    [
        ("x", 2, "says no rows"),
        ("-5", 2, "says no rows"),
        ("1:2:3", 2, "says no rows"),
        ("1", 3, "keep at least 2"),
        ("1999:", 3, "keep at least 2"),
    ],
)
def test_rows_that_make_no_recording_are_refused(
    rows: str, code: int, words: str, bench: tuple[Path, Path], tmp_path: Path, run: Run
) -> None:
    recording, machine = bench
    ran = run("bundle", recording, "--machine", machine, f"--rows={rows}", "-o", tmp_path / "bug.zip")
    assert ran.code == code
    assert words in ran.err
    assert not (tmp_path / "bug.zip").exists()


def test_what_is_derived_is_derived_again(tmp_path: Path, run: Run) -> None:
    """A capture keeps its phase voltages: its angle counts as taken from them, not as measured."""
    columns: Columns = terminals(lambda t: 150.0 + 300.0 * t, seconds=0.4)
    (tmp_path / "c.csv").write_text(csv_text(columns))
    plate = {name: getattr(NAMEPLATE, name) for name in ("n_p", "r_s", "l_d", "l_q", "psi_m")}
    lines = [f"{name} = {value}" for name, value in plate.items()]
    (tmp_path / "c.toml").write_text("\n".join(["[machine]", *lines]))
    ran = run("bundle", tmp_path / "c.csv", "--machine", tmp_path / "c.toml", "-o", tmp_path / "bug.zip")
    assert ran.code == 0, ran.err
    folder = opened(tmp_path / "bug.zip", tmp_path / "bug")
    old = pm.load(tmp_path / "c.csv", tmp_path / "c.toml")
    new = pm.load(folder / "recording.parquet", folder / "machine.toml")
    assert (new.names, new.kind, new.load, new.angle_error) == (
        old.names,
        old.kind,
        old.load,
        old.angle_error,
    )
    assert {remark.finding for remark in new.account.remarks} == {
        remark.finding for remark in old.account.remarks
    }
    for name in old.names:
        np.testing.assert_allclose(new.column(name), old.column(name), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    "content",
    [
        "no JSON",
        '{"parameters": {}, "method": NaN}',
        "[]",
        "{}",
        '"text"',
        '{"verdict": "named", "model": 1}',
        '{"parameters": {"r_s": 1}, "method": "lm"}',
        '{"verdict": "named", "model": {}, "read": 5}',
    ],
)
def test_what_is_no_answer_is_refused(
    content: str, bench: tuple[Path, Path], tmp_path: Path, run: Run
) -> None:
    recording, machine = bench
    (tmp_path / "a.json").write_text(content)
    ran = run(
        *("bundle", recording, "--machine", machine, "--answer", tmp_path / "a.json"),
        *("-o", tmp_path / "bug.zip"),
    )
    assert ran.code == 3
    assert "a.json" in ran.err
    assert not (tmp_path / "bug.zip").exists()


def test_an_identification_is_an_answer(bench: tuple[Path, Path], tmp_path: Path, run: Run) -> None:
    recording, machine = bench
    answer = tmp_path / "a.json"
    run("identify", recording, "--machine", machine, "--fit", "r_s", "--method", "lm", "--json", answer)
    ran = run("bundle", recording, "--machine", machine, "--answer", answer, "-o", tmp_path / "bug.zip")
    assert ran.code == 0, ran.err
    assert "identification, by version" in ran.out


def test_a_file_is_not_written_over_what_it_is_made_from(bench: tuple[Path, Path], run: Run) -> None:
    recording, machine = bench
    ran = run("bundle", recording, "--machine", machine, "-o", machine)
    assert ran.code == 2
    assert machine.read_text() == MACHINE
