"""The whole swarm compiled by JAX: jit over lax.scan in time, vmap over the particles, in float64."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
from jax import lax
from window import FASTEST, HIGH, INERTIA, LOW, PERIOD, POLE_PAIRS, PULL, TRUTH, Array, Job, stream, weight

jax.config.update("jax_enable_x64", True)


def slope(x: Any, v_d: Any, v_q: Any, p: Any) -> Any:
    """Right-hand side of (1)-(3) for i_d, i_q, omega_e."""
    i_d, i_q, w = x
    tau = 1.5 * POLE_PAIRS * (p[3] * i_q + (p[1] - p[2]) * i_d * i_q)
    return (
        (v_d - p[0] * i_d + w * p[2] * i_q) / p[1],
        (v_q - p[0] * i_q - w * (p[1] * i_d + p[3])) / p[2],
        POLE_PAIRS / p[4] * (tau - p[5] * w / POLE_PAIRS - p[6]),
    )


def fitness(p: Any, columns: dict[str, Any], w_speed: float) -> Any:
    """Cost of one parameter set p of shape (7,)."""

    def step(state: Any, sample: Any) -> Any:
        x, cost = state
        v_d, v_q, i_d, i_q, w = sample
        cost += 1.5 * ((x[0] - i_d) ** 2 + (x[1] - i_q) ** 2) + (w_speed * (x[2] - w)) ** 2
        h = PERIOD
        k1 = slope(x, v_d, v_q, p)
        k2 = slope([a + h / 2 * k for a, k in zip(x, k1, strict=True)], v_d, v_q, p)
        k3 = slope([a + h / 2 * k for a, k in zip(x, k2, strict=True)], v_d, v_q, p)
        k4 = slope([a + h * k for a, k in zip(x, k3, strict=True)], v_d, v_q, p)
        new = tuple(
            a + h / 6 * (b + 2 * (c + d) + e) for a, b, c, d, e in zip(x, k1, k2, k3, k4, strict=True)
        )
        return (new, cost), None

    zero = 0.0 * p[0]
    start = tuple(columns[name][0] + zero for name in ("i_d", "i_q", "omega_e"))
    samples = tuple(columns[name] for name in ("v_d", "v_q", "i_d", "i_q", "omega_e"))
    return lax.scan(step, (start, zero), samples, unroll=8)[0][1]


def run(job: Job, columns: dict[str, Array]) -> Callable[[], float]:
    """The whole swarm as one call; the first one compiles it."""
    places, pulls = stream(job)
    fitted = jnp.array(job.fitted)
    low, high = jnp.asarray(LOW)[fitted], jnp.asarray(HIGH)[fitted]
    fastest, w_speed = FASTEST * (high - low), weight(columns)
    data = {name: jnp.asarray(column) for name, column in columns.items()}

    def evaluate(x: Any) -> Any:
        points = jnp.tile(jnp.asarray(TRUTH), (job.particles, 1)).at[:, fitted].set(x)
        return jax.vmap(lambda p: fitness(p, data, w_speed))(points)

    def generation(state: Any, pull: Any) -> Any:
        x, v, own, own_cost = state
        best = own[jnp.argmin(own_cost)]
        v = INERTIA * v + PULL * pull[0] * (own - x) + PULL * pull[1] * (best - x)
        v = jnp.clip(v, -fastest, fastest)
        x = jnp.clip(x + v, low, high)
        cost = evaluate(x)
        better = cost < own_cost
        own = jnp.where(better[:, None], x, own)
        return (x, v, own, jnp.where(better, cost, own_cost)), None

    @jax.jit
    def swarm(places: Any, pulls: Any) -> Any:
        x = low + places * (high - low)
        state = (x, jnp.zeros_like(x), x, evaluate(x))
        return jnp.min(lax.scan(generation, state, pulls)[0][3])

    return lambda: float(swarm(places, pulls))
