"""No unusable recording is accepted silently: each is refused with the file, the place and a way out."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pmsm_rs as pm
import pytest
from bad_content import (
    changed,
    edited,
    lines_of,
    mat_bytes,
    mechanical_angle,
    npz_bomb,
    npz_bytes,
    npz_deflated_bomb,
    parquet_bomb,
    parquet_bytes,
    parquet_of_text,
    parquet_with_gap,
    pickled_objects,
    renamed,
    time_edited,
    without,
)
from conftest import Ran, csv_text, plausible

Run = Callable[..., Ran]


NO_NUMBER, NO_TIME, GAP = "is no number", "time", "missing"


# name -> (file name, bytes, words that the message must hold, line or row it must name or None)
BAD: dict[str, tuple[str, bytes | Callable[[], bytes], list[str], int | None]] = {
    "no current": ("r.csv", without("i_d", "i_q"), ["i_q", "missing"], None),
    "no speed": ("r.csv", without("omega_e", "theta_e"), ["omega_e", "missing"], None),
    "no time": ("r.csv", without("t"), ["time", "period"], None),
    "speed in doubt": ("r.csv", renamed(omega_e="speed [rad/s]", theta_e="x"), ["speed", "mechanical"], None),
    "angle in doubt": ("r.csv", renamed(theta_e="position [rad]"), ["position", "theta_m"], None),
    "time without unit": ("r.csv", renamed(t="time"), ["time", "unit"], None),
    "speed without unit": ("r.csv", renamed(omega_e="omega_el", theta_e="x"), ["omega_el", "unit"], None),
    "unit of another kind": ("r.csv", renamed(i_d="i_d [V]"), ["i_d", "voltage", "current"], None),
    "unknown unit": ("r.csv", renamed(i_d="i_d [furlong]"), ["furlong"], None),
    "effective phase value": (
        "r.csv",
        csv_text(
            {**plausible(), "i_a": plausible()["i_d"], "i_b": plausible()["i_d"]}, {"i_a": "i_a [A rms]"}
        ).encode(),
        ["effective"],
        None,
    ),
    "text in numbers": ("r.csv", edited(20, "i_d", "broken"), ["'broken'", NO_NUMBER, "i_d"], 20),
    "OVER in the middle": ("r.csv", edited(31, "v_q", "OVER"), ["'OVER'", NO_NUMBER, "v_q"], 31),
    "OVER in the first row": ("r.csv", edited(2, "v_q", "OVER"), ["'OVER'", NO_NUMBER], 2),
    "NaN": ("r.csv", edited(40, "i_q", "nan"), ["i_q", "not a number"], 40),
    "infinity": ("r.csv", edited(41, "i_q", "inf"), ["i_q", "infinite"], 41),
    "1e400": ("r.csv", edited(42, "i_q", "1e400"), ["i_q", "too large"], 42),
    "overflow mark": ("r.csv", edited(43, "i_q", "9.9e37"), ["i_q", "the value is 99"], 43),
    "empty cell": ("r.csv", edited(44, "i_q", ""), ["i_q", GAP], 44),
    "time running backwards": ("r.csv", time_edited(50, 0.001), ["runs back", "sort"], 52),
    "time standing still": ("r.csv", time_edited(50, 0.049), ["stands still"], 52),
    "empty file": ("r.csv", b"", ["empty"], None),
    "blank file": ("r.csv", b"\n\n  \n", ["no table"], None),
    "header only": ("r.csv", lines_of()[0].encode(), ["header", "no rows"], None),
    "no header": ("r.csv", "\n".join(lines_of()[1:]).encode(), ["no header", "column 1"], None),
    "too few samples": ("r.csv", "\n".join(lines_of()[:9]).encode(), ["8 samples", "16"], None),
    "a row too short": ("r.csv", "\n".join([*lines_of()[:60], "0.06,1"]).encode(), ["2 fields", "7"], 61),
    "cut short": ("r.csv", "\n".join(lines_of()).encode()[:-90], ["fields"], None),
    "a row too long": (
        "r.csv",
        "\n".join([*lines_of()[:60], lines_of()[60] + ",1"]).encode(),
        ["8 fields"],
        61,
    ),
    "duplicate column": ("r.csv", renamed(v_d="i_d"), ["two columns", "i_d"], None),
    "two columns for one quantity": ("r.csv", renamed(v_d="id", i_d="isd"), ["both", "i_d"], None),
    "decimal comma in commas": (
        "r.csv",
        b"t,x\n" + b"".join(f"0,{k},1,{k}\n".encode() for k in range(40)),
        ["header has 2 fields", "4"],
        1,
    ),
    "commas within quotes": (
        "r.csv",
        b"t,i_d\n" + b"".join(f'"0,{k}","1,{k}"\n'.encode() for k in range(40)),
        ["quotes", "decimals or thousands"],
        None,
    ),
    "NUL bytes": ("r.csv", edited(30, "i_d", "1.\0"), ["NUL"], 30),
    "binary as csv": ("r.csv", bytes(range(256)) * 40, ["NUL"], None),
    "control characters": ("r.csv", edited(30, "i_d", "\x07"), ["control"], 30),
    "prose": ("r.csv", b"Dear colleague,\nthe bench is broken again.\nBest regards\n", ["no table"], None),
    "parquet cut short": ("r.parquet", parquet_bytes()[:-200], ["parquet", "cut short"], None),
    "parquet with damage inside": (
        "r.parquet",
        parquet_bytes()[:400] + b"\xff" * 3000 + parquet_bytes()[3400:],
        ["parquet", "cannot be read"],
        None,
    ),
    "parquet footer that lies": (
        "r.parquet",
        parquet_bytes()[:-8] + b"\xff\xff\xff\x7fPAR1",
        ["footer"],
        None,
    ),
    "csv called parquet": ("r.parquet", csv_text(plausible()).encode(), ["parquet", "content"], None),
    "parquet with a missing value": ("r.parquet", parquet_with_gap(), ["i_q", GAP, "counting from 0"], 17),
    "parquet of text": ("r.parquet", parquet_of_text(), ["i_d", "numbers"], None),
    "parquet NaN": (
        "r.parquet",
        lambda: parquet_bytes({**plausible(), "i_d": np.where(np.arange(400) == 5, np.nan, 0.0)}),
        ["i_d", "not a number", "counting from 0"],
        5,
    ),
    "parquet bomb": ("r.parquet", parquet_bomb, ["bytes", "max_bytes"], None),
    "feather cut short": ("r.feather", b"ARROW1\0\0" + b"\xff" * 100, ["Arrow", "cannot be read"], None),
    "objects in npz": ("r.npz", pickled_objects(), ["objects"], None),
    "npz that declares too much": ("r.npz", npz_bomb(), ["bytes", "max_bytes"], None),
    "deflated npz bomb": ("r.npz", npz_deflated_bomb, ["bytes", "max_bytes"], None),
    "npz cut short": ("r.npz", npz_bytes(**plausible())[:900], ["npz", "cannot be read"], None),
    "npz of complex numbers": (
        "r.npz",
        npz_bytes(**{**plausible(), "i_d": np.ones(400, complex)}),
        ["complex"],
        None,
    ),
    "npz of text": (
        "r.npz",
        npz_bytes(**{**plausible(), "i_d": np.full(400, "x")}),
        ["i_d", "numbers"],
        None,
    ),
    "npz of unequal lengths": (
        "r.npz",
        npz_bytes(**{**plausible(), "i_d": np.ones(7)}),
        ["i_d", "7 rows"],
        None,
    ),
    "npz of matrices": (
        "r.npz",
        npz_bytes(**{**plausible(), "i_d": np.ones((400, 2))}),
        ["i_d", "[:,0]"],
        None,
    ),
    "mat cut short": ("r.mat", mat_bytes(**plausible())[:5000], [".mat", "cannot be read"], None),
    "mat without arrays": ("r.mat", mat_bytes(text="nothing"), ["no columns of numbers"], None),
    "gzip": ("r.csv.gz", b"\x1f\x8b\x08" + bytes(100), ["gzip", "unpack"], None),
    "a spreadsheet": ("r.xls", b"\xd0\xcf\x11\xe0" + bytes(100), ["spreadsheet"], None),
    "pickle": ("r.pkl", pickle.dumps(plausible()), ["NUL"], None),
    "mechanical angle called electrical": (
        "r.csv",
        mechanical_angle(),
        ["theta_e", "mechanical", "n_p"],
        None,
    ),
    "angle in degrees": (
        "r.csv",
        changed(theta_e=np.degrees(np.unwrap(plausible()["theta_e"])) / 20.0),
        ["theta_e", "times as fast"],
        None,
    ),
    "angle wrapped in degrees without a speed": (
        "r.csv",
        csv_text(
            {
                **{name: x for name, x in plausible().items() if name != "omega_e"},
                "theta_e": np.linspace(0.0, 2000.0, len(plausible()["t"])) % 360.0,
            }
        ).encode(),
        ["theta_e", "wraps at 360", "deg"],
        None,
    ),
    "angle against speed": (
        "r.csv",
        changed(theta_e=-plausible()["theta_e"]),
        ["against", "scale = -1"],
        None,
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_recordings_are_refused(case: str, tmp_path: Path, machine_file: Path, run: Run) -> None:
    name, content, words, line = BAD[case]
    path = tmp_path / name
    path.write_bytes(content() if callable(content) else content)
    before = sorted(tmp_path.iterdir())
    outputs = [
        "--json",
        tmp_path / "a.json",
        "--report",
        tmp_path / "a.html",
        "--trajectories",
        tmp_path / "a.parquet",
    ]
    ran = run("diagnose", path, "--machine", machine_file, *outputs)
    assert ran.code == 3, ran
    assert ran.out == ""
    assert ran.err.startswith(f"pmsm-rs: {path}")
    assert ran.err.count("\n") == 1
    assert "; " in ran.err, "the message must say what to do"
    for word in words:
        assert word.lower() in ran.err.lower(), ran.err
    if line is not None:
        assert f"line {line}" in ran.err or f"row {line} " in ran.err, ran.err
    assert sorted(tmp_path.iterdir()) == before, "no output may be left behind"

    with pytest.raises(pm.DataError) as caught:
        pm.load(path, machine_file)
    assert caught.value.file == str(path)  # type: ignore[attr-defined]
    assert caught.value.row == line or line is None  # type: ignore[attr-defined]
    assert caught.value.fix  # type: ignore[attr-defined]


@pytest.mark.parametrize("what", ["folder", "nothing"])
def test_what_is_no_file_is_a_usage_error(what: str, tmp_path: Path, machine_file: Path, run: Run) -> None:
    path = tmp_path if what == "folder" else tmp_path / "absent.csv"
    ran = run("identify", path, "--machine", machine_file, "--json", tmp_path / "a.json")
    assert ran.code == 2
    assert str(path) in ran.err
    assert not (tmp_path / "a.json").exists()
