"""What answers say, as plain frozen values over the JSON that is written to files."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Self

from ..errors import written_by
from .estimates import Estimate, estimates, json_text
from .unmodelled import Unmodelled

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

Traces = Mapping[str, "Mapping[str, NDArray[np.float64]]"]


@dataclass(frozen=True)
class Location:
    """Where a mismatch sits.

    Attributes
    ----------
    equation : str
        d, q, mechanical or sensor.
    share : float
        Its share of the whole mismatch, 0 to 1.
    sentence : str
        The same in words.
    where : tuple of mapping
        Operating points: variable, low, high and unit.
    order_electrical : float or None
        Order in the electrical angle.
    order_mechanical : float or None
        Order in the mechanical angle.
    frequency_hz : float or None
        Frequency, Hz.
    trend : str or None
        `grows` or `fades`, where it changes over the recording.
    p_value : float or None
        Probability of so much by chance.
    recordings : tuple of int
        Numbers, from 1, of the recordings that show it where not all of several do.
    """

    equation: str
    share: float
    sentence: str
    where: tuple[Mapping[str, Any], ...]
    order_electrical: float | None
    order_mechanical: float | None
    frequency_hz: float | None
    trend: str | None
    p_value: float | None
    recordings: tuple[int, ...] = ()


@dataclass(frozen=True)
class Remaining:
    """The residual of one equation beside the effects that were found, where it exceeds the noise.

    Attributes
    ----------
    equation : str
        d, q or mechanical.
    beside : tuple of str
        The effects that were found.
    times_recording : float
        Residual on the recording, in times the noise.
    times_validation : float or None
        The same on the validation run; None without one.
    over : tuple of str
        Variables on which it depends.
    p_value : float
        Probability of so much by chance.
    sentence : str
        The same in words.
    nearest : mapping or None
        A step like those of `path`: the model with that effect of the catalogue whose form comes nearest. A
        smooth map does as well, so it is no name. None where no effect comes near.
    """

    equation: str
    beside: tuple[str, ...]
    times_recording: float
    times_validation: float | None
    over: tuple[str, ...]
    p_value: float
    sentence: str
    nearest: Mapping[str, Any] | None = None

    @property
    def times(self) -> float:
        """The larger of the two."""
        return max(self.times_recording, self.times_validation or 0.0)


@dataclass(frozen=True)
class Share:
    """What an effect explains of the excess mean square of the dq-model.

    Attributes
    ----------
    effect : str
        Id of the effect.
    alone : float
        Share, 0 to 1, that it explains by itself.
    beside : float
        Share that it explains beside the others, none of which takes its place.
    """

    effect: str
    alone: float
    beside: float


@dataclass(frozen=True)
class Budget:
    """The budget of one channel on one run; the shares add up to one.

    Attributes
    ----------
    run : str
        "recording" or "validation".
    channel : str
        Such as `i_q`.
    equation : str
        The equation that predicts it.
    before : float
        Residual of the dq-model, in times the noise.
    after : float
        Residual of the final model, in times the noise.
    parts : tuple of Share
        Shares of the effects in the excess mean square of the dq-model, the largest first.
    shared : float
        What any of several effects could explain.
    unmodelled : float
        What the map without a name explains.
    rest : float
        What remains.
    """

    run: str
    channel: str
    equation: str
    before: float
    after: float
    parts: tuple[Share, ...]
    shared: float
    unmodelled: float
    rest: float

    @classmethod
    def of(cls, entry: Mapping[str, Any]) -> Self:
        """Reads its JSON object.

        Parameters
        ----------
        entry : mapping
            The object.

        Returns
        -------
        Budget
            The budget.
        """
        parts = tuple(Share(**part) for part in entry["parts"])
        return cls(**{**entry, "parts": parts})


@dataclass(frozen=True)
class Candidate:
    """An effect that would explain the mismatch.

    Attributes
    ----------
    effect : str
        Id of the effect.
    probability : float
        Its posterior probability, 0 to 1.
    sentence : str
        The effect in words, as in the catalogue.
    equation : str
        Its equation.
    parameters : mapping of str to Estimate
        Its parameters with standard errors.
    equivalent_to : tuple of str
        Effects that this recording cannot tell from it.
    gain_held_out : float or None
        Share of the residual's squares above the noise that it removes on data not used for fitting, -1 to
        1. It is negative where the prediction gets worse.
    """

    effect: str
    probability: float
    sentence: str
    equation: str
    parameters: Mapping[str, Estimate]
    equivalent_to: tuple[str, ...]
    gain_held_out: float | None


@dataclass(frozen=True)
class DiagnosisValues:
    """The values of a `Diagnosis`, which says what each of them is."""

    verdict: str
    read: tuple[Mapping[str, Any], ...]
    data_quality: tuple[Mapping[str, str], ...]
    located: tuple[Location, ...]
    remaining: tuple[Remaining, ...]
    budget: tuple[Budget, ...]
    options: Mapping[str, float]
    reason: str | None
    ranking: tuple[Candidate, ...]
    effects: tuple[str, ...]
    base: Mapping[str, Estimate]
    cannot_see: tuple[Mapping[str, Any], ...]
    next_experiment: str | None
    noise_floor: Mapping[str, float]
    fit: Mapping[str, Mapping[str, Mapping[str, float]]]
    recording_kind: str | None
    recordings: tuple[Mapping[str, Any], ...]
    interrupted: bool
    seed: int
    version: str
    data: Mapping[str, Any] = field(repr=False, compare=False)
    traces: Traces = field(repr=False, compare=False, default_factory=dict)

    @classmethod
    def from_json(cls, text: str, traces: Traces | None = None) -> Self:
        """Reads what `to_json` writes.

        Parameters
        ----------
        text : str
            The JSON text.
        traces : mapping or None, default None
            Traces, where they are at hand; without them nothing can be drawn.

        Returns
        -------
        Diagnosis
            The answer.

        Raises
        ------
        DataError
            For anything else.
        """
        with written_by("to_json"):
            return cls.of(json.loads(text), traces)

    @classmethod
    def of(cls, data: Mapping[str, Any], traces: Traces | None = None) -> Self:
        """Reads the JSON object of an answer.

        Parameters
        ----------
        data : mapping
            The object.
        traces : mapping or None, default None
            Traces, where they are at hand.

        Returns
        -------
        Diagnosis
            The answer.
        """
        read = data.get("read")
        return cls(
            verdict=data["verdict"],
            read=() if read is None else tuple(read) if isinstance(read, list) else (read,),
            data_quality=tuple(data["data_quality"]),
            located=tuple(_location(entry) for entry in data["located"]),
            remaining=tuple(_remaining(entry) for entry in data.get("remaining", ())),
            budget=tuple(Budget.of(entry) for entry in data.get("budget", ())),
            options=data.get("options", {}),
            reason=data.get("reason"),
            ranking=tuple(_candidate(entry) for entry in data["ranking"]),
            effects=tuple(data["model"]["effects"]),
            base=estimates(data["model"]["base"]),
            cannot_see=tuple(data["cannot_see"]),
            next_experiment=data["next_experiment"],
            noise_floor=data["noise_floor"],
            fit=data["fit"],
            recording_kind=data.get("recording_kind"),
            recordings=tuple(data.get("recordings", ())),
            interrupted=bool(data.get("interrupted", False)),
            seed=data["seed"],
            version=data["version"],
            data=data,
            traces={name: trace for name, trace in (traces or {}).items() if len(trace)},
        )

    @property
    def model(self) -> Mapping[str, Any]:
        """The object `model` of the JSON answer.

        It has `effects` and `base`, and `unmodelled` where the verdict is unknown or partial.
        """
        model: Mapping[str, Any] = self.data["model"]
        return model

    @property
    def nameplate(self) -> Sequence[Mapping[str, Any]]:
        """What was converted of the nameplate in a machine file, one JSON object for each entry."""
        entries: Sequence[Mapping[str, Any]] = self.data.get("nameplate", ())
        return entries

    @property
    def formulas(self) -> Sequence[Mapping[str, Any]] | None:
        """Formulas for a torque that has no name, the most credible first.

        One JSON object for each: formula, parameters, explains, times_noise, evidence, equivalent,
        has_form_of. Empty where no simple formula describes it; None where that was not asked.
        """
        entries: Sequence[Mapping[str, Any]] | None = self.data.get("formulas")
        return entries

    @property
    def unmodelled(self) -> Unmodelled | None:
        """Where the verdict is unknown or partial, the map of what no candidate explains; else None."""
        entry = self.model.get("unmodelled")
        return None if entry is None else Unmodelled.of(entry)

    @property
    def shown(self) -> str | None:
        """Which traces are compared and drawn.

        "validation" where there is one, else "recording", None without traces.
        """
        return next((name for name in ("validation", "recording") if name in self.traces), None)

    def to_json(self) -> str:
        """Gives the whole answer as JSON text, schema pmsm-rs.diagnosis/2.

        Returns
        -------
        str
            The text of its file.
        """
        return json_text(self.data)


def _remaining(entry: Mapping[str, Any]) -> Remaining:
    return Remaining(
        equation=entry["equation"],
        beside=tuple(entry["beside"]),
        times_recording=entry["times_noise"]["recording"],
        times_validation=entry["times_noise"]["validation"],
        over=tuple(entry["over"]),
        p_value=entry["p_value"],
        sentence=entry["sentence"],
        nearest=entry.get("nearest"),
    )


def _location(entry: Mapping[str, Any]) -> Location:
    return Location(
        entry["equation"],
        entry["share"],
        entry["sentence"],
        tuple(entry.get("where") or ()),
        entry.get("order_electrical"),
        entry.get("order_mechanical"),
        entry.get("frequency_hz"),
        entry.get("trend"),
        entry.get("p_value"),
        tuple(entry.get("recordings", ())),
    )


def _candidate(entry: Mapping[str, Any]) -> Candidate:
    return Candidate(
        entry["effect"],
        entry["probability"],
        entry["sentence"],
        entry["equation"],
        estimates(entry["parameters"]),
        tuple(entry["equivalent_to"]),
        entry.get("gain_held_out"),
    )


def chosen(answer: DiagnosisValues) -> list[Candidate]:
    """The candidates that the model holds."""
    return [candidate for candidate in answer.ranking if candidate.effect in answer.effects]


def compared(answer: DiagnosisValues) -> str:
    """The run on which the model is compared: "validation" where there is one, else "recording"."""
    return "validation" if answer.fit.get("validation", {}).get("before") else "recording"


def leading(answer: DiagnosisValues, most: int) -> list[Candidate]:
    """The first `most` candidates, and all further ones that the model holds."""
    return [c for at, c in enumerate(answer.ranking) if at < most or c.effect in answer.effects]
