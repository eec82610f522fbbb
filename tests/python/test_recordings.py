"""Diagnoses of real measurements. They are not part of the repository; see docs/real_recordings.md."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pmsm_rs as pm
import pytest
from numpy.typing import NDArray
from pmsm_rs.config.machine_file import read_machine
from scipy import io, signal

ROOT = Path(__file__).resolve().parents[2]
RECORDINGS = Path(os.environ.get("PMSM_RS_RECORDINGS", ROOT.parent / "shared" / "recordings"))
MACHINES = ROOT / "docs" / "machines"

Array = NDArray[np.float64]


def diagnose(
    machine: str, recording: str, validation: str | None = None, *, rows: int | None = None
) -> pm.Diagnosis:
    """The diagnosis of a recording, or of its first rows, by a machine file of the documentation; skips where
    it is absent."""
    for name in filter(None, (recording, validation)):
        if not (RECORDINGS / name).is_file():
            pytest.skip(f"the recording is not at {RECORDINGS / name}")
    described = read_machine(MACHINES / machine)
    run, *other = (pm.load(RECORDINGS / name, described) for name in filter(None, (recording, validation)))
    if rows is not None:
        run = pm.load({name: run.column(name)[:rows] for name in run.names})
    return pm.diagnose(run, described.machine, validation=other[0] if other else None, seed=1)


class Force(NamedTuple):
    """Drive force (N) and the regressors of mass, viscous, Coulomb, constant and even viscous friction."""

    measured: Array
    regressors: Array

    def error(self, theta: Array) -> float:
        """Relative force error of parameters in the order of the regressors."""
        rest = self.measured - self.regressors @ theta
        return float(np.linalg.norm(rest) / np.linalg.norm(self.measured))


def force(name: str) -> Force:
    """The EMPS benchmark's own view of a run, after Janot, Gautier & Brunot (2019).

    The position is low-passed forward and backward (4th-order Butterworth, 100 Hz) and differentiated twice
    by central differences; 49 samples are dropped, and everything is decimated by 10 behind an 8th-order
    Chebyshev filter. Padding and phase are those of MATLAB's filtfilt and decimate.
    """
    path = RECORDINGS / "emps" / name
    if not path.is_file():
        pytest.skip(f"the recording is not at {path}")
    run = io.loadmat(path)
    low_pass = signal.butter(4, 100.0, fs=1000.0)
    position = signal.filtfilt(*low_pass, run["qm"].ravel(), padlen=12)
    v = np.gradient(position, 1e-3)
    sense = np.sign(v)
    anti_alias = signal.cheby1(8, 0.05, 0.8 / 10)

    def decimated(x: Array) -> Array:
        kept = x[49:]
        first = (len(kept) - 1) % 10
        filtered: Array = signal.filtfilt(*anti_alias, kept, padlen=24)
        return filtered[first::10]

    columns = (np.gradient(v, 1e-3), v, sense, np.ones_like(v), np.abs(v))
    return Force(
        decimated(run["vir"].ravel() * run["gtau"].item()),
        np.column_stack([decimated(column) for column in columns]),
    )


def parameters(step: Mapping[str, Any]) -> Array:
    """Parameters of one step of the path in the order of the regressors, zero where it has none.

    While the drive moves, a constant load and the even part of Coulomb friction are the same force.
    """
    base, effects = step["base"], step["parameters"]
    coulomb, uneven = effects.get("coulomb_friction", {}), effects.get("asymmetric_friction", {})

    def value(of: Mapping[str, Any], name: str) -> float:
        return of[name]["value"] if name in of else 0.0

    constant = value(base, "tau_load") + value(uneven, "tau_a")
    found = (value(base, "j"), value(base, "b"), value(coulomb, "tau_c"), constant, value(uneven, "b_a"))
    return np.array(found)


PUBLISHED = [
    (("coulomb_friction",), 4.0834e-2),
    (("coulomb_friction", "asymmetric_friction"), 3.1117e-2),
]
"""Force error on the recording after each effect, published with the EMPS data."""


@pytest.fixture(scope="module")
def emps() -> pm.Diagnosis:
    return diagnose("emps.toml", "emps/DATA_EMPS.mat", "emps/DATA_EMPS_PULSES.mat")


def test_the_force_measure_is_the_published_one() -> None:
    """Published parameters give the published errors on both runs, so the measure below is theirs."""
    published = np.array([95.1089, 203.5034, 20.3935, -3.1648, 0.0])
    assert force("DATA_EMPS.mat").error(published) == pytest.approx(4.0834e-2, abs=1e-6)
    assert force("DATA_EMPS_PULSES.mat").error(published) == pytest.approx(5.9824e-2, abs=1e-6)


def steps(emps: pm.Diagnosis) -> list[Mapping[str, Any]]:
    """The path to the model, and behind it that with asymmetric friction where this is the form that comes
    nearest to what is left."""
    nearest = emps.remaining[0].nearest
    both = "asymmetric_friction" not in emps.effects and nearest
    return [*emps.data["path"], *([nearest] if both else [])]


def test_emps_finds_coulomb_and_then_asymmetric_friction(emps: pm.Diagnosis) -> None:
    """The rig leaves many times its noise, so the answer is partial: asymmetric friction may be named or the
    form that comes nearest."""
    assert emps.verdict == "partial"
    assert emps.effects[0] == "coulomb_friction"
    assert [set(step["effects"]) for step in steps(emps)] == [
        set(),
        *(set(effects) for effects, _ in PUBLISHED),
    ]


@pytest.mark.parametrize(("effects", "published"), PUBLISHED, ids=lambda x: str(x))
def test_emps_reaches_the_published_force_error(
    emps: pm.Diagnosis, effects: tuple[str, ...], published: float
) -> None:
    step = next(step for step in steps(emps) if set(step["effects"]) == set(effects))
    assert force("DATA_EMPS.mat").error(parameters(step)) == pytest.approx(published, rel=0.03)


def test_emps_gets_better_on_the_run_with_force_pulses_at_every_step(emps: pm.Diagnosis) -> None:
    pulses = force("DATA_EMPS_PULSES.mat")
    errors = [pulses.error(parameters(step)) for step in steps(emps)]
    assert errors == sorted(errors, reverse=True)
    fit = emps.fit["validation"]
    assert fit["after"]["omega_e"] < 0.3 * fit["before"]["omega_e"]


SATURATION = {"saturation_q", "saturation_d", "cross_saturation"}


def test_operating_points_of_a_traction_motor_show_saturation() -> None:
    answer = diagnose("lea_traction_b.toml", "lea_traction/group_B.csv")
    assert answer.recording_kind == "operating_points"
    assert answer.verdict == "partial"
    first = answer.ranking[0]
    assert SATURATION & set(answer.effects)
    assert {first.effect, *first.equivalent_to} <= SATURATION
    fit = answer.fit["recording"]
    assert all(fit["after"][axis] < 0.5 * fit["before"][axis] for axis in ("v_d", "v_q"))


def test_a_motor_that_warms_up_shows_thermal_drift_of_magnet_and_winding() -> None:
    answer = diagnose("lea_traction_a.toml", "lea_traction/group_A.csv")
    found = {candidate.effect: candidate for candidate in answer.ranking}
    assert {"magnet_thermal_drift", "rs_thermal_drift"} <= set(answer.effects)
    magnet = found["magnet_thermal_drift"].parameters["alpha"]
    assert magnet.value == pytest.approx(1.0e-3, rel=0.15)  # of a sintered NdFeB magnet, 1/K
    alpha = found["rs_thermal_drift"].parameters["alpha"]
    # Either copper's coefficient, or the interval holds it, boundless or not, and r_s is told as confounded.
    if alpha.value != pytest.approx(3.9e-3, rel=0.25):
        assert alpha.ci95 or "the recording does not show it" in (alpha.why_none or "")
        low, high = alpha.ci95 or (-math.inf, math.inf)
        assert low < 3.9e-3 < high
        confounded = [item for item in answer.data_quality if "hardly separable" in item["finding"]]
        assert any("r_s" in item["finding"] for item in confounded)


def test_a_servo_bench_shows_coulomb_friction() -> None:
    answer = diagnose("hsm150.toml", "hsm150/idf_pos_0.06_1.mat", "hsm150/idf_pos_0.06_2.mat")
    assert answer.ranking[0].effect == "coulomb_friction"
    assert answer.ranking[0].parameters["tau_c"].value == pytest.approx(0.037, rel=0.25)
    fit = answer.fit["validation"]
    assert fit["after"]["omega_e"] < 0.5 * fit["before"]["omega_e"]


def test_a_flexible_coupling_shows_antiresonance_and_resonance() -> None:
    # 6.4 of its 20 s show the same shaft.
    answer = diagnose("flexible_shaft.toml", "flexible_shaft/MultisineTypeA.mat", rows=16_000)
    # The rig leaves five times its noise beside the shaft.
    assert (answer.verdict, answer.effects) == ("partial", ("two_mass_shaft",))
    shaft = answer.ranking[0].parameters
    assert shaft["f_antires"].value == pytest.approx(54.0, abs=3.0)
    assert shaft["f_res"].value == pytest.approx(76.0, abs=3.0)


def test_open_terminals_show_the_harmonics_and_what_is_wrong_with_the_probes() -> None:
    answer = diagnose("back_emf_scope.toml", "back_emf_scope/1000rpm_CHAN1.csv")
    assert answer.recording_kind == "open_circuit"
    # Three to four times the noise is left beside the 5th and the 7th.
    assert (answer.verdict, answer.effects) == ("partial", ("back_emf_harmonics",))
    harmonics = answer.ranking[0].parameters
    # The phases taken by themselves have a 5th harmonic of 3.4 to 3.7 % and a 7th of 0.2 to 0.5 %.
    assert harmonics["e5_rel"].value == pytest.approx(0.036, abs=0.002)
    assert harmonics["e7_rel"].value == pytest.approx(0.0035, abs=0.0015)
    found = [item["finding"] for item in answer.data_quality]
    assert any("v_c has 0.1000 times the gain" in text for text in found)
    assert any("v_b has an offset of -0.16" in text for text in found)
    assert answer.base["psi_m"].value == pytest.approx(3.95 / (2 * np.pi * 1000 / 60 * 7), rel=0.01)


@pytest.mark.parametrize(
    ("motor", "n_p", "missing", "verdict"),
    [
        ("mj5208", 7, {"dead_time", "saturation_d"}, "named"),
        ("be8108", 21, {"dead_time", "saturation_d"}, "named"),
        # The inverter is the same for all. Here its voltage comes out as 0.97 ± 0.65 V, which may be none.
        ("mad8318", 21, {"dead_time", "saturation_d"}, "ambiguous"),
        ("flipsky6374", 7, {"dead_time"}, "named"),
        ("custom", 20, set(), "no_mismatch"),
    ],
)
def test_points_of_one_axis_show_its_saturation_and_what_the_inverter_loses(
    tmp_path: Path, motor: str, n_p: int, missing: set[str], verdict: str
) -> None:
    machine = (MACHINES / "moteus_mj5208.toml").read_text().replace("n_p = 7", f"n_p = {n_p}")
    (tmp_path / "machine.toml").write_text(machine)
    answer = diagnose(str(tmp_path / "machine.toml"), f"moteus_inductance/ld_{motor}.json")
    assert answer.recording_kind == "operating_points"
    assert answer.verdict == verdict
    assert set(answer.effects) == missing
    assert set(answer.fit["recording"]["after"]) == {"v_q"}
    if "dead_time" in missing:
        [found] = [candidate for candidate in answer.ranking if candidate.effect == "dead_time"]
        v_err = found.parameters["v_err"]
        if verdict == "named":
            assert v_err.value == pytest.approx(0.13, abs=0.02)
            assert v_err.stderr is not None
            assert v_err.stderr < 0.03
        else:
            assert found.probability <= 0.5


def test_a_flux_map_shows_saturation_and_no_resistance() -> None:
    answer = diagnose("baldor.toml", "baldor_flux_map/baldor_400rpm_map.npz")
    assert answer.verdict == "partial"
    assert {"saturation_q", "cross_saturation"} <= set(answer.effects) <= SATURATION
    r_s = answer.base["r_s"]
    assert r_s.value is None
    assert "does not show" in (r_s.why_none or "")
