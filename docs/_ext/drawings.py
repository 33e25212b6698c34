"""The directive ``{drawing} NAME``: a drawing as SVG in the page, in the colour of its text."""

import re
from collections.abc import Callable
from typing import ClassVar

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

_SUB = re.compile(r"_\{?([A-Za-z0-9,+−]+)\}?")


def text(x: float, y: float, words: str, anchor: str = "middle", size: int = 15) -> str:
    """Words at a place; ``_`` makes a subscript."""
    inner = _SUB.sub(
        r'<tspan dy="4" font-size="11">\1</tspan><tspan dy="-4">&#8203;</tspan>', words
    )
    return (
        f'<text x="{x}" y="{y}" text-anchor="{anchor}" font-size="{size}" stroke="none"'
        f' fill="currentColor">{inner}</text>'
    )


def line(*points: tuple[float, float], dash: bool = False, arrow: bool = False) -> str:
    """A polygon line."""
    d = " ".join(f"{x},{y}" for x, y in points)
    style = ' stroke-dasharray="5 4"' if dash else ""
    end = ' marker-end="url(#arrow)"' if arrow else ""
    return f'<polyline points="{d}" fill="none"{style}{end}/>'


def resistor(x: float, y: float, label: str, length: float = 80.0) -> str:
    """A resistance from (x, y) to the right."""
    low = x + length / 2 - 21
    zigzag = [(low + 7 * k, y + (0 if k in (0, 6) else (-7 if k % 2 else 7))) for k in range(7)]
    parts = [(x, y), *zigzag, (x + length, y)]
    return line(*parts) + text(x + length / 2, y - 14, label)


def capacitor(x: float, y: float, label: str, foot: str = "") -> str:
    """A compliance from (x, y) down to the ground, or to a pressure."""
    plates = line((x - 13, y + 34), (x + 13, y + 34)) + line((x - 13, y + 42), (x + 13, y + 42))
    made = line((x, y), (x, y + 34)) + plates + line((x, y + 42), (x, y + 66))
    made += text(x + 18, y + 43, label, "start")
    if foot:
        return made + text(x, y + 84, foot)
    return made + line((x - 12, y + 66), (x + 12, y + 66)) + line((x - 7, y + 71), (x + 7, y + 71))


def node(x: float, y: float, label: str = "", above: float = 14.0) -> str:
    """A node with its pressure."""
    return f'<circle cx="{x}" cy="{y}" r="3.5" fill="currentColor"/>' + text(x, y - above, label)


def box(x: float, y: float, width: float, height: float, *lines: str) -> str:
    """A box with lines of text."""
    made = f'<rect x="{x}" y="{y}" width="{width}" height="{height}" rx="6" fill="none"/>'
    top = y + height / 2 - 9 * (len(lines) - 1) + 5
    return made + "".join(
        text(x + width / 2, top + 18 * k, words, size=13) for k, words in enumerate(lines)
    )


def svg(width: int, height: int, *parts: str) -> str:
    """The whole drawing."""
    head = '<marker id="arrow" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7"'
    head += ' orient="auto"><path d="M0,0 L8,4 L0,8 z" fill="currentColor"/></marker>'
    return (
        f'<svg class="drawing" viewBox="0 0 {width} {height}"'
        f' style="max-width:{width}px;width:100%"'
        f' stroke="currentColor" stroke-width="1.6" role="img"><defs>{head}</defs>'
        f"{''.join(parts)}</svg>"
    )


def windkessel() -> str:
    """Three elements behind a port."""
    return svg(
        420, 150, node(40, 40, "P"), text(40, 68, "Q →"), resistor(40, 40, "R_p", 110),
        node(150, 40, "P_wk"), capacitor(150, 40, "C"), resistor(150, 40, "R_d", 130),
        node(280, 40, "P_ref"),
    )  # fmt: skip


def coronary() -> str:
    """Five elements of a coronary bed."""
    return svg(
        560, 160, node(40, 45, "P"), text(40, 73, "Q →"), resistor(40, 45, "R_1", 110),
        node(150, 45, "P_a"), capacitor(150, 45, "C_a"), resistor(150, 45, "R_2", 140),
        node(290, 45, "P̃"), capacitor(290, 45, "C_im", "P_im(t)"), resistor(290, 45, "R_3", 130),
        node(420, 45, "P_venous"),
    )  # fmt: skip


