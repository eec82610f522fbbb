"""Boxes and arrows as SVG: the two diagrams of "How the diagnosis works"."""

from __future__ import annotations

from dataclasses import dataclass, field
from html import escape

INK, LINE, PAPER = "#1b1f24", "#6b7480", "#ffffff"
STEP, INPUT, QUESTION = "#dcebf5", "#f2f2f2", "#fdf1d8"
GOOD, DOUBT, NONE = "#d9efe4", "#fbe3d3", "#e3e7ea"
FONT = "font-family='Helvetica, Arial, sans-serif'"


@dataclass
class Diagram:
    """A drawing of `width` by `height` pixels; `title` says in words what it shows."""

    width: int
    height: int
    title: str
    parts: list[str] = field(default_factory=list)

    def box(self, x: int, y: int, width: int, height: int, text: str, fill: str, heading: str = "") -> None:
        """A box with an optional bold first line; newlines of `text` start new lines."""
        self.parts.append(
            f"<rect x='{x}' y='{y}' width='{width}' height='{height}' rx='6' fill='{fill}' stroke='{LINE}'/>"
        )
        lines = [(heading, "bold"), *((line, "normal") for line in text.split("\n"))]
        shown = [(line, weight) for line, weight in lines if line]
        top = y + height / 2 - 9 * (len(shown) - 1) + 5
        for row, (line, weight) in enumerate(shown):
            self.parts.append(
                f"<text x='{x + width / 2:g}' y='{top + 18 * row:g}' text-anchor='middle' {FONT} "
                f"font-size='14' font-weight='{weight}' fill='{INK}'>{escape(line)}</text>"
            )

    def arrow(self, *points: tuple[int, int], label: str = "") -> None:
        """A line through the points with a head at the last one, and a label beside its beginning."""
        path = " ".join(f"{x},{y}" for x, y in points)
        self.parts.append(
            f"<polyline points='{path}' fill='none' stroke='{LINE}' stroke-width='1.5' "
            "marker-end='url(#head)'/>"
        )
        if label:
            (x, y), (to_x, to_y) = points[0], points[1]
            across = to_x != x
            if to_y < y:
                y = to_y - 23
            self.parts.append(
                f"<text x='{x + 10 if across else x + 8}' y='{y - 6 if across else y + 18}' {FONT} "
                f"font-size='13' font-style='italic' fill='{INK}'>{escape(label)}</text>"
            )

    def svg(self) -> str:
        """The text of the file."""
        size = f"width='{self.width}' height='{self.height}' viewBox='0 0 {self.width} {self.height}'"
        head = (
            "<marker id='head' viewBox='0 0 10 10' refX='9' refY='5' markerWidth='8' markerHeight='8' "
            f"orient='auto-start-reverse'><path d='M0,0 L10,5 L0,10 z' fill='{LINE}'/></marker>"
        )
        paper = f"<rect width='{self.width}' height='{self.height}' fill='{PAPER}'/>"
        body = "\n".join([f"<defs>{head}</defs>", paper, *self.parts])
        return (
            f"<svg xmlns='http://www.w3.org/2000/svg' role='img' {size}>\n"
            f"<title>{escape(self.title)}</title>\n{body}\n</svg>\n"
        )


def pipeline(effects: int) -> Diagram:
    """From the recording to the answer, with a catalogue of so many effects."""
    drawing = Diagram(980, 330, "The steps of a diagnosis, from recording and nameplate to the answer")
    drawing.box(20, 30, 170, 90, "voltages, currents,\nangle, speed", INPUT, "Recording")
    drawing.box(20, 210, 170, 90, "rough values,\nkind of load", INPUT, "Machine file")
    steps = [
        (230, 30, "Fit the dq-model", "all parameters,\nby simulation"),
        (420, 30, "Noise floor", "of each channel,\nfrom the recording"),
        (610, 30, "Mismatch", "where is the residual\nabove the floor?"),
        (610, 210, "Search", "score effects, refit,\ncompare evidence"),
        (420, 210, "Checks", "validation run,\nsmooth discrepancy"),
    ]
    for x, y, heading, text in steps:
        drawing.box(x, y, 165, 90, text, STEP, heading)
    drawing.box(230, 210, 165, 90, "verdict, parameters,\nbudget, limits,\nnext experiment", GOOD, "Answer")
    drawing.box(810, 120, 150, 90, f"{effects} effects with\nequations", INPUT, "Catalogue")
    drawing.arrow((190, 75), (228, 75))
    drawing.arrow((105, 210), (105, 165), (312, 165), (312, 122))
    drawing.arrow((395, 75), (418, 75))
    drawing.arrow((585, 75), (608, 75))
    drawing.arrow((692, 120), (692, 208))
    drawing.arrow((885, 210), (885, 255), (777, 255))
    drawing.arrow((610, 255), (587, 255))
    drawing.arrow((420, 255), (397, 255))
    return drawing


def verdicts() -> Diagram:
    """Which question leads to which verdict."""
    drawing = Diagram(980, 560, "The questions that lead to each verdict")
    questions = [
        (20, "Does the recording\nallow an answer?"),
        (130, "Does the dq-model\nexplain it down to noise?"),
        (240, "Does a set of effects\nexplain it down to noise?"),
        (350, "Do effects explain what\na smooth term cannot?"),
    ]
    for y, text in questions:
        drawing.box(60, y, 220, 80, text, QUESTION)
    for y, label in ((100, "yes"), (210, "no"), (320, "no")):
        drawing.arrow((170, y), (170, y + 28), label=label)
    answers = [
        (20, "undetermined", "The reason says why.", NONE, "no"),
        (130, "no_mismatch", "Nothing is missing that this recording could show.", GOOD, "yes"),
        (350, "partial", "The named effects act, and something else does.", GOOD, "yes"),
    ]
    for y, name, text, fill, label in answers:
        drawing.arrow((280, y + 40), (558, y + 40), label=label)
        drawing.box(560, y, 390, 80, text, fill, name)
    drawing.box(340, 240, 170, 80, "Does a rival explain\nit as well?", QUESTION)
    drawing.arrow((280, 280), (338, 280), label="yes")
    drawing.arrow((510, 280), (558, 280), label="no")
    drawing.box(560, 240, 180, 80, "One set explains it.", GOOD, "named")
    drawing.box(770, 240, 180, 80, "Several explain it.", DOUBT, "ambiguous")
    drawing.arrow((425, 240), (425, 226), (860, 226), (860, 238), label="yes")
    drawing.arrow((170, 430), (170, 458), label="no")
    drawing.box(60, 460, 890, 80, "Something is missing that the catalogue does not hold.", DOUBT, "unknown")
    return drawing
