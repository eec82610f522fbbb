"""The bench of a design: a closed-loop drive around each rival, its limits, and what it would log."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from .._core import Machine
from .._core import Recording as _Recording
from ..config.nameplate import PARAMETERS
from ..io.recording import Recording
from ..model import REFERENCE_TEMPERATURE, Model
from .rivals import reading_of

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from .limits import Limits
    from .references import References

    Array = NDArray[np.float64]

# Share of a limit that the simulated drive may reach: the real one is not quite the simulated one.
MARGIN = 0.95
# Acceleration is taken over at least this time, s: shorter is ripple that no coupling feels.
_OVER = 2e-3
# What a drive that must not turn back may turn back, share of the range.
_BACK = 0.01
# Rows of a trial at most: rivals are compared on means of equal runs of rows.
_ROWS = 2000
# A drive whose electrical side was not recorded samples so many times its current loop's time constant.
_SLOWNESS = 100.0
_QUICK = 5000.0


@dataclass(frozen=True)
class Trial:
    """What a rival does under a manoeuvre.

    There are the recording and its machine, and at its rows time (s), speed (rad/s), currents (A), angle
    (rad) and torque (N·m). `peaks` are shares of the limits.
    """

    recording: Recording
    machine: Machine
    t: Array
    omega_m: Array
    i_d: Array
    i_q: Array
    theta_m: Array
    tau_e: Array
    peaks: Mapping[str, float]

    @property
    def broken(self) -> str | None:
        """The limit that it keeps least, None where it keeps all."""
        worst = max(self.peaks, key=lambda name: self.peaks[name])
        return worst if self.peaks[worst] > MARGIN else None


@dataclass(frozen=True)
class Bench:
    """A drive within limits.

    `load_kind` is what a recording knows of the load, `period` that of the log in s. `whole` says that no
    rows may be averaged.
    """

    limits: Limits
    load_kind: str
    period: float
    whole: bool

    def run(
        self, model: Model, references: References, load: Mapping[str, Any] | float | None = None
    ) -> Trial:
        """Runs a manoeuvre with the motor of `model`; `load` replaces the constant load torque.

        Raises PmsmError where the drive cannot run this motor.
        """
        limits, scales = self.limits, model.specification["scales"]
        electrical = reading_of(model)["electrical"]
        f_sample = limits.f_sample
        v_dc = limits.voltage
        if not electrical:
            f_sample = max(f_sample, _QUICK)
            model, v_dc = _stand_in(model, limits, f_sample)
        reference: dict[str, Any] = {
            "i_d": {"t": references.t, "value": references.i_d},
            "i_q": {"t": references.t, "value": references.i_q},
        }
        if references.omega_m is not None:
            reference["omega_m"] = {"t": references.t, "value": references.omega_m}
        given = {
            "current_bandwidth": limits.current_bandwidth,
            "speed_bandwidth": limits.speed_bandwidth,
        }
        locked = self.load_kind == "locked"
        about: dict[str, Any] = {"kind": self.load_kind}
        if load is not None:
            # The torque of a formula: what a recording would know of it does not matter here.
            about = {"tau": load}
        elif limits.load_torque:
            stated = "known_constant" if self.load_kind == "none" else self.load_kind
            about = {"tau": limits.load_torque, "kind": stated}
        elif self.load_kind == "known_constant":
            about = {"kind": "none"}
        known = scales["has_temperature"], scales["has_magnet_temperature"]
        temperature = {
            name: REFERENCE_TEMPERATURE
            for name, logged in zip(("winding", "magnet"), known, strict=True)
            if logged
        }
        made = model.simulate(
            duration=limits.time,
            reference=reference,
            drive={"v_dc": v_dc, "i_limit": limits.current, "f_sample": f_sample},
            control={name: value for name, value in given.items() if value is not None},
            load={"kind": "locked"} if locked else about,
            sensors={"log_theta_m": True},
            temperature=temperature,
        )
        peaks = self._peaks(made.recording, made.truth.traces, electrical, locked)
        every = max(1, round(self.period * f_sample))
        if not self.whole:
            every = max(every, -(-len(made.recording) // _ROWS))
        return _thinned(made.recording, made.truth.traces, model, f_sample, every, peaks)

    def _peaks(
        self, recording: Recording, truth: Mapping[str, Array], electrical: bool, locked: bool
    ) -> dict[str, float]:
        limits, t = self.limits, recording.column("t")
        peaks = {"current": float(np.hypot(truth["i_d"], truth["i_q"]).max()) / limits.current}
        if electrical:
            v = np.hypot(recording.column("v_d"), recording.column("v_q"))
            peaks["voltage"] = float(v.max()) / (limits.voltage / math.sqrt(3.0))
        if locked:
            return peaks
        omega = truth["omega_m"]
        peaks["speed"] = _share(float(omega.min()), float(omega.max()), limits.speed)
        if limits.acceleration is not None:
            rows = max(1, round(_OVER / float(t[1] - t[0])))
            rise = np.abs(omega[rows:] - omega[:-rows]) / (t[rows:] - t[:-rows])
            peaks["acceleration"] = float(rise.max()) / limits.acceleration
        if limits.position is not None:
            turned = truth["theta_m"] - truth["theta_m"][0]
            peaks["position"] = _share(float(turned.min()), float(turned.max()), limits.position)
        return peaks


def _share(least: float, most: float, allowed: tuple[float, float]) -> float:
    """How much of an allowed range is taken.

    Where the range ends at the start, an overshoot of `_BACK` of the whole range is allowed: no controller
    stands still to the last digit.
    """
    low, high = allowed
    back = _BACK * (high - low)
    over, under = max(high, back), max(-low, back)
    return max(most / over, -least / under, 0.0)


def _stand_in(model: Model, limits: Limits, f_sample: float) -> tuple[Model, float]:
    """The motor of a recording without voltages, with an electrical side that any drive can follow, and a DC
    link for it.
    """
    specification = dict(model.specification)
    base = dict(specification["base"])
    psi_m = max(base["psi_m"], 1e-9)
    inductance = 0.3 * psi_m / limits.current
    r_s = inductance * f_sample / _SLOWNESS
    base |= {"psi_m": psi_m, "l_d": inductance, "l_q": inductance, "r_s": r_s}
    omega_e = specification["scales"]["n_p"] * max(limits.speed[1], -limits.speed[0])
    v_dc = 10.0 * (psi_m * omega_e + limits.current * (r_s + inductance * (omega_e + f_sample)))
    specification["base"] = base
    return Model({**model.to_dict(), "specification": specification}), v_dc


def _thinned(
    recording: Recording,
    truth: Mapping[str, Array],
    model: Model,
    f_sample: float,
    every: int,
    peaks: Mapping[str, float],
) -> Trial:
    """Every so manieth row of what was simulated."""
    rows = len(recording) // every * every
    thin = {name: truth[name][:rows:every] for name in ("omega_m", "i_d", "i_q", "theta_m", "tau_e")}
    kept = thinned(recording, every)
    machine = sampled(model.machine, f_sample / every)
    return Trial(kept, machine, kept.column("t"), **thin, peaks=peaks)


def thinned(recording: _Recording, every: int) -> Recording:
    """Every so manieth row, with the means of the voltages over the rows for which it stands."""
    rows = len(recording) // every * every
    columns = {}
    for name in recording.names:
        values = np.asarray(recording.column(name))[:rows]
        means = name in ("v_d", "v_q")
        columns[name] = values.reshape(-1, every).mean(axis=1) if means else values[::every]
    return Recording(columns, load=recording.load, load_value=recording.load_value)


def sampled(machine: Machine, f_sample: float) -> Machine:
    """The machine with another sample rate of its log, Hz."""
    plate = {name: getattr(machine, name) for name in (*PARAMETERS, "v_dc", "i_rated")}
    return Machine(**plate, f_sample=f_sample)
