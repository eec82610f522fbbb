"""Closed loop of design: are ambiguous answers settled by designed recordings, and by random ones?

python -m proof.design --out out/design --cases 20 --seed 7          # from the root of the repository

A drive of this folder's plant makes a narrow recording: one direction, two speeds, no steps of i_d. Where its
diagnosis is `ambiguous`, the package designs the next recording. The plant records it, and both recordings
are diagnosed together. That is repeated once where it is not settled. The same case goes through random
manoeuvres of the same families, limits and length, and through the rich manoeuvre of this folder at the same
length. A case is settled where the answer names the effect that is true, alone and without a rival.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import sys
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[name] = "1"

import numpy as np  # noqa: E402

from .case import machine_file, nameplate_of, write_text  # noqa: E402
from .effects import HOLDS  # noqa: E402
from .machines import MACHINES, another  # noqa: E402
from .manoeuvres import Manoeuvre, limit_slope, make  # noqa: E402
from .parameters import Machine  # noqa: E402
from .plant import Run, simulate  # noqa: E402
from .strengths import RULES  # noqa: E402

# s of each recording, and recordings after the first
TIME, ROUNDS = 0.8, 2
# shares of the rated values that the next recording may use
CURRENT, SPEED = 1.0, 0.8
# strengths, in the units of RULES
STRENGTH = (0.5, 3.0)
# effects whose equations are not stiff, and whose answer has a single name
EFFECTS = (
    "coulomb_friction",
    "saturation_q",
    "asymmetric_friction",
    "voltage_delay",
    "stribeck_friction",
    "cross_saturation",
    "dead_time",
    "encoder_angle_offset",
)
ARMS = ("designed", "random", "rich")


@dataclass(frozen=True)
class Setting:
    """A case: the machine, the effect with its parameters, and a seed."""

    number: int
    machine: Machine
    effect: str
    values: dict[str, float]
    seed: int


def setting(number: int, seed: int) -> Setting:
    """The case of a number; effects take turns, machines and strengths are drawn."""
    rng = np.random.default_rng([seed, 5, number])
    effect = EFFECTS[number % len(EFFECTS)]
    kinds = [k for k, m in MACHINES.items() if m.f_sample <= 16_000.0]
    machine = another(MACHINES[str(rng.choice(kinds))], rng)
    greatest, rule = RULES[effect]
    s = min(greatest, math.exp(rng.uniform(*map(math.log, STRENGTH))))
    values = rule(machine, s, lambda a, b: float(rng.uniform(a, b)), rng)
    return Setting(number, machine, effect, values, int(rng.integers(1, 2**31 // 1000)))


def narrow(machine: Machine, seed: int) -> Manoeuvre:
    """Two speeds in one direction, every other time almost the same ones, with i_d at zero."""
    rng = np.random.default_rng([seed, 6])
    n = round(TIME * machine.f_sample)
    low = rng.uniform(0.25, 0.4) * machine.w_rated
    high = low * (1.1 if rng.uniform() < 0.5 else rng.uniform(1.6, 2.4))
    w = np.where(np.arange(n) < n // 2, low, high)
    w = limit_slope(w, low, 0.5 * machine.tau_rated / machine.j / machine.f_sample)
    zero = np.zeros(n)
    return Manoeuvre("narrow", "none", w, zero, zero, zero, w_start=low)


def of_references(machine: Machine, references: dict[str, np.ndarray]) -> Manoeuvre:
    """A designed manoeuvre at the sample rate of the drive."""
    t = references["t"]
    at = np.arange(round(float(t[-1]) * machine.f_sample)) / machine.f_sample
    i_d, i_q = (np.interp(at, t, references[k]) for k in ("i_d_ref", "i_q_ref"))
    zero = np.zeros(len(at))
    if "omega_m_ref" not in references:
        return Manoeuvre("designed", "none", zero, i_d, i_q, zero, currents_alone=True)
    return Manoeuvre("designed", "none", np.interp(at, t, references["omega_m_ref"]), i_d, i_q, zero)


def drawn(answer: Any, machine: Machine, seed: int) -> tuple[Manoeuvre, str]:
    """A random manoeuvre of the package's families that keeps the limits, and its words."""
    from pmsm_rs.experiments.design import bench_of
    from pmsm_rs.experiments.outcome import columns_of
    from pmsm_rs.experiments.references import GENES, build, families

    bench, scales = bench_of(answer, limits_of(machine))
    rng = np.random.default_rng([seed, 8])
    while True:
        kind = str(rng.choice(families(scales)))
        references = build(kind, rng.random(GENES), bench.limits, scales)
        if bench.run(answer.model, references).broken is None:
            return of_references(machine, columns_of(references)), references.words


def recorded(case: Setting, manoeuvre: Manoeuvre, number: int) -> Run:
    """What the plant logs."""
    return simulate(
        case.machine,
        {case.effect: case.values},
        manoeuvre,
        seed=1000 * case.seed + number,
        nameplate=nameplate_of(case.machine, case.seed),
    )


def limits_of(machine: Machine) -> dict[str, dict[str, float]]:
    """What the next recording may use."""
    return {
        "limits": {
            "current": CURRENT * machine.i_rated,
            "speed": SPEED * machine.w_rated,
            "voltage": machine.v_dc,
            "time": TIME,
        },
        "drive": {"f_sample": machine.f_sample, "current_bandwidth": machine.f_sample / 25.0},
    }


def excess(run: Run, machine: Machine) -> float:
    """The largest share of its limits of current and speed that a run took."""
    a, b, c = (run.truth[k] for k in ("i_a", "i_b", "i_c"))
    current = float(np.sqrt((a * a + b * b + c * c) * 2.0 / 3.0).max()) / (CURRENT * machine.i_rated)
    return max(current, float(np.abs(run.truth["omega_m"]).max()) / (SPEED * machine.w_rated))


