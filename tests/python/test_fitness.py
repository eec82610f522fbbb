"""The fitness as a function of Python's own."""

from __future__ import annotations

import numpy as np
import pmsm_rs as pm
import pytest
from conftest import Columns, plausible

MACHINE = pm.Machine(n_p=3, r_s=0.9, l_d=0.0096, l_q=0.0213, psi_m=0.193, j=0.0126, b=0.0017)
BOUNDS = {"r_s": (0.3, 2.0), "tau_load": (-3.0, 3.0)}


@pytest.fixture
def recording() -> pm.Recording:
    return pm.Recording(plausible(), load="unknown_constant")


def test_it_is_what_the_swarm_lowers(recording: pm.Recording) -> None:
    fit = pm.identify(recording, MACHINE, fit=BOUNDS, method="pso", swarm=pm.Swarm(8, 20))
    best = [fit.parameters[name].value for name in BOUNDS]
    fitness = pm.Fitness(recording, MACHINE, list(BOUNDS))
    assert fitness(np.array([best]))[0] == fit.cost


def test_a_point_costs_the_same_alone_and_among_others(recording: pm.Recording) -> None:
    points = np.random.default_rng(1).uniform([0.3, -3.0], [2.0, 3.0], (700, 2))
    many = pm.Fitness(recording, MACHINE, list(BOUNDS), threads=2)(points)
    fitness = pm.Fitness(recording, MACHINE, list(BOUNDS), threads=1)
    assert many.shape == (700,)
    assert [fitness(points[k : k + 1])[0] for k in (0, 1, 350, 699)] == [many[k] for k in (0, 1, 350, 699)]


def test_what_cannot_be_simulated_costs_infinity(recording: pm.Recording) -> None:
    assert np.isinf(
        pm.Fitness(recording, MACHINE, list(BOUNDS))(np.array([[np.nan, 0.0], [1e308, 1.0]]))
    ).all()


def test_wrong_shapes_and_names_are_refused(recording: pm.Recording, columns: Columns) -> None:
    with pytest.raises(pm.UsageError, match="there is no parameter 'rs'"):
        pm.Fitness(recording, MACHINE, ["rs"])
    with pytest.raises(pm.PmsmError, match="name these"):
        pm.Fitness(recording, MACHINE, ["r_s", "j"])
    fitness = pm.Fitness(recording, MACHINE, list(BOUNDS))
    with pytest.raises(pm.UsageError, match="give 2 per point"):
        fitness(np.zeros((3, 3)))
    with pytest.raises(TypeError):
        fitness(columns["t"])
