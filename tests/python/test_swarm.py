"""Settings of the swarm: names, numbers and the command line."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pmsm_rs as pm
import pytest
from conftest import Ran

Run = Callable[..., Ran]


@pytest.fixture(scope="module")
def made() -> pm.Simulation:
    return pm.simulate(
        duration=0.05,
        drive={"f_sample": 1e4},
        reference={"omega_m": {"t": [0, 0.05], "value": [0, 60]}},
        load={"tau": 3.0},
    )


@pytest.mark.parametrize(
    "swarm",
    [
        pm.Swarm(),
        pm.Swarm(inertia=0.9, inertia_schedule="linear", inertia_last=0.4),
        pm.Swarm(inertia=1.0, inertia_schedule="adaptive", inertia_last=0.0),
        pm.Swarm(inertia=1.0, inertia_schedule="random", inertia_last=0.5),
        pm.Swarm(update="constriction", cognitive=2.05, social=2.05, neighbourhood="ring"),
        pm.Swarm(update="fully_informed", cognitive=2.05, social=2.05, neighbourhood="von_neumann"),
    ],
)
def test_every_variant_finds_two_parameters(made: pm.Simulation, swarm: pm.Swarm) -> None:
    fit = pm.identify(
        made.recording,
        made.machine,
        fit={"r_s": (0.05, 0.5), "tau_load": (0.0, 10.0)},
        method="pso",
        swarm=swarm,
    )
    assert fit.parameters["r_s"].value == pytest.approx(0.17, rel=0.2)
    assert fit.parameters["tau_load"].value == pytest.approx(3.0, rel=0.05)


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"update": "inertial"}, "did you mean 'inertia'?"),
        ({"neighbourhood": "star"}, "neighbourhood 'star' is not known"),
        ({"inertia_schedule": "linear"}, "inertia_last is None"),
        ({"inertia_last": 0.4}, "inertia_schedule 'constant'"),
    ],
)
def test_wrong_names_are_refused(wrong: dict[str, Any], words: str) -> None:
    with pytest.raises(pm.UsageError) as refused:
        pm.Swarm(**wrong)
    assert words in str(refused.value)


@pytest.mark.parametrize(
    ("swarm", "words"),
    [
        (pm.Swarm(update="constriction"), "cognitive + social is 2.98"),
        (pm.Swarm(velocity_limit=0.0), "velocity_limit is 0"),
        (pm.Swarm(particles=0), "particles is 0"),
        (pm.Swarm(particles=-1), "settings of the swarm"),
    ],
)
def test_wrong_numbers_are_refused(made: pm.Simulation, swarm: pm.Swarm, words: str) -> None:
    with pytest.raises(pm.UsageError) as refused:
        pm.identify(made.recording, made.machine, method="pso", swarm=swarm)
    assert words in str(refused.value)


def test_swarm_on_the_command_line(made: pm.Simulation, run: Run, tmp_path: Path) -> None:
    recording, machine, out = (str(tmp_path / name) for name in ("r.parquet", "m.toml", "o.json"))
    made.write(recording)
    made.write_machine(machine)
    asked = ["identify", recording, "--machine", machine, "--fit", "r_s,tau_load", "--method", "pso"]
    text = "particles=12, iterations=8,update=constriction,cognitive=2.05,social=2.05,neighbourhood=ring"
    ran = run(*asked, "--swarm", text, "--json", out)
    assert ran.code in (0, 4)
    answer = json.loads(Path(out).read_text())
    assert len(answer["history"]) == 9
    assert answer["evaluations"] == 12 * 9
    for wrong in ("particle=3", "particles", "particles=many", "update=slow"):
        refused = run(*asked, "--swarm", wrong)
        assert (refused.code, refused.out) == (2, ""), wrong
