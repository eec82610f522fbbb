"""The model of an answer in hand: what it predicts, how the motor responds, and what its equations are."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, Self

from . import _core
from ._core import Machine, UsageError
from .errors import did_you_mean, no_answer, opened, refuse
from .quantities.parameters import BASE
from .results.estimates import Estimate, estimates

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import ArrayLike, NDArray

    from .io.recording import Recording
    from .progress import Progress
    from .simulation.drive import Simulation

    Columns = dict[str, NDArray[np.float64]]

REFERENCE_TEMPERATURE = 20.0


class Model(Mapping[str, Any]):
    """The motor model that a diagnosis settled on: the dq-model with the effects that were found.

    It reads like the object `model` of the JSON answer (`model["effects"]`, `model["base"]`), and does what a
    model does. `to_dict()` and `Model(mapping)` carry it through JSON without the loss of a bit.

    Parameters
    ----------
    data : mapping
        The object `model` of an answer, or what `to_dict` gives.

    Raises
    ------
    UsageError
        For what is neither.

    Examples
    --------
    >>> import pmsm_rs as pm
    >>> from pmsm_rs.support.demo import recording_files
    >>> run, other, machine = recording_files()
    >>> model = pm.diagnose(run, machine).model
    >>> model.effects
    ('dead_time',)
    >>> pm.Model(model.to_dict()) == model
    True
    """

    def __init__(self, data: Mapping[str, Any]) -> None:
        """Takes the object `model` of an answer, or what `to_dict` gives."""
        if not isinstance(data, Mapping) or "base" not in data or "effects" not in data:
            raise refuse(
                UsageError, "this is no model of an answer", fix="give the object `model` of a JSON answer"
            )
        self._data = dict(data)

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Self:
        """Reads the model of a JSON answer.

        Parameters
        ----------
        path : path
            The file, as `diagnose --json` writes it.

        Returns
        -------
        Model
            The model.

        Raises
        ------
        UsageError
            Where there is none.
        """
        with opened(str(path), "answer") as file:
            try:
                content = json.loads(file.read_text(encoding="utf-8"))
            except (UnicodeDecodeError, json.JSONDecodeError, RecursionError) as error:
                raise no_answer(path) from error
        if isinstance(content, Mapping) and isinstance(content.get("model"), Mapping):
            content = content["model"]
        try:
            return cls(content)
        except UsageError as error:
            raise refuse(
                UsageError,
                "there is no model in it",
                file=str(path),
                fix="write an answer with: pmsm-rs diagnose ... --json ANSWER.json",
            ) from error

    def __getitem__(self, key: str) -> Any:
        return self._data[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._data)

    def __len__(self) -> int:
        return len(self._data)

    def __repr__(self) -> str:
        return f"<Model of {', '.join(self.effects) or 'the dq-model alone'}>"

    @property
    def effects(self) -> tuple[str, ...]:
        """Ids of its effects."""
        return tuple(self._data["effects"])

    @property
    def specification(self) -> Mapping[str, Any]:
        """Values of all parameters as the equations have them, with the scales at which they are meant.

        Raises
        ------
        UsageError
            Where the answer has none, as nothing was fitted.
        """
        found = self._data.get("specification")
        if not isinstance(found, Mapping):
            raise refuse(
                UsageError,
                "this answer has no model that could be simulated: nothing was fitted to the recording",
                fix="diagnose a recording of which more can be said",
            )
        return found

    @property
    def _text(self) -> str:
        return json.dumps(self.specification, allow_nan=False)

    @property
    def parameters(self) -> dict[str, Estimate]:
        """Estimates by name.

        Those of the base have their own names; each effect's parameters in the equations are
        `EFFECT.PARAMETER`, with the standard error where the recording shows one. They are those of the best
        fit without a map of missing torques and voltages; `specification` holds the values beside the map.
        """
        own = estimates(self._data["base"])
        errors, values = self._errors, self._values
        for choice in self.specification["effects"]:
            units = _units(choice)
            for name, beside_map in choice["parameters"].items():
                path = f"{choice['effect']}.{name}"
                value, stderr = values.get(path, beside_map), errors.get(path)
                interval = None if stderr is None else (value - 1.959964 * stderr, value + 1.959964 * stderr)
                why = None if stderr is not None else "it was chosen, or the recording does not show it"
                own[path] = Estimate(value, stderr, interval, units.get(name, "1"), why)
        return own

    @property
    def _values(self) -> dict[str, float]:
        found = self._data.get("covariance") or {}
        return dict(zip(found.get("names", ()), found.get("values", ()), strict=False))

    @property
    def _errors(self) -> dict[str, float]:
        found = self._data.get("covariance")
        if not found:
            return {}
        diagonal = [row[k] for k, row in enumerate(found["matrix"])]
        named = zip(found["names"], diagonal, strict=True)
        return {name: math.sqrt(x) for name, x in named if x is not None and x >= 0.0}

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the estimated parameters, in the order of `covariance` and `correlation`."""
        return tuple((self._data.get("covariance") or {}).get("names", ()))

    @property
    def covariance(self) -> NDArray[np.float64]:
        """Covariance of the parameters `names`, shape (n, n), in products of their SI units.

        NaN where the recording does not show one.
        """
        import numpy as np

        rows = (self._data.get("covariance") or {}).get("matrix", [])
        return np.array([[math.nan if x is None else x for x in row] for row in rows]).reshape(
            len(rows), len(rows)
        )

    @property
    def correlation(self) -> NDArray[np.float64]:
        """Correlation of the parameters `names`, shape (n, n), from -1 to 1."""
        import numpy as np

        covariance = self.covariance
        scale = np.sqrt(np.diag(covariance))
        with np.errstate(divide="ignore", invalid="ignore"):
            correlation: NDArray[np.float64] = np.clip(covariance / np.outer(scale, scale), -1.0, 1.0)
        return correlation

    @property
    def machine(self) -> Machine:
        """The nameplate with the values of `parameters`; `v_dc` and `i_rated` are the recording's largest."""
        specification, own = self.specification, estimates(self._data["base"])
        found = {name: entry.value for name, entry in own.items() if entry.value is not None}
        scales = specification["scales"]
        return Machine(
            n_p=int(scales["n_p"]),
            v_dc=scales["v_dc"] or None,
            i_rated=scales["i_max"] or None,
            **{name: found.get(name, specification["base"][name]) for name in BASE},
        )

    def to_dict(self) -> dict[str, Any]:
        """Gives the object `model` of the JSON answer.

        Returns
        -------
        dict
            The object.
        """
        return dict(self._data)

    def to_frame(self) -> Any:
        """Gives the parameters as a pandas DataFrame.

        Returns
        -------
        pandas.DataFrame
            Columns value, stderr, low, high and unit; the index is the name.

        Raises
        ------
        UsageError
            Without pandas.
        """
        try:
            import pandas as pd  # type: ignore[import-untyped]
        except ImportError as error:
            raise refuse(
                UsageError, "pandas is not installed", fix="install it: pip install pandas"
            ) from error
        rows = {
            name: {
                "value": x.value,
                "stderr": x.stderr,
                "low": x.ci95[0] if x.ci95 else None,
                "high": x.ci95[1] if x.ci95 else None,
                "unit": x.unit,
            }
            for name, x in self.parameters.items()
        }
        return pd.DataFrame.from_dict(rows, orient="index")

    def predict(
        self,
        recording: Recording,
        machine: Machine | None = None,
        *,
        one_step: bool = False,
        threads: int | None = None,
        progress: Progress | None = None,
    ) -> Columns:
        """Predicts a recording.

        In free run, currents run over the whole recording, driven by the logged voltage and the measured
        speed; the speed runs over windows of 0.25 s. Nothing is estimated but initial values and an unknown
        load.

        Parameters
        ----------
        recording : Recording
            The run.
        machine : Machine or None, default None
            The nameplate by which the recording is read; None takes the model's own.
        one_step : bool, default False
            Predict each sample from the one before.
        threads : int or None, default None
            None uses every processor.
        progress : callable or None, default None
            Is called as progress(stage, fraction) from time to time.

        Returns
        -------
        dict of str to ndarray
            `t` in s, and `NAME_measured`, `NAME_model` for each channel, of shape (samples,). Channels are
            i_d, i_q in A, omega_e in rad/s; of operating points v_d, v_q in V.

        Raises
        ------
        UsageError
            Where the recording shows nothing that the model holds for.

        Examples
        --------
        >>> import pmsm_rs as pm
        >>> from pmsm_rs.support.demo import recording_files
        >>> run, other, machine = recording_files()
        >>> model = pm.diagnose(run, machine).model
        >>> predicted = model.predict(pm.load(other, machine))
        >>> predicted["i_q_model"].shape == predicted["t"].shape
        True
        """
        self._expect(recording)
        return _core.predict(
            recording,
            machine or self.machine,
            self._text,
            one_step=one_step,
            threads=threads,
            progress=progress,
        )

    def explain(self, recording: Recording, machine: Machine | None = None) -> dict[str, Columns]:
        """Shows what each effect does to a recording over time.

        The other effects and the base parameters keep their values.

        Parameters
        ----------
        recording : Recording
            The run.
        machine : Machine or None, default None
            The nameplate by which the recording is read; None takes the model's own.

        Returns
        -------
        dict of str to dict of str to ndarray
            Per effect `t` in s, and for each channel the prediction with the effect minus that without it.
            Arrays of shape (samples,), in the channel's unit.

        Raises
        ------
        UsageError
            As `predict` does.
        """
        whole = self.predict(recording, machine)
        told: dict[str, Columns] = {}
        for effect in self.effects:
            without = self.without(effect).predict(recording, machine)
            told[effect] = {"t": whole["t"]} | {
                name.removesuffix("_model"): whole[name] - without[name]
                for name in whole
                if name.endswith("_model")
            }
        return told

    def without(self, effect: str) -> Model:
        """Gives the same model with one effect taken out; all else keeps its value.

        Parameters
        ----------
        effect : str
            Id of the effect.

        Returns
        -------
        Model
            The model without it.

        Raises
        ------
        UsageError
            Naming the effects that it has.
        """
        if effect not in self.effects:
            raise refuse(
                UsageError, f"the model has no effect '{effect}'", fix=did_you_mean(effect, self.effects)
            )
        specification = dict(self.specification)
        specification["effects"] = [x for x in specification["effects"] if x["effect"] != effect]
        rest = {**self._data, "effects": [x for x in self.effects if x != effect]}
        return Model({**rest, "specification": specification, "covariance": None})

    def respond(
        self,
        t: ArrayLike,
        v_d: ArrayLike,
        v_q: ArrayLike,
        tau_load: ArrayLike = 0.0,
        *,
        i_d: float = 0.0,
        i_q: float = 0.0,
        omega_m: float = 0.0,
        theta_m: float = 0.0,
        temperature: float = REFERENCE_TEMPERATURE,
        temperature_magnet: float = REFERENCE_TEMPERATURE,
        steps: int | None = None,
    ) -> Columns:
        """Computes the open-loop response of the motor.

        Parameters
        ----------
        t : array_like of shape (instants,)
            Instants in s, increasing.
        v_d, v_q : array_like
            Voltage in the rotor frame, V, from each instant to the next; a number holds throughout.
        tau_load : array_like, default 0.0
            Load torque against positive rotation, N·m, likewise.
        i_d, i_q : float, default 0.0
            Currents at the start, A.
        omega_m : float, default 0.0
            Mechanical speed at the start, rad/s.
        theta_m : float, default 0.0
            Mechanical angle at the start, rad.
        temperature, temperature_magnet : float, default 20.0
            Of winding and magnet, degC.
        steps : int or None, default None
            Runge-Kutta steps in each interval; None makes as many as the fastest time constant needs.

        Returns
        -------
        dict of str to ndarray
            `t`, `i_d`, `i_q` (A), `tau_e` (N·m), `omega_m` (rad/s) and `theta_m` (rad), of shape (instants,).

        Raises
        ------
        UsageError
            For unequal lengths, times that do not increase, and a motion that does not stay finite.
        """
        import numpy as np

        try:
            instants = np.ascontiguousarray(t, dtype=float)
            given = [
                np.ascontiguousarray(np.broadcast_to(np.asarray(x, dtype=float), instants.shape))
                for x in (v_d, v_q, tau_load)
            ]
        except (TypeError, ValueError) as error:
            raise refuse(
                UsageError,
                f"the inputs are no columns of one length ({error})",
                fix="give one value per instant",
            ) from error
        if instants.ndim != 1 or not all(np.isfinite(x).all() for x in (instants, *given)):
            raise refuse(
                UsageError, "the inputs are not one row of finite numbers", fix="leave out what is none"
            )
        heating = [temperature - REFERENCE_TEMPERATURE, temperature_magnet - REFERENCE_TEMPERATURE]
        out, _ = _core.respond(
            self._text, instants, *given, begin=[i_d, i_q, omega_m, theta_m], heating=heating, steps=steps
        )
        return {"t": instants, **out}

    def simulate(self, config: Any = None, /, **tables: Any) -> Simulation:
        """Simulates this motor in a closed-loop drive, by `pmsm_rs.simulate`.

        Parameters
        ----------
        config : path, mapping or None, default None
            The configuration, as for `pmsm_rs.simulate`.
        **tables : object
            Tables and keys on top of it.

        Returns
        -------
        Simulation
            The run.
        """
        from .simulation.drive import simulate

        return simulate(config, **({"effects": self} | tables))

    def equations(
        self,
        *,
        temperature: float = REFERENCE_TEMPERATURE,
        temperature_magnet: float = REFERENCE_TEMPERATURE,
    ) -> dict[str, Any]:
        """Gives the equations as lists of elementary operations, from which exports are written.

        Parameters
        ----------
        temperature, temperature_magnet : float, default 20.0
            Of winding and magnet in degC; they replace measured ones.

        Returns
        -------
        dict
            `states` are the names of the states; `start`, `derivative`, `output`, `command`, `torque` and
            `flux` have `inputs`, `operations` and `outputs`.
        """
        heating = [temperature - REFERENCE_TEMPERATURE, temperature_magnet - REFERENCE_TEMPERATURE]
        told: dict[str, Any] = json.loads(_core.equations(self._text, heating=heating))
        return told

    @staticmethod
    def _expect(recording: object) -> None:
        if not isinstance(recording, _core.Recording):
            raise refuse(
                UsageError,
                f"a {type(recording).__name__} was given where a Recording is expected",
                fix="load it first: pmsm_rs.load(data, machine)",
            )


def _units(choice: Mapping[str, Any]) -> dict[str, str]:
    from .results.registry import of_choice

    return {p["name"]: p["unit"] for p in of_choice(choice)["parameters"]}