def settled(answer: Any, effect: str) -> str:
    """`right`, `wrong` or `open`: whether the answer names one effect for sure, and the true one."""
    if answer.verdict == "ambiguous" or not answer.effects:
        return "open"
    if answer.verdict != "named":
        return "open"
    return "right" if set(answer.effects) in ({effect}, {effect, *HOLDS.get(effect, ())}) else "wrong"


def arm(case: Setting, kind: str, first: Any, log: Any, plate: Path, tries: int) -> dict[str, Any]:
    """Recordings of one kind until the case is settled."""
    import pmsm_rs as pm

    rows: list[dict[str, Any]] = []
    answer, logs = first, [log]
    for number in range(1, ROUNDS + 1):
        row: dict[str, Any] = {}
        seed = 100 * case.seed + number
        try:
            if kind == "rich":
                manoeuvre = make(case.machine, "rich", "none", duration=TIME, seed=seed)
            elif kind == "random":
                manoeuvre, row["words"] = drawn(answer, case.machine, seed)
            else:
                began = time.process_time()
                found = pm.design(answer, limits_of(case.machine), tries=tries, seed=seed, threads=1)
                row |= {"task": found.task, "nats": found.nats, "words": found.words}
                row |= {"rivals": list(found.rivals), "seconds": time.process_time() - began}
                manoeuvre = of_references(case.machine, found.references)
            run = recorded(case, manoeuvre, number)
        except (pm.PmsmError, RuntimeError) as error:
            rows.append(row | {"state": "open", "error": str(error)})
            break
        row["of_limits"] = excess(run, case.machine)
        before = answer
        logs.append(pm.load({"t": run.t, **run.log}, str(plate)))
        answer = pm.diagnose(logs, str(plate), threads=1)
        row |= {"verdict": answer.verdict, "effects": list(answer.effects)}
        row["state"] = settled(answer, case.effect)
        rows.append(row)
        if row["state"] != "open":
            break
        if answer.verdict == "undetermined":
            # There is no model to design from: the next one comes from the answer before.
            answer = before
    return {"rounds": rows, "state": rows[-1]["state"], "recordings": len(rows)}


def answer_case(number: int, seed: int, out: Path, tries: int, arms: tuple[str, ...]) -> dict[str, Any]:
    """One case from its first recording to the last; its result is kept in a file."""
    import pmsm_rs as pm

    case = setting(number, seed)
    file = out / f"case{number:03d}.json"
    if file.exists():
        return json.loads(file.read_text(encoding="utf-8"))
    result: dict[str, Any] = {"case": number, "effect": case.effect, "machine": case.machine.name}
    result["values"] = case.values
    try:
        manoeuvre = narrow(case.machine, case.seed)
        run = recorded(case, manoeuvre, 0)
        plate = out / f"case{number:03d}.toml"
        write_text(plate, machine_file(nameplate_of(case.machine, case.seed), manoeuvre))
        log = pm.load({"t": run.t, **run.log}, str(plate))
        first = pm.diagnose(log, str(plate), threads=1)
        result |= {"verdict": first.verdict, "effects": list(first.effects)}
        result["rivals"] = {c.effect: list(c.equivalent_to) for c in first.ranking[:3]}
        if first.verdict == "ambiguous":
            result["arms"] = {kind: arm(case, kind, first, log, plate, tries) for kind in arms}
    except (pm.PmsmError, RuntimeError) as error:
        result["error"] = str(error)
    write_text(file, json.dumps(result, indent=1) + "\n")
    return result


def table(results: list[dict[str, Any]], arms: tuple[str, ...]) -> str:
    """How many cases each kind of recording settled."""
    open_ones = [r for r in results if "arms" in r]
    lines = [f"{len(results)} cases, {len(open_ones)} of them ambiguous after the first recording", ""]
    lines += ["| next recordings | settled by 1 | settled by 2 at most | wrong name | not settled |"]
    lines += ["|---|---|---|---|---|"]
    for kind in arms:
        ends = [r["arms"][kind] for r in open_ones]
        right = [e for e in ends if e["state"] == "right"]
        one = sum(e["recordings"] == 1 for e in right)
        wrong = sum(e["state"] == "wrong" for e in ends)
        lines.append(f"| {kind} | {one} | {len(right)} | {wrong} | {len(ends) - len(right) - wrong} |")
    return "\n".join(lines) + "\n"


def main() -> int:
    """Do what the arguments ask."""
    ap = argparse.ArgumentParser(
        prog="python -m proof.design",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    ap.add_argument("--out", type=Path, required=True)
    ap.add_argument("--cases", type=int, default=40)
    ap.add_argument("--seed", type=int, required=True)
    ap.add_argument("--jobs", type=int, default=2)
    ap.add_argument("--tries", type=int, default=32, help="manoeuvres that a design compares")
    ap.add_argument("--arms", type=lambda text: tuple(text.split(",")), default=ARMS)
    a = ap.parse_args()
    a.out.mkdir(parents=True, exist_ok=True)
    with ProcessPoolExecutor(a.jobs) as pool:
        jobs = [pool.submit(answer_case, k, a.seed, a.out, a.tries, a.arms) for k in range(a.cases)]
        results = []
        for job in jobs:
            try:
                results.append(job.result())
            except Exception as error:
                # A case that the proof itself cannot make does not end the others; it is told.
                results.append({"error": repr(error)})
            print(json.dumps({k: v for k, v in results[-1].items() if k != "values"}), flush=True)
    text = table(results, a.arms)
    write_text(a.out / "table.md", text)
    write_text(a.out / "results.json", json.dumps(results, indent=1) + "\n")
    print(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
