"""Answers as they are handed out: their values, and how they print, draw and show themselves."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any, overload

from ._core import DataError, UsageError
from .errors import no_answer, opened, refuse
from .model import Model
from .results.estimates import IdentificationValues
from .results.findings import DiagnosisValues, compared

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from .view.notebook import Page

# What draws and renders is fetched by those who use it: a fleet of diagnoses needs none of it.


class Identification(IdentificationValues):
    """Estimated parameters of the dq-model, as `identify` returns them.

    Attributes
    ----------
    parameters : mapping of str to Estimate
        Value, standard error, 95 % interval and unit by name.
    cost : float
        Sum of squared errors, each over the noise of its channel.
    history : tuple of float
        Best cost of each generation.
    method : str
        How it was searched: "pso", "lm" or "pso+lm".
    evaluations : int
        Number of simulations.
    converged : bool
        Whether the search came to rest.
    interrupted : bool
        Whether Ctrl-C ended it.
    rms : mapping of str to float
        Measured minus model per channel, in its SI unit.
    cannot_show : tuple of mapping
        Parameters that this recording does not determine, each with the reason.
    seed : int
        Seed of the search.
    version : str
        Version of the package.
    data : mapping
        The JSON object.

    Examples
    --------
    >>> import pmsm_rs as pm
    >>> from pmsm_rs.support.demo import recording_files
    >>> run, other, machine = recording_files()
    >>> found = pm.identify(run, machine, method="lm")
    >>> pm.Identification.from_json(found.to_json()) == found
    True
    """

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
    """What the dq-model leaves out, as `diagnose` returns it.

    Fields are those of the JSON answer, of which `effects` and `base` stand under `model` there. Channels are
    i_d, i_q (A), omega_e (rad/s, electrical), and of operating points v_d, v_q (V).

    Attributes
    ----------
    verdict : str
        `no_mismatch`, `named`, `partial` (the named effects are missing, and something else beside them),
        `ambiguous`, `unknown` or `undetermined`.
    read : tuple of mapping
        For each recording: which columns became what, which were not used and why, and which questions could
        be asked. In the JSON answer it is an object for one recording and a list for several.
    data_quality : tuple of mapping
        Findings, each with finding, consequence, fix and code.
    located : tuple of Location
        Where the mismatch sits, the largest share first.
    remaining : tuple of Remaining
        What exceeds the noise beside the effects that were found; empty where nothing does.
    budget : tuple of Budget
        Share of the mismatch that each effect takes away, by channel and run.
    options : mapping of str to float
        The constants on which the verdict rests, see `DiagnosisOptions`.
    reason : str or None
        Why a verdict is `undetermined`; None otherwise.
    ranking : tuple of Candidate
        Candidates with their probabilities: the effects of the model first, then by probability.
    effects : tuple of str
        Ids of the effects of the model.
    base : mapping of str to Estimate
        The base parameters r_s, l_d, l_q, psi_m, j, b and an unknown load.
    cannot_see : tuple of mapping
        Effects that this recording cannot show: effect, why, and power, the probability that it would have
        been found.
    next_experiment : str or None
        What recording would decide more.
    noise_floor : mapping of str to float
        Residual of a perfect model per channel, root mean square in its unit.
    fit : mapping
        fit["recording" or "validation"]["before" or "after"][channel] is the residual, root mean square in
        the channel's unit. `before` is the dq-model with all its parameters estimated.
    recording_kind : str or None
        full, electrical, mechanical, operating_points or open_circuit.
    recordings : tuple of mapping
        Of several recordings each one's file, samples, duration in s, kind, load, noise_floor and fit.
    interrupted : bool
        Whether Ctrl-C ended it.
    seed : int
        Seed of the searches.
    version : str
        Version of the package.
    data : mapping
        The JSON object. data["machine"] is what was stated of machine, drive and load; data["path"] is the
        way to the model, one effect more at each step.
    traces : mapping
        traces["recording"] and, with a validation run, traces["validation"] hold arrays of shape (samples,):
        `t` in s and, per channel, `NAME_measured`, `NAME_before` and `NAME_after`. The operating point is
        `op_omega_e` (rad/s), `op_i_d`, `op_i_q` (A), `op_theta_e` and `op_theta_m` (rad), as far as known.
        Several recordings lie end to end, numbered by `recording`.

    Examples
    --------
    >>> import pmsm_rs as pm
    >>> from pmsm_rs.support.demo import recording_files
    >>> run, other, machine = recording_files()
    >>> answer = pm.diagnose(run, machine, validation=other)
    >>> answer.ranking[0].effect
    'dead_time'
    >>> pm.Diagnosis.from_json(answer.to_json()).verdict
    'named'
    """

    @property
    def model(self) -> Model:
        """The model that was settled on, to predict, simulate and export with.

        It reads like `model` of the JSON answer.
        """
        return Model(self.data["model"])

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
        """Renders one self-contained HTML page.

        The same answer, title and command give the same bytes.

        Parameters
        ----------
        path : path or None, default None
            Where it is written; None returns it for a notebook to show.
        title : str or None, default None
            Its heading.
        command : str or None, default None
            The command line that made the answer, which the page shows.

        Returns
        -------
        Page or None
            The page where `path` is None.

        Raises
        ------
        UsageError
            If it cannot be written.
        """
        from .view.notebook import Page
        from .view.report import render

        page = Page(render(self, title, command))
        if path is None:
            return page
        page.save(path)
        return None

    def export(self, to: str, path: str | os.PathLike[str], **options: Any) -> list[str]:
        """Writes the model for another tool.

        Parameters
        ----------
        to : str
            One of `pmsm_rs.export.KINDS`: machine, python, rust, fmu, fmu3, modelica, motulator, gem,
            mujoco, c-header.
        path : path
            Where it goes.
        **options : object
            Options of that kind, see `pmsm-rs export --help`.

        Returns
        -------
        list of str
            Sentences on what the tool cannot express and the file does not hold.

        Raises
        ------
        UsageError
            As `pmsm_rs.export.export` does.
        """
        from .export import export

        return export(self.model, to, path, **options)

    def trajectories(self, path: str | os.PathLike[str]) -> None:
        """Writes t and the measured, before and after values per channel as Parquet.

        Parameters
        ----------
        path : path
            Where it goes; its name ends with .parquet.

        Raises
        ------
        UsageError
            Where it cannot be written.
        """
        from .results.trajectories import write

        write(self, path)

    def plot(self) -> Figure:
        """Draws measured minus model, before and after, over time and over the operating points.

        Returns
        -------
        matplotlib.figure.Figure
            The figure.

        Raises
        ------
        UsageError
            Without traces.
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


def read_answer(
    path: str | os.PathLike[str], trajectories: str | os.PathLike[str] | None = None
) -> Diagnosis:
    """The diagnosis in a file that --json wrote, with the traces of a file that --trajectories wrote.

    Raises UsageError where there is no such file and where it is no answer, DataError for trajectories that
    cannot be read.
    """
    with opened(str(path), "answer") as file:
        try:
            answer = Diagnosis.from_json(file.read_text(encoding="utf-8"))
        except (UnicodeDecodeError, DataError) as error:
            raise no_answer(path) from error
    if trajectories is None:
        return answer
    from .io.formats import open_source
    from .io.recording import DEFAULT_MAX_BYTES

    source = open_source(trajectories, DEFAULT_MAX_BYTES)
    run = compared(answer)
    # A validation run need not have every channel of the recording.
    channels = answer.fit.get(run, {}).get("after", {})
    if not {"t", *(f"{name}_after" for name in channels)} <= {*source.names}:
        raise refuse(
            UsageError,
            "these are not the trajectories of the answer",
            file=str(trajectories),
            fix="write both at once: pmsm-rs diagnose ... --json ANSWER.json --trajectories OUT.parquet",
        )
    return Diagnosis.of(answer.data, {run: source.read(source.names)})
