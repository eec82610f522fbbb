"""Formulas for the torque that an answer could not name."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ..model import Model
from . import search as formulas
from .weak_form import Motion, motion, windows

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from .._core import Recording

    Trace = Mapping[str, NDArray[np.float64]]

_ASKED = ("unknown", "partial")
_LOADS = ("none", "known_constant", "measured", "unknown_constant")


def found(
    data: Mapping[str, Any], traces: Mapping[str, Trace], recording: Recording, validation: Recording | None
) -> list[dict[str, Any]] | None:
    """Formulas for what remains of the equation of motion, as JSON objects; see `formulas.Formula`.

    `data` is the JSON answer, `traces` are its signals. An empty list says that no simple formula describes
    it. None where the question does not arise: nothing remains there, the verdict is another, or the
    recording does not hold what it takes.
    """
    specification = data["model"].get("specification")
    if data["verdict"] not in _ASKED or specification is None or not remains(data):
        return None
    named = Model({**data["model"], "specification": {**specification, "map": []}})
    run = _motion(named, traces.get("recording"), recording)
    form = None if run is None else windows(run)
    if form is None:
        return None
    other = None if validation is None else _motion(named, traces.get("validation"), validation)
    check = None if other is None else windows(other)
    told = formulas.search(form, check, j=specification["base"]["j"])
    noise = data["noise_floor"]["omega_e"] / specification["scales"]["n_p"]
    return [formula.to_dict(noise) for formula in told]


def remains(data: Mapping[str, Any]) -> bool:
    """Whether torque remains above the noise, beside the effects and beside a map of the voltages."""
    if all(entry["equation"] != "mechanical" for entry in data.get("remaining", ())):
        return False
    maps = data["model"]["specification"].get("map", ())
    if not maps or any("mechanical" in term["equations"] for term in maps):
        # What remains is described by no map, or by one of the torque itself.
        return True
    left = [run["after"].get("omega_e") for run in data["fit"].values() if run.get("after")]
    most = data["noise_floor"]["omega_e"] * math.sqrt(1.0 + data["options"]["mismatch"])
    return any(value is not None and value > most for value in left)


def _motion(model: Model, trace: Trace | None, recording: Recording) -> Motion | None:
    """The motion of a run; none where its load steps at unknown times, or where the trace is another's."""
    if not trace or recording.load not in _LOADS or len(trace["t"]) != len(recording):
        return None
    load: Any = 0.0
    if recording.load == "known_constant":
        load = recording.load_value or 0.0
    elif recording.load == "measured":
        load = recording.column("tau_m")
    elif recording.load == "unknown_constant":
        load = None
    tau_e = recording.column("tau_e") if "tau_e" in recording.names else None
    return motion(model, trace, load=load, tau_e=tau_e)
