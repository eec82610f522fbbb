"""Mistakes of wiring, unit and scale that a recording is made with: what is told of them."""

from __future__ import annotations

import numpy as np
import pmsm_rs as pm
import pytest
from conftest import csv_text
from pmsm_rs.config.machine_file import read_machine
from pmsm_rs.config.rules import Rule
from pmsm_rs.io.corrections import corrected, of_load, undoing
from pmsm_rs.support import demo

pq = pytest.importorskip("pyarrow.parquet")


@pytest.fixture
def columns() -> dict[str, np.ndarray]:
    """The first half second of the demo recording, an inverter that loses voltage in its dead time."""
    table = pq.read_table(demo.recording_files()[0])
    return {name: table[name].to_numpy()[:5000].astype(float) for name in table.column_names}


def diagnosed(columns: dict[str, np.ndarray]) -> pm.Diagnosis:
    machine = read_machine(demo.recording_files()[2]).machine
    return pm.diagnose(pm.Recording(columns, load="unknown_constant"), machine)


@pytest.mark.parametrize(("one", "other"), [("i_b", "i_c"), ("i_a", "i_b"), ("i_c", "i_a")])
def test_interchanged_phases_are_refused_and_the_column_named(columns, one, other):
    columns[one], columns[other] = columns[other], columns[one]
    with pytest.raises(pm.DataError, match="interchange"):
        diagnosed(columns)


def told_mistakes(columns: dict[str, np.ndarray]) -> list[str]:
    answer = diagnosed(columns)
    told = [f["finding"] for f in answer.data_quality if "reads as if" in f["finding"]]
    assert not told or answer.verdict in {"unknown", "undetermined"}
    return told


def test_phases_in_another_place_of_the_turn_are_told(columns):
    columns["i_a"], columns["i_b"], columns["i_c"] = columns["i_b"], columns["i_c"], columns["i_a"]
    [told] = told_mistakes(columns)
    assert "currents of the phases b, c, a were in the columns of a, b, c" in told


@pytest.mark.parametrize(
    ("names", "said"),
    [(("i_a", "i_b", "i_c"), "all currents had the opposite sign"), (("i_b",), "i_b had the opposite sign")],
)
def test_signs_that_explain_what_no_physics_does_are_told(columns, names, said):
    for name in names:
        columns[name] = -columns[name]
    [told] = told_mistakes(columns)
    assert said in told


def test_an_angle_from_another_axis_is_told(columns):
    columns["theta_e"] = columns["theta_e"] - np.pi / 2
    [told] = told_mistakes(columns)
    assert "theta_e was 90° too small" in told


def test_a_recording_as_it_is_reads_as_no_mistake(columns):
    assert not told_mistakes(columns)


@pytest.mark.parametrize(
    ("scaled", "factor", "said"),
    [(("i_a", "i_b", "i_c"), 10.0, "currents"), (("v_d", "v_q"), 0.001, "voltages")],
)
def test_a_scale_that_the_nameplate_contradicts_is_told(columns, scaled, factor, said):
    for name in scaled:
        columns[name] = columns[name] * factor
    answer = diagnosed(columns)
    told = [f for f in answer.data_quality if "nameplate" in f["finding"] or "times too" in f["finding"]]
    assert len(told) == 1
    assert said in told[0]["finding"] + told[0]["fix"]
    # Where effects would make up for the scale, the headline names it and they have no name.
    assert "times too" not in told[0]["finding"] or (answer.verdict == "undetermined" and not answer.effects)


def test_a_nameplate_as_it_is_allowed_to_be_is_no_finding(columns):
    assert not [f for f in diagnosed(columns).data_quality if "nameplate" in f["finding"]]


# What a diagnosis may say of a log, and what has then been done to the columns.
UNDONE = {
    "all currents had the opposite sign": {name: (name, -1.0) for name in ("i_a", "i_b", "i_c")},
    "all voltages had the opposite sign": {name: (name, -1.0) for name in ("v_d", "v_q")},
    "i_b had the opposite sign": {"i_b": ("i_b", -1.0)},
    "v_d and v_q were interchanged": {"v_d": ("v_q", 1.0), "v_q": ("v_d", 1.0)},
    "the phases a and c were interchanged": {"i_a": ("i_c", 1.0), "i_c": ("i_a", 1.0)},
    "the currents of the phases b, c, a were in the columns of a, b, c": {
        "i_a": ("i_b", 1.0),
        "i_b": ("i_c", 1.0),
        "i_c": ("i_a", 1.0),
    },
}
"""Per mistake the true column that each column of the log holds, and its sign."""


