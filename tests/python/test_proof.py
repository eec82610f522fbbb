"""The proof judges fairly, hides the truth, goes on where it stopped, and gives the same cases for the same
seed."""

from __future__ import annotations

import hashlib
import json
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("numba")
pytest.importorskip("pyarrow")
pytest.importorskip("scipy")

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from proof import answers, bench, generate, limits, splits  # noqa: E402
from proof.case import make_case  # noqa: E402
from proof.families import family  # noqa: E402
from proof.foreign import FORMS  # noqa: E402
from proof.heldout import columns, held_out  # noqa: E402
from proof.least import least_speed, left, rightly_named  # noqa: E402
from proof.lookalikes import lookalikes  # noqa: E402
from proof.machines import MACHINES, SERVO, SPREAD, another  # noqa: E402
from proof.manoeuvres import make  # noqa: E402
from proof.peers import simulate_by  # noqa: E402
from proof.plan import DRY, FAMILIES, KNOWN, Planned, plan, together  # noqa: E402
from proof.plant import simulate  # noqa: E402
from proof.score import Judged, judge  # noqa: E402
from proof.summary import brier, calibration, headline  # noqa: E402
from proof.table import markdown, write_results  # noqa: E402


def truth(kind: str, *effects: str, **more: Any) -> dict[str, Any]:
    """What a sealed truth says that matters to the judge."""
    return {
        "kind": kind,
        "effect": "+".join(effects) or "none",
        "components": [e for e in effects if not e.startswith("x_")],
        "accept": {e: ["mechanical"] for e in effects},
        "parameters": {"coulomb_friction": {"tau_c": 0.2, "w_smooth": 0.05}},
        "indistinguishable": [],
        "also_accept": [],
        "base_true": {},
        "severity": 4.0,
        "manoeuvre": "poor" if kind == "poor" else "rich",
        "load": "none",
        "machine": "servo",
        "source": "plant",
        **more,
    }


def answer(verdict: str, *ranking: tuple[str, float], **more: Any) -> dict[str, Any]:
    """An answer with this ranking; `near` are the equivalents of the first."""
    near = more.pop("near", [])
    return {
        "verdict": verdict,
        "located": [{"equation": "mechanical"}],
        "ranking": [
            {"effect": e, "probability": p, "equivalent_to": near, "parameters": {}} for e, p in ranking
        ],
        "model": {"effects": [e for e, _ in ranking[:1]]},
        **more,
    }


def judged(what: dict[str, Any], said: dict[str, Any]) -> Judged:
    return judge("v000", what, said, {})


COULOMB, DRAG = "coulomb_friction", "quadratic_drag"


def test_the_right_name_is_right_and_a_wrong_one_is_wrong() -> None:
    right = judged(truth("single", COULOMB), answer("named", (COULOMB, 0.97)))
    assert (right.right, right.named_first, right.first_two, right.wrong_confident) == (
        True,
        True,
        True,
        False,
    )
    wrong = judged(truth("single", COULOMB), answer("named", (DRAG, 0.9), (COULOMB, 0.05)))
    assert (wrong.right, wrong.named_first, wrong.first_two, wrong.wrong_confident) == (
        False,
        False,
        True,
        True,
    )
    assert not judged(truth("single", COULOMB), answer("named", (DRAG, 0.4))).wrong_confident


def test_an_ambiguous_set_is_honest_but_does_not_name() -> None:
    row = judged(truth("single", COULOMB), answer("ambiguous", (DRAG, 0.5), near=[COULOMB]))
    assert (row.right, row.ambiguity_honest, row.wrong_confident) == (False, True, False)
    assert not judged(truth("single", COULOMB), answer("ambiguous", (DRAG, 0.5))).ambiguity_honest


