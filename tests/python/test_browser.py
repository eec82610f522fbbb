"""Report and notebook cards in a real browser: nothing complains, everything is there and can be read."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from answers import IDENTIFICATION, diagnosis
from browser import Page, browser, installed
from pmsm_rs import Identification
from test_report import full

PROGRAM = installed()
pytestmark = pytest.mark.skipif(
    PROGRAM is None, reason="there is no Chromium to show the report (Debian: apt install chromium)"
)
FIGURES = 2 + 4 + 4 + 4
SIZES = """[...document.querySelectorAll("svg[role=img]")].map(svg => {
  const box = svg.getBoundingClientRect();
  const count = what => svg.querySelectorAll(what).length;
  return [box.width, box.height, count("path, use"), count("text")];
})"""
# Contrast by WCAG 2.2 of every text that stands in an element of its own, on the colour it is painted on.
CONTRAST = """[...document.querySelectorAll("body *:not(svg *, svg, style, script)")].filter(element =>
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
# The same for what charts write, which has no ground of its own but that of the page or of a bar.
LABELS = """[...document.querySelectorAll("section svg text, .hero svg text")].filter(text => {
    const fill = getComputedStyle(text).fill;
    return ["rgba(0, 0, 0, 0)", "none", getComputedStyle(document.body).backgroundColor].includes(fill);
  }).map(text => text.textContent)"""
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
    full().report(path, command="pmsm-rs diagnose run.csv --machine machine.toml")
    return path


@pytest.mark.parametrize("width", [1200, 820, 390, 320])
def test_all_figures_are_there_and_nothing_sticks_out(page: Page, report: Path, width: int) -> None:
    page.open(report, width=width)
    sizes = page.ask(SIZES)
    assert len(sizes) == FIGURES
    for wide, high, paths, texts in sizes:
        assert 200 < wide <= width
        assert high > 80
        assert paths >= 3
        assert texts > 5
    assert page.ask("document.documentElement.scrollWidth") <= width, "nothing may need sideways scrolling"
    assert page.complaints == []


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
@pytest.mark.parametrize("width", [1200, 390])
def test_text_has_contrast_and_size(page: Page, report: Path, width: int, dark: bool) -> None:
    page.open(report, width=width, dark=dark)
    ground = page.ask("getComputedStyle(document.body).backgroundColor")
    assert (ground == "rgb(14, 17, 21)") == dark
    assert page.ask(CONTRAST) == []
    assert page.ask(LABELS) == []
    assert page.ask(SMALLEST) >= 12


def test_the_first_screen_holds_verdict_effects_picture_and_advice(page: Page, report: Path) -> None:
    page.open(report, width=1200, height=900)
    for what in ("h1", ".effects li", ".next", ".hero figure:nth-of-type(1)", ".hero figure:nth-of-type(2)"):
        assert page.ask(f"document.querySelector('{what}').getBoundingClientRect().bottom") <= 900, what


def test_the_page_can_be_read_without_scripts(page: Page, report: Path) -> None:
    page.call("Emulation.setScriptExecutionDisabled", value=True)
    try:
        page.open(report)
        assert page.complaints == []
        page.open(report, width=390)
        shown = page.call("Page.captureScreenshot")["data"]
    finally:
        page.call("Emulation.setScriptExecutionDisabled", value=False)
    assert len(shown) > 20_000
    # Nothing is hidden but the buttons, which would do nothing.
    text = report.read_text(encoding="utf-8")
    hidden = re.findall(r"<(\w+)[^>]*\shidden>(.*?)</\1>", text, flags=re.DOTALL)
    assert hidden
    assert all("<button" in inside for _, inside in hidden)


def mouse(page: Page, kind: str, x: float, y: float) -> None:
    page.call(
        "Input.dispatchMouseEvent",
        type=kind,
        x=x,
        y=y,
        button="none" if kind == "mouseMoved" else "left",
        buttons=1,
        clickCount=1,
    )


def test_time_plots_are_read_and_zoomed(page: Page, report: Path) -> None:
    page.open(report, width=1200)
    line = "document.querySelectorAll('svg[data-plot=residual]')[1].querySelector('path.before')"
    ticks = "[...document.querySelectorAll('svg[data-plot=residual]')[1].querySelectorAll('.tx text')]"
    at_first, numbers = page.ask(f"{line}.getAttribute('d')"), page.ask(f"{ticks}.map(t => t.textContent)")
    page.ask("document.querySelectorAll('svg[data-plot=residual]')[1].scrollIntoView({block: 'center'})")
    left, top, wide, high = page.ask(
        "(r => [r.x, r.y, r.width, r.height])"
        "(document.querySelectorAll('svg[data-plot=residual]')[1].getBoundingClientRect())"
    )
    y = top + high / 2
    mouse(page, "mouseMoved", left + 0.5 * wide, y)
    told = page.ask("document.querySelectorAll('svg[data-plot=residual]')[1].nextElementSibling.value")
    assert re.fullmatch(r"t = 1\.\d+ s: before \S+ … \S+, after \S+ … \S+ A", told)
    mouse(page, "mousePressed", left + 0.4 * wide, y)
    mouse(page, "mouseMoved", left + 0.5 * wide, y)
    mouse(page, "mouseReleased", left + 0.5 * wide, y)
    zoomed = page.ask(f"{ticks}.map(t => Number(t.textContent))")
    assert page.ask(f"{line}.getAttribute('d')") != at_first
    assert 1.0 <= min(zoomed) < max(zoomed) < 1.6
    page.ask("document.querySelector('[data-zoom=out]').click()")
    assert max(page.ask(f"{ticks}.map(t => Number(t.textContent))")) > max(zoomed)
    page.ask("document.querySelector('[data-zoom=all]').click()")
    assert page.ask(f"{line}.getAttribute('d')") == at_first
    assert page.ask(f"{ticks}.map(t => t.textContent)") == numbers
    assert page.complaints == []


def test_parameters_and_machine_file_can_be_copied(page: Page, report: Path) -> None:
    page.open(report)
    page.ask("navigator.clipboard.writeText = async text => { window.taken = text; }")
    for of, begins in (("sheet", "parameter\tnameplate\tfound"), ("file", "# Found together")):
        page.ask(f"document.querySelector('[data-copy={of}]').click()")
        assert page.ask("new Promise(done => setTimeout(() => done(window.taken), 50))").startswith(begins)
    assert page.complaints == []


def test_it_asks_nothing_of_the_network(page: Page, report: Path) -> None:
    page.open(report)
    loaded = page.ask("performance.getEntriesByType('resource').map(entry => entry.name)")
    assert [name for name in loaded if not name.startswith("data:")] == []


def test_it_prints_on_paper(page: Page, report: Path) -> None:
    page.open(report)
    paper = page.printed()
    assert paper.startswith(b"%PDF")
    assert 2 <= len(re.findall(rb"/Type\s*/Page\b", paper)) <= 12


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
    (tmp_path / "cell.html").write_text(f"<!doctype html><meta charset=utf-8>{full().report()._repr_html_()}")
    page.open(tmp_path / "cell.html", width=1000)
    inside = "document.querySelector('iframe').contentDocument.querySelectorAll('svg[role=img]').length"
    assert page.ask(inside) == FIGURES
    assert page.complaints == []