def surrogate() -> str:
    """Aorta, artery, bed."""
    return svg(
        560, 160, node(40, 45, "P_aorta(t)"), resistor(40, 45, "R0 + K|Q|", 170),
        node(210, 45, "P_distal"), capacitor(210, 45, "C0"), line((210, 45), (320, 45)),
        box(320, 20, 190, 56, "coronary bed", "α R_1, α R_2, α R_3"),
    )  # fmt: skip


def domain() -> str:
    """Blood, wall and ports of an artery."""
    curve = "M70,{0} C170,{1} 240,{2} 300,{3} S420,{4} 470,{5}"
    lumen = [curve.format(70, 70, 100, 92, 72, 78), curve.format(150, 150, 122, 128, 146, 142)]
    outer = [curve.format(54, 54, 80, 72, 54, 60), curve.format(166, 166, 142, 148, 164, 160)]
    paths = "".join(f'<path d="{d}" fill="none"/>' for d in (*lumen, *outer))
    ends = "".join(line((x, a), (x, b), dash=True) for x, a, b in ((70, 70, 150), (470, 78, 142)))
    return svg(
        600, 215, paths, ends, text(185, 114, "blood: u, p"), text(250, 40, "wall: d"),
        line((262, 44), (282, 78), arrow=True), text(385, 200, "outer wall: tissue"),
        line((385, 186), (360, 158), arrow=True), text(120, 200, "interface: one velocity"),
        line((120, 186), (140, 152), arrow=True), text(34, 114, "inlet"),
        text(486, 106, "outlet:", "start"), text(486, 124, "P = P_offset + Z Q", "start", 13),
    )  # fmt: skip


def time_points() -> str:
    """Where the equations hold within a step."""
    made = [line((40, 60), (520, 60), arrow=True), text(520, 86, "t")]
    for x, name in ((90, "t"), (430, "t + Δt"), (317, "t + α_f Δt"), (260, "t + α_m Δt")):
        top = name in ("t", "t + Δt")
        made += [line((x, 52), (x, 68)), text(x, 40 if not top else 88, name, size=13)]
    made[-1] = text(225, 112, "a at t + α_m Δt", size=13)
    made[-3] = text(330, 30, "u, d, p at t + α_f Δt", size=13)
    made += [line((235, 98), (258, 72), arrow=True), line((325, 36), (318, 50), arrow=True)]
    return svg(560, 125, *made)


def mesh_motion() -> str:
    """A lumen that widens takes its mesh with it."""
    made = []
    for left, amount in ((30, 0.0), (310, 16.0)):
        for k in range(5):
            y = 40 + 25 * k
            bow = amount * (k - 2) / 2.0
            d = f"M{left},{y} Q{left + 110},{y + 2 * bow} {left + 220},{y}"
            width = 3 if k in (0, 4) else 1
            made.append(f'<path d="{d}" fill="none" stroke-width="{width}"/>')
        for k in range(6):
            x = left + 44 * k
            bow = amount * (1 - ((x - left - 110) / 110.0) ** 2)
            made.append(line((x, 40 - bow), (x, 140 + bow)))
    made += [text(140, 178, "reference: x"), text(420, 178, "x + d_mesh")]
    return svg(560, 190, *made)


def wall_elements() -> str:
    """Linear tetrahedra, quadratic ones, and a wedge."""
    made = []
    for left, name in ((30, "linear"), (210, "quadratic"), (390, "wedge of bending")):
        a, b, c, d = (left, 120), (left + 90, 135), (left + 120, 95), (left + 55, 35)
        if name.startswith("wedge"):
            low = [(left, 125), (left + 80, 135), (left + 120, 105)]
            high = [(x + 6, y - 50) for x, y in low]
            made += [line(*low), line(*high, high[0]), line(low[0], low[2], dash=True)]
            made += [line(p, q) for p, q in zip(low, high, strict=True)]
            dots = [*low, *high]
        else:
            made += [line(a, b, c, d, a), line(b, d), line(a, c, dash=True)]
            dots = [a, b, c, d]
            if name == "quadratic":
                pairs = ((a, b), (b, c), (c, d), (d, a), (b, d), (a, c))
                made += [
                    f'<circle cx="{(p[0] + q[0]) / 2}" cy="{(p[1] + q[1]) / 2}" r="3.5"'
                    ' fill="none"/>'
                    for p, q in pairs
                ]
        made += [node(x, y) for x, y in dots]
        made.append(text(left + 60, 168, name))
    return svg(560, 180, *made)


