"""Every error that is raised and every finding that is told has a code, and the code an entry."""

from __future__ import annotations

import ast
import importlib
import inspect
import json
import pickle
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pmsm_rs as pm
import pytest
from conftest import PACKAGE, ROOT
from pmsm_rs import messages
from pmsm_rs.cli import main
from pmsm_rs.errors import message, refuse

CORE = ROOT / "crates" / "pmsm-core" / "src"
STRING = r"\"((?:\\.|[^\"\\])*)\""
RAISED = ("refuse", "_bad", "Refused", "Problem")
# Messages that name nothing but values: the entry of their kind of error says what can be said.
GENERAL = {"… is a …", "… is …", "the … is …", "…", "……", "[machine] …"}


def rust(path: Path) -> str:
    return path.read_text(encoding="utf-8").split("#[cfg(test)]\nmod tests")[0]


def shape(text: str) -> str:
    """A Rust string with `…` for each value."""
    return re.sub(r"\{[^{}]*\}", "…", re.sub(r"\\\n\s*", "", text))


def pieces(node: ast.expr | None) -> Iterator[str]:
    """What a string of the package may say, with `…` for each value."""
    match node:
        case ast.Constant(value=str(text)):
            yield text
        case ast.JoinedStr(values=parts):
            yield "".join(str(p.value) if isinstance(p, ast.Constant) else "…" for p in parts)
        case ast.IfExp(body=one, orelse=other):
            yield from pieces(one)
            yield from pieces(other)


def calls(*names: str) -> Iterator[tuple[str, ast.Call]]:
    for path in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call):
                called = getattr(node.func, "id", getattr(node.func, "attr", ""))
                if called in names:
                    yield called, node


def findings() -> set[str]:
    """The findings of core and package."""
    found = set()
    for path in CORE.rglob("*.rs"):
        if "track" in path.parts:  # Notes of a window, which stand in the estimates of the tracker.
            continue
        text = rust(path)
        for match in re.finditer(rf"finding(?:: | = |:\s+)\s*(?:format!\(\s*)?{STRING}", text):
            found.add(shape(match[1]))
    for _, call in calls("Remark"):
        found.update(pieces(call.args[0]))
    return found - {"…", "recording …: …"}


def problems() -> set[str]:
    """The problems of errors of core and package."""
    found = set()
    for called, call in calls(*RAISED):
        given = [*call.args, *(word.value for word in call.keywords if word.arg == "problem")]
        found.update(pieces(given[1] if called == "refuse" else given[0]))
    for path in CORE.rglob("*.rs"):
        text = rust(path)
        for pattern in (r"unusable\(\s*(?:format!\(\s*)?", r"problem(?:: | = )\s*(?:&?format!\(\s*)?"):
            found.update(shape(match[1]) for match in re.finditer(pattern + STRING, text))
    return found - GENERAL


@pytest.mark.parametrize("finding", sorted(findings()))
def test_every_finding_has_an_entry(finding: str) -> None:
    code = messages.of_finding(finding)
    assert code is not None
    assert messages.entries()[code].kind == "finding"


@pytest.mark.parametrize("problem", sorted(problems()))
def test_every_error_has_an_entry_of_its_own(problem: str) -> None:
    code = messages.of_error(problem, ())
    assert code is not None, "no entry says this"
    assert messages.entries()[code].kind == "error"


def test_what_is_raised_is_found() -> None:
    assert len(findings()) > 55
    assert len(problems()) > 200


def test_every_kind_of_error_has_an_entry_for_the_rest() -> None:
    for name in pm.__all__:
        kind = getattr(pm, name)
        if inspect.isclass(kind) and issubclass(kind, pm.PmsmError) and kind is not pm.PmsmError:
            entry = messages.entries()[kind("zzz").code]
            assert entry.any == name