def test_look_alikes_are_accepted_and_make_a_case_unidentifiable() -> None:
    twins = truth("single", "stribeck_friction", indistinguishable=[COULOMB])
    for said in (answer("named", (COULOMB, 0.9)), answer("ambiguous", (DRAG, 0.5), near=[COULOMB])):
        row = judged(twins, said)
        assert row.right
        assert not row.identifiable
        assert not row.wrong_confident
    assert judged(truth("single", COULOMB), {}).identifiable
    assert not judged(truth("single", COULOMB, severity=1.4), {}).identifiable
    assert not judged(truth("single", COULOMB, shortened=True, degraded="short"), {}).identifiable


@pytest.mark.parametrize(
    ("verdict", "right", "alarm"),
    [
        ("no_mismatch", True, False),
        ("undetermined", False, False),
        ("named", False, True),
        ("partial", False, True),
        ("ambiguous", False, True),
        ("unknown", False, True),
    ],
)
def test_a_clean_case_must_be_called_clean(verdict: str, right: bool, alarm: bool) -> None:
    row = judged(truth("clean"), answer(verdict, (DRAG, 0.4)))
    assert (row.right, row.false_alarm, row.wrong_confident) == (right, alarm, False)
    sure = judged(truth("clean"), answer(verdict, (DRAG, 0.8)))
    assert (sure.right, sure.false_alarm, sure.wrong_confident) == (False, True, True)


def test_physics_outside_the_catalogue_must_not_get_a_name() -> None:
    outside = truth("unknown", "x_tight_spot")
    assert judged(outside, answer("unknown")).right
    named = judged(outside, answer("named", (COULOMB, 0.8)))
    assert (named.right, named.wrong_confident) == (False, True)
    assert judged({**outside, "also_accept": [COULOMB]}, answer("named", (COULOMB, 0.8))).right


def test_a_pair_needs_both_names() -> None:
    both = answer("named", (COULOMB, 0.9), model={"effects": ["dead_time", COULOMB]})
    one = answer("named", (COULOMB, 0.9))
    what = truth("pair", COULOMB, "dead_time")
    assert judged(what, both).right
    assert (judged(what, one).right, judged(what, one).one_of_two) == (False, True)


def test_a_poor_manoeuvre_asks_for_honesty() -> None:
    what = truth("poor", COULOMB)
    assert judged(what, answer("ambiguous", (DRAG, 0.5), near=[COULOMB])).right
    assert judged(what, answer("named", (COULOMB, 0.9))).right
    assert not judged(what, answer("no_mismatch")).right
    assert judged({**what, "severity": 1.1}, answer("no_mismatch")).right
    assert judged(what, answer("named", (DRAG, 0.9))).wrong_confident
    assert judged(what, answer("no_mismatch")).equation_right is None


def test_no_answer_is_wrong_but_no_alarm() -> None:
    for kind, effects in (("clean", ()), ("single", (COULOMB,)), ("unknown", ("x_weak_leg",))):
        row = judged(truth(kind, *effects), {})
        assert not row.right
        assert not row.wrong_confident
        assert not row.false_alarm
        assert row.verdict == "no answer"


def test_the_equation_is_the_first_one_located() -> None:
    said = answer("named", (COULOMB, 0.9), located=[{"equation": "q"}, {"equation": "mechanical"}])
    assert judged(truth("single", COULOMB), said).equation_right is False
    assert judged(truth("single", COULOMB), answer("unknown")).equation_right is True
    assert judged(truth("clean"), answer("no_mismatch")).equation_right is None


def test_parameters_and_intervals_are_compared_under_their_binding_names() -> None:
    said = answer("named", (COULOMB, 0.9))
    said["ranking"][0]["parameters"] = {
        "tau_c": {"value": 0.21, "ci95": [0.19, 0.23]},
        "w_smooth": {"value": 9.0, "ci95": [8.0, 10.0]},
    }
    row = judged(truth("single", COULOMB), said)
    assert row.parameter_error == pytest.approx(0.05)
    assert row.intervals == [True]
    said["ranking"][0]["parameters"]["tau_c"]["ci95"] = [0.205, 0.215]
    assert judged(truth("single", COULOMB), said).intervals == [False]
    said["ranking"][0]["parameters"]["tau_c"] = {"value": None, "ci95": None}
    assert judged(truth("single", COULOMB), said).parameter_error is None


