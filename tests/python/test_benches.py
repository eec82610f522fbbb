"""Logs of benches: sensors that are read seldom, rows of units, operating points that stand out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pmsm_rs as pm
import pytest
from conftest import Columns, csv_text, plausible
from pmsm_rs.io.held import held


def held_for(values: np.ndarray, rows: int, first: int = 0) -> np.ndarray:
    at = np.maximum((np.arange(len(values)) - first) // rows * rows + first, 0)
    return values[at]


@pytest.mark.parametrize("speed_rows", [1, 6])
def test_an_angle_that_is_held_goes_with_the_speed(speed_rows: int, tmp_path: Path) -> None:
    columns = plausible(4000)
    columns["theta_e"] = held_for(columns["theta_e"], 8)
    columns["omega_e"] = held_for(columns["omega_e"], speed_rows, 3)
    (tmp_path / "r.csv").write_text(csv_text(columns))
    recording = pm.load(tmp_path / "r.csv")
    [remark] = recording.account.remarks
    assert "'theta_e'" in remark.finding
    assert "8" in remark.finding
    assert ("'omega_e'" in remark.finding) == (speed_rows > 1)


@pytest.mark.parametrize("factor", [-1.0, 3.0, 0.3])
def test_a_held_angle_against_the_speed_is_still_refused(factor: float, tmp_path: Path) -> None:
    columns = plausible(4000)
    columns["theta_e"] = held_for(np.unwrap(columns["theta_e"]) * factor, 4)
    (tmp_path / "r.csv").write_text(csv_text(columns))
    with pytest.raises(pm.DataError, match="turns"):
        pm.load(tmp_path / "r.csv")


def test_a_dead_angle_is_still_refused(columns: Columns, tmp_path: Path) -> None:
    columns["theta_e"] = np.full(400, 1.25)
    (tmp_path / "r.csv").write_text(csv_text(columns))
    with pytest.raises(pm.DataError, match="theta_e turns 0 times as fast"):
        pm.load(tmp_path / "r.csv")


def test_a_locked_rotor_needs_no_column_of_its_motion(columns: Columns, tmp_path: Path) -> None:
    names = {"t": "Messzeit [s]"}
    (tmp_path / "machine.toml").write_text('[machine]\nn_p = 3\n[load]\nkind = "locked"\n')
    standing = {name: columns[name] for name in ("t", "v_d", "v_q", "i_d", "i_q")}
    (tmp_path / "r.csv").write_text(csv_text(standing, names))
    recording = pm.load(tmp_path / "r.csv", tmp_path / "machine.toml")
    assert recording.kind == "electrical"
    np.testing.assert_array_equal(recording.column("omega_m"), 0.0)
    assert pm.inspect(tmp_path / "r.csv", tmp_path / "machine.toml").is_ready
    # A speed that was recorded stays.
    (tmp_path / "r.csv").write_text(csv_text({**standing, "omega_e": np.full(400, 0.01)}, names))
    recording = pm.load(tmp_path / "r.csv", tmp_path / "machine.toml")
    np.testing.assert_array_equal(recording.column("omega_e"), 0.01)
    (tmp_path / "machine.toml").write_text("[machine]\nn_p = 3\n")
    (tmp_path / "r.csv").write_text(csv_text(standing, names))
    with pytest.raises(pm.DataError, match="omega_e"):
        pm.load(tmp_path / "r.csv", tmp_path / "machine.toml")


def test_a_coarse_sensor_is_not_held() -> None:
    t = np.arange(8000) * 1e-4
    coarse = np.round(np.cumsum(20.0 + 10.0 * np.sin(9.0 * t)) * 1e-4 / 0.01) * 0.01
    noisy = np.round(np.random.default_rng(1).normal(size=8000) * 2.0) / 10.0
    stepped = np.repeat([0.0, 1.0, 2.0, -1.0], 2000)
    assert held({"theta_m": coarse, "i_a": noisy, "omega_m": stepped}, {}) is None


UNIT_ROWS = {
    "a date above": ("2019-05-11 15:22:21.2\n", "s, V, V, A, A, rad, rad.s, N.mm, Deg C, W"),
    "brackets": ("", "[s],[V],[V],[A],[A],[rad],[rad.s^-1],[N mm],[°C],[W]"),
    "a unit nobody knows": ("bench 7\n\n", "s,V,V,A,A,rad,rad/s,mN.m,degC,furlong"),
}


@pytest.mark.parametrize("kind", UNIT_ROWS)
def test_rows_of_units_of_a_bench(kind: str, columns: Columns, tmp_path: Path) -> None:
    above, units = UNIT_ROWS[kind]
    more = {"tau_m": columns["i_q"], "temperature": np.full(400, 25.0), "power": np.ones(400)}
    header, *rows = csv_text({**columns, **more}).splitlines()
    (tmp_path / "r.csv").write_text("\n".join([above + header.replace(",", ", "), units, *rows]) + "\n")
    recording = pm.load(tmp_path / "r.csv")
    np.testing.assert_allclose(recording.column("tau_m"), columns["i_q"] * 1e-3)
    np.testing.assert_allclose(recording.column("omega_e"), columns["omega_e"])
    assert recording.account.columns["tau_m"].unit == "mN·m"
    assert recording.account.ignored == ("power",)


def test_torques_in_hundredths(columns: Columns, tmp_path: Path) -> None:
    (tmp_path / "r.csv").write_text(csv_text({**columns, "tau_m": columns["i_q"]}, {"tau_m": "tau_m [N·cm]"}))
    np.testing.assert_allclose(pm.load(tmp_path / "r.csv").column("tau_m"), columns["i_q"] * 1e-2)


def points(seed: int = 3) -> Columns:
    """Operating points of a machine with saturation and dead time, and noise."""
    random = np.random.default_rng(seed)
    grid = np.meshgrid([-8.0, -4.0, 0.0], [-6.0, -2.0, 2.0, 6.0], [100.0, 200.0, 300.0])
    i_d, i_q, w = (axis.ravel() for axis in grid)
    drop = 0.4 * np.sign(i_q)
    return {
        "t": np.arange(len(w), dtype=float),
        "i_d": i_d,
        "i_q": i_q,
        "omega_e": w,
        "v_d": 0.9 * i_d - w * 0.021 * i_q * (1.0 - 0.01 * np.abs(i_q)) + random.normal(size=len(w)) * 0.02,
        "v_q": 0.9 * i_q + w * (0.0096 * i_d + 0.19) + drop + random.normal(size=len(w)) * 0.02,
    }


@pytest.mark.parametrize("seed", range(3))
def test_operating_points_of_an_odd_motor_are_not_wild(seed: int, tmp_path: Path) -> None:
    (tmp_path / "r.csv").write_text(csv_text(points(seed)))
    recording = pm.load(tmp_path / "r.csv")
    assert (recording.kind, len(recording), recording.account.remarks) == ("operating_points", 36, ())


def test_a_wild_row_is_told_by_its_number_and_left_out(tmp_path: Path) -> None:
    columns = points()
    columns["v_q"][17] += 12.0
    (tmp_path / "r.csv").write_text(csv_text(columns))
    recording = pm.load(tmp_path / "r.csv")
    assert len(recording) == 35
    [remark] = recording.account.remarks
    assert remark.finding.startswith("An outlier was left out: line 19, where v_q is +")


def test_a_point_at_the_end_of_the_range_is_never_wild(tmp_path: Path) -> None:
    columns = {name: np.append(values, values[-1]) for name, values in points().items()}
    columns["t"][-1] += 1.0
    columns["i_q"][-1], columns["v_q"][-1] = 30.0, 60.0
    (tmp_path / "r.csv").write_text(csv_text(columns))
    assert len(pm.load(tmp_path / "r.csv")) == 37