@pytest.mark.parametrize("mistake", UNDONE)
def test_the_lines_that_undo_a_mistake_make_the_columns_right(mistake, columns, tmp_path):
    """In a file whose names, units and scales are its own."""
    header = {"t": "t", "v_d": "ud [mV]", "v_q": "uq [mV]", "theta_e": "theta_el [deg]", "omega_e": "we [Hz]"}
    header |= {f"i_{phase}": f"i{phase} (mA)" for phase in "abc"}
    size = {"v": 1e3, "i": 1e3}
    log = {name: columns[name] for name in header}
    log |= {name: sign * columns[other] for name, (other, sign) in UNDONE[mistake].items()}
    log = {name: values * size.get(name[0], 1.0) for name, values in log.items()}
    log["theta_e"], log["omega_e"] = np.degrees(log["theta_e"]), log["omega_e"] / (2.0 * np.pi)
    path, machine = tmp_path / "run.csv", tmp_path / "machine.toml"
    path.write_text(csv_text(log, header))
    finding = {
        "finding": f"the log reads as if {mistake}: with that undone the bare machine leaves 1.00",
        "consequence": "",
        "fix": "check wiring",
    }
    rules = pm.load(path).account.columns
    fix = corrected(finding, rules)["fix"]
    assert fix.startswith("check wiring; these lines of [columns] undo it in the log: ")
    machine.write_text(f"[machine]\nn_p = 4\n[columns]\n{fix.partition(': ')[2].replace('; ', chr(10))}\n")
    recording = pm.load(path, machine)
    for name in UNDONE[mistake]:
        np.testing.assert_allclose(recording.column(name), columns[name], atol=1e-9)


@pytest.mark.parametrize(("words", "off"), [("30° too large", 30.0), ("90° too small", -90.0)])
def test_an_angle_is_undone_in_the_unit_of_the_file(words, off, columns, tmp_path):
    columns["theta_e"] = columns["theta_e"] + np.radians(off)
    path = tmp_path / "run.csv"
    path.write_text(
        csv_text(columns | {"theta_e": np.degrees(columns["theta_e"])}, {"theta_e": "theta_el [deg]"})
    )
    rule = undoing(f"theta_e was {words}", pm.load(path).account.columns)["theta_e"]
    assert (rule.offset, rule.unit) == (-off, "deg")


@pytest.mark.parametrize(
    ("mistake", "scales"),
    [
        ("the voltages were √3 times too large", {"v_d": 3**-0.5, "v_q": 3**-0.5}),
        ("the currents were √2 times too small", {"i_a": 2**0.5}),
        ("currents and voltages were 10 times too large", {"v_d": 0.1, "v_q": 0.1, "i_a": 0.1}),
    ],
)
def test_a_wrong_scale_is_undone(mistake, scales):
    rules = {name: Rule(name, "") for name in ("v_d", "v_q", "i_a", "omega_e")}
    found = {name: rule.scale for name, rule in undoing(mistake, rules).items()}
    assert found == pytest.approx(scales)


def test_a_speed_of_the_wrong_sign_is_undone():
    found = undoing("the speed had the opposite sign", {"n": Rule("rpm", "rpm", offset=3.0)})
    assert found == {"n": Rule("rpm", "rpm", scale=-1.0, offset=-3.0)}


