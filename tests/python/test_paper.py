"""The paper's figures by one command."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from conftest import Ran
from pmsm_rs.paper import runs, setup

Run = Callable[..., Ran]


@pytest.fixture(scope="module")
def data() -> runs.Run:
    return runs.run()


def test_the_drive_drifts_within_the_paper_s_figures(data: runs.Run) -> None:
    assert len(data.t) == setup.WINDOWS * setup.SAMPLES
    assert 0.15 < data.r_s.min() < 0.17
    assert 0.2 < data.r_s.max() < 0.22
    assert 2.94 < data.load.min() < data.load.max() < 3.06


@pytest.mark.parametrize("method", ["pso", "lm"])
def test_resistance_and_load_are_tracked(data: runs.Run, method: str) -> None:
    found = runs.follow(data, method)
    assert np.abs(found.errors("r_s")).max() < 0.02
    assert np.sqrt(np.mean(found.errors("tau_load") ** 2)) < 0.005


def test_searches_converge_by_the_paper_s_generation(data: runs.Run) -> None:
    many = runs.seeds(data, setup.SWARM.velocity_limit)
    assert len(many.own) == 100
    assert many.share("own") >= 0.95


def test_reproduce(run: Run, tmp_path: Path) -> None:
    out = tmp_path / "paper"
    ran = run("reproduce", "fig6", "fig7", "fig8", "--out", str(out))
    assert (ran.code, ran.err) == (0, "")
    assert "tracking error of r_s" in ran.out
    names = {path.name for path in out.iterdir()}
    assert {f"fig{k}.{kind}" for k in (6, 7, 8) for kind in ("png", "svg")} <= names
    rows = list(csv.DictReader((out / "windows_swarm.csv").read_text().splitlines()))
    assert len(rows) == setup.WINDOWS
    assert "What the paper leaves open" in (out / "paper.md").read_text()


def test_only_the_paper_s_figures(run: Run, tmp_path: Path) -> None:
    ran = run("reproduce", "fig4", "--out", str(tmp_path))
    assert ran.code == 2
    assert "did you mean" in ran.err
