"""The manual holds what it promises: its Python examples run, and its first pages are short."""

from __future__ import annotations

import re
from pathlib import Path

import pmsm_rs as pm
import pytest
from conftest import ROOT

DOCS = ROOT / "docs"
PAGES = [path for path in sorted(DOCS.glob("*.md")) if "```python" in path.read_text()]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_examples_run(page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for block in re.findall(r"```python\n(.*?)```", page.read_text(), re.DOTALL):
        exec(compile(block, str(page), "exec"), names)


def test_every_error_kind_has_its_cure_in_the_manual() -> None:
    page = (DOCS / "troubleshooting.md").read_text()
    kinds = [name for name in pm.__all__ if name.endswith("Error") and name != "PmsmError"]
    assert kinds
    assert [name for name in kinds if f"| `{name}` |" not in page] == []


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
