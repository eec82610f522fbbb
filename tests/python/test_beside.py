"""One axis beside the phases, and one phase beside the axes: neither is used, and a contradiction is told."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pmsm_rs as pm
import pytest
from conftest import MACHINE, Columns, Ran
from pmsm_rs.io.beside import lone
from pmsm_rs.io.rotation import phases

Run = Callable[..., Ran]


@pytest.fixture
def log() -> Columns:
    """Currents of the axes and of the phases over the turns of a rotor."""
    t = np.arange(600) * 2e-4
    theta = 60.0 * t + 40.0 * t**2
    i_d, i_q = np.cos(9.0 * t), 3.0 + np.sin(21.0 * t)
    i_a, i_b, i_c = phases((i_d + 1j * i_q) * np.exp(1j * theta))
    whole = {"t": t, "v_d": -i_q, "v_q": 10.0 + i_d, "theta_e": theta, "omega_e": 60.0 + 80.0 * t}
    return {**whole, "i_a": i_a, "i_b": i_b, "i_c": i_c, "i_d": i_d, "i_q": i_q}


def without(log: Columns, *names: str) -> Columns:
    return {name: values for name, values in log.items() if name not in names}


def test_a_phase_that_is_mapped_to_an_axis_is_told_and_not_used(
    log: Columns, tmp_path: Path, run: Run
) -> None:
    log = without(log, "i_d", "i_q")
    rows = zip(*log.values(), strict=True)
    text = [",".join(log), *(",".join(repr(float(x)) for x in row) for row in rows)]
    (tmp_path / "r.csv").write_text("\n".join(text))
    columns = '[columns]\ni_q = { from = "i_a", unit = "Ampere" }'
    (tmp_path / "m.toml").write_text(f"{MACHINE}\n{columns}\n")
    recording = pm.load(tmp_path / "r.csv", tmp_path / "m.toml")
    assert {"i_b", "i_c"} <= {*recording.names}
    assert "i_q" not in recording.names
    assert "i_q" not in recording.account.columns
    assert "i_a" in recording.account.ignored
    [entry] = recording.account.unused
    assert (entry.column, entry.quantity) == ("i_a", "current")
    ran = run("inspect", tmp_path / "r.csv", "--machine", tmp_path / "m.toml")
    assert ran.code == 0
    told = " ".join(ran.out.split())
    assert "i_q from 'i_a' is not used beside i_b and i_c, which give both axes" in told
    assert "[PR216]" in told
    [unused] = [
        each for each in pm.inspect(tmp_path / "r.csv", tmp_path / "m.toml").columns if not each.names
    ]
    assert unused.column == "i_a"
    assert "only a part of it" in (unused.why or "")


@pytest.mark.parametrize(
    ("left_out", "name", "others"),
    [
        (("i_d",), "i_q", ("i_a", "i_b", "i_c")),
        (("i_q", "i_c"), "i_d", ("i_a", "i_b")),
        (("i_a", "i_c"), "i_b", ("i_d", "i_q")),
    ],
)
def test_what_agrees_is_listed_as_unused_without_a_finding(
    left_out: tuple[str, ...], name: str, others: tuple[str, ...], log: Columns
) -> None:
    recording = pm.load(without(log, *left_out))
    assert name not in recording.names
    assert {*others} <= {*recording.names}
    assert name in recording.account.ignored
    assert not recording.account.remarks


@pytest.mark.parametrize("wrong", [-1.0, 1.5, 0.0])
def test_another_sign_or_size_contradicts(wrong: float, log: Columns) -> None:
    log["i_q"] = wrong * log["i_q"]
    [found] = lone(without(log, "i_d"), None)
    assert found == ("i_q", ("i_a", "i_b", "i_c"), wrong != 0.0)


def test_both_ways_of_logging_are_used_side_by_side(log: Columns) -> None:
    assert lone(log, None) == []
    assert {"i_a", "i_q"} <= {*pm.load(log).names}


def test_without_an_angle_nothing_is_left_out(log: Columns) -> None:
    assert lone(without(log, "theta_e", "i_d"), 3) == []
    turned = {**without(log, "theta_e", "i_d"), "theta_m": log["theta_e"] / 3.0}
    assert [found.name for found in lone(turned, 3)] == ["i_q"]
    assert lone(turned, None) == []
