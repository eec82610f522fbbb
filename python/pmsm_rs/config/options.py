"""The constants on which a verdict of the diagnosis rests."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, fields
from typing import Any, Final

from .. import _core
from .._core import UsageError
from ..errors import did_you_mean, refuse

_CORE: Final[dict[str, Any]] = json.loads(_core.diagnosis_options())


@dataclass(frozen=True, kw_only=True)
class DiagnosisOptions:
    """The constants on which a verdict rests; every answer lists their values under `options`.

    All are pure numbers but `run_up` (s) and the costs, which are in nats (1 nat is a factor e in
    probability).

    Samples: `rows_per_sample` rows of a waveform count as one independent sample, and a channel has at least
    `fewest_samples`. A mean square below `floor_known_to` times that of the noise gains nothing.

    Priors of causes: an effect costs `effect_cost`, a coefficient of a map `coefficient_cost`. `unknown` is
    kept for physics outside the catalogue. A set holds at most `most_effects`.

    Decisions: a set counts as better from a gain of `decisive`. An effect is named beside something else from
    the probability `named`, if it explains `beside_remainder` times what remains. A channel is mismatched
    from an excess mean square of `mismatch` times the noise's, on another recording of `mismatch_held_out`,
    and explained below `explained`. A model is refuted where its mean square on another recording exceeds
    `refuted_times` that of the dq-model plus `refuted_by`. Something remains from `remaining_times` times the
    noise, if chance does that more rarely than `remaining_chance`. No name is likelier than `ceiling_unknown`
    where none is given, and than `ceiling_doubtful` where something else remains.

    Priors of parameters: `nameplate_spread` and `run_up_spread` are standard deviations of a logarithm, of a
    nameplate value and of the time `run_up`. In that time the largest torque brings a rotor of unknown
    inertia to its largest speed. `friction_spread` is the standard deviation of a stated friction, as a share
    of it. A fit whose residual exceeds `worse_than_constant` times a signal's own variation is no model,
    unless the signal varies by less than `still` times its noise.

    Raises UsageError, when a diagnosis is made with it, for a value that is no finite number above zero.
    """

    rows_per_sample: float = _CORE["rows_per_sample"]
    fewest_samples: float = _CORE["fewest_samples"]
    floor_known_to: float = _CORE["floor_known_to"]
    effect_cost: float = _CORE["effect_cost"]
    coefficient_cost: float = _CORE["coefficient_cost"]
    decisive: float = _CORE["decisive"]
    unknown: float = _CORE["unknown"]
    named: float = _CORE["named"]
    beside_remainder: float = _CORE["beside_remainder"]
    most_effects: int = _CORE["most_effects"]
    mismatch: float = _CORE["mismatch"]
    mismatch_held_out: float = _CORE["mismatch_held_out"]
    explained: float = _CORE["explained"]
    refuted_times: float = _CORE["refuted_times"]
    refuted_by: float = _CORE["refuted_by"]
    remaining_times: float = _CORE["remaining_times"]
    remaining_chance: float = _CORE["remaining_chance"]
    ceiling_unknown: float = _CORE["ceiling_unknown"]
    ceiling_doubtful: float = _CORE["ceiling_doubtful"]
    nameplate_spread: float = _CORE["nameplate_spread"]
    friction_spread: float = _CORE["friction_spread"]
    run_up: float = _CORE["run_up"]
    run_up_spread: float = _CORE["run_up_spread"]
    worse_than_constant: float = _CORE["worse_than_constant"]
    still: float = _CORE["still"]

    @property
    def settings(self) -> str:
        """As the core reads it: JSON text."""
        return json.dumps(asdict(self), allow_nan=True)

    @classmethod
    def parse(cls, text: str) -> DiagnosisOptions:
        """From `name=value,name=value`, as on the command line. Raises UsageError naming what is wrong."""
        known = [field.name for field in fields(cls)]
        given: dict[str, Any] = {}
        for part in filter(None, (part.strip() for part in text.split(","))):
            name, _, value = (piece.strip() for piece in part.partition("="))
            if name not in known:
                raise refuse(UsageError, f"a diagnosis has no option '{name}'", fix=did_you_mean(name, known))
            try:
                given[name] = int(value) if name == "most_effects" else float(value)
            except ValueError:
                raise refuse(
                    UsageError, f"'{part}' gives the option {name} no number", fix=f"write {name}=..."
                ) from None
        return cls(**given)