def prestress() -> str:
    """The imaged shape carries its pressure."""
    made = []
    for left, radius, words in ((110, 46, "unloaded: unknown"), (400, 62, "image: S₀, under p")):
        for r in (radius, radius + 14):
            made.append(f'<circle cx="{left}" cy="90" r="{r}" fill="none"/>')
        made.append(text(left, 190, words))
    for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        made.append(line((400 + 20 * dx, 90 + 20 * dy), (400 + 56 * dx, 90 + 56 * dy), arrow=True))
    made += [line((195, 90), (300, 90), dash=True, arrow=True), text(400, 95, "p")]
    return svg(520, 205, *made)


def contact() -> str:
    """Sides of a slit that come close push each other apart."""
    top, low = (
        "M40,60 C180,60 220,84 280,84 S420,60 520,60",
        "M40,140 C180,140 220,112 280,112 S420,140 520,140",
    )
    made = [f'<path d="{d}" fill="none"/>' for d in (top, low)]
    made += [line((280, 98), (280, 62), arrow=True), line((280, 98), (280, 134), arrow=True)]
    made += [text(296, 103, "g", "start"), text(280, 45, "p = κ (1 − g/g_m)²")]
    return svg(560, 170, *made)


def loop() -> str:
    """α with 3D in the loop."""
    return svg(
        600, 150, box(20, 40, 120, 56, "ramp in 3D", "R0, K"),
        line((140, 68), (180, 68), arrow=True),
        box(180, 40, 120, 56, "surrogate", "α"), line((300, 68), (340, 68), arrow=True),
        box(340, 40, 120, 56, "rest in 3D", "Pd/Pa"), line((460, 68), (500, 68), arrow=True),
        box(500, 40, 84, 56, "stress", "FFR"),
        line((400, 96), (400, 130), (240, 130), (240, 98), arrow=True),
        text(320, 122, "differs from the measured one", size=12),
    )  # fmt: skip


def diagnosis() -> str:
    """Hypotheses compared."""
    return svg(
        600, 170, box(20, 55, 110, 56, "record", "P, Q, noise"),
        line((130, 83), (170, 83), arrow=True),
        box(170, 10, 190, 30, "no gap"), box(170, 48, 190, 30, "one effect"),
        box(170, 86, 190, 30, "two effects"), box(170, 124, 190, 30, "free forcing: unknown"),
        line((360, 83), (405, 83), arrow=True), box(405, 55, 80, 56, "evidence", "ln Z"),
        line((485, 83), (515, 83), arrow=True), text(520, 88, "verdict", "start", 14),
    )  # fmt: skip


def schur() -> str:
    """The linear system of a step."""
    return svg(
        560, 150, box(30, 20, 110, 60, "A", "velocity"), box(145, 20, 60, 60, "G"),
        box(30, 85, 110, 40, "D"), box(145, 85, 60, 40, "C"),
        line((230, 72), (290, 72), arrow=True),
        text(300, 50, "wall: factor by nested dissection", "start", 13),
        text(300, 76, "blood: diagonal, renewed each system", "start", 13),
        text(300, 102, "pressure: Schur complement S", "start", 13),
    )  # fmt: skip


def adjoint() -> str:
    """Forward sweep, and the transposed systems backwards."""
    made = []
    for k in range(4):
        x = 40 + 125 * k
        made += [box(x, 30, 80, 36, f"step {k + 1}"), box(x, 104, 80, 36, "transposed")]
        made.append(line((x + 40, 66), (x + 40, 104), dash=True, arrow=True))
        if k < 3:
            made.append(line((x + 80, 48), (x + 123, 48), arrow=True))
            made.append(line((x + 125, 122), (x + 82, 122), arrow=True))
    return svg(560, 160, *made, text(530, 53, "r", "start"), text(8, 127, "∂r", "start"))


DRAWINGS: dict[str, Callable[[], str]] = {
    made.__name__: made
    for made in (windkessel, coronary, surrogate, domain, time_points, mesh_motion, wall_elements,
                 prestress, contact, loop, diagnosis, schur, adjoint)
}  # fmt: skip


class Drawing(SphinxDirective):
    """One of `DRAWINGS`."""

    required_arguments = 1
    option_spec: ClassVar = {}

    def run(self) -> list[nodes.Node]:
        """Put it into the page."""
        made = DRAWINGS.get(self.arguments[0])
        if made is None:
            raise self.error(f"no drawing {self.arguments[0]}")
        words = (made.__doc__ or "").split("\n")[0]
        figure = f'<figure class="drawing">{made()}<figcaption>{words}</figcaption></figure>'
        return [nodes.raw("", figure, format="html")]


def setup(app: Sphinx) -> dict[str, bool]:
    """Register the directive."""
    app.add_directive("drawing", Drawing)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