@pytest.mark.parametrize(
    ("mistake", "given", "right"),
    [
        (
            "the speed was in rpm and not in rad/s",
            {"omega_m": Rule("w", "rad/s")},
            {"omega_m": Rule("w", "rpm")},
        ),
        (
            "omega_e was the mechanical speed and not 4 times that",
            {"omega_e": Rule("w", "rpm", offset=2.0)},
            {"omega_e": Rule("w", "rpm", scale=4.0, offset=8.0)},
        ),
        (
            "omega_m was the electrical speed, 4 times the mechanical one",
            {"n": Rule("n", "rpm")},
            {"n": Rule("n", "rpm", scale=0.25)},
        ),
        (
            "the angle and the speed had the opposite sign",
            {"theta_m": Rule("a", "deg", offset=5.0), "n": Rule("n", "rpm")},
            {"theta_m": Rule("a", "deg", scale=-1.0, offset=-5.0), "n": Rule("n", "rpm", scale=-1.0)},
        ),
    ],
)
def test_speeds_of_another_unit_shaft_or_direction_are_undone(mistake, given, right):
    assert undoing(mistake, given) == right


def test_an_angle_and_a_speed_that_run_backwards_are_refused_beside_phase_currents(columns):
    for name in ("theta_e", "omega_e"):
        columns[name] = -columns[name]
    with pytest.raises(pm.DataError, match="or the sense of angle and speed"):
        diagnosed(columns)


def by_axis(columns: dict[str, np.ndarray]) -> None:
    """Currents by axis and not by phase."""
    currents = [columns.pop(f"i_{phase}") for phase in "abc"]
    for name, turn in (("i_d", np.cos), ("i_q", lambda angle: -np.sin(angle))):
        places = enumerate(currents)
        columns[name] = sum(2 / 3 * i * turn(columns["theta_e"] - 2 * np.pi / 3 * k) for k, i in places)


def test_an_angle_and_a_speed_that_run_backwards_are_told_beside_currents_by_axis(columns):
    by_axis(columns)
    for name in ("theta_e", "omega_e"):
        columns[name] = -columns[name]
    [told] = told_mistakes(columns)
    assert "the angle and the speed had the opposite sign" in told


def test_a_speed_in_rpm_without_an_angle_is_told(columns):
    by_axis(columns)
    del columns["theta_e"]
    columns["omega_e"] = columns["omega_e"] * (60 / (2 * np.pi))
    [told] = told_mistakes(columns)
    assert "the speed was in rpm and not in rad/s" in told


def test_d_and_q_of_another_axis_are_undone():
    rules = {name: Rule(f"x_{name}", "A") for name in ("i_d", "i_q", "v_d", "v_q")}
    found = undoing("d and q were those of an axis 90° ahead of the magnet", rules)
    assert {name: (rule.source, rule.scale) for name, rule in found.items()} == {
        "i_d": ("x_i_q", -1.0),
        "i_q": ("x_i_d", 1.0),
        "v_d": ("x_v_q", -1.0),
        "v_q": ("x_v_d", 1.0),
    }


@pytest.mark.parametrize(
    "mistake", ["the voltages were logged one row early", "i_a had the opposite sign", "something new"]
)
def test_what_no_line_undoes_is_told_as_it_was(mistake):
    finding = {
        "finding": f"the log reads as if {mistake}: with that undone",
        "consequence": "",
        "fix": "look",
    }
    assert corrected(finding, {"t": Rule("t", "s")}) == finding


def test_a_diagnosis_tells_the_lines(columns):
    columns["v_d"], columns["v_q"] = columns["v_q"], columns["v_d"]
    [fix] = [f["fix"] for f in diagnosed(columns).data_quality if "reads as if" in f["finding"]]
    assert 'v_d = { from = "v_q", unit = "V" }; v_q = { from = "v_d", unit = "V" }' in fix


def test_a_load_torque_of_the_wrong_sign_is_told():
    finding = {
        "finding": "a load that is 2.002 N·m more than the log or the machine file says would do the same",
        "consequence": "",
        "fix": "look",
    }
    rules = {"tau_m": Rule("load", "N·m")}
    found = of_load(finding, -1.0, rules)
    assert "opposite sign" in found["finding"]
    assert 'tau_m = { from = "load", unit = "N·m", scale = -1.0 }' in found["fix"]
    # The other way round, of another size, or without a log it says nothing of the sign.
    for load, known in ((1.0, rules), (-0.5, rules), (-1.0, {})):
        assert of_load(finding, load, known) == finding
