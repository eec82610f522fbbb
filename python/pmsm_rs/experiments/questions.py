"""What a manoeuvre can be asked: to tell models or formulas apart, or to make parameters known."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations
from typing import TYPE_CHECKING

from . import certainty, formula_rivals
from .bench import Bench, Trial
from .certainty import Gain
from .comparison import ROUNDS, Comparison, Separation
from .formula_rivals import FormulaRival
from .references import References
from .rivals import Rival, plain

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    Array = NDArray[np.float64]

Separations = tuple[Separation, ...]
# What a manoeuvre is worth of which the dq-model explains next to nothing.
UNEXPLAINED = 0.0


class TellModels:
    """Which of several models is true: the worst of all ordered pairs counts."""

    def __init__(
        self, bench: Bench, rivals: Sequence[Rival], comparison: Comparison, *, enough: float
    ) -> None:
        self._bench, self._rivals, self._comparison = bench, tuple(rivals), comparison
        self._enough = enough
        self._plain = [plain(rival) for rival in rivals]

    def trials(self, references: References) -> list[Trial]:
        """See `search.Question`."""
        made = []
        for rival in self._rivals:
            trial = self._bench.run(rival.model, references)
            made.append(trial)
            if trial.broken is not None:
                break
        return made

    def worth(self, trials: Sequence[Trial]) -> tuple[float, Separations]:
        """See `search.Question`.

        What the manoeuvre tells of the parameters counts, too, and alone beyond what is enough: a rich
        recording also answers for rivals of which nobody has thought.
        """
        worst, found = self._compared(trials, 1)
        for rival, dq, trial in zip(self._rivals, self._plain, trials, strict=True):
            if not self._comparison.explains(rival, dq, trial):
                return UNEXPLAINED, found
        return min(worst, self._enough) + min(s.gained for s in found), found

    def closely(self, trials: Sequence[Trial]) -> tuple[float, Separations]:
        """The same with every rival fitted anew, not linearly."""
        return self._compared(trials, ROUNDS)

    def _compared(self, trials: Sequence[Trial], rounds: int) -> tuple[float, Separations]:
        found = []
        for a, b in permutations(range(len(self._rivals)), 2):
            pair = self._rivals[a], self._rivals[b]
            found.append(self._comparison.separation(*pair, trials[a], rounds=rounds))
        return min(s.nats for s in found), tuple(found)


class TellFormulas:
    """Which of several formulas is true."""

    def __init__(
        self, bench: Bench, rivals: Sequence[FormulaRival], *, noise: float, load_open: bool
    ) -> None:
        self._bench, self._rivals = bench, tuple(rivals)
        self._noise, self._load_open = noise, load_open

    def trials(self, references: References) -> list[Trial]:
        """See `search.Question`."""
        made = []
        for rival in self._rivals:
            trial = formula_rivals.run(self._bench, rival, references)
            made.append(trial)
            if trial.broken is not None:
                break
        return made

    def worth(self, trials: Sequence[Trial]) -> tuple[float, Separations]:
        """See `search.Question`."""
        found = tuple(
            formula_rivals.separation(
                self._rivals[a],
                self._rivals[b],
                trials[a],
                noise=self._noise,
                load_open=self._load_open,
            )
            for a, b in permutations(range(len(self._rivals)), 2)
        )
        return min(s.nats for s in found), found


class PinDown:
    """What the least certain parameters of a model are."""

    def __init__(
        self, bench: Bench, rival: Rival, comparison: Comparison, before: Array, rows: float
    ) -> None:
        self._bench, self._rival, self._comparison = bench, rival, comparison
        self._before, self._rows = before, rows
        self.asked = certainty.open_parameters(rival, before)

    def trials(self, references: References) -> list[Trial]:
        """See `search.Question`."""
        return [self._bench.run(self._rival.model, references)]

    def worth(self, trials: Sequence[Trial]) -> tuple[float, Gain]:
        """See `search.Question`."""
        (trial,) = trials
        weight = max(1.0, self._rows / len(trial.t))
        found = certainty.gain(self._comparison, self._rival, trial, self._before, self.asked, weight)
        return found.nats, found
