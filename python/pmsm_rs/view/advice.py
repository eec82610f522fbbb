"""What to do next, for every verdict."""

from __future__ import annotations

from ..results.findings import DiagnosisValues
from ..results.words import listed, lower_first, title


def next_step(answer: DiagnosisValues) -> str:
    """One or two sentences: what to record, to correct or to take over."""
    if answer.interrupted:
        return "Run the diagnosis again to the end; this is the best result so far."
    if answer.next_experiment:
        return answer.next_experiment
    fixes = [item["fix"] for item in answer.data_quality if item["fix"]]
    if answer.verdict == "undetermined":
        return fixes[0] if fixes else "Record a run in which the motor is driven through its operating range."
    file = ", and take over the values of the corrected machine file" if answer.data.get("machine") else ""
    names = listed([lower_first(title(effect)) for effect in answer.effects])
    if answer.verdict == "no_mismatch":
        if answer.remaining:
            return "Diagnose the validation run by itself; it shows more than this recording."
        return (
            f"Nothing needs to be added to the model{file}."
            if file
            else "Nothing needs to be added to the model."
        )
    if answer.verdict == "named" and names and not answer.remaining:
        return f"Add {names} to the model, with the parameters below{file}."
    if answer.verdict == "ambiguous":
        return "Record the motor at other speeds and currents; that may tell the candidates apart."
    if answer.unmodelled is not None and answer.unmodelled.terms:
        beside = f"{names} and " if names else ""
        return f"Add {beside}the map of what has no name to the model, or look for its cause."
    return "Record the motor at other speeds and currents; see below where the mismatch sits."
