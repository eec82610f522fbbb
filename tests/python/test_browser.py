"""Report and notebook cards in a real browser: nothing complains, everything is there and can be read."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from browser import Page, browser, installed
from pmsm_rs import Identification
from test_results import IDENTIFICATION, diagnosis

PROGRAM = installed()
pytestmark = pytest.mark.skipif(
    PROGRAM is None, reason="there is no Chromium to show the report (Debian: apt install chromium)"
)
FIGURES = 8
SIZES = """[...document.querySelectorAll("svg")].map(svg => {
  const box = svg.getBoundingClientRect();
  const count = what => svg.querySelectorAll(what).length;
  return [box.width, box.height, count("path, use"), count("text")];
})"""
# Contrast by WCAG 2.2 of every text that stands in an element of its own, on the colour it is painted on.
CONTRAST = """[...document.querySelectorAll("body *:not(svg *):not(style):not(script)")].filter(element =>
  [...element.childNodes].some(node => node.nodeType === 3 && node.textContent.trim())).map(element => {
    const numbers = colour => colour.match(/[\\d.]+/g).map(Number);
    const light = colour => { const [r, g, b] = numbers(colour).map(c => c / 255)
      .map(c => c <= 0.04045 ? c / 12.92 : ((c + 0.055) / 1.055) ** 2.4);
      return 0.2126 * r + 0.7152 * g + 0.0722 * b; };
    let ground = element;
    const painted = item => getComputedStyle(item).backgroundColor;
    while (ground && (numbers(painted(ground))[3] ?? 1) === 0) ground = ground.parentElement;
    const pair = [getComputedStyle(element).color, ground ? painted(ground) : "rgb(255, 255, 255)"]
      .map(light).sort((a, b) => b - a);
    return [(pair[0] + 0.05) / (pair[1] + 0.05), element.textContent.trim().slice(0, 40)];
  }).filter(([ratio]) => ratio < 4.5)"""
SMALLEST = """Math.min(...[...document.querySelectorAll("body *:not(svg *):not(sub)")].filter(element =>
  [...element.childNodes].some(node => node.nodeType === 3 && node.textContent.trim()))
  .map(element => parseFloat(getComputedStyle(element).fontSize)))"""


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    assert PROGRAM is not None
    with browser(PROGRAM, tmp_path_factory.mktemp("browser")) as opened:
        yield opened


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("report") / "report.html"
    diagnosis().report(path)
    return path


@pytest.mark.parametrize("width", [1200, 820, 390, 320])
def test_all_figures_are_there_and_nothing_sticks_out(page: Page, report: Path, width: int) -> None:
    page.open(report, width=width)
    sizes = page.ask(SIZES)
    assert len(sizes) == FIGURES
    for wide, high, paths, texts in sizes:
        assert 200 < wide <= width
        assert high > 100
        assert paths > 5
        assert texts > 5
    assert page.ask("document.documentElement.scrollWidth") <= width, "nothing may need sideways scrolling"
    assert page.complaints == []


def test_text_has_contrast_and_size(page: Page, report: Path) -> None:
    for width in (1200, 390):
        page.open(report, width=width)
        assert page.ask(CONTRAST) == []
        assert page.ask(SMALLEST) >= 12


def test_it_asks_nothing_of_the_network(page: Page, report: Path) -> None:
    page.open(report)
    loaded = page.ask("performance.getEntriesByType('resource').map(entry => entry.name)")
    assert [name for name in loaded if not name.startswith("data:")] == []


def test_it_prints_on_paper(page: Page, report: Path) -> None:
    page.open(report)
    paper = page.printed()
    assert paper.startswith(b"%PDF")
    assert 2 <= len(re.findall(rb"/Type\s*/Page\b", paper)) <= 8


def test_a_browser_would_complain(page: Page, tmp_path: Path) -> None:
    """What the tests above rely on."""
    bad = tmp_path / "bad.html"
    bad.write_text(
        "<!doctype html><p style='color:#bbb'>pale</p><img src='absent.png'><script>nothing()</script>"
    )
    page.open(bad)
    assert len(page.complaints) >= 2
    assert [text for _, text in page.ask(CONTRAST)] == ["pale"]


@pytest.mark.parametrize("dark", [False, True])
def test_notebook_cards(page: Page, tmp_path: Path, dark: bool) -> None:
    cards = [diagnosis()._repr_html_(), Identification.from_json(json.dumps(IDENTIFICATION))._repr_html_()]
    ground = "#111" if dark else "#fff"
    (tmp_path / "cell.html").write_text(
        f"<!doctype html><meta charset=utf-8><body style='background:{ground};color:#888'>{''.join(cards)}"
    )
    page.open(tmp_path / "cell.html", width=900, dark=dark)
    assert len(page.ask(SIZES)) == 1
    assert page.ask(CONTRAST) == []
    assert page.complaints == []


def test_a_report_within_a_notebook(page: Page, tmp_path: Path) -> None:
    (tmp_path / "cell.html").write_text(
        f"<!doctype html><meta charset=utf-8>{diagnosis().report()._repr_html_()}"
    )
    page.open(tmp_path / "cell.html", width=1000)
    inside = "document.querySelector('iframe').contentDocument.querySelectorAll('svg').length"
    assert page.ask(inside) == FIGURES
    assert page.complaints == []
