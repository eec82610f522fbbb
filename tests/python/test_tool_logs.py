"""Logs as tools of drives write them, by their own names and units."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pmsm_rs as pm
import pytest
from conftest import MACHINE, Columns, csv_text

# The rows of properties that TwinCAT Scope 3.4 writes above the samples.
SCOPE_NAMES = {
    "v_d": ("fUd", "REAL64", "V (Voltage)"),
    "v_q": ("fUq", "REAL64", "V (Voltage)"),
    "i_d": ("fId", "REAL64", "A (Current)"),
    "i_q": ("fIq", "REAL64", "A (Current)"),
    "theta_e": ("theta_e", "REAL64", "rad (Angle)"),
    "omega_e": ("omega_e", "REAL64", "rad/s (AngularVelocity)"),
}


def scope_export(
    columns: Columns, separator: str = "\t", *, together: bool = False, comma: bool = False, slow: int = 1
) -> str:
    """An export with one column of times per channel or one for all; the last channel is a slow one."""
    names = list(SCOPE_NAMES)
    blocks = [names] if together else [[name] for name in names]
    made = [(columns["t"], [(columns[n], SCOPE_NAMES[n]) for n in block]) for block in blocks]
    if slow > 1:
        t = columns["t"][::slow]
        made.append((t, [(3.0 * t, ("Load torque", "REAL32", "Nm (Torque)"))]))

    def number(value: float) -> str:
        return repr(float(value)).replace(".", "," if comma else ".")

    def row(key: str, at: int | None) -> str:
        fields: list[str] = []
        for _, channels in made:
            fields.append(key)
            fields += ["" if at is None else channel[1][at] for channel in channels]
        return separator.join(fields)

    lines = [
        separator.join(("Name", "Project", "")),
        separator.join(("File", r"C:\export.csv", "")),
        separator.join(("Starttime of export", "132959733843760000", "Montag, 2. Mai 2022", "15:56:24.376")),
        separator.join(("Endtime of export", "132959733853750000", "Montag, 2. Mai 2022", "15:56:25.375")),
        *("", ""),
        *(row("Name", 0), row("SymbolComment", None), row("Data-Type", 1), row("Unit", 2), ""),
    ]
    for k in range(len(columns["t"])):
        fields = []
        for t, channels in made:
            if k < len(t):
                fields += [number(1e3 * t[k]), *(number(values[k]) for values, _ in channels)]
        lines.append(separator.join(fields))
    return "\r\n".join([*lines, "EOF", ""])


@pytest.mark.parametrize(
    ("separator", "together", "comma"),
    [("\t", False, False), (";", True, True), (",", False, False), ("\t", True, True)],
)
def test_twincat_scope(separator: str, together: bool, comma: bool, columns: Columns, tmp_path: Path) -> None:
    path = tmp_path / "export.csv"
    path.write_text(scope_export(columns, separator, together=together, comma=comma))
    recording = pm.load(path)
    for name in columns:
        np.testing.assert_allclose(recording.column(name), columns[name], atol=1e-12)
    assert not recording.account.remarks


def test_channels_of_other_rates_of_twincat_scope(columns: Columns, tmp_path: Path) -> None:
    path = tmp_path / "export.txt"
    path.write_text(scope_export(columns, slow=20))
    recording = pm.load(path)
    np.testing.assert_allclose(recording.column("tau_m")[:381], 3.0 * columns["t"][:381], atol=1e-9)
    assert any("sampled at 50 Hz" in remark.finding for remark in recording.account.remarks)


def test_a_field_of_twincat_scope_that_is_no_number_is_refused_with_its_line(
    columns: Columns, tmp_path: Path
) -> None:
    path = tmp_path / "export.csv"
    text = scope_export(columns, together=True).split("\r\n")
    at = next(k for k, line in enumerate(text) if line.startswith("5.0\t"))
    fields = text[at].split("\t")
    text[at] = "\t".join([fields[0], "n/a", *fields[2:]])
    path.write_text("\r\n".join(text))
    with pytest.raises(pm.DataError, match=rf"line {at + 1}, column 'fUd': 'n/a' is no number"):
        pm.load(path)


def test_an_odrive_log(columns: Columns, tmp_path: Path) -> None:
    """Properties by their paths; speed and position in turns of the shaft."""
    header = {
        "i_q": "axis0.motor.foc.Iq_measured",
        "i_d": "axis0.motor.foc.Id_measured",
        "omega_m": "axis0.encoder.vel_estimate",
        "theta_m": "axis0.encoder.pos_estimate",
        "v_dc": "vbus_voltage",
        "t": "time [s]",
    }
    turns = {
        "omega_m": columns["omega_e"] / (6.0 * np.pi),
        "theta_m": np.unwrap(columns["theta_e"]) / (6.0 * np.pi),
        "v_dc": 24.0 + 0.0 * columns["t"],
    }
    log = {name: columns[name] for name in ("t", "i_d", "i_q")} | turns
    log["fet"] = columns["t"]
    path = tmp_path / "odrive.csv"
    path.write_text(csv_text(log, header | {"fet": "axis0.fet_thermistor.temperature"}))
    recording = pm.load(path)
    np.testing.assert_allclose(recording.column("omega_m"), columns["omega_e"] / 3.0)
    np.testing.assert_allclose(recording.column("theta_m"), 2.0 * np.pi * turns["theta_m"])
    assert recording.account.columns["i_q"].source == header["i_q"]
    # With two axes it is to be said which.
    log["other"] = columns["i_q"]
    path.write_text(csv_text(log, header | {"other": "axis1.motor.foc.Iq_measured"}))
    with pytest.raises(pm.DataError, match=r"axis0\.motor\.foc\.Iq_measured.*axis1.*could be i_q"):
        pm.load(path)


def test_a_simplefoc_monitor_log(columns: Columns, tmp_path: Path, machine_file: Path) -> None:
    """Tab-separated values; the library prints currents in mA, and own code often A, so that is asked."""
    names = {"v_q": "voltage.q", "v_d": "voltage.d", "i_q": "current.q", "i_d": "current.d"}
    header = names | {"omega_m": "velocity", "theta_m": "angle", "t": "millis"}
    log = {
        "t": 1e3 * columns["t"],
        "target": 0.0 * columns["t"],
        "v_q": columns["v_q"],
        "v_d": columns["v_d"],
        "i_q": 1e3 * columns["i_q"],
        "i_d": 1e3 * columns["i_d"],
        "omega_m": columns["omega_e"] / 3.0,
        "theta_m": np.unwrap(columns["theta_e"]) / 3.0,
    }
    path = tmp_path / "monitor.txt"
    path.write_text(csv_text(log, header, "\t"))
    with pytest.raises(pm.DataError, match=r'i_q = \{ from = "current\.q", unit = "A" or "mA"'):
        pm.load(path)
    lines = "\n".join(f'{name} = {{ from = "{names[name]}", unit = "mA" }}' for name in ("i_d", "i_q"))
    machine_file.write_text(f"{MACHINE}\n[columns]\n{lines}\n")
    recording = pm.load(path, machine_file)
    for name in ("t", "v_d", "v_q", "i_d", "i_q"):
        np.testing.assert_allclose(recording.column(name), columns[name], atol=1e-12)
    np.testing.assert_allclose(recording.column("omega_m"), columns["omega_e"] / 3.0)
    # Where the file states the unit, nothing is asked.
    path.write_text(csv_text(log, header | {"i_q": "current q [mA]", "i_d": "current d [mA]"}, "\t"))
    np.testing.assert_allclose(pm.load(path).column("i_q"), columns["i_q"])
