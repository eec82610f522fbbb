"""Writes a concealed case: recordings and machine file for the tool, the truth in a folder of its own."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Callable
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from . import limits
from .bench import degrade
from .effects import EQUATION, HOLDS, Effects, effect_values
from .foreign import FORMS
from .lookalikes import lookalikes
from .manoeuvres import Manoeuvre, make
from .oracle import oracle
from .parameters import Machine
from .peers import simulate_by
from .plant import Run, simulate
from .reference import Fit, currents, fit_plain, park, speed_residual, torque_of

BASE = ("r_s", "l_d", "l_q", "psi_m", "n_p", "j", "b")


def atomically(path: Path, write: Callable[[str], None]) -> None:
    """Let `write` fill a temporary file beside `path`, then rename it: readers see all of it or nothing."""
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    os.close(handle)
    try:
        write(temporary)
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except BaseException:
        os.unlink(temporary)
        raise


def write_text(path: Path, text: str) -> None:
    """Write a text file atomically."""

    def write(name: str) -> None:
        with open(name, "w", encoding="utf-8") as f:
            f.write(text)

    atomically(path, write)


def write_arrays(path: Path, arrays: dict[str, np.ndarray]) -> None:
    """Write a compressed npz atomically."""

    def write(name: str) -> None:
        # given a name instead of a file, numpy would append a suffix
        with open(name, "wb") as f:
            np.savez_compressed(f, **arrays)

    atomically(path, write)


def write_parquet(path: Path, run: Run) -> None:
    """Write the log of a run."""
    write_columns(path, {"t": run.t, **run.log})


def write_columns(path: Path, columns: dict[str, np.ndarray]) -> None:
    """Write columns (n,): t as float64, everything else as float32, zstd on split byte streams."""
    table = pa.table({k: v if k == "t" else v.astype(np.float32) for k, v in columns.items()})
    atomically(
        path,
        lambda name: pq.write_table(
            table,
            name,
            compression="zstd",
            compression_level=9,
            use_dictionary=False,
            use_byte_stream_split=True,
        ),
    )


def nameplate_of(machine: Machine, seed: int) -> Machine:
    """The machine as its nameplate tells it: every base parameter but n_p 5 to 20 % off, either way."""
    rng = np.random.default_rng([seed, 11])

    def off(value: float) -> float:
        return float(f"{value * (1 + rng.choice([-1, 1]) * rng.uniform(0.05, 0.2)):.5g}")

    m = machine
    return replace(
        m, r_s=off(m.r_s), l_d=off(m.l_d), l_q=off(m.l_q), psi_m=off(m.psi_m), j=off(m.j), b=off(m.b)
    )


def machine_file(nameplate: Machine, manoeuvre: Manoeuvre) -> str:
    """Text of machine.toml."""
    lines = ["# nameplate values (data sheet, each may be off by 5 to 20 %)", "[machine]"]
    units = ("ohm", "H", "H", "V s, peak per phase", "pole pairs", "kg m^2, everything that turns", "N m s")
    lines += [f"{k} = {getattr(nameplate, k)!r}  # {u}" for k, u in zip(BASE, units, strict=True)]
    lines += ["", "[drive]", f"v_dc = {nameplate.v_dc:g}  # V", f"i_rated = {nameplate.i_rated:g}  # A peak"]
    lines += [f"f_sample = {nameplate.f_sample:g}  # Hz", "", "[load]", f'kind = "{manoeuvre.load}"']
    if manoeuvre.load == "known_constant":
        lines.append(f"value = {float(manoeuvre.tau_load[0])!r}  # N m")
    return "\n".join(lines) + "\n"


def clean_channels(run: Run) -> dict[str, np.ndarray]:
    """What the sensors would have shown without noise and quantisation: i_a, i_b, i_c, omega_e, each (n,)."""
    names = {"i_a": "seen_a", "i_b": "seen_b", "i_c": "seen_c", "omega_e": "seen_w"}
    return {name: run.truth[seen] for name, seen in names.items()}


def base_of(machine: Machine) -> dict[str, float]:
    """The parameters of the plain machine."""
    return {k: float(getattr(machine, k)) for k in BASE}


def noise_of(run: Run) -> tuple[dict[str, np.ndarray], dict[str, float]]:
    """Noise of a full log: i_d, i_q (A) and omega_e (rad/s), each (n,), and their rms."""
    noise = {k: run.log[k] - v for k, v in clean_channels(run).items()}
    n_d, n_q = park(noise["i_a"], noise["i_b"], noise["i_c"], run.log["theta_e"])
    out = {"i_d": n_d, "i_q": n_q, "omega_e": noise["omega_e"]}
    return out, {k: float(np.sqrt(np.mean(v**2))) for k, v in out.items()}


def refit(machine: Machine, manoeuvre: Manoeuvre, run: Run, *, base: bool = True) -> Fit:
    """The plain machine fitted to a log from its true parameters, which stay as they are without `base`.

    Rows that the log left out are left out of the load's steps, too.
    """
    known = manoeuvre.known_load
    rows = np.rint(run.t * machine.f_sample).astype(int)
    at = np.searchsorted(rows, known["breaks"])
    known = {**known, "breaks": tuple(int(k) for k in at if 0 < k < len(rows))}
    return fit_plain(base_of(machine), run.log, float(np.median(np.diff(run.t))), **known, refit=base)


def account(machine: Machine, effects: Effects, manoeuvre: Manoeuvre, run: Run) -> dict[str, Any]:
    """Noise of a run, the least that true equations leave, and the plain machine's residual over the noise at
    the true and at re-fitted base parameters.

    True equations leave more than the noise.  Their free run of the currents is driven by the noisy speed,
    that of the speed by the torque of noisy currents, less a noisy load torque where that is measured.
    """
    (noise, rms), clean, theta = noise_of(run), clean_channels(run), run.log["theta_e"]
    load, known = manoeuvre.tau_load[manoeuvre.settle :], manoeuvre.known_load
    base, least = base_of(machine), rms
    if not manoeuvre.locked:
        n_d, n_q = noise["i_d"], noise["i_q"]
        i_d, i_q = park(*(clean[k] for k in ("i_a", "i_b", "i_c")), theta)
        push = torque_of(base, i_d + n_d, i_q + n_q) - torque_of(base, i_d, i_q)
        if "tau_m" in run.log:
            push -= run.log["tau_m"] - load
        t_s, first = 1.0 / machine.f_sample, np.array([i_d[0], i_q[0]])
        seen, true = (
            currents(base, {**run.log, "omega_e": omega}, t_s, first)
            for omega in (run.log["omega_e"], clean["omega_e"])
        )
        rest = {
            "i_d": n_d - (seen - true)[:, 0],
            "i_q": n_q - (seen - true)[:, 1],
            "omega_e": speed_residual(base, push, noise["omega_e"], t_s, machine.n_p),
        }
        least = {k: float(np.sqrt(np.mean(v**2))) for k, v in rest.items()}
    out: dict[str, Any] = {"noise_rms": rms, "least_rms": least, "load_breaks": list(known["breaks"])}
    for name, free in (("plain_true", False), ("plain_refit", True)):
        fit = refit(machine, manoeuvre, run, base=free)
        out[name] = {k: round(v / rms[k], 4) for k, v in fit.rms().items()}
    out["refit_base"] = fit.base
    return out


def stated(effects: dict[str, dict[str, float]]) -> dict[str, dict[str, float]]:
    """The parameters as an answer states them: a sensor's gain, not its error."""
    gains = "current_gain_imbalance"
    return {k: {n: 1.0 + x for n, x in v.items()} if k == gains else v for k, v in effects.items()}


