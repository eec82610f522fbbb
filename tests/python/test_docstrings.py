"""Public docstrings say parameters, results and errors in the form of numpydoc, and their examples run."""

from __future__ import annotations

import dataclasses
import doctest
import inspect
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pmsm_rs as pm
import pytest
from conftest import ROOT
from pmsm_rs import plot
from pmsm_rs.export import export
from pmsm_rs.live.window import Drift
from pmsm_rs.results.estimates import Estimate
from pmsm_rs.results.findings import Budget, Candidate, Location, Remaining, Share
from pmsm_rs.results.unmodelled import Term, Unmodelled
from pmsm_rs.simulation.drive import Truth
from pmsm_rs.view.notebook import Page

numpydoc = pytest.importorskip("numpydoc.docscrape")
validate = pytest.importorskip("numpydoc.validate")

PUBLIC = [getattr(pm, name) for name in pm.__all__ if name != "__version__"]
DRAWN = [
    value
    for name, value in vars(plot).items()
    if inspect.isfunction(value) and value.__module__ == plot.__name__ and name[0] != "_"
]
PARTS = [Estimate, Location, Remaining, Share, Budget, Candidate, Unmodelled, Term, Drift, Truth, Page]
RULES = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["numpydoc_validation"]["checks"]


def name_of(value: Any) -> str:
    return f"{value.__module__}.{value.__qualname__}"


def is_result(kind: type) -> bool:
    """Whether instances come out of functions of this package, so that their fields are what is described."""
    return dataclasses.is_dataclass(kind) and kind not in {pm.Swarm, pm.DiagnosisOptions}


def documented() -> Iterator[str]:
    """Names of all that is public: functions, classes, and what the package defines on these."""
    for value in [*PUBLIC, *DRAWN, *PARTS, export]:
        if inspect.isclass(value) and issubclass(value, Exception):
            continue
        yield name_of(value)
        if not inspect.isclass(value):
            continue
        for name in dir(value):
            member = inspect.getattr_static(value, name)
            inner = member.fget if isinstance(member, property) else getattr(member, "__func__", member)
            if name[0] != "_" and inspect.isfunction(inner) and inner.__module__.startswith("pmsm_rs"):
                yield f"{name_of(value)}.{name}"


def faults(name: str) -> list[str]:
    """What the checker has against the docstring of `name`."""
    found = validate.validate(name)["errors"]
    off = {*RULES[1:]}
    value = validate.Validator._load_obj(name)
    if inspect.isclass(value) and is_result(value):
        off.add("PR01")
    return [f"{code} {text}" for code, text in found if code not in off]


@pytest.mark.parametrize("name", sorted({*documented()}))
def test_a_public_docstring_is_complete(name: str) -> None:
    assert faults(name) == []


@pytest.mark.parametrize("kind", [k for k in [*PUBLIC, *PARTS] if inspect.isclass(k) and is_result(k)])
def test_a_result_describes_each_of_its_fields(kind: type) -> None:
    told = numpydoc.NumpyDocString(inspect.getdoc(kind))["Attributes"]
    names = {name.strip() for entry in told for name in entry.name.split(",")}
    assert {field.name for field in dataclasses.fields(kind)} - names == set()  # type: ignore[arg-type]
    assert all(entry.type and entry.desc for entry in told)


DIAGNOSE = cache(pm.diagnose)
"""Several examples begin with the same diagnosis; it is made once."""


@pytest.mark.parametrize(
    "value", [v for v in PUBLIC if not (inspect.isclass(v) and issubclass(v, Exception))], ids=name_of
)
def test_the_examples_run(value: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(pm, "diagnose", DIAGNOSE)
    finder = doctest.DocTestFinder(recurse=False)
    found = [test for test in finder.find(value, name_of(value), module=False) if test.examples]
    assert found, "it has no example"
    for test in found:
        result = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE).run(test)
        assert result.failed == 0


def test_all_that_is_public_is_looked_at() -> None:
    names = {*documented()}
    assert {"pmsm_rs.run.diagnose", "pmsm_rs.model.Model.predict", "pmsm_rs.plot.residual_map"} <= names
    assert len(names) > 80
