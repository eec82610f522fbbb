"""Names of columns as logs of other tools have them: read for what they say, refused where they say two
things, and never dropped in silence.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pmsm_rs as pm
import pytest
from conftest import Columns, csv_text
from hypothesis import given, settings
from hypothesis import strategies as st
from pmsm_rs.io.formats.sniff import name_and_unit
from pmsm_rs.io.naming import meaning


def several(plain: str, *spaced: str) -> list[str]:
    """Names parted by blanks, and those that hold some."""
    return [*plain.split(), *spaced]


VOLTAGES = several(
    "Vd vd V_d Ud ud U_d usd u_sd U_SD vds v_ds Vd_ref VdRef vdref vd_cmd ud_soll UdSoll udsoll Ud* u_d_set "
    "vd_target ud_demand v_d_star Vd_out voltage_d VoltageD d_voltage d_axis_voltage voltage_d_setpoint "
    "Voltage.d target_voltage_d Vqd.d Vdq.d motorVars_M1.Vd_V ref.Vd Spannung_d Laengsspannung "
    "d-axis-voltage axis0.motor.Vd_setpoint V_D vd_meas ud_ist",
    *("Ud [V]", "U_d / V", "Vd (ref)", "Voltage D [V]", "Direct voltage (V)"),
)
CURRENTS = several(
    "Iq iq I_q isq i_sq iqs i_qs Iq_meas iqmeas iq_act IqIst iq_ist iq_measured Iq_measured iq_fb iq_fbk "
    "iq_actual iq_feedback current_q CurrentQ q_axis_current Iqd.q Idq.q motorVars.Iq_A Iq_in_A I_Q_MEAS "
    "iq_filt Strom_q Querstrom Drehmomentstrom axis0.motor.current_control.Iq_measured",
    *("Iq (A)", "Iq (measured)", "q-axis current", "Torque current [A]", "r0078 I_q_ist", "Iq / A"),
)
PHASES = several(
    "Ib ib I_b ibs Iv i_v I_V_meas phase_b_current PhaseCurrentB current_b Strom_V Phasenstrom_b ib_ist",
    *("Phase B Current (A)", "Motor Current Phase V [A]"),
)
SPEEDS = {
    "omega_m": several(
        "speed_rpm rpm RPM SpeedRPM n_rpm rotor_speed_rpm motor_rpm speed_fb_rpm speed_est_rpm speed_krpm "
        "Drehzahl_rpm istdrehzahl_rpm mech_speed_rads w_mech_rad_s shaft_velocity_rad_s wm_rad_s",
        *("n [U/min]", "n [min-1]", "Drehzahl [1/min]", "Velocity actual value [rpm]", "ω_m [rad/s]"),
    ),
    "omega_e": several(
        "erpm eRPM electrical_frequency_hz omega_el_rad_s we_rad_s motor_speed_erpm",
        *("Motor speed [rad/s elec]", "omega_e [rad/s]", "el. Winkelgeschwindigkeit in rad/s"),
    ),
}
ANGLES = {
    "theta_e": several(
        "theta_e_deg theta_el_rad ThetaElec_rad elAngle_deg phi_el_rad MEAS_EL_ANGLE_deg",
        *("Theta [rad el]", "el. Winkel [°]", "Winkel elektrisch [rad]", "Electrical Position [deg]"),
    ),
    "theta_m": several(
        "theta_m_rad theta_mech_deg shaft_angle_rad mech_angle_deg phi_mech_rad",
        *("mechanical angle [rad]", "Rotorwinkel mech (rad)", "θ_m [rad]", "Shaft position [rev]"),
    ),
}
DOUBTFUL = {
    ("omega_e", "omega_m"): several(
        "speed motor_speed velocity omega w wr SPEED_MEAS ActVelo vel_estimate MAIN.fbAxis.fActVelo",
        *("speed [rad/s]", "Rotor speed (rad/s)", "encoder.vel_estimate [turns/s]"),
    ),
    ("theta_e", "theta_m"): several(
        "theta angle position pos phi Winkel Rotorlage RotorWinkel rotor_angle ActPos pos_estimate "
        "encoder_angle angleFOC_rad axis0.encoder.pos_estimate",
        "Rotor angle (deg)",
    ),
}
TIMES = several(
    "time_s t_us Time_ms timestamp_us TimeStamp_us micros millis Zeit_s elapsed_time_s",
    "Time [s]",
    "Zeit (s)",
)
OTHER_VOLTAGES = several(
    "Vq Uq u_q usq vqs Vq_ref VqRef uq_soll Uq* u_q_cmd voltage_q VoltageQ q_axis_voltage Vqd.q Vdq.q "
    "Querspannung voltage_q_setpoint v_q_star Vq_out"
)
STRANGERS = several(
    "iq_error iq_max vd_integral v_alpha i_beta Valpha v_ab Uab battery_voltage input_voltage current_in idc "
    "profile_id vesc_id omega_max speed_limit Voltage_V Current_A i1 u_L2 speed_meters_per_sec wheel_speed "
    "T_motor status AccX y CH1 Vd_pu iq_raw torque Torque_cmd tau_est Vd_sat i_r_d Vd_comp Iq2 Vd_1"
)
LINKS = several("Vdc v_dc vbus u_zk dc_link_voltage vbus_voltage VdcBus_V")


def said(name: str) -> tuple[str, ...]:
    """The canonical columns of a name, both as CSV takes its unit off and as other formats leave it."""
    split, whole = meaning(*name_and_unit(name)), meaning(name)
    assert split == whole
    return split.columns if split is not None and split.sure else ()


@pytest.mark.parametrize("name", VOLTAGES)
def test_usual_names_of_a_voltage(name: str) -> None:
    assert said(name) == ("v_d",)


@pytest.mark.parametrize("name", OTHER_VOLTAGES)
def test_usual_names_of_the_other_voltage(name: str) -> None:
    assert said(name) == ("v_q",)


@pytest.mark.parametrize("name", CURRENTS)
def test_usual_names_of_a_current(name: str) -> None:
    assert said(name) == ("i_q",)


@pytest.mark.parametrize("name", PHASES)
def test_usual_names_of_a_phase_current(name: str) -> None:
    assert said(name) == ("i_b",)


@pytest.mark.parametrize(
    ("column", "name"), [(c, n) for table in (SPEEDS, ANGLES) for c, ns in table.items() for n in ns]
)
def test_usual_names_of_speed_and_angle_with_their_unit(column: str, name: str) -> None:
    assert said(name) == (column,)
    found = meaning(name)
    assert found is not None
    assert not found.needs_unit


@pytest.mark.parametrize(("columns", "name"), [(c, n) for c, names in DOUBTFUL.items() for n in names])
def test_electrical_or_mechanical_stays_open_where_a_name_does_not_say(
    columns: tuple[str, str], name: str
) -> None:
    assert said(name) == columns


@pytest.mark.parametrize("name", TIMES)
def test_usual_names_of_a_time(name: str) -> None:
    assert said(name) == ("t",)


@pytest.mark.parametrize("name", LINKS)
def test_usual_names_of_the_dc_link(name: str) -> None:
    assert said(name) == ("v_dc",)


@pytest.mark.parametrize("name", STRANGERS)
def test_what_is_something_else_is_no_column_of_the_motor(name: str) -> None:
    assert len(said(name)) != 1


def written(columns: Columns, folder: Path, header: dict[str, str], rules: str = "") -> tuple[Path, Path]:
    (folder / "r.csv").write_text(csv_text(columns, header))
    (folder / "m.toml").write_text(f"[machine]\nn_p = 3\n{rules}")
    return folder / "r.csv", folder / "m.toml"


@pytest.mark.parametrize("name", VOLTAGES)
def test_a_voltage_of_any_usual_name_is_read(name: str, columns: Columns, tmp_path: Path) -> None:
    recording = pm.load(written(columns, tmp_path, {"v_d": name})[0])
    np.testing.assert_array_equal(recording.column("v_d"), columns["v_d"])
    assert recording.kind == "full"
    assert recording.account.ignored == ()


@pytest.mark.parametrize("first", ["v_d_ref", "ud", "Vd"])
@pytest.mark.parametrize("second", ["v_d_meas", "ud_ist"])
def test_two_names_of_one_voltage_are_refused_with_a_line_for_each(
    first: str, second: str, columns: Columns, tmp_path: Path
) -> None:
    columns["extra"] = columns["v_d"]
    file, _ = written(columns, tmp_path, {"v_d": first, "extra": second})
    with pytest.raises(pm.DataError, match="could be v_d") as caught:
        pm.load(file)
    for name in (first, second):
        line = f'v_d = {{ from = "{name}", unit = "V" }}'
        assert line in str(caught.value)
        _, machine = written(columns, tmp_path, {"v_d": first, "extra": second}, f"[columns]\n{line}\n")
        assert pm.load(file, machine).account.columns["v_d"].source == name


def test_a_measured_current_goes_before_a_plain_and_that_before_a_filtered_one(columns: Columns) -> None:
    log = dict(columns)
    i_q = log.pop("i_q")
    for name in ("iq_filt", "iq", "iq_meas"):
        log[name] = i_q
        assert pm.load(log).account.columns["i_q"].source == name


@pytest.mark.parametrize("role", ["ref", "soll", "cmd", "setpoint", "target", "demand", "est", "hat"])
def test_a_current_that_did_not_flow_is_never_taken_for_one(role: str, columns: Columns) -> None:
    log = {**columns, f"i_q_{role}": columns["i_q"]}
    assert "i_q" in pm.load(log).account.columns
    del log["i_q"]
    with pytest.raises(pm.DataError, match=f"'i_q_{role}' was not taken"):
        pm.load(log)


@pytest.mark.parametrize(("name", "what"), [("Torque_cmd", "command"), ("tau_est", "estimate")])
def test_a_commanded_or_estimated_torque_is_no_load_torque(name: str, what: str, columns: Columns) -> None:
    recording = pm.load({**columns, name: columns["i_q"]})
    assert not {"tau_m", "tau_e"} & {*recording.names}
    [entry] = recording.account.unused
    assert (entry.column, entry.use) == (name, None)
    assert what in entry.why


def test_everything_that_is_unclear_is_said_at_once(columns: Columns, tmp_path: Path) -> None:
    header = {"t": "time", "theta_e": "Winkel", "omega_e": "speed", "i_q": "iq_ref", "v_d": "Vd [furlong]"}
    with pytest.raises(pm.DataError, match="5 things are missing or unclear") as caught:
        pm.load(written(columns, tmp_path, header)[0])
    text = str(caught.value)
    for name in ("time", "Winkel", "speed", "iq_ref", "furlong"):
        assert name in text
    assert "\n" not in text
    assert len(caught.value.problems) == 5  # type: ignore[attr-defined]
    assert all(problem.fix for problem in caught.value.problems)  # type: ignore[attr-defined]


@pytest.mark.parametrize("wanted", ["Current q axis (mA)", "Current q axis"])
def test_from_takes_the_header_to_the_letter_and_without_its_unit(
    wanted: str, columns: Columns, tmp_path: Path
) -> None:
    given = {**columns, "i_q": 1e3 * columns["i_q"]}
    rules = f'[columns]\ni_q = {{ from = "{wanted}" }}\n'
    recording = pm.load(*written(given, tmp_path, {"i_q": "Current q axis (mA)"}, rules))
    np.testing.assert_allclose(recording.column("i_q"), columns["i_q"])
    assert recording.account.columns["i_q"].source == "Current q axis (mA)"
    # So it is where the format has no place for a unit but the name.
    log = {name: values for name, values in given.items() if name != "i_q"}
    recording = pm.load({**log, "Current q axis (mA)": given["i_q"]}, tmp_path / "m.toml")
    np.testing.assert_allclose(recording.column("i_q"), columns["i_q"])


def test_the_unit_at_the_end_of_a_name_holds_for_from_too(columns: Columns, tmp_path: Path) -> None:
    columns["omega_m"] = columns.pop("omega_e") / 3.0
    given = {**columns, "omega_m": columns["omega_m"] * 30.0 / np.pi}
    rules = '[columns]\nomega_m = "drive_speed_rpm"\n'
    recording = pm.load(*written(given, tmp_path, {"omega_m": "drive_speed_rpm"}, rules))
    np.testing.assert_allclose(recording.column("omega_m"), columns["omega_m"])


def test_a_name_that_stands_twice_matters_only_where_it_is_asked_for(
    columns: Columns, tmp_path: Path
) -> None:
    columns |= {"one": columns["t"], "two": columns["i_d"]}
    header = {"one": "tau_WR", "two": "tau_WR"}
    assert len(pm.load(written(columns, tmp_path, header)[0])) == 400
    with pytest.raises(pm.DataError, match="two columns are called 'tau_WR'"):
        pm.load(*written(columns, tmp_path, header, '[columns]\ntau_m = "tau_WR"\n'))
    with pytest.raises(pm.DataError, match="two columns are called 'Iq'"):
        pm.load(written(columns, tmp_path, {"one": "Iq", "two": "Iq", "i_q": "x"})[0])


def test_a_name_that_looks_like_a_voltage_is_told_with_its_line(columns: Columns, tmp_path: Path) -> None:
    header = {"v_d": "Vsd_K7", "v_q": "Vsq_K7"}
    file, machine = written(columns, tmp_path, header)
    recording = pm.load(file, machine)
    assert recording.kind == "mechanical"
    assert recording.account.missed == {"voltage"}
    lines = [entry.use for entry in recording.account.unused]
    written(columns, tmp_path, header, "[columns]\n" + "\n".join(map(str, lines)) + "\n")
    again = pm.load(file, machine)
    assert again.kind == "full"
    np.testing.assert_array_equal(again.column("v_q"), columns["v_q"])


def test_what_the_columns_table_names_was_chosen(columns: Columns, tmp_path: Path) -> None:
    header = {"theta_e": "Theta", "v_d": "Vsd_K7"}
    rules = '[columns]\nomega_e = "omega_e"\nv_q = "v_q"\n'
    assert pm.load(*written(columns, tmp_path, header, rules)).account.missed == frozenset()


def test_a_position_in_millimetres_is_no_angle(columns: Columns, tmp_path: Path) -> None:
    recording = pm.load(written(columns, tmp_path, {"theta_e": "Position [mm]"})[0])
    assert "theta_e" not in recording.names
    assert recording.account.missed == {"angle"}


def test_a_single_letter_refuses_no_file(columns: Columns) -> None:
    del columns["omega_e"]
    recording = pm.load({**columns, "N": columns["i_d"]})
    assert "omega_m" not in recording.names
    assert recording.account.missed == {"speed"}


def test_a_filtered_command_is_not_preferred_to_the_command(columns: Columns) -> None:
    log = {**columns, "v_d_ref_filt": columns["v_d"]}
    log["v_d_ref"] = log.pop("v_d")
    assert pm.load(log).account.columns["v_d"].source == "v_d_ref"


def test_one_axis_alone_is_refused_with_the_line_for_the_other(columns: Columns, tmp_path: Path) -> None:
    line = 'i_d = { value = 0.0, unit = "A" }'
    file, machine = written(columns, tmp_path, {"i_d": "x"})
    with pytest.raises(pm.DataError, match="column 'i_d': is missing") as caught:
        pm.load(file, machine)
    assert line in str(caught.value)
    written(columns, tmp_path, {"i_d": "x"}, f"[columns]\n{line}\n")
    assert pm.load(file, machine).kind == "full"


def test_id_is_a_current_only_beside_iq(columns: Columns) -> None:
    log = {**columns, "id": columns.pop("i_d"), "iq": columns.pop("i_q")}
    log = {name: values for name, values in log.items() if name not in {"i_d", "i_q"}}
    assert {"i_d", "i_q"} <= {*pm.load(log).names}
    number = {"t": log["t"], "omega_m": log["omega_e"], "tau_e": log["iq"], "id": log["id"]}
    recording = pm.load(number)
    assert "i_d" not in recording.names
    assert recording.account.ignored == ("id",)


@settings(max_examples=300, deadline=None)
@given(st.text(max_size=60))
def test_any_text_may_be_a_name(text: str) -> None:
    found = meaning(text)
    assert found is None or all(isinstance(name, str) for name in found.columns)