def test_the_held_out_residual_is_judged_from_the_trajectories() -> None:
    rng = np.random.default_rng(3)
    n = 4000
    theta = np.linspace(0.0, 60.0, n)
    phases = [5.0 * np.cos(theta - k * 2.0 * np.pi / 3.0) for k in range(3)]
    clean = {"a": phases[0], "b": phases[1], "c": phases[2], "omega": 300.0 + np.zeros(n)}
    noise = rng.standard_normal((4, n))
    measured = {"t": np.arange(n) * 1e-4, "theta_e": theta, "omega_e": clean["omega"] + noise[3]}
    measured |= {f"i_{k}": clean[k] + noise[c] for c, k in enumerate("abc")}
    floor = {"i_d": np.sqrt(2.0 / 3.0), "i_q": np.sqrt(2.0 / 3.0), "omega_e": 1.0}
    honest = {"i_d_before": 5.0 + np.full(n, 3.0), "i_d_after": np.full(n, 5.0), "i_q_after": np.zeros(n)}
    found = held_out(honest, measured, clean, floor, {k: 0.5 * v for k, v in floor.items()})
    assert found.before == pytest.approx(np.sqrt(1.0 + 9.0 * 1.5), rel=0.05)
    assert found.after == pytest.approx(1.0, abs=0.05)
    assert found.remaining == pytest.approx(2.0, abs=0.1)
    assert not found.copied
    told = {"omega_e_after": clean["omega"] + 0.3 * noise[3]}
    assert held_out(told, measured, clean, floor, floor).copied
    short = {"t": measured["t"][::5], "i_q_after": np.zeros(n // 5)}
    assert held_out(short, measured, clean, floor, floor).after == pytest.approx(1.0, abs=0.05)
    nothing = held_out({}, measured, clean, floor, floor)
    assert (nothing.before, nothing.after, nothing.remaining, nothing.copied) == (None, None, None, False)


def test_calibration_counts_every_name_and_brier_the_first() -> None:
    rows = [judged(truth("single", COULOMB), answer("named", (COULOMB, 0.9))) for _ in range(3)]
    rows.append(judged(truth("clean"), answer("named", (DRAG, 0.9))))
    rows.append(judged(truth("single", COULOMB), answer("unknown", (DRAG, 1.0))))
    rows.append(judged(truth("clean"), answer("no_mismatch")))
    rows[0] = judged(truth("single", COULOMB), answer("named", (COULOMB, 0.9), (DRAG, 0.05)))
    found = calibration(rows)
    assert [(b.low, b.count, b.observed) for b in found[:1]] == [(0.0, 1, 0.0)]
    found = found[1:]
    assert [(b.low, b.count) for b in found] == [(0.9, 5)]
    assert found[0].stated == pytest.approx(0.92)
    assert found[0].observed == pytest.approx(0.6)
    assert brier(rows).value == pytest.approx((3 * 0.01 + 0.81 + 1.0) / 5)
    assert brier([]).value is None


def test_the_parts_of_a_whole_bench_are_counted() -> None:
    alone = {"dead_time": 5.0, "stribeck_friction": 3.0, "iron_loss": 9.0, DRAG: 1.4}
    what = truth("whole", *alone, alone=alone, family="whole")
    said = answer("partial", ("dead_time", 0.99), (COULOMB, 0.95), ("saturation_d", 0.3))
    said["model"]["effects"] = ["dead_time", COULOMB, "saturation_d"]
    row = judged(what, said)
    # a nested friction counts, the drag is too weak to be asked for, the saturation is not there
    assert (row.strong, row.found, row.names, row.names_right) == (3, 2, 3, 2)
    assert (row.right, row.wrong_confident) == (False, False)
    said["ranking"][0]["equivalent_to"] = ["iron_loss"]
    said["model"]["effects"] = ["dead_time", COULOMB]
    row = judged(what, said)
    assert (row.found, row.right) == (3, True)
    assert not judged(what, {**said, "verdict": "unknown"}).right
    said["ranking"][2]["probability"] = 0.6
    assert judged(what, said).wrong_confident
    assert not judged(what, said).right
    assert str(family([row])["parts of 2 times the noise and more, found"]) == "3 of 3 (100.0 %)"


def foreign(*known: str) -> dict[str, Any]:
    """Truth of an eddy brake, alone or beside known effects."""
    place = {"equations": ["mechanical"], "over": ["omega_e"], "shows": ["mechanical"]}
    more = {"alone": dict.fromkeys(known, 4.0), "foreign": {"x_eddy_brake": place}, "family": "foreign"}
    return truth("foreign", "x_eddy_brake", *known, **more)


def test_a_foreign_form_is_left_without_a_name_and_known_effects_are_named_beside_it() -> None:
    assert judged(foreign(), answer("unknown")).right
    assert not judged(foreign(), answer("partial", (COULOMB, 0.95))).right
    assert judged({**foreign(), "also_accept": [COULOMB]}, answer("partial", (COULOMB, 0.95))).right
    # without a verdict that names, a probability above a half is still a wrong name
    assert judged(foreign(), answer("unknown", (COULOMB, 0.7))).wrong_confident
    beside = answer("partial", ("dead_time", 0.95))
    assert judged(foreign("dead_time"), beside).right
    assert not judged(foreign("dead_time"), {**beside, "verdict": "named"}).right
    assert not judged(foreign("dead_time", DRAG), beside).right


def test_what_remains_is_to_lie_in_the_equation_and_over_the_variable_of_the_form() -> None:
    def placed(**more: Any) -> tuple[bool | None, bool | None]:
        row = judged(foreign("dead_time"), answer("partial", ("dead_time", 0.95), **more))
        return row.foreign_equation, row.foreign_variable

    left = {"times_noise": {"recording": 3.0, "validation": 9.0}}
    small = {"equation": "q", "over": ["i_q"], "times_noise": {"recording": 1.2, "validation": 1.1}}
    greatest = {"equation": "mechanical", "over": ["omega_e"], **left}
    assert placed(remaining=[small, greatest]) == (True, True)
    assert placed(remaining=[small, {**greatest, "over": ["theta_m"]}]) == (True, False)
    assert placed(remaining=[greatest | {"equation": "d"}, small]) == (False, False)
    term = {"equation": "mechanical", "variables": [{"variable": "omega_e"}]}
    assert placed(model={"effects": ["dead_time"], "unmodelled": {"terms": [term]}}) == (True, True)
    where = [{"variable": "omega_e", "low": 0.0, "high": 1.0}]
    assert placed(located=[{"equation": "q"}, {"equation": "mechanical", "where": where}]) == (True, True)
    alone = judged(foreign(), answer("unknown", located=[{"equation": "q"}, {"equation": "mechanical"}]))
    assert alone.foreign_equation is False
    assert judged(truth("single", COULOMB), answer("unknown")).foreign_equation is None


def test_intervals_of_whole_benches_and_of_the_base_are_compared() -> None:
    what = truth("whole", COULOMB, "dead_time", base_true={"r_s": 1.0, "j": 2.0})
    said = answer("named", (COULOMB, 0.99))
    said["ranking"][0]["parameters"] = {"tau_c": {"value": 0.21, "ci95": [0.19, 0.23]}}
    said["model"]["base"] = {
        "r_s": {"ci95": [0.9, 1.1]},
        "j": {"ci95": [2.1, 2.2]},
        "tau_load": {"ci95": [0, 1]},
    }
    row = judged(what, said)
    assert (row.intervals, row.base_intervals) == ([True], [True, False])


def test_bench_like_logs_are_counted_apart(tmp_path: Path) -> None:
    rows = [
        judged(truth("single", COULOMB), answer("named", (COULOMB, 0.9))),
        judged(truth("single", COULOMB, degraded="gaps"), answer("named", (DRAG, 0.9))),
    ]
    printed = write_results(rows, tmp_path, cases=2, seed=4, code="abc")
    assert "1 of 1 (100.0 %)" in printed
    score = json.loads((tmp_path / "score.json").read_text())
    name = "identifiable single effects named"
    assert (score["full"][name], score["bench"][name]) == ({"count": 1, "of": 1}, {"count": 0, "of": 1})
    table = (tmp_path / "table.md").read_text()
    assert f"| {name} | 1 of 1 (100.0 %) | 0 of 1 (0.0 %) |" in table
    assert "| v000 | coulomb friction | 4.00 | gaps | rich | none | named | quadratic drag | 0.90 |" in table
    assert (tmp_path / "calibration.png").read_bytes().startswith(b"\x89PNG")
    assert (tmp_path / "calibration.svg").read_bytes().startswith(b"<?xml")


def test_a_set_without_cases_of_a_kind_says_so() -> None:
    assert all(str(v) == "–" for v in headline([]).values())
    assert "There is none." in markdown(
        [], {"cases": 1, "seed": 1, "version": "1", "commit": "", "code": "a", "split": "all"}
    )


def test_the_plan_holds_what_the_manual_promises() -> None:
    cases = plan(600, 11)
    assert cases == plan(600, 11)
    assert cases != plan(600, 12)
    assert Counter(c.family for c in cases) == {
        "singles": 117, "pairs": 24, "bench": 75, "clean": 42, "poor": 18, "unknown": 24, "whole": 100,
        "foreign": 100, "limits": 100,
    }  # fmt: skip
    assert Counter(c.simulator for c in cases) == {"plant": 567, "motulator": 21, "gym-electric-motor": 12}
    by = {f: [c for c in cases if c.family == f] for f in FAMILIES}
    assert {c.log for c in by["bench"]} == set(bench.KINDS)
    assert {c.log for c in by["limits"]} == set(limits.KINDS)
    assert Counter(c.kind for c in by["limits"]) == {"clean": 70, "limited": 30}
    assert {c.effects[0] for c in by["singles"]} == set(KNOWN)
    assert {c.effects[0] for c in by["foreign"]} == set(splits.forms("scoring"))
    assert Counter(bool(c.effects[1:]) for c in by["foreign"]) == {True: 50, False: 50}
    assert {len(c.effects) for c in by["whole"]} == {3, 4, 5, 6, 7}
    for c in by["whole"] + by["foreign"] + by["pairs"]:
        assert len(set(c.effects)) == len(c.effects)
        assert together(c.effects)
        assert len(set(c.effects) & set(DRY)) <= 1
    assert set(Counter(c.machine for c in by["clean"])) == set(splits.machines("scoring"))
    for count in (1, 2, 24, 61):
        assert len(plan(count, 3)) == count


def test_a_set_of_some_families_has_no_others() -> None:
    assert {c.family for c in plan(40, 5, ("whole", "limits"))} == {"whole", "limits"}
    assert Counter(c.family for c in plan(40, 5, ("whole", "limits"))) == {"whole": 20, "limits": 20}
    with pytest.raises(ValueError, match="no family half"):
        plan(40, 5, ("half",))


def test_what_scores_shares_no_machine_and_no_form_with_what_calibrates() -> None:
    for of, every in ((splits.machines, MACHINES), (splits.forms, FORMS)):
        scoring, calibration = set(of("scoring")), set(of("calibration"))
        assert not scoring & calibration
        assert scoring | calibration == set(of("all")) == set(every)
    for split in ("scoring", "calibration"):
        # each side of the drive is on both sides of the split
        assert {FORMS[k].equations[0] in ("mechanical", "sensor") for k in splits.forms(split)} == {
            True,
            False,
        }
        assert {"mechanical", "sensor"} <= {FORMS[k].equations[0] for k in splits.forms(split)}
        cases = plan(60, 3, ("foreign",), split)
        assert {c.machine for c in cases} <= set(splits.machines(split))
        assert {c.effects[0] for c in cases} == set(splits.forms(split))
    assert len(FORMS) >= 10


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


TOOL = """#!{python}
import json, pathlib, sys
told = sys.argv[1:]
pathlib.Path({log!r}).open("a").write(json.dumps(told) + "\\n")
pathlib.Path(told[told.index("--json") + 1]).write_text('{{"verdict": "no_mismatch"}}')
print("a word on standard error", file=sys.stderr)
sys.exit(4)
"""


def test_the_tool_is_given_the_open_files_alone_and_asked_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    tool, log = tmp_path / "tool", tmp_path / "calls"
    tool.write_text(TOOL.format(python=sys.executable, log=str(log)))
    tool.chmod(0o755)
    monkeypatch.setattr(answers, "TOOL", tool)
    assert not answers.is_answered(7, tmp_path, "abc")
    cost = answers.answer(7, tmp_path, "abc")
    assert (cost.exit, cost.said, cost.code) == (4, "a word on standard error", "abc")
    assert cost.cpu_seconds >= 0.0
    assert cost.memory_mb > 1.0
    assert json.loads((tmp_path / "answers" / "v007.json").read_text()) == {"verdict": "no_mismatch"}
    called = log.read_text()
    assert "sealed" not in called
    assert called.count(str(tmp_path / "open" / "v007")) == 3
    assert answers.is_answered(7, tmp_path, "abc")
    assert not answers.is_answered(7, tmp_path, "changed")


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere the system tells only what it counts itself")
def test_memory_is_that_of_the_tool_and_not_of_who_called_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    held = np.ones(40_000_000)
    tool, seen = tmp_path / "tool", tmp_path / "seen"
    # it holds the memory until that has been looked at
    tool.write_text(
        f"#!{sys.executable}\nimport pathlib, time\nheld = bytearray(60_000_000)\n"
        f"while not pathlib.Path({str(seen)!r}).exists():\n    time.sleep(0.01)\n"
    )
    tool.chmod(0o755)
    look = answers.peak

    def peak(process: int) -> float:
        memory = look(process)
        if memory > 60.0:
            seen.touch()
        return memory

    monkeypatch.setattr(answers, "peak", peak)
    monkeypatch.setattr(answers, "TOOL", tool)
    assert 60.0 < answers.answer(1, tmp_path, "abc").memory_mb < 1e-6 * held.nbytes / 2


def test_a_tool_that_does_not_end_is_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tool = tmp_path / "tool"
    tool.write_text(f"#!{sys.executable}\nimport time\ntime.sleep(60)\n")
    tool.chmod(0o755)
    monkeypatch.setattr(answers, "TOOL", tool)
    monkeypatch.setattr(answers, "TIMEOUT", 0.2)
    assert answers.answer(1, tmp_path, "abc").exit is None


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


def test_what_is_counted_against_the_least_is_named_rightly() -> None:
    named = answer("named", (COULOMB, 0.9))
    assert rightly_named(truth("single", COULOMB), named)
    assert not rightly_named(truth("single", DRAG), named)
    assert not rightly_named(truth("single", COULOMB), answer("ambiguous", (COULOMB, 0.9)))
    assert not rightly_named(truth("single", COULOMB, degraded="noisy"), named)
    assert not rightly_named(truth("poor", COULOMB), named)
    assert not rightly_named(truth("clean"), named)
    pair = answer("named", (COULOMB, 0.9), model={"effects": [DRAG, COULOMB]})
    assert rightly_named(truth("pair", COULOMB, DRAG), pair)
    assert not rightly_named(truth("pair", COULOMB, DRAG), named)


def test_what_is_left_is_over_the_noise_where_the_model_speaks() -> None:
    model, measured = np.array([1.0, np.nan, 1.0]), np.array([1.2, 9.0, 0.8])
    rest = left({"i_q_after": model, "i_q_measured": measured}, {"i_q": 0.1})
    assert rest == {"i_q": pytest.approx(2.0)}
