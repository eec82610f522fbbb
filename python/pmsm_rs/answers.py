"""Answers as they are handed out: their values, and how they print, draw and show themselves."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any, Self, overload

from .errors import written_by
from .model import Model
from .results.findings import DiagnosisValues, IdentificationValues, Traces

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from .view.notebook import Page

# What draws and renders is fetched by those who use it: a fleet of diagnoses needs none of it.


class Identification(IdentificationValues):
    """Estimated parameters of the dq-model.

    `history` holds the best cost of each generation, and `rms` measured minus model per channel in its SI
    unit. `cannot_show` lists the parameters that this recording does not determine, with the reason.
    """

    @classmethod
    def from_json(cls, text: str) -> Self:
        """From what `to_json` writes. Raises DataError for anything else."""
        with written_by("to_json"):
            return super().from_json(text)

    def __repr__(self) -> str:
        state = "interrupted" if self.interrupted else "converged" if self.converged else "not converged"
        return f"<Identification by {self.method}, {state}: {', '.join(self.parameters)}>"

    def __str__(self) -> str:
        from .view.summary import identification

        return identification(self)

    def _repr_html_(self) -> str:
        from .view.notebook import identification

        return identification(self)


class Diagnosis(DiagnosisValues):
    """What the dq-model leaves out; fields are those of the JSON answer, of which `effects` and `base` stand
    under `model` there.

    `read` says for each recording which of its columns became what, which were not used and why, and which
    questions could be asked. In the JSON answer it is an object for one recording and a list for several. The
    verdict is `no_mismatch`, `named`, `partial` (the named effects are missing, and something else beside
    them that is not in the catalogue), `ambiguous`, `unknown` or `undetermined`. Channels are i_d, i_q (A),
    omega_e (rad/s, electrical), of operating points v_d, v_q (V). `noise_floor` is the residual of a perfect
    model in each, `fit["recording" or "validation"]["before" or "after"]` the residual, both as root mean
    square in the channel's unit. `data_quality` has finding, consequence and fix; `cannot_see` effect, why,
    and power, the probability that it would have been found. `remaining` says what exceeds the noise beside
    the effects that were found, named or not, and is empty where nothing does. `budget` says which share of
    the mismatch each effect takes away, by channel and run. `options` are the constants on which the verdict
    rests, see `DiagnosisOptions`. `reason` says why a verdict is `undetermined`, and is None otherwise.
    `data["machine"]` is what was stated of machine, drive and load. `data["path"]` is the way to the model,
    one effect more at each step.

    `traces["recording"]` and, where a validation run was given, `traces["validation"]` hold arrays of shape
    (samples,). They are `t` in s and, per channel, `NAME_measured`, `NAME_before` and `NAME_after`. The
    operating point is `op_omega_e` (rad/s), `op_i_d`, `op_i_q` (A), `op_theta_e` and `op_theta_m` (rad), as
    far as known. Several recordings lie end to end there, numbered by `recording`. `recordings` says of each
    its file, samples, duration in s, kind, load, noise_floor and fit; it is empty for a single one.
    """

    @property
    def model(self) -> Model:
        """The model that was settled on, to predict, simulate and export with; it reads like `model` of the
        JSON answer.
        """
        return Model(self.data["model"])

    @classmethod
    def from_json(cls, text: str, traces: Traces | None = None) -> Self:
        """From what `to_json` writes, with the traces where they are at hand. Raises DataError for anything
        else.
        """
        with written_by("to_json"):
            return super().from_json(text, traces)

    @overload
    def report(
        self, path: str | os.PathLike[str], title: str | None = None, *, command: str | None = None
    ) -> None: ...
    @overload
    def report(self, path: None = None, title: str | None = None, *, command: str | None = None) -> Page: ...
    def report(
        self,
        path: str | os.PathLike[str] | None = None,
        title: str | None = None,
        *,
        command: str | None = None,
    ) -> Page | None:
        """One self-contained HTML page: written to `path`, or returned for a notebook to show.

        `command` is the command line that made the answer, where there is one; the page shows it. The same
        answer, title and command give the same bytes. Raises UsageError if it cannot be written.
        """
        from .view.notebook import Page
        from .view.report import render

        page = Page(render(self, title, command))
        if path is None:
            return page
        page.save(path)
        return None

    def export(self, to: str, path: str | os.PathLike[str], **options: Any) -> list[str]:
        """Writes the model for another tool, one of `pmsm_rs.export.KINDS`: machine, python, rust, fmu,
        modelica, motulator, gem, mujoco, c-header.

        Returns sentences that say what the tool cannot express and the file does not hold. Raises UsageError
        as `pmsm_rs.export.export` does.
        """
        from .export import export

        return export(self.model, to, path, **options)

    def trajectories(self, path: str | os.PathLike[str]) -> None:
        """Writes t and the measured, before and after values per channel as Parquet.

        Raises UsageError if it cannot.
        """
        from .results.trajectories import write

        write(self, path)

    def plot(self) -> Figure:
        """A matplotlib figure: measured minus model before and after over time, and over the operating
        points.
        """
        from .plot import overview

        return overview(self)

    def __repr__(self) -> str:
        by_name = {candidate.effect: candidate.probability for candidate in self.ranking}
        chosen = [f"{name} {100 * by_name[name]:.0f} %" if name in by_name else name for name in self.effects]
        state = ", interrupted" if self.interrupted else ""
        return f"<Diagnosis: {self.verdict}{': ' if chosen else ''}{', '.join(chosen)}{state}>"

    def __str__(self) -> str:
        from .view.summary import diagnosis

        return diagnosis(self)

    def _repr_html_(self) -> str:
        from .view.notebook import diagnosis

        return diagnosis(self)