def test_codes_are_unique_and_the_table_is_complete() -> None:
    text = (PACKAGE / "messages.toml").read_text(encoding="utf-8")
    codes = re.findall(r"^\[(PR\d{3})\]$", text, re.MULTILINE)
    assert codes == sorted(set(codes)) == list(messages.entries())
    assert not messages.retired() & {*codes}
    patterns = [says for entry in messages.entries().values() for says in entry.says]
    assert len(patterns) == len({*patterns})
    for entry in messages.entries().values():
        assert entry.says or entry.any, entry.code
        assert entry.cause.endswith("."), entry.code
        assert entry.cure.endswith("."), entry.code
        for says in entry.says:
            find = (
                messages.of_finding if entry.kind == "finding" else lambda text: messages.of_error(text, ())
            )
            assert find(says) == entry.code, says


REFUSED: list[tuple[Callable[[], object], str]] = [
    (lambda: pm.load("there_is_none.csv"), "PR003"),
    (lambda: pm.Machine(n_p=0), "PR030"),
    (lambda: pm.Machine(n_p=4, r_s=-1.0), "PR030"),
    (lambda: pm.diagnose({"t": [0.0]}, pm.Machine(n_p=4)), "PR007"),
    (lambda: pm.Recording({"t": [0.0, 0.0, 1.0], "i_q": [1.0, 1.0, 1.0]}), "PR092"),
    (lambda: pm.diagnose_many("run.csv", pm.Machine(n_p=4)), "PR170"),
    (lambda: pm.Swarm(inertia_schedule="cubic"), "PR011"),
]


@pytest.mark.parametrize(("call", "code"), REFUSED, ids=[code for _, code in REFUSED])
def test_an_error_shows_its_code(call: Callable[[], object], code: str) -> None:
    with pytest.raises(pm.PmsmError) as caught:
        call()
    assert caught.value.code == code
    assert str(caught.value).endswith(f" [{code}]")
    assert message(caught.value) == str(caught.value).removesuffix(f" [{code}]")


def test_an_error_keeps_its_code_through_pickle() -> None:
    error = refuse(pm.DataError, "there is no time column", file="a.csv", fix="add one")
    again = pickle.loads(pickle.dumps(error))
    assert str(again) == str(error) == "a.csv: there is no time column; add one [PR070]"


def test_a_refusal_that_became_a_finding_has_the_code_of_the_error() -> None:
    assert messages.of_finding("r_s is not on the nameplate and this recording does not show it") == "PR131"


def test_the_answer_names_the_code_of_each_finding() -> None:
    t = np.arange(400) * 1e-3
    noise = 0.01 * np.random.default_rng(1).standard_normal((2, 400))
    still = pm.Recording(t=t, v_d=0.0 * t, v_q=0.0 * t, i_d=noise[0], i_q=noise[1], theta_e=0.0 * t)
    answer = pm.diagnose(still, pm.Machine(n_p=4, r_s=0.5, l_d=1e-3, l_q=1e-3, psi_m=0.1, j=1e-3, b=1e-3))
    told = json.loads(answer.to_json())["data_quality"]
    assert told
    for item in told:
        assert {"finding", "consequence", "fix", "code"} == {*item}
        assert f"[{item['code']}]" in str(answer)


def test_explain_prints_the_entry_without_a_network(capsys: pytest.CaptureFixture[str]) -> None:
    for code, entry in messages.entries().items():
        with pytest.raises(SystemExit) as ended:
            main(["explain", code.lower()])
        assert ended.value.code == 0
        out = capsys.readouterr().out
        assert entry.cause in out
        assert entry.cure in out
    with pytest.raises(SystemExit) as ended:
        main(["explain"])
    listed = capsys.readouterr().out
    assert ended.value.code == 0
    assert all(code in listed for code in messages.entries())
    with pytest.raises(SystemExit) as ended:
        main(["explain", "PR999"])
    assert ended.value.code == 2
    assert "[PR002]" in capsys.readouterr().err


def test_the_manual_has_an_anchor_for_every_code(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(ROOT / "docs")
    generate = importlib.import_module("generate")
    text = generate.messages("error") + generate.messages("finding")
    assert re.findall(r'<a id="(PR\d{3})"', text) == list(messages.entries())
    page = (ROOT / "docs" / "troubleshooting.md").read_text(encoding="utf-8")
    assert "generated/errors.md" in page
    assert "generated/findings.md" in page
