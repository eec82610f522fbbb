"""Everything wrong with a machine file is said at once, with its path and the nearest right name."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pmsm_rs as pm
import pytest
from conftest import MACHINE, Ran, csv_text, plausible
from pmsm_rs.config.machine_file import read_machine

BAD = {
    "no TOML": ("[machine\nn_p = 3", ["TOML", "line 1"]),
    "binary": ("\udcff\udcfe", ["UTF-8"]),
    "no machine table": ("[drive]\nv_dc = 540", ["machine", "missing"]),
    "no pole pairs": (
        "[machine]\nr_s = 1.0",
        ["machine.n_p: is missing", "number of pole pairs", "8 poles", "n_p = 4 under [machine]", "[PR036]"],
    ),
    "a decimal comma": ("[machine]\nn_p = 3\nr_s = 0,27 # ohm", ["line 3", "0,27", "write 0.27", "[PR032]"]),
    "a decimal comma in a column": (
        "[machine]\nn_p = 3\n[columns]\ni_d = { value = 0,5 }",
        ["line 4", "write 0.5"],
    ),
    "a value that is not there": (
        "[machine]\nn_p =   # pole pairs",
        ["line 2", "n_p has no value", "[PR032]"],
    ),
    "a number in quotes": ('[machine]\nn_p = "15"', ["machine.n_p", "'15'", "write 15 without quotes"]),
    "a comma in quotes": ('[machine]\nn_p = 3\nr_s = "0,27"', ["write 0.27 without quotes"]),
    "a name without its sign": ('[machine]\nn_p = 3\n[columns]\niq = "x"', ["did you mean 'i_q'"]),
    "pole pairs of nought": ("[machine]\nn_p = 0", ["machine.n_p"]),
    "broken pole pairs": ("[machine]\nn_p = 3.5", ["machine.n_p", "3.5"]),
    "pole pairs of thousands": ("[machine]\nn_p = 3000", ["n_p", "200"]),
    "a whole number beyond a float": (
        "[machine]\nn_p = 3\nr_s = 1" + 400 * "0",
        ["line 3", "r_s", "64 bits"],
    ),
    "a whole number beyond Python": ("[machine]\nn_p = 3\nr_s = 1" + 5000 * "0", ["line 3", "r_s"]),
    "a hexadecimal number beyond 64 bits": (
        "[machine]\nn_p = 0x" + 20 * "f" + "\nr_s = 1.0",
        ["line 2", "n_p"],
    ),
    "a whole number too large in a column": (
        "[machine]\nn_p = 3\n[columns]\ni_d = { from = 'x', scale = 1" + 400 * "0" + " }",
        ["line 4", "i_d"],
    ),
    "negative inertia": ("[machine]\nn_p = 3\nj = -0.01", ["machine.j", "-0.01"]),
    "negative resistance": ("[machine]\nn_p = 3\nr_s = -1.0", ["machine.r_s"]),
    "absurd resistance": ("[machine]\nn_p = 3\nr_s = 1e9", ["r_s", "ohm"]),
    "NaN": ("[machine]\nn_p = 3\nl_d = nan", ["machine.l_d"]),
    "infinite": ("[machine]\nn_p = 3\nl_q = inf", ["machine.l_q"]),
    "text": ('[machine]\nn_p = 3\npsi_m = "0.2"', ["machine.psi_m"]),
    "truth value": ("[machine]\nn_p = 3\nr_s = true", ["machine.r_s"]),
    "unknown key": ("[machine]\nn_p = 3\nrs = 1.0", ["machine.rs", "did you mean 'r_s'"]),
    "misspelt table": ("[machine]\nn_p = 3\n[colums]\nt = 'x'", ["colums", "did you mean 'columns'"]),
    "unknown load": (
        "[machine]\nn_p = 3\n[load]\nkind = 'mesured'",
        ["load.kind", "did you mean 'measured'"],
    ),
    "known load without value": ("[machine]\nn_p = 3\n[load]\nkind = 'known_constant'", ["value", "N m"]),
    "value without known load": ("[machine]\nn_p = 3\n[load]\nkind = 'none'\nvalue = 1.0", ["value"]),
    "unknown column": ("[machine]\nn_p = 3\n[columns]\nomega = 'x'", ["columns.omega", "did you mean"]),
    "unknown unit": (
        "[machine]\nn_p = 3\n[columns]\ni_d = { from = 'x', unit = 'V' }",
        ["columns.i_d.unit", "current"],
    ),
    "period of a current": ("[machine]\nn_p = 3\n[columns]\ni_d = { period = 1.0 }", ["columns.i_d.period"]),
    "neither name nor period": ("[machine]\nn_p = 3\n[columns]\nt = { unit = 's' }", ["columns.t", "from"]),
    "scale of nought": (
        "[machine]\nn_p = 3\n[columns]\ni_d = { from = 'x', scale = 0 }",
        ["columns.i_d", "scale"],
    ),
    "unknown key of a column": (
        "[machine]\nn_p = 3\n[columns]\ni_d = { form = 'x' }",
        ["columns.i_d.form", "did you mean 'from'"],
    ),
    "a number for a column": ("[machine]\nn_p = 3\n[columns]\ni_d = 4", ["columns.i_d"]),
    "a table that is none": ("machine = 3", ["machine", "table"]),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_machine_files_are_refused(case: str, tmp_path: Path, run: Callable[..., Ran]) -> None:
    text, words = BAD[case]
    path = tmp_path / "m.toml"
    path.write_bytes(text.encode("utf-8", "surrogateescape"))
    (tmp_path / "r.csv").write_text(csv_text(plausible()))
    ran = run("identify", tmp_path / "r.csv", "--machine", path, "--json", tmp_path / "a.json")
    assert ran.code == 3, ran
    assert ran.err.startswith(f"pmsm-rs: {path}")
    for word in words:
        assert word in ran.err, ran.err
    assert not (tmp_path / "a.json").exists()
    with pytest.raises(pm.MachineError):
        read_machine(path)


def test_every_error_is_said_at_once(tmp_path: Path) -> None:
    path = tmp_path / "m.toml"
    path.write_text("[machine]\nr_s = -1\nfoo = 2\n[drive]\nv_dc = 'x'\n[columns]\nspeed = 'n'\n")
    with pytest.raises(pm.MachineError) as caught:
        read_machine(path)
    for where in ("machine.n_p", "machine.r_s", "machine.foo", "drive.v_dc", "columns.speed"):
        assert where in str(caught.value)


def test_tables_of_other_tools_are_ignored(tmp_path: Path) -> None:
    path = tmp_path / "m.toml"
    path.write_text(MACHINE + "\n[log]\nanything = 1\n[bench]\nnumber = 4\n")
    described = read_machine(path)
    assert described.machine.n_p == 3
    assert described.machine.l_d == 0.0096
    assert described.load == "unknown_constant"


def test_all_but_the_pole_pairs_may_be_left_out(tmp_path: Path) -> None:
    path = tmp_path / "m.toml"
    path.write_text("[machine]\nn_p = 4\n")
    described = read_machine(path)
    assert described.machine == pm.Machine(n_p=4)
    assert described.load is None


def test_whole_numbers_are_numbers(tmp_path: Path) -> None:
    path = tmp_path / "m.toml"
    path.write_text(
        "[machine]\nn_p = 4\nr_s = 1\n[drive]\nv_dc = 540\n[load]\nkind = 'known_constant'\nvalue = 2\n"
    )
    described = read_machine(path)
    assert (described.machine.r_s, described.machine.v_dc, described.load_value) == (1.0, 540.0, 2.0)
