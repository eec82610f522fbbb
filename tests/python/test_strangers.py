"""Tables as strangers write them, in English and German: read right, or refused with the line that helps.

Each table has the same recording under other names, in other units and other dialects of text. Nothing is
ever read as something else than it is.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pmsm_rs as pm
import pytest
from conftest import MACHINE, plausible

N_P = 3
RPM = 60.0 / (2.0 * np.pi)
DEG = 180.0 / np.pi
OZ_IN = 0.00706155181422604


def recording() -> dict[str, np.ndarray]:
    """What is in every table, in SI units."""
    out = plausible(200)
    theta = out["theta_e"]
    i = out["i_d"] + 1j * out["i_q"]
    v = out["v_d"] + 1j * out["v_q"]
    for k, phase in enumerate("abc"):
        turn = np.exp(1j * (theta - 2.0 * np.pi * k / 3.0))
        out[f"i_{phase}"], out[f"v_{phase}"] = (i * turn).real, (v * turn).real
    return out | {
        "omega_m": out["omega_e"] / N_P,
        "theta_m": np.unwrap(theta) / N_P,
        "tau_m": 0.3 + 0.1 * np.sin(5.0 * out["t"]),
        "tau_e": 0.4 + 0.1 * np.sin(5.0 * out["t"]),
        "v_dc": 24.0 + 0.0 * theta,
        "temperature": 40.0 + out["t"],
    }


SI = recording()


@dataclass(frozen=True)
class Table:
    """Headers with the canonical column and the factor to its values; `dialect` makes the text of the rows.

    `asked` are lines of [columns] of which the refusal offers at least a part, and with which it is read.
    """

    headers: Mapping[str, tuple[str, float]]
    asked: Mapping[str, str] = field(default_factory=dict)
    separator: str = ","
    comma: bool = False
    above: str = ""
    units: str | None = None
    dialect: Callable[[float], str] = repr
    stamps: Callable[[float], str] | None = None
    hint: str = ""


def volts(d: str, q: str, factor: float = 1.0) -> dict[str, tuple[str, float]]:
    return {d: ("v_d", factor), q: ("v_q", factor)}


def amps(d: str, q: str, factor: float = 1.0) -> dict[str, tuple[str, float]]:
    return {d: ("i_d", factor), q: ("i_q", factor)}


def iso(t: float) -> str:
    return f"2024-03-31T12:00:{t:09.6f}"


def two_words(t: float) -> str:
    return f"31.03.2024 12:00:{t:09.6f}"


TABLES = {
    "plain": Table(
        {"Time (s)": ("t", 1)}
        | volts("Vd (V)", "Vq (V)")
        | amps("Id (A)", "Iq (A)")
        | {"Speed mech (rpm)": ("omega_m", RPM)}
    ),
    "German": Table(
        {"Zeit [ms]": ("t", 1e3)}
        | volts("Spannung_d [V]", "Spannung_q [V]")
        | amps("Strom_d [A]", "Strom_q [A]")
        | {"Drehzahl [U/min]": ("omega_m", RPM), "Wicklungstemperatur [°C]": ("temperature", 1)},
        separator=";",
        comma=True,
    ),
    "German set points": Table(
        {"Zeit [s]": ("t", 1)}
        | volts("Ud_soll [V]", "Uq_soll [V]")
        | amps("Id_ist [A]", "Iq_ist [A]")
        | {"Winkel_el [°]": ("theta_e", DEG), "n_ist [1/min]": ("omega_m", RPM)},
        separator=";",
        comma=True,
    ),
    "German long words": Table(
        {"Zeit in s": ("t", 1)}
        | volts("Laengsspannung in V", "Querspannung in V")
        | amps("Längsstrom in A", "Querstrom in A")
        | {"elektrische Winkelgeschwindigkeit in rad/s": ("omega_e", 1)},
        separator="\t",
        comma=True,
    ),
    "units below": Table(
        {"Time": ("t", 1e3)}
        | volts("Ud", "Uq")
        | amps("Id", "Iq", 1e3)
        | {"Motor speed mech": ("omega_m", 1e-3 * RPM), "Load torque": ("tau_m", 1e3)},
        units="ms,V,V,mA,mA,krpm,mNm",
    ),
    "units in brackets below": Table(
        {"Time": ("t", 1)}
        | volts("v_d", "v_q")
        | amps("i_d", "i_q")
        | {"omega mech": ("omega_m", 1), "Shaft load torque": ("tau_m", 1 / OZ_IN)},
        units="[s];[V];[V];[A];[A];[rad.s-1];[oz-in]",
        separator=";",
    ),
    "newton millimetres": Table(
        {"t [s]": ("t", 1)}
        | amps("id [A]", "iq [A]")
        | {"Load torque [N.mm]": ("tau_m", 1e3), "Mech speed [rad.s-1]": ("omega_m", 1)}
    ),
    "newton centimetres": Table(
        {"t_s": ("t", 1)}
        | amps("id_mA", "iq_mA", 1e3)
        | {"load_torque_Ncm": ("tau_m", 1e2), "mech_speed_rpm": ("omega_m", RPM)}
    ),
    "effective values": Table(
        {"Time [s]": ("t", 1)}
        | volts("Vd [Vrms]", "Vq [Vrms]", 1 / np.sqrt(2.0))
        | amps("Id [Arms]", "Iq [Arms]", 1 / np.sqrt(2.0))
        | {"we [rad/s]": ("omega_e", 1)}
    ),
    "phases by letter": Table(
        {"Time (us)": ("t", 1e6)}
        | volts("Vd_cmd (V)", "Vq_cmd (V)")
        | {f"Phase {p.upper()} Current (A)": (f"i_{p}", 1) for p in "abc"}
        | {"Electrical angle (rad)": ("theta_e", 1)}
    ),
    "phases U V W": Table(
        {"Time[s]": ("t", 1)}
        | {f"U_{w}[V]": (f"v_{p}", 1) for p, w in zip("abc", "UVW", strict=True)}
        | {f"I_{w}[A]": (f"i_{p}", 1) for p, w in zip("abc", "UVW", strict=True)}
        | {"phi_el[deg]": ("theta_e", DEG)}
    ),
    "German phases": Table(
        {"Zeit/s": ("t", 1)}
        | volts("u_d_soll/V", "u_q_soll/V")
        | {f"Strom Phase {w}/A": (f"i_{p}", 1) for p, w in zip("abc", "UVW", strict=True)}
        | {"Rotorwinkel elektrisch/rad": ("theta_e", 1)},
        separator=";",
    ),
    "numbered phases": Table(
        {"t": ("t", 1)}
        | volts("ud", "uq")
        | {f"i{k}": (f"i_{p}", 1) for k, p in enumerate("abc", start=1)}
        | {"theta_e": ("theta_e", 1)},
        asked={f"i_{p}": f'{{ from = "i{k}", unit = "A" }}' for k, p in enumerate("abc", start=1)},
        hint="'i1'",
    ),
    "speed without frame": Table(
        {"t": ("t", 1)} | volts("vd", "vq") | amps("id", "iq") | {"speed [rad/s]": ("omega_m", 1)},
        asked={"omega_m": '{ from = "speed [rad/s]", unit = "rad/s" }'},
        hint="omega_m = { from",
    ),
    "speed without unit": Table(
        {"t": ("t", 1)} | volts("vd", "vq") | amps("id", "iq") | {"Drehzahl": ("omega_m", RPM)},
        asked={"omega_m": '{ from = "Drehzahl", unit = "rpm" }'},
        hint='"rpm"',
    ),
    "angle in degrees without unit": Table(
        {"t": ("t", 1)} | volts("vd", "vq") | amps("id", "iq") | {"theta_el": ("theta_e", DEG)},
        asked={"theta_e": '{ from = "theta_el", unit = "deg" }'},
        hint='"deg"',
    ),
    "time without unit": Table(
        {"timestamp": ("t", 1e6)} | volts("vd", "vq") | amps("id", "iq") | {"we_rad_s": ("omega_e", 1)},
        asked={"t": '{ from = "timestamp", unit = "us" }'},
        hint='"us"',
    ),
    "torque of nobody": Table(
        {"t": ("t", 1)} | {"torque [Nm]": ("tau_m", 1), "rpm": ("omega_m", RPM)},
        asked={"tau_e": '{ from = "torque [Nm]", unit = "N·m" }'},
        hint="the torque of the load or of the motor",
    ),
    "electromagnetic torque": Table(
        {"time_s": ("t", 1)} | {"electromagnetic torque (Nm)": ("tau_e", 1), "w_mech (rad/s)": ("omega_m", 1)}
    ),
    "camel case": Table(
        {"timeMs": ("t", 1e3)}
        | volts("motorVoltageD", "motorVoltageQ")
        | amps("motorCurrentD", "motorCurrentQ")
        | {"mechSpeedRpm": ("omega_m", RPM), "dcBusVoltage": ("v_dc", 1)}
    ),
    "paths of a debugger": Table(
        {"Time [s]": ("t", 1)}
        | volts("motor1.Vdq_V.d", "motor1.Vdq_V.q")
        | amps("motor1.Idq_A.d", "motor1.Idq_A.q")
        | {"motor1.speed_mech_Hz": ("omega_m", 1 / (2.0 * np.pi))},
        separator=";",
    ),
    "tabs and a date line above": Table(
        {"t(s)": ("t", 1)} | volts("Ud(V)", "Uq(V)") | amps("Id(A)", "Iq(A)") | {"n(rpm)": ("omega_m", RPM)},
        separator="\t",
        above="Recorded 2019-05-11 15:22:21.215576\nOperator: K. Meier, bench 2\n\n",
    ),
    "ISO stamps": Table(
        {"timestamp": ("t", 1)}
        | volts("vd_V", "vq_V")
        | amps("id_A", "iq_A")
        | {"omega_el_rad_s": ("omega_e", 1)},
        stamps=iso,
    ),
    "stamps of two words": Table(
        {"Datum Uhrzeit": ("t", 1)}
        | volts("Ud [V]", "Uq [V]")
        | amps("Id [A]", "Iq [A]")
        | {"n [min-1]": ("omega_m", RPM)},
        separator=";",
        comma=True,
        stamps=two_words,
    ),
    "signs apart": Table(
        {"t (s)": ("t", 1)} | volts("vd", "vq") | amps("id", "iq") | {"n (rpm)": ("omega_m", RPM)},
        dialect=lambda value: f"{'-' if value < 0 else '+'} {abs(value)!r}",
    ),
    "no header": Table(
        {"1": ("t", 1), **{str(k): (n, 1) for k, n in enumerate(("v_d", "v_q", "i_d", "i_q", "omega_e"), 2)}},
        asked={
            name: f'"column {k}"' for k, name in enumerate(("t", "v_d", "v_q", "i_d", "i_q", "omega_e"), 1)
        },
        hint='t = { from = "column 1"',
    ),
    "names in quotes": Table(
        {'"Time, s"': ("t", 1)}
        | volts('"Voltage, d axis (V)"', '"Voltage, q axis (V)"')
        | amps('"Current, d axis (A)"', '"Current, q axis (A)"')
        | {'"Electrical speed (rad/s)"': ("omega_e", 1)}
    ),
    "turns": Table(
        {"time [s]": ("t", 1)}
        | volts("ud", "uq")
        | amps("id", "iq")
        | {"shaft velocity [turns/s]": ("omega_m", 1 / (2.0 * np.pi))}
        | {"shaft position [turns]": ("theta_m", 1 / (2.0 * np.pi))}
    ),
    "electrical frequency": Table(
        {"time [s]": ("t", 1)}
        | volts("ud", "uq")
        | amps("id", "iq")
        | {"f_el [Hz]": ("omega_e", 1 / (2.0 * np.pi))},
        asked={"omega_e": '{ from = "f_el [Hz]", unit = "Hz" }'},
        hint="omega_e",
    ),
    "per unit": Table(
        {"time [s]": ("t", 1)}
        | volts("ud [pu]", "uq [pu]", 1 / 24.0)
        | amps("id [A]", "iq [A]")
        | {"we [rad/s]": ("omega_e", 1)},
        asked={
            n: f'{{ from = "{c} [pu]", scale = 24.0, unit = "V" }}' for n, c in (("v_d", "ud"), ("v_q", "uq"))
        },
        hint="ud",
    ),
    "millivolts and milliamps": Table(
        {"time_us": ("t", 1e6)}
        | volts("vd_mV", "vq_mV", 1e3)
        | amps("id_mA", "iq_mA", 1e3)
        | {"erpm": ("omega_e", RPM)}
    ),
    "wrapped counter": Table(
        {"micros": ("t", 1e6)} | volts("vd", "vq") | amps("id", "iq") | {"rpm_mech": ("omega_m", RPM)},
        dialect=lambda value: repr(value),
    ),
    "feet and pounds": Table(
        {"Time (s)": ("t", 1)}
        | amps("Id (A)", "Iq (A)")
        | {"Load Torque (lb-in)": ("tau_m", 1 / 0.1129848290276167), "Shaft Speed (RPM)": ("omega_m", RPM)}
        | {"Winding Temperature (°F)": ("temperature", 1)},
    ),
}


def text_of(table: Table) -> str:
    """The table as a file."""
    columns = []
    for name, factor in table.headers.values():
        values = SI[name] * factor
        if name == "temperature" and "°F" in "".join(table.headers):
            values = SI[name] * 1.8 + 32.0
        columns.append(values)
    rows = []
    for row in zip(*columns, strict=True):
        fields = [table.dialect(float(value)) for value in row]
        if table.comma:
            fields = [text.replace(".", ",") for text in fields]
        if table.stamps is not None:
            fields[0] = table.stamps(row[0])
        rows.append(table.separator.join(fields))
    head = [] if "1" in table.headers else [table.separator.join(table.headers)]
    units = [] if table.units is None else [table.units]
    return table.above + "\n".join([*head, *units, *rows]) + "\n"


def check(found: pm.Recording, table: Table, asked: Mapping[str, str]) -> None:
    """Every column of the table is there with its values, and nothing else is."""
    own = {name for name, _ in table.headers.values()}
    for name in own - {"tau_m"} if "tau_e" in asked else own:
        tolerance = 1e-9 * (1.0 + np.abs(SI[name]).max())
        np.testing.assert_allclose(found.column(name), SI[name], atol=max(tolerance, 2e-6 * (name == "t")))
    derived = {"omega_e", "omega_m", "theta_e", "theta_m", "i_d", "i_q", "v_d", "v_q"} | {*asked}
    assert {*found.names} <= own | derived


@pytest.mark.parametrize("name", TABLES)
def test_a_table_is_read_right_or_refused_with_its_line(name: str, tmp_path: Path) -> None:
    table = TABLES[name]
    path, machine = tmp_path / "run.csv", tmp_path / "machine.toml"
    path.write_text(text_of(table))
    machine.write_text(MACHINE)
    if table.asked:
        with pytest.raises(pm.DataError) as caught:
            pm.load(path, machine)
        assert table.hint in str(caught.value)
        lines = "\n".join(f"{column} = {line}" for column, line in table.asked.items())
        machine.write_text(f"{MACHINE}\n[columns]\n{lines}\n")
    check(pm.load(path, machine), table, table.asked)