def make_case(
    folder: str | os.PathLike[str],
    machine: Machine,
    effects: Effects,
    manoeuvre: str = "rich",
    load: str = "none",
    seed: int = 1,
    *,
    truth_folder: str | os.PathLike[str],
    duration: float = 2.0,
    degraded: str | None = None,
    stator_hold: bool = False,
    log_command: bool = False,
    log_v_dc: bool = False,
    simulator: str = "plant",
    solve: bool = False,
) -> dict[str, Any]:
    """Make recording.parquet, validation.parquet and machine.toml in `folder`, the truth in `truth_folder`.

    The validation run is another manoeuvre of the same kind on the same machine, with its own load unless
    that is known and constant.  `degraded` names a poorer logger (`bench.KINDS`); the truth's `runs` describe
    the log before it.  `simulator` is this folder's plant or one of
    `peers.SIMULATORS`.  Effects outside the package's catalogue begin with x_; "unknown" is then expected.
    Returns what truth.json holds; clean.npz beside it holds the validation run without sensor noise.  Raises
    ValueError if the truth would end up where the tool may see it, and whatever `manoeuvres.make`,
    `plant.simulate` and `bench.degrade` raise.  `stator_hold`, `log_command`: see `plant.simulate`.  `solve`
    states what the plant's own equations leave over the noise (`oracle`), for voltages held in the rotor's
    frame.
    """
    opened, sealed = Path(folder), Path(truth_folder)
    if sealed.resolve() == opened.resolve():
        raise ValueError("the truth must not lie in the folder the tool sees")
    opened.mkdir(parents=True, exist_ok=True)
    sealed.mkdir(parents=True, exist_ok=True)
    filled, nameplate = effect_values(effects), nameplate_of(machine, seed)
    runs: dict[str, Any] = {}
    similar: list[str] = []
    clean: dict[str, np.ndarray] = {}
    forms = {k: FORMS[k] for k in filled if k in FORMS}
    known = [k for k in filled if k not in FORMS]
    moves = [make(machine, manoeuvre, load, duration=duration, seed=1000 * seed + k) for k in (0, 1)]
    if load == "known_constant":
        # the machine file states one value, so it holds for both runs
        moves[1] = replace(moves[1], tau_load=np.full_like(moves[1].tau_load, moves[0].tau_load[0]))
    for number, name in enumerate(("recording", "validation")):
        m, run_seed = replace(moves[number], log_v_dc=log_v_dc), 1000 * seed + number
        if simulator == "plant":
            run = simulate(
                machine,
                effects,
                m,
                seed=run_seed,
                nameplate=nameplate,
                stator_hold=stator_hold,
                log_command=log_command,
            )
        else:
            run = simulate_by(simulator, machine, effects, m, seed=run_seed, nameplate=nameplate)
        runs[name] = account(machine, effects, m, run)
        if solve:
            noise = runs[name]["noise_rms"]
            own = oracle(machine, effects, m, run)
            runs[name]["oracle"] = {k: round(v / noise[k], 4) for k, v in own.items()}
        clean = {k: v.astype(np.float32) for k, v in clean_channels(run).items()}
        full = run
        if degraded is not None:
            limited = degraded in limits.KINDS
            logged = (
                limits.limit(run, degraded, machine, seed, run_seed)
                if limited
                else degrade(run, degraded, machine, run_seed)
            )
            # more noise hides more; the other logs do not keep the rows that the fit needs
            run, full = logged, logged if degraded == "noisy" else run
        if name == "recording":
            similar = lookalikes(machine, effects, m, full, base_of(machine))
        write_parquet(opened / f"{name}.parquet", run)
    write_arrays(
        sealed / "clean.npz",
        {"a": clean["i_a"], "b": clean["i_b"], "c": clean["i_c"], "omega": clean["omega_e"]},
    )
    write_text(opened / "machine.toml", machine_file(nameplate, moves[0]))
    label = "+".join(filled) if filled else "none"
    truth: dict[str, Any] = {
        "version": "1.0",
        "source": simulator,
        "effect": label,
        "components": known,
        "expected": ("partial" if known else "unknown") if forms else label,
        "equation": {k: EQUATION[k][0] for k in filled},
        "accept": {k: list(EQUATION[k]) for k in filled},
        "parameters": stated(filled),
        "also_accept": sorted(
            {k for form in forms.values() for k in form.accepted}
            | {part for effect in known for part in HOLDS.get(effect, ())}
        ),
        "foreign": {k: {"equations": list(f.equations), "over": list(f.over)} for k, f in forms.items()},
        "indistinguishable": similar,
        "base_true": {k: getattr(machine, k) for k in BASE},
        "nameplate": {k: getattr(nameplate, k) for k in BASE},
        "machine": machine.name,
        "manoeuvre": manoeuvre,
        "load": load,
        "load_const": float(moves[0].tau_load[0]) if "constant" in load else 0.0,
        "seed": seed,
        "f_sample": machine.f_sample,
        "duration": duration,
        "v_dc": machine.v_dc,
        "hold": ("stator, command logged" if log_command else "stator") if stator_hold else "rotor",
        "noise": {k: v for k, v in asdict(machine).items() if k.startswith(("noise", "lsb", "encoder"))},
        "runs": runs,
    }
    if degraded is not None:
        truth["degraded"] = degraded
    if degraded in limits.KINDS:
        truth["logger"] = limits.drawn(degraded, seed)
    if degraded == "short":
        truth["shortened"] = True
    write_text(sealed / "truth.json", json.dumps(truth, indent=1) + "\n")
    return truth
