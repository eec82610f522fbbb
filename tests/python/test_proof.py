"""The proof scores one answer fairly: what is right, what is a wrong name, and what is a false alarm."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("numba")
pytest.importorskip("pyarrow")
pytest.importorskip("scipy")

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from verdicts import COULOMB, DRAG, answer, judged, truth  # noqa: E402

from proof.heldout import held_out  # noqa: E402
from proof.least import left, rightly_named  # noqa: E402


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
