"""An unknown torque gets the formula that made it, and none where no simple one describes it."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache
from math import cos, exp, sin
from typing import Any

import numpy as np
import pmsm_rs as pm
import pytest
from models import model_of, simulated
from pmsm_rs.export.program import evaluate
from pmsm_rs.formulas.balance import Balance, Choice
from pmsm_rs.formulas.reading import torque as read
from pmsm_rs.formulas.search import Formula, search
from pmsm_rs.formulas.spread import spread
from pmsm_rs.formulas.terms import Term, reverses, terms
from pmsm_rs.formulas.unknown_torque import remains
from pmsm_rs.formulas.weak_form import Motion, windows
from pmsm_rs.results.registry import effect
from pmsm_rs.view.formulas import order

J = 0.004


def sign(x: float) -> float:
    return (x > 0.0) - (x < 0.0)


Torque = Callable[[Any, Any, Any], Any]

# Torques that nobody wrote the terms for: other widths, exponents and mixtures than those of the grids.
FORMS: dict[str, tuple[Torque, str]] = {
    "root": (lambda w, th, te: 0.03 * sign(w) * abs(w) ** 0.52, "|ω|^"),
    "eddy-current brake": (lambda w, th, te: 0.02 * w / (1.0 + (w / 13.0) ** 2), "ω/(1 + (ω/"),
    "hump": (
        lambda w, th, te: 0.3 * sign(w) * exp(-(((abs(w) - 37.0) / 9.0) ** 2)),
        "− w_1)/w_0)²)",
    ),
    "falling": (lambda w, th, te: 0.2 * sign(w) * exp(-((w / 11.0) ** 2)), "exp(−(ω/"),
    "once a turn": (lambda w, th, te: 0.1 * sin(th + 0.4), "cos(θ)"),
    "tight spot": (
        lambda w, th, te: 0.1 * sign(w) * (0.8 + cos(th - 1.0)),
        "·sin(θ))·sgn(ω)",
    ),
    "cam": (
        lambda w, th, te: 0.2 * exp((cos(th - 2.2) - 1.0) / 0.4**2),
        "exp((cos(θ − theta_1) − 1)/w²)",
    ),
    "of the torque": (lambda w, th, te: 0.15 * abs(te) * sign(w), "|τ_e|·sgn(ω)"),
    "drag and wave": (lambda w, th, te: 4e-5 * w * abs(w) + 0.06 * cos(3 * th), "ω·|ω|"),
}


def moved(
    torque: Torque, seed: int, noise: float = 0.02, *, about: float = 0.0, swing: float = 1.0
) -> Motion:
    """A motor whose speed swings under this torque, through standstill unless it swings `about` a speed; the
    speed is measured with noise.
    """
    rng = np.random.default_rng(seed)
    h, n, fine = 2e-3, 3000, 10
    t = h * np.arange(n)
    phases = rng.uniform(0.0, 2.0 * np.pi, 3)
    omega, theta, driven = np.zeros(n), np.zeros(n), np.zeros(n)

    def aim(at: Any) -> Any:
        waves = zip((0.31, 0.83, 1.7), (45.0, 25.0, 12.0), phases, strict=True)
        swings = (size * np.sin(2.0 * np.pi * f * at + phase) for f, size, phase in waves)
        return about + swing * sum(swings)

    # Plain floats: arithmetic of numpy's own numbers takes several times as long.
    w, th, s = float(aim(0.0)), 0.0, h / fine
    for k, wanted in enumerate(aim(t + 0.05).tolist()):
        te = 0.25 * (wanted - w)
        omega[k], theta[k], driven[k] = w, th, te
        for _ in range(fine):
            middle = w + 0.5 * s * (te - float(torque(w, th, te))) / J
            gain = s * (te - float(torque(middle, th + 0.5 * s * w, te))) / J
            w, th = w + gain, th + s * (w + 0.5 * gain)
    # What drives holds from row to row; the log has its mean about each row.
    tau_e = np.concatenate([driven[:1], 0.5 * (driven[1:] + driven[:-1])])
    return Motion(t, omega + noise * rng.standard_normal(n), theta, tau_e, tau_e, load_open=False)


@cache
def swung(name: str, seed: int) -> Motion:
    """A motor that swings under a torque of `FORMS`."""
    return moved(FORMS[name][0], seed)


@cache
def found(name: str) -> list[Formula]:
    """Formulas for a torque of `FORMS`, from two runs."""
    form, check = windows(swung(name, 1)), windows(swung(name, 2))
    assert form is not None
    return search(form, check, j=J)


@pytest.mark.parametrize("name", FORMS)
def test_the_form_that_made_the_torque_comes_first(name: str) -> None:
    told = found(name)
    assert told, name
    mark = FORMS[name][1]
    assert mark in told[0].text, [(f.text, f.evidence) for f in told]
    assert min(told[0].explains.values()) > 0.9
    assert len(told) <= 5
    alike = [f.evidence for f in told if f.equivalent]
    assert all(evidence > max(f.evidence for f in told) - 3.0 for evidence in alike)
    assert told[0].evidence > max(f.evidence for f in told) - 3.0
    apart = [f.evidence for f in told[1 + len(alike) :]]
    assert apart == sorted(apart, reverse=True)
    assert not told[0].equivalent


def test_the_numbers_of_a_formula_are_those_that_made_it() -> None:
    form, check = windows(moved(FORMS["hump"][0], 3)), windows(moved(FORMS["hump"][0], 4))
    assert form is not None
    parameters = search(form, check, j=J)[0].parameters
    assert parameters["k"][0] == pytest.approx(0.3, rel=0.1)
    assert parameters["w_1"][0] == pytest.approx(37.0, rel=0.05)
    assert parameters["w_0"][0] == pytest.approx(9.0, rel=0.15)
    assert parameters["w_1"][1] == "rad/s"


def wandering(seed: int) -> Torque:
    """A friction that wanders about 0.3 N·m, whatever the motor does."""
    steps = 0.02 * np.random.default_rng(seed).standard_normal(200)
    level = iter(np.repeat(0.3 + np.cumsum(steps), 400).tolist())
    return lambda w, th, te: next(level) * sign(w)


def test_a_steady_motion_tells_nothing_of_friction_that_grows_with_the_motor_torque() -> None:
    """The motor torque equals the friction there, so that it explains it whatever its cause."""
    form, check = (windows(moved(wandering(seed), seed, about=40.0, swing=0.05)) for seed in (1, 2))
    assert form is not None
    assert check is not None
    run = Balance.of(form, J)
    [term] = [term for term in terms(form.motion) if term.effect == "load_dependent_friction"]
    sides = run.sides(Choice(((term, ()),)))
    assert sides is not None
    # The balance closes best at k = 1, which says nothing of the torque.
    column = sides.values[:, 0]
    assert float(column @ run.target) / float(column @ column) == pytest.approx(1.0, abs=0.05)
    fit = run.fit(sides)
    assert 0.0 <= fit.strengths[0] < 0.6
    assert fit.gain < 3.0
    assert not [formula for formula in search(form, check, j=J) if "τ_e" in formula.text]


@pytest.mark.parametrize("share", [0.05, 0.15, 0.4])
def test_friction_that_grows_with_the_motor_torque_is_found_where_motoring_and_braking_differ(
    share: float,
) -> None:
    def friction(w: Any, th: Any, te: Any) -> Any:
        return share * abs(te) * sign(w)

    form, check = windows(moved(friction, 1)), windows(moved(friction, 2))
    assert form is not None
    best = search(form, check, j=J)[0]
    assert best.text == "{k}·|τ_e|·sgn(ω)".format(k="k")
    assert best.parameters["k"][0] == pytest.approx(share, rel=0.05)
    assert best.effects == ("load_dependent_friction",)


def test_of_formulas_that_differ_by_their_curve_alone_there_is_one() -> None:
    for name in ("root", "falling", "drag and wave"):
        told = found(name)
        physics = [frozenset(term.kind for term in read(f.to_dict(1.0)).parts) for f in told]
        assert len(physics) == len(set(physics))


def test_where_the_machine_turns_one_way_no_formula_rests_on_the_direction() -> None:
    def torque(w: Any, th: Any, te: Any) -> Any:
        return 4e-5 * w * abs(w) + 0.06 * cos(2 * th)

    form, check = (windows(moved(torque, seed, about=60.0, swing=0.5)) for seed in (1, 2))
    assert form is not None
    told = search(form, check, j=J)
    assert told[0].text == "k1·ω·|ω| + c2·cos(2θ) + s2·sin(2θ)"
    assert told[0].effects == ("quadratic_drag", "load_torque_pulsation")
    assert not [f for f in told if "θ))·sgn(ω)" in f.text or "·ω²" in f.text]
    both = windows(moved(torque, 3))
    assert both is not None
    assert reverses(both.motion)
    assert not reverses(form.motion)


def test_the_numbers_are_judged_on_rows_to_which_they_were_not_fitted() -> None:
    """A torque that differs from one half of the recording to the other is predicted by neither."""
    torque = FORMS["once a turn"][0]
    best = found("once a turn")[0]
    for before, after in best.residual.values():
        assert after < 0.3 * before
    told = best.to_dict(0.02)
    assert told["times_noise"]["validation"]["after"] == pytest.approx(best.residual["validation"][1] / 0.02)
    form, turned = windows(swung("once a turn", 1)), windows(moved(lambda w, th, te: -torque(w, th, te), 2))
    assert form is not None
    assert search(form, turned, j=J) == []


@pytest.mark.parametrize("turns", [True, False])
def test_a_term_has_the_law_of_the_effect_of_the_catalogue_that_it_tells(turns: bool) -> None:
    t = np.linspace(0.0, 1.0, 400)
    theta = (9.0 if turns else 0.9) * np.sin(5.0 * t)
    omega = 300.0 * np.cos(5.0 * t)
    moving = Motion(t, omega, theta, 2.0 * np.sin(23.0 * t), t, False)
    fast = np.abs(omega) > 30.0
    parts = {"stribeck_friction": {"tau_c": 0.0, "tau_x": 0.2, "w_s": 30.0}}
    told = [term for term in terms(moving) if term.effect]
    assert {term.effect for term in told} == {
        "coulomb_friction",
        "quadratic_drag",
        "asymmetric_friction",
        "load_dependent_friction",
        "load_torque_pulsation",
        "cogging_torque",
        "stribeck_friction",
        *([] if turns else ["gravity_torque"]),
    }
    for term in told:
        assert term.effect is not None
        values = parts.get(term.effect) or _strength(term)
        if term.effect == "cogging_torque" and values["order_mech"] < _LEAST_COGGING:
            continue
        model = model_of(simulated({term.effect: values}))
        at = {"omega_m": omega, "theta_m": theta, "tau_e": moving.tau_e, "t": t}
        law = sum(evaluate(model.equations()["torque"], at).values(), np.zeros_like(t))
        columns = np.column_stack(term.columns(moving, (30.0,) if term.shapes else ()))[fast]
        left = law[fast] - columns @ np.linalg.lstsq(columns, law[fast], rcond=None)[0]
        assert np.abs(law[fast]).max() > 0.0
        assert np.abs(left).max() < 1e-3 * np.abs(law[fast]).max(), (term.text, term.effect)


# The simulated machine has four pole pairs.
_LEAST_COGGING = 8


def _strength(term: Term) -> dict[str, float]:
    """Values of an effect of the catalogue in which it has the law of the term."""
    entry = effect(str(term.effect))
    names = [x["name"] for x in entry["parameters"] if x["strength"]]
    values = {name: 0.0 for name in names}
    if term.effect == "asymmetric_friction":
        return values | {"b_a": 0.01}
    order = re.search(r"cos\((\d*)θ\)", term.text)
    if order and term.effect != "gravity_torque":
        return values | {names[0]: 0.1, names[1]: 0.2, "order_mech": float(order[1] or 1)}
    return values | {name: 0.1 for name in names[:2]}


def test_less_of_a_friction_has_no_law_of_the_catalogue() -> None:
    def less(w: Any, th: Any, te: Any) -> Any:
        return -1e-5 * w * abs(w)

    form = windows(moved(less, 1))
    assert form is not None
    [drag] = [f for f in search(form, None, j=J) if f.text == "k·ω·|ω|"]
    assert drag.parameters["k"][0] < 0.0
    assert drag.effects == (None,)


def test_no_formula_is_told_for_noise_or_for_a_torque_without_a_law() -> None:
    for seed in range(3):
        form, check = (
            windows(moved(lambda w, th, te: 0.0, seed)),
            windows(moved(lambda w, th, te: 0.0, seed + 9)),
        )
        assert form is not None
        assert search(form, check, j=J) == []
    rng = np.random.default_rng(5)
    # A new torque every 0.1 s, whatever the motor does.
    torques = np.repeat(rng.uniform(-0.3, 0.3, 400), 1000)
    draws = iter(np.concatenate([torques, torques[::-1]]).tolist())
    form = windows(moved(lambda w, th, te: next(draws), 6))
    check = windows(moved(lambda w, th, te: next(draws), 7))
    assert form is not None
    assert search(form, check, j=J) == []


def test_a_run_that_is_too_short_or_full_of_gaps_has_no_windows() -> None:
    t = np.array([0.0, 1.0, 2.0])
    assert windows(Motion(t, t, t, t, t, load_open=True)) is None
    t = np.cumsum(np.where(np.arange(100) % 5 == 0, 10.0, 1.0))
    assert windows(Motion(t, t, t, t, t, load_open=True)) is None


def test_of_a_long_run_the_means_of_rows_are_used() -> None:
    t = np.arange(200_001) * 1e-4
    form = windows(Motion(t, np.sin(t), 1.0 - np.cos(t), t, t, load_open=False))
    assert form is not None
    assert len(form.motion.t) <= 60_000
    assert form.motion.load_open is False
    np.testing.assert_allclose(form.motion.omega_m, np.sin(form.motion.t), atol=1e-6)


def test_an_answer_without_a_name_holds_formulas() -> None:
    def recording(seed: int) -> pm.Recording:
        run = swung("hump", seed)
        return pm.Recording(t=run.t, tau_e=run.tau_e, omega_m=run.omega_m, theta_m=run.theta_m, load="none")

    machine = pm.Machine(n_p=2, j=1.1 * J, b=0.0)
    answer = pm.diagnose(recording(1), machine, validation=recording(2))
    assert answer.verdict == "unknown"
    assert answer.formulas
    assert "w_1" in answer.formulas[0]["formula"]
    assert answer.data["formulas"] == answer.formulas
    again = type(answer).from_json(answer.to_json())
    assert again.formulas == answer.formulas
    named = pm.diagnose(free_of_friction(), machine)
    assert named.formulas is None
    numbers = [entry for formula in answer.formulas for entry in formula["parameters"].values()]
    assert all((entry["stderr"] is None) != (entry["why_none"] is None) for entry in numbers)
    assert any(entry["stderr"] for entry in numbers)
    text = " ".join(str(answer).split())
    assert "±" in text[text.index("Formulas for the torque") : text.index("Parameters")]


def test_the_numbers_of_a_formula_have_standard_errors() -> None:
    misses: dict[str, list[float]] = {"k": [], "a": []}
    for seed in range(4):
        form = windows(swung("root", seed))
        assert form is not None
        [power] = [f for f in search(form, None, j=J) if f.text == "k·|ω|^a·sgn(ω)"]
        for name, truth in (("k", 0.03), ("a", 0.52)):
            number = power.parameters[name]
            assert number.stderr is not None
            assert 0.0 < number.stderr < 0.5 * abs(truth)
            misses[name].append((number.value - truth) / number.stderr)
    for values in misses.values():
        assert np.sqrt(np.mean(np.square(values))) < 3.0


def test_numbers_that_a_run_does_not_tell_apart_have_no_standard_error() -> None:
    run = Balance.of(windows(swung("root", 1)), J)  # type: ignore[arg-type]
    [drag] = [term for term in terms(run.form.motion) if term.text == "{k}·ω·|ω|"]
    [once, twice] = spread(run, Choice(((drag, ()), (drag, ()))), np.array([0.5, 0.5]))
    assert once == twice == [None]
    [[alone]] = spread(run, Choice(((drag, ()),)), np.array([1.0]))
    assert alone is not None


def test_no_formula_is_asked_for_where_a_map_of_the_voltages_leaves_no_torque() -> None:
    data = {
        "remaining": [{"equation": "mechanical"}],
        "model": {"specification": {"map": [{"equations": ["d", "q"]}]}},
        "fit": {"recording": {"after": {"omega_e": 0.31}}, "validation": {"after": {"omega_e": 0.30}}},
        "noise_floor": {"omega_e": 0.306},
        "options": {"mismatch": 0.3},
    }
    assert not remains(data)
    assert remains({**data, "fit": {"recording": {"after": {"omega_e": 0.6}}}})
    assert remains({**data, "model": {"specification": {"map": [{"equations": ["mechanical"]}]}}})
    assert remains({**data, "model": {"specification": {}}})
    assert not remains({**data, "remaining": [{"equation": "d"}]})


def test_the_order_of_formulas_is_told_as_it_is() -> None:
    def entries(*equivalent: bool) -> list[dict[str, Any]]:
        return [{"equivalent": each} for each in equivalent]

    assert order(entries(False)) == ""
    assert "the first 2 apart" in order(entries(False, True, False, False))
    assert "The others have less evidence" in order(entries(False, True, False, False))
    assert "all apart" in order(entries(False, True))
    assert "less evidence" not in order(entries(False, True))


def free_of_friction() -> pm.Recording:
    run = moved(lambda w, th, te: 0.0, 1)
    return pm.Recording(t=run.t, tau_e=run.tau_e, omega_m=run.omega_m, theta_m=run.theta_m, load="none")
