"""Every format and every dialect of text gives the same columns."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pandas as pd
import pmsm_rs as pm
import polars as pl
import pyarrow as pa
import pyarrow.feather
import pyarrow.parquet
import pytest
import scipy.io
from conftest import ROOT, Columns, csv_text, plausible
from hypothesis import given, settings
from hypothesis import strategies as st
from pmsm_rs.io.formats.ahead import Opening


def check(recording: pm.Recording, columns: Columns, rtol: float = 1e-12) -> None:
    assert sorted(recording.names) == sorted(columns)
    for name, values in columns.items():
        np.testing.assert_allclose(recording.column(name), values, rtol=rtol, atol=1e-12, err_msg=name)


def table(columns: Columns) -> pa.Table:
    return pa.table(dict(columns))


def test_parquet(columns: Columns, tmp_path: Path) -> None:
    pyarrow.parquet.write_table(table(columns), tmp_path / "r.parquet", row_group_size=97)
    check(pm.load(tmp_path / "r.parquet"), columns)


def test_parquet_of_single_precision_and_integers(columns: Columns, tmp_path: Path) -> None:
    columns["i_d"] = np.round(columns["i_d"] * 8.0)
    mixed = {name: pa.array(values, pa.float32()) for name, values in columns.items()}
    mixed["t"] = pa.array(columns["t"])
    mixed["i_d"] = pa.array(columns["i_d"].astype(np.int16))
    pyarrow.parquet.write_table(pa.table(mixed), tmp_path / "r.parquet")
    single = {name: values.astype(np.float32).astype(float) for name, values in columns.items()}
    check(pm.load(tmp_path / "r.parquet"), single | {"t": columns["t"]})


@pytest.mark.parametrize("compression", ["zstd", "lz4", "uncompressed"])
def test_feather(columns: Columns, tmp_path: Path, compression: str) -> None:
    pyarrow.feather.write_feather(table(columns), str(tmp_path / "r.feather"), compression=compression)
    check(pm.load(tmp_path / "r.feather"), columns)


def test_arrow_stream_file(columns: Columns, tmp_path: Path) -> None:
    data = table(columns)
    with pa.ipc.new_stream(str(tmp_path / "r.arrow"), data.schema) as writer:
        writer.write_table(data)
    check(pm.load(tmp_path / "r.arrow"), columns)


def test_npz(columns: Columns, tmp_path: Path) -> None:
    np.savez(tmp_path / "r.npz", **columns)
    check(pm.load(tmp_path / "r.npz"), columns)
    np.savez_compressed(tmp_path / "s.npz", **columns)
    check(pm.load(tmp_path / "s.npz"), columns)


@pytest.mark.parametrize("do_compression", [True, False])
def test_matlab(columns: Columns, tmp_path: Path, do_compression: bool) -> None:
    scipy.io.savemat(tmp_path / "r.mat", dict(columns), oned_as="column", do_compression=do_compression)
    check(pm.load(tmp_path / "r.mat"), columns)


def test_a_column_of_a_matrix(columns: Columns, tmp_path: Path, machine_file: Path) -> None:
    stacked = np.column_stack(list(columns.values()))
    scipy.io.savemat(tmp_path / "r.mat", {"data": stacked})
    np.savez(tmp_path / "r.npz", data=stacked)
    rules = "\n".join(f'{name} = "data[:,{i}]"' for i, name in enumerate(columns))
    machine_file.write_text(f"[machine]\nn_p = 3\n[columns]\n{rules}\n")
    check(pm.load(tmp_path / "r.mat", machine_file), columns)
    check(pm.load(tmp_path / "r.npz", machine_file), columns)


@pytest.mark.parametrize("separator", [",", ";", "\t", "|"])
def test_separators(columns: Columns, tmp_path: Path, separator: str) -> None:
    (tmp_path / "r.csv").write_text(csv_text(columns, separator=separator))
    check(pm.load(tmp_path / "r.csv"), columns)


@pytest.mark.parametrize("separator", [";", "\t"])
def test_decimal_comma(columns: Columns, tmp_path: Path, separator: str) -> None:
    (tmp_path / "r.csv").write_text(csv_text(columns, separator=separator).replace(".", ","))
    check(pm.load(tmp_path / "r.csv"), columns)


def test_blanks_around_numbers(columns: Columns, tmp_path: Path) -> None:
    text = csv_text(columns)
    (tmp_path / "a.csv").write_text(text.replace(",", " ,  "))
    check(pm.load(tmp_path / "a.csv"), columns)
    aligned = "\n".join("  " + line.replace(",", "   ") for line in text.splitlines())
    (tmp_path / "b.txt").write_text(aligned)
    check(pm.load(tmp_path / "b.txt"), columns)


def test_comments_blank_lines_and_line_ends(columns: Columns, tmp_path: Path) -> None:
    lines = csv_text(columns).splitlines()
    lines[50:50] = ["", "# a remark", "% another"]
    (tmp_path / "r.csv").write_bytes(("# bench 4\r\n\r\n" + "\r\n".join(lines) + "\r\n").encode())
    check(pm.load(tmp_path / "r.csv"), columns)


def test_a_header_behind_a_comment_sign(columns: Columns, tmp_path: Path) -> None:
    np.savetxt(tmp_path / "r.txt", np.column_stack(list(columns.values())), header=" ".join(columns))
    check(pm.load(tmp_path / "r.txt"), columns)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "cp1252"])
def test_encodings(columns: Columns, tmp_path: Path, encoding: str) -> None:
    columns["temperature"] = np.full(len(columns["t"]), 21.5)
    text = csv_text(columns, {"temperature": "temperature [°C]"})
    (tmp_path / "r.csv").write_bytes(text.encode(encoding))
    check(pm.load(tmp_path / "r.csv"), columns)


def test_a_units_row_is_obeyed(columns: Columns, tmp_path: Path) -> None:
    lines = csv_text({**columns, "t": columns["t"] * 1e3, "i_q": columns["i_q"] * 1e3}).splitlines()
    lines.insert(1, "ms,V,V,A,mA,rad,rad/s")
    (tmp_path / "r.csv").write_text("\n".join(lines))
    check(pm.load(tmp_path / "r.csv"), columns)


def test_units_in_headers_are_obeyed(columns: Columns, tmp_path: Path) -> None:
    given = dict(columns)
    header = {
        "t": "time [ms]",
        "i_d": "i_d (mA)",
        "theta_e": "theta_e [deg]",
        "omega_e": "omega_e [1/min]",
        "v_q": "v_q in mV",
    }
    given["t"] = columns["t"] * 1e3
    given["i_d"] = columns["i_d"] * 1e3
    given["v_q"] = columns["v_q"] * 1e3
    given["theta_e"] = np.degrees(columns["theta_e"])
    given["omega_e"] = columns["omega_e"] * 30.0 / np.pi
    (tmp_path / "r.csv").write_text(csv_text(given, header))
    check(pm.load(tmp_path / "r.csv"), columns, rtol=1e-11)


def test_a_scope_preamble_is_skipped(columns: Columns, tmp_path: Path) -> None:
    preamble = "Model,MDO3024\nFirmware,1.26\nPoint Format,Y,\n\n"
    (tmp_path / "r.csv").write_text(preamble + csv_text(columns))
    check(pm.load(tmp_path / "r.csv"), columns)


SCOPES = {
    "R&S": ("in s,C1 in V,C2 in V\n", "{t:.7e},{a},{b}"),
    "Tektronix": ("Model,MDO3024\n\nHorizontal Units,S,\n\nTIME,CH1,CH2\n", "{t:.7e},{a},{b}"),
    "Keysight": ("x-axis,1,2\nsecond,Volt,Volt\n", "{t:+.7e},{a},{b}"),
    "Siglent": ("Record Length,Analog:9\nSource,CH1,CH2\nSecond,Volt,Volt\n", "{t:.7e},{a},{b}"),
    "PicoScope": ("Time,Channel A,Channel B\n(ms),(V),(V)\n\n", "{ms:.7e},{a},{b}"),
    "Rigol": ("X,CH1,CH2,Start,Increment\nSequence,VOLT,VOLT,0.0e-04,1.0e-03\n", "{k},{a},{b},"),
    "Rigol, new": ("Time(s),CH1V,CH2V,t0 = 0.0,tInc = 0.001,\n", "{t:.7e},{a},{b},,,"),
}


@pytest.mark.parametrize("brand", SCOPES)
def test_oscilloscope_headers(brand: str, columns: Columns, tmp_path: Path, machine_file: Path) -> None:
    head, row = SCOPES[brand]
    rows = [
        row.format(k=k, t=t, ms=1e3 * t, a=repr(float(a)), b=repr(float(b)))
        for k, (t, a, b) in enumerate(zip(columns["t"], columns["i_d"], columns["i_q"], strict=True))
    ]
    (tmp_path / "r.csv").write_text(head + "\n".join(rows) + "\n")
    first = {"Keysight": "1", "PicoScope": "Channel A", "R&S": "C1", "Rigol, new": "CH1V"}.get(brand, "CH1")
    second = first[:-1] + chr(ord(first[-1]) + 1) if brand != "Rigol, new" else "CH2V"
    machine_file.write_text(
        f"[machine]\nn_p = 3\n[columns]\nomega_m = {{ value = 20.0 }}\n"
        f"i_d = {{ from = '{first}', unit = 'A' }}\n"
        f"i_q = {{ from = '{second}', unit = 'A' }}\n"
    )
    wanted = {name: columns[name] for name in ("t", "i_d", "i_q")}
    check(pm.load(tmp_path / "r.csv", machine_file), {**wanted, "omega_m": np.full(400, 20.0)}, rtol=1e-6)


def test_a_vesc_log(columns: Columns, tmp_path: Path) -> None:
    names = {
        "t": "ms_today",
        "v_d": "d_axis_voltage",
        "v_q": "q_axis_voltage",
        "i_d": "d_axis_current",
        "i_q": "q_axis_current",
        "omega_e": "erpm",
    }
    del columns["theta_e"]
    given = {**columns, "t": columns["t"] * 1e3, "omega_e": columns["omega_e"] * 30.0 / np.pi}
    (tmp_path / "r.csv").write_text(csv_text(given, names, ";"))
    check(pm.load(tmp_path / "r.csv"), columns, rtol=1e-11)


VESC_HEADER = (
    "ms_today;input_voltage;temp_mos_max;temp_mos_1;temp_mos_2;temp_mos_3;temp_motor;current_motor;current_in;"
    "d_axis_current;q_axis_current;erpm;duty_cycle;amp_hours_used;amp_hours_charged;watt_hours_used;"
    "watt_hours_charged;tachometer;tachometer_abs;encoder_position;fault_code;vesc_id;d_axis_voltage;"
    "q_axis_voltage;ms_today_setup;amp_hours_setup;amp_hours_charged_setup;watt_hours_setup;"
    "watt_hours_charged_setup;battery_level;battery_wh_tot;current_in_setup;current_motor_setup;"
    "speed_meters_per_sec;tacho_meters;tacho_abs_meters;num_vescs;ms_today_imu;roll;pitch;yaw;accX;accY;accZ;"
    "gyroX;gyroY;gyroZ;gnss_posTime;gnss_lat;gnss_lon;gnss_alt;gnss_gVel;gnss_vVel;gnss_hAcc;gnss_vAcc;"
)


def test_a_whole_vesc_log(tmp_path: Path) -> None:
    """With every column that VESC Tool writes, and its separator at the end of every line."""
    names = VESC_HEADER.rstrip(";").split(";")
    rows = []
    for k in range(40):
        row = dict.fromkeys(names, f"{0.5 * k:.3f}")
        row |= {"ms_today": str(33_000_000 + 20 * k), "fault_code": "FAULT_CODE_NONE"}
        row |= {"erpm": "6000", "input_voltage": "48.2", "temp_motor": "31.5"}
        rows.append(";".join(row.values()) + ";")
    (tmp_path / "log.csv").write_text("\n".join([VESC_HEADER, *rows]) + "\n")
    recording = pm.load(tmp_path / "log.csv")
    wanted = ["i_d", "i_q", "omega_e", "t", "temperature", "v_d", "v_dc", "v_q"]
    assert sorted(recording.names) == wanted
    np.testing.assert_allclose(recording.column("omega_e"), 6000.0 * 2.0 * np.pi / 60.0)
    np.testing.assert_allclose(np.diff(recording.column("t")), 0.02)
    np.testing.assert_array_equal(recording.column("temperature"), 31.5)


def test_a_moteus_log(columns: Columns, tmp_path: Path) -> None:
    columns["omega_m"] = columns.pop("omega_e") / 3.0
    columns["theta_m"] = np.unwrap(columns.pop("theta_e")) / 3.0
    given = {name: columns[name] / (2.0 * np.pi) for name in ("omega_m", "theta_m")}
    given = {**columns, **given}
    names = {
        "t": "time [s]",
        "i_d": "servo_stats.d_A",
        "i_q": "servo_stats.q_A",
        "v_d": "servo_control.d_V",
        "v_q": "servo_control.q_V",
        "omega_m": "servo_stats.velocity",
        "theta_m": "servo_stats.position",
    }
    (tmp_path / "r.csv").write_text(csv_text(given, names))
    check(pm.load(tmp_path / "r.csv"), columns, rtol=1e-11)


def test_frames_in_memory(columns: Columns) -> None:
    structured = np.rec.fromarrays(list(columns.values()), names=list(columns))
    for frame in (columns, table(columns), pl.DataFrame(columns), pd.DataFrame(columns), structured):
        check(pm.load(frame), columns)
    check(pm.Recording(**columns), columns)
    check(pm.Recording({name: list(values) for name, values in columns.items()}), columns)
    check(pm.Recording({name: values[::-1][::-1] for name, values in columns.items()}), columns)


def test_arrays_that_are_not_aligned(columns: Columns) -> None:
    packed = np.empty(400, dtype=np.dtype([("flag", "u1"), *((name, "<f8") for name in columns)]))
    for name, values in columns.items():
        packed[name] = values
    assert not packed["i_q"].flags.aligned
    check(pm.load(packed), columns)
    shifted = np.frombuffer(b"\0" + columns["i_q"].tobytes(), "<f8", offset=1)
    check(pm.Recording(**{**columns, "i_q": shifted}), columns)


def test_quantities_with_units_by_duck_typing(columns: Columns) -> None:
    class Quantity:
        def __init__(self, magnitude: np.ndarray) -> None:
            self.magnitude = magnitude

        def to(self, unit: str) -> Quantity:
            assert unit == "A"
            return Quantity(self.magnitude / 1e3)

    milliamperes = Quantity(columns["i_d"] * 1e3)
    check(pm.Recording(**{**columns, "i_d": milliamperes}), columns)


def test_speed_in_rpm_becomes_mechanical_speed(columns: Columns) -> None:
    omega = columns.pop("omega_e") / 3.0
    recording = pm.Recording(**columns, n=omega * 30.0 / np.pi)
    np.testing.assert_allclose(recording.column("omega_m"), omega)


def test_effective_values_of_the_rotor_frame_become_amplitudes(columns: Columns, tmp_path: Path) -> None:
    given = {**columns, "i_q": columns["i_q"] / np.sqrt(2.0), "i_d": columns["i_d"] / np.sqrt(2.0)}
    (tmp_path / "r.csv").write_text(csv_text(given, {"i_q": "iq_rms", "i_d": "i_d [Arms]"}))
    check(pm.load(tmp_path / "r.csv"), columns)


def test_time_from_a_period(columns: Columns, tmp_path: Path, machine_file: Path) -> None:
    del columns["t"], columns["theta_e"]
    (tmp_path / "r.csv").write_text(csv_text(columns))
    machine_file.write_text("[machine]\nn_p = 3\n[columns]\nt = { period = 2.5 }\n")
    recording = pm.load(tmp_path / "r.csv", machine_file)
    assert recording.kind == "operating_points"
    np.testing.assert_array_equal(recording.column("t")[:3], [0.0, 2.5, 5.0])


def test_mapping_with_unit_scale_and_offset(columns: Columns, tmp_path: Path, machine_file: Path) -> None:
    given = {**columns, "i_q": (columns["i_q"] - 1.0) / 35.15}
    (tmp_path / "r.csv").write_text(csv_text(given, {"i_q": "vir"}))
    machine_file.write_text(
        '[machine]\nn_p = 3\n[columns]\ni_q = { from = "vir", scale = 35.15, offset = 1.0 }\n'
    )
    check(pm.load(tmp_path / "r.csv", machine_file), columns)


def test_a_column_can_be_left_out(columns: Columns, tmp_path: Path, machine_file: Path) -> None:
    columns["temperature"] = np.full(len(columns["t"]), np.nan)
    (tmp_path / "r.csv").write_text(csv_text(columns))
    machine_file.write_text("[machine]\nn_p = 3\n[columns]\ntemperature = false\n")
    del columns["temperature"]
    check(pm.load(tmp_path / "r.csv", machine_file), columns)


def test_text_columns_that_nobody_asked_for_do_not_matter(columns: Columns, tmp_path: Path) -> None:
    lines = csv_text(columns).splitlines()
    lines = [f"{line},{'state' if i == 0 else 'RUN'}" for i, line in enumerate(lines)]
    (tmp_path / "r.csv").write_text("\n".join(lines))
    check(pm.load(tmp_path / "r.csv"), columns)


@settings(max_examples=40)
@given(
    st.sampled_from([",", ";", "\t"]),
    st.booleans(),
    st.integers(0, 5),
    st.sampled_from(["\n", "\r\n"]),
    st.randoms(use_true_random=False),
)
def test_any_dialect_gives_the_same_numbers(
    tmp_path_factory: pytest.TempPathFactory,
    separator: str,
    comma: bool,
    comments: int,
    end: str,
    random: np.random.Generator,
) -> None:
    columns = plausible(30)
    names = list(columns)
    random.shuffle(names)  # type: ignore[arg-type]
    columns = {name: columns[name] for name in names}
    text = csv_text(columns, separator=separator)
    if comma and separator != ",":
        text = text.replace(".", ",")
    path = tmp_path_factory.mktemp("dialect") / "r.csv"
    path.write_bytes(("# remark\n" * comments + text).replace("\n", end).encode())
    recording = pm.load(path)
    assert sorted(recording.names) == sorted(columns)
    for name, values in columns.items():
        # as many digits as tell one number from the next
        np.testing.assert_array_equal(recording.column(name), values, err_msg=name)


RECORDINGS = Path(os.environ.get("PMSM_RS_RECORDINGS", ROOT.parent / "shared" / "recordings"))
REAL = {
    "lea_traction/group_B.csv": (
        "t = { period = 5.0 }\nomega_m = { from = 'motor_speed', unit = 'rpm' }\ntau_m = 'torque'\n"
        "temperature = 'stator_winding'\ntemperature_magnet = 'pm'",
        218,
        "operating_points",
    ),
    "emps/DATA_EMPS.mat": ("tau_e = { from = 'vir', scale = 35.15 }\ntheta_m = 'qm'", 24841, "mechanical"),
    "hsm150/idf_pos_0.06_1.mat": (
        "t = 'data[:,0]'\ntheta_m = 'data[:,2]'\nomega_m = 'data[:,3]'\ntau_e = 'data[:,4]'",
        20000,
        "mechanical",
    ),
    "flexible_shaft/MultisineTypeA.mat": (
        "t = { period = 0.0004 }\ntheta_m = 'theta_mx'\nomega_m = 'omega_max'\n"
        "tau_e = { from = 'iq_adx', scale = 0.5 }",
        50000,
        "mechanical",
    ),
    "embir_dyno/futek_test_13_05_2021_17-55-58.csv": (
        "omega_m = 'a1 velocity'\ntau_e = 'a1 torque'",
        7766,
        "mechanical",
    ),
}


DESCRIBED = {
    "back_emf_scope/1000rpm_CHAN1.csv": ("back_emf_scope.toml", 65000),
    "moteus_inductance/ld_mj5208.json": ("moteus_mj5208.toml", 41),
    "baldor_flux_map/baldor_400rpm_map.npz": ("baldor.toml", 567),
}


@pytest.mark.parametrize("name", DESCRIBED)
def test_real_recordings_by_the_machine_files_of_the_documentation(name: str) -> None:
    if not RECORDINGS.is_dir():
        pytest.skip(f"the real recordings are not at {RECORDINGS}")
    machine, rows = DESCRIBED[name]
    recording = pm.load(RECORDINGS / name, ROOT / "docs" / "machines" / machine)
    assert len(recording) == rows


@pytest.mark.parametrize("name", REAL)
def test_real_recordings(name: str, machine_file: Path) -> None:
    if not RECORDINGS.is_dir():
        pytest.skip(f"the real recordings are not at {RECORDINGS}")
    rules, rows, kind = REAL[name]
    machine_file.write_text(f"[machine]\nn_p = 3\n[columns]\n{rules}\n")
    recording = pm.load(RECORDINGS / name, machine_file)
    assert (len(recording), recording.kind) == (rows, kind)


def test_a_file_opened_meanwhile_is_the_same_or_refused_alike(columns: Columns, tmp_path: Path) -> None:
    pyarrow.parquet.write_table(table(columns), tmp_path / "r.parquet")
    check(pm.load(Opening(tmp_path / "r.parquet", 1 << 30)), columns)
    for missing, limit in [("nothing.parquet", 1 << 30), ("r.parquet", 100)]:
        opening = Opening(tmp_path / missing, limit)
        with pytest.raises(pm.PmsmError) as meanwhile:
            pm.load(opening)
        with pytest.raises(pm.PmsmError) as alone:
            pm.load(tmp_path / missing, max_bytes=limit)
        assert type(meanwhile.value) is type(alone.value)
        assert str(meanwhile.value) == str(alone.value)
