"""The manual holds what it promises: its Python examples run, and it knows every finding of the diagnosis."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pmsm_rs as pm
import pytest
from conftest import PACKAGE, ROOT

DOCS = ROOT / "docs"
PAGES = [path for path in sorted(DOCS.glob("*.md")) if "```python" in path.read_text()]
CORE = ROOT / "crates" / "pmsm-core" / "src"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_examples_run(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for block in re.findall(r"```python\n(.*?)```", page.read_text(), re.DOTALL):
        exec(compile(block, str(page), "exec"), names)


def of_core() -> Iterator[str]:
    """The findings of the core, with `…` for each value."""
    for path in sorted(CORE.rglob("*.rs")):
        if "track" in path.parts:  # Notes of a window, which stand in the estimates of the tracker.
            continue
        text = path.read_text().split("#[cfg(test)]\nmod tests")[0]
        for found in re.finditer(r"finding(?:: | = )\s*(?:format!\(\s*)?\"((?:\\.|[^\"\\])*)\"", text):
            yield re.sub(r"\{[^{}]*\}", "…", re.sub(r"\\\n\s*", "", found[1]))


def of_package() -> Iterator[str]:
    """The findings of the readers."""
    for path in sorted(PACKAGE.rglob("*.py")):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "Remark":
                text = node.args[0]
                parts = text.values if isinstance(text, ast.JoinedStr) else [text]
                yield "".join(p.value if isinstance(p, ast.Constant) else "…" for p in parts)


def flat(text: str) -> str:
    """Words alone, in small letters."""
    return " ".join(re.findall(r"[\w…]+", text.lower()))


@pytest.mark.parametrize("finding", sorted({*of_core(), *of_package()} - {"…"}))
def test_every_finding_has_its_cure_in_the_manual(finding: str) -> None:
    page = flat((DOCS / "troubleshooting.md").read_text().split("## Findings")[1])
    # Four words in a row that are no value, or all there are between two values.
    runs = [flat(part).split() for part in finding.split("…")]
    longest = max(len(run) for run in runs)
    least = min(longest, 4)
    known = any(" ".join(run[k : k + least]) in page for run in runs for k in range(len(run) - least + 1))
    assert known, finding


def test_every_error_kind_has_its_cure_in_the_manual() -> None:
    page = (DOCS / "troubleshooting.md").read_text()
    kinds = [name for name in pm.__all__ if name.endswith("Error") and name != "PmsmError"]
    assert kinds
    assert [name for name in kinds if f"| `{name}` |" not in page] == []


def test_the_findings_are_found() -> None:
    assert len({*of_core()}) > 40
    assert len({*of_package()}) > 12


def test_the_readme_is_short_and_its_links_lead_somewhere() -> None:
    text = (ROOT / "README.md").read_text()
    assert len(text.splitlines()) < 150
    first = text.split("## ")[0]
    assert first.index("![") < first.index("pip install") < first.index("pmsm-rs demo")
    assert "make test" in text
    for target in re.findall(r"\]\(((?!https?:)[^)#]+)", text):
        assert (ROOT / target).exists(), target


def test_how_the_diagnosis_works_fits_on_a_page_and_has_its_pictures() -> None:
    text = (DOCS / "how_it_works.md").read_text()
    assert len(text.split()) <= 900
    pictures = re.findall(r"!\[[^\]]+\]\(([^)]+)\)", text)
    assert len(pictures) == 3
    assert all((DOCS / picture).exists() for picture in pictures)
