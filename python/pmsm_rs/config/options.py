"""The constants on which a verdict of the diagnosis rests."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any, Final

from .. import _core
from .._core import UsageError
from ..errors import did_you_mean, number_of, refuse
from .settings import Settings, assignments

_CORE: Final[dict[str, Any]] = json.loads(_core.diagnosis_options())


@dataclass(frozen=True, kw_only=True)
class DiagnosisOptions(Settings):
    """The constants on which a verdict rests; every answer lists their values under `options`.

    Their defaults are those of the core, and stand on the page of options in the manual. All are pure numbers
    but `run_up` (s) and the costs, which are in nats (1 nat is a factor e in probability).

    Parameters
    ----------
    rows_per_sample : float
        Rows of a waveform that count as one independent sample.
    fewest_samples : float
        Independent samples that a channel has at least.
    floor_known_to : float
        Mean square, in times that of the noise, below which a model gains nothing: the noise is known to a
        tenth.
    effect_cost : float
        Prior cost of an effect, nats.
    coefficient_cost : float
        Prior cost of a coefficient of a map, nats.
    decisive : float
        Gain in nats from which a set counts as better.
    unknown : float
        Prior probability of physics outside the catalogue.
    named : float
        Probability from which an effect is named although something else remains.
    beside_remainder : float
        Excess mean square that an effect explains, over the excess that remains, from which it is named
        although something else is missing.
    most_effects : int
        Most effects of a set.
    mismatch : float
        Excess mean square of a channel, in times that of the noise, from which it is mismatched.
    mismatch_held_out : float
        As `mismatch`, on another recording.
    explained : float
        Excess mean square below which a channel is explained. An effect must gain more.
    refuted_times : float
        A model is refuted where its mean square on another recording exceeds that of the dq-model this many
        times, plus `refuted_by`.
    refuted_by : float
        Mean square, in times that of the noise, that `refuted_times` adds.
    remaining_times : float
        Residual, in times the noise, from which something remains.
    remaining_chance : float
        Probability below which noise alone must give such a residual, or nothing is said to remain.
    ceiling_unknown : float
        Largest probability of an effect where none is named, or where another recording contradicts it.
    ceiling_doubtful : float
        Largest probability of an effect in doubt: something else remains, or another recording is not
        predicted.
    nameplate_spread : float
        Standard deviation of the logarithm of a nameplate value.
    friction_spread : float
        Standard deviation of a stated friction, as a share of it.
    run_up : float
        Time in s in which the largest torque brings a rotor of unknown inertia to its largest speed.
    run_up_spread : float
        Standard deviation of the logarithm of `run_up`.
    worse_than_constant : float
        A fit is no model where its residual exceeds the variation of the signal itself by this factor.
    still : float
        `worse_than_constant` is not applied to a signal that varies by less than this times its noise.

    Raises
    ------
    UsageError
        When a diagnosis is made with it, for a value that is no finite number above zero.

    Examples
    --------
    >>> import pmsm_rs as pm
    >>> pm.DiagnosisOptions(most_effects=2).most_effects
    2
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

    def with_effects(self, definitions: Sequence[Mapping[str, Any]]) -> str:
        """Gives the options as the core reads them, with definitions of effects given as text.

        Parameters
        ----------
        definitions : sequence of mapping
            Definitions, as `Effect.definition` has them.

        Returns
        -------
        str
            JSON text.

        Raises
        ------
        UsageError
            Naming an option that is no finite number above zero.
        """
        for name, value in asdict(self).items():
            if not 0.0 < number_of(f"the option {name}", value) < math.inf:
                raise refuse(
                    UsageError, f"the option {name} is {value}", fix="give a finite number above zero"
                )
        return json.dumps(asdict(self) | ({"effects": list(definitions)} if definitions else {}))

    @classmethod
    def parse(cls, text: str) -> DiagnosisOptions:
        """Reads options as on the command line.

        Parameters
        ----------
        text : str
            `name=value,name=value`.

        Returns
        -------
        DiagnosisOptions
            With the default of what is not named.

        Raises
        ------
        UsageError
            Naming what is wrong.
        """
        known = [field.name for field in fields(cls)]
        given: dict[str, Any] = {}
        for part, name, mark, value in assignments(text):
            if not mark and name[0].isdigit():
                raise refuse(
                    UsageError,
                    f"'{part}' is a number without a name",
                    fix="part options by a comma, and write numbers with a decimal point, as in named=0.95",
                )
            if name not in known:
                raise refuse(UsageError, f"a diagnosis has no option '{name}'", fix=did_you_mean(name, known))
            try:
                given[name] = int(value) if name == "most_effects" else float(value)
            except ValueError:
                raise refuse(
                    UsageError,
                    f"'{part}' gives the option {name} no number",
                    fix=f"write a number behind it, as in {name}={_CORE[name]:g}, which is the default",
                ) from None
        return cls(**given)
