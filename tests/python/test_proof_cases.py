"""A case of the proof: the same for the same seed, on a machine of its own, with all names it accepts."""

from __future__ import annotations

import hashlib
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("numba")
pytest.importorskip("pyarrow")
pytest.importorskip("scipy")

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from verdicts import COULOMB  # noqa: E402

from proof import generate  # noqa: E402
from proof.case import make_case  # noqa: E402
from proof.heldout import columns  # noqa: E402
from proof.least import least_speed  # noqa: E402
from proof.lookalikes import lookalikes  # noqa: E402
from proof.machines import MACHINES, SERVO, SPREAD, another  # noqa: E402
from proof.manoeuvres import make  # noqa: E402
from proof.peers import simulate_by  # noqa: E402
from proof.plan import Planned  # noqa: E402
from proof.plant import simulate  # noqa: E402


def test_every_case_has_a_machine_of_its_own() -> None:
    made = [
        another(machine, np.random.default_rng(seed)) for machine in MACHINES.values() for seed in range(20)
    ]
    assert len({m.r_s for m in made}) == len(made)
    for m in made:
        kind = MACHINES[m.name]
        for of, of_kind in ((m.r_s, kind.r_s), (m.l_d, kind.l_d), (m.psi_m, kind.psi_m), (m.j, kind.j)):
            assert 1 / SPREAD <= of / of_kind <= SPREAD
        assert 1.0 <= (m.l_q / m.l_d) / (kind.l_q / kind.l_d) <= SPREAD
        # the link drives it as far as the machine that it is like
        assert m.psi_m * m.w_rated == pytest.approx(kind.psi_m * kind.w_rated)
    assert another(SERVO, np.random.default_rng(3)) == another(SERVO, np.random.default_rng(3))


def hashes(folder: Path) -> dict[str, str]:
    """Content of every file below a folder."""
    files = sorted(p for p in folder.rglob("*") if p.is_file())
    return {str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


def test_a_case_depends_on_its_seed_alone_and_a_torn_one_is_made_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(generate, "DURATION", (0.3, 0.4))
    planned = Planned("single", (COULOMB,), "servo", "none", "two_currents", "plant")
    first = generate.generate(2, 5, planned, tmp_path / "a")
    torn = tmp_path / "b" / ".v002" / "open"
    torn.mkdir(parents=True)
    (torn / "recording.parquet").write_bytes(b"half")
    assert not generate.is_made(2, tmp_path / "b")
    generate.generate(2, 5, planned, tmp_path / "b")
    assert generate.is_made(2, tmp_path / "b")
    assert hashes(tmp_path / "a") == hashes(tmp_path / "b")
    assert first["kind"] == "single"
    assert 1.3 < first["severity"] < 22.0
    assert {p.name for p in (tmp_path / "a" / "open" / "v002").iterdir()} == {
        "machine.toml", "recording.parquet", "validation.parquet"
    }  # fmt: skip


def test_a_weak_stribeck_is_coulomb_friction_and_a_strong_one_is_not() -> None:
    manoeuvre = make(SERVO, "rich", "none", duration=1.0, seed=3)
    base = {k: float(getattr(SERVO, k)) for k in ("r_s", "l_d", "l_q", "psi_m", "n_p", "j", "b")}
    found = []
    for size in (0.07, 1.0):
        effects = {"stribeck_friction": {"tau_c": 0.2 * size, "tau_s": 0.4 * size, "w_s": 8.0}}
        run = simulate(SERVO, effects, manoeuvre, seed=8)
        found.append(lookalikes(SERVO, effects, manoeuvre, run, base))
    assert found == [["coulomb_friction"], []]


@pytest.mark.parametrize("simulator", ["motulator", "gym-electric-motor"])
def test_other_simulators_agree_with_the_plant_where_nothing_is_switched_on(simulator: str) -> None:
    pytest.importorskip(simulator.replace("-", "_"), reason="pip install pmsm-rs[peers]")
    manoeuvre = make(SERVO, "rich", "unknown_piecewise", duration=0.15, seed=3)
    theirs = simulate_by(simulator, SERVO, {}, manoeuvre, seed=8)
    ours = simulate(SERVO, {}, manoeuvre, seed=8, stator_hold=simulator == "motulator")
    # a rounding of the last digit may move a sample across a step of the converter
    assert np.abs(theirs.truth["i_a"] - ours.truth["i_a"]).max() < 1.5 * SERVO.lsb_i
    assert np.abs(theirs.truth["omega_m"] - ours.truth["omega_m"]).max() < 1e-5 * SERVO.w_rated
    with pytest.raises(ValueError, match="dead_time"):
        simulate_by(simulator, SERVO, {"dead_time": {"v_err": 1.0}}, manoeuvre, seed=8)


@pytest.mark.parametrize("load", ["none", "measured"])
def test_what_a_true_machine_leaves_follows_from_the_stated_noise(tmp_path: Path, load: str) -> None:
    noisy = replace(SERVO, noise_i=10.0 * SERVO.noise_i)
    case = make_case(tmp_path / "open", noisy, {}, load=load, truth_folder=tmp_path / "sealed")
    run = case["runs"]["validation"]
    found = least_speed(case, columns(tmp_path / "open" / "validation.parquet"), draws=10)
    # more than the speed sensor's noise, as much as the noise that was really drawn
    assert run["least_rms"]["omega_e"] > 1.2 * run["noise_rms"]["omega_e"]
    assert found.mean() == pytest.approx(run["least_rms"]["omega_e"], abs=3.0 * found.std())
    # in a shorter free run the rotor is moved less
    shorter = least_speed(case, columns(tmp_path / "open" / "validation.parquet"), draws=10, window=0.05)
    assert shorter.mean() < found.mean()


def test_the_mean_of_two_levels_of_friction_is_no_wrong_name(tmp_path: Path) -> None:
    friction = {"asymmetric_friction": {"tau_c_pos": 0.05, "tau_c_neg": 0.09}}
    case = make_case(tmp_path / "open", SERVO, friction, truth_folder=tmp_path / "sealed")
    assert case["also_accept"] == [COULOMB]
    drag = {"quadratic_drag": {"k": 1e-5}}
    assert make_case(tmp_path / "o", SERVO, drag, truth_folder=tmp_path / "s")["also_accept"] == []
