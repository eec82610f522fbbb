"""Plots of an answer draw where they are told, say what was not logged, and lose no peak."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial

import numpy as np
import pmsm_rs as pm
import pytest
from answers import ANSWER, IDENTIFICATION, diagnosis, traces
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.axes import Axes
from pmsm_rs import Diagnosis, Identification, plot
from pmsm_rs.results import traces as reduced


def test_a_figure_of_its_own() -> None:
    figure = diagnosis().plot()
    assert len(figure.axes) == 4
    assert figure._repr_png_().startswith(b"\x89PNG")  # type: ignore[attr-defined]
    with pytest.raises(pm.UsageError, match="without its traces"):
        Diagnosis.from_json(json.dumps(ANSWER)).plot()


PLOTS: list[Callable[..., Axes]] = [
    partial(plot.residual_over_time, name="i_d"),
    partial(plot.trajectory, name="i_d"),
    partial(plot.residual_over, name="i_d", variable="op_i_q"),
    partial(plot.residual_map, name="i_d"),
    partial(plot.order_spectrum, name="i_d"),
]


@pytest.mark.parametrize("draw", PLOTS, ids=lambda draw: draw.func.__name__)
def test_plots_draw_on_the_axes_they_are_given_and_on_their_own(draw: Callable[..., Axes]) -> None:
    from matplotlib import pyplot

    figure, ax = pyplot.subplots()
    assert draw(diagnosis(), ax=ax) is ax
    assert ax.get_xlabel()
    ax.set_title("restyled")
    pyplot.close(figure)
    own = draw(traces()["recording"])
    assert own.get_ylabel()
    pyplot.close(own.figure)
    with pytest.raises(pm.UsageError, match="did you mean 'i_d'"):
        draw(diagnosis(), name="id")


def test_plots_over_what_was_not_logged_say_so() -> None:
    with pytest.raises(pm.UsageError, match="no column 'i_q'; did you mean 'op_i_q'"):
        plot.residual_over(diagnosis(), "i_d", "i_q")
    with pytest.raises(pm.UsageError, match="no column 'op_w'"):
        plot.residual_map(diagnosis(), "i_d", x="op_w")
    with pytest.raises(pm.UsageError, match="no column 'op_theta_x'"):
        plot.order_spectrum(diagnosis(), "i_d", angle="op_theta_x")


def test_the_history_of_a_swarm() -> None:
    from matplotlib import pyplot

    ax = plot.history(Identification.from_json(json.dumps(IDENTIFICATION)))
    np.testing.assert_array_equal(ax.lines[0].get_ydata(), IDENTIFICATION["history"])
    pyplot.close(ax.figure)


def test_the_order_spectrum_finds_the_order_that_was_put_in() -> None:
    trace = traces()["recording"]
    for angle, order in (("op_theta_e", 6), ("op_theta_m", 18)):
        orders = np.arange(1, 25)
        found = reduced.amplitudes(trace[angle], reduced.residual(trace, "i_d", "before"), orders)
        assert orders[np.argmax(found)] == order
        assert found.max() == pytest.approx(0.3, rel=0.02)


@given(st.integers(1, 5000), st.integers(1, 300), st.integers(0, 2**31))
def test_thinning_loses_no_peak(n: int, bins: int, seed: int) -> None:
    y = np.random.default_rng(seed).standard_normal(n)
    x, thin = reduced.envelope(np.arange(n, dtype=float), y, bins)
    assert len(thin) <= max(2 * bins, n if n <= 2 * bins else 0)
    assert (thin.min(), thin.max()) == (y.min(), y.max())
    assert np.all(np.diff(x) > 0)
