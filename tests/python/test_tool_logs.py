"""Logs as tools of drives write them, by their own names and units."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pmsm_rs as pm
import pytest
from conftest import Columns

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
