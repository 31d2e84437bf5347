#!/usr/bin/env python3
"""Draws the rows of bench_order as an SVG picture.

    bench/order/plot.py order.csv docs/images/cloth_order.svg
"""

import csv
import math
import sys

COLOURS = {"one linear solve": "#b35806", "Newton": "#1b6ca8", "XPBD 1 x 200": "#7a7a7a",
           "XPBD 20 x 2": "#2e8b57"}
LABELS = {"one linear solve": "mass-spring, one linear solve", "Newton": "mass-spring, Newton",
          "XPBD 1 x 200": "XPBD, 1 substep of 200 sweeps",
          "XPBD 20 x 2": "XPBD, 20 substeps of 2 sweeps"}
WIDTH, HEIGHT, LEFT, TOP, BOTTOM, GAP = 300, 260, 62, 42, 74, 78


def read(path):
    lines = {}
    with open(path, encoding="utf-8") as file:
        for row in csv.DictReader(file):
            if row["model"] in COLOURS:
                values = tuple(float(row[key]) for key in ("x", "error", "seconds"))
                lines.setdefault(row["study"], {}).setdefault(row["model"], []).append(values)
    return lines


def decades(values):
    """The powers of ten around the values, in steps of a half."""
    low, high = math.log10(min(values)), math.log10(max(values))
    return math.floor(2 * low) / 2, math.ceil(2 * high) / 2


class Panel:
    """A diagram with two logarithmic axes."""

    def __init__(self, place, title, axis, lines):
        self.left = LEFT + place * (WIDTH + GAP)
        self.title, self.axis, self.lines = title, axis, lines
        points = [p for line in lines.values() for p in line]
        self.x_range = decades([x for x, _ in points])
        self.y_range = decades([y for _, y in points])

    def x(self, value):
        low, high = self.x_range
        return self.left + WIDTH * (math.log10(value) - low) / (high - low)

    def y(self, value):
        low, high = self.y_range
        return TOP + HEIGHT * (high - math.log10(value)) / (high - low)

    def ticks(self):
        for power in range(math.ceil(self.x_range[0]), math.floor(self.x_range[1]) + 1):
            x = self.x(10.0 ** power)
            yield f'<path d="M{x:.1f} {TOP}v{HEIGHT}" class="grid"/>'
            yield f'<text x="{x:.1f}" y="{TOP + HEIGHT + 17}" class="middle">{label(power)}</text>'
        for power in range(math.ceil(self.y_range[0]), math.floor(self.y_range[1]) + 1):
            y = self.y(10.0 ** power)
            yield f'<path d="M{self.left} {y:.1f}h{WIDTH}" class="grid"/>'
            yield (f'<text x="{self.left - 6}" y="{y + 4:.1f}" class="end">'
                   f'{label(power)}</text>')

    def slope(self):
        """A line of slope one for the eye, in the lower right corner."""
        high = self.x_range[1] - 0.08
        x0, x1 = 10 ** (high - 0.5), 10 ** high
        y0 = 10 ** (self.y_range[0] + 0.15)
        y1 = y0 * x1 / x0
        yield (f'<path d="M{self.x(x0):.1f} {self.y(y0):.1f}L{self.x(x1):.1f} {self.y(y1):.1f}" '
               'class="slope"/>')
        yield (f'<text x="{self.x(x0) - 4:.1f}" y="{self.y(y0) + 1:.1f}" class="end">order 1'
               '</text>')

    def draw(self, with_slope):
        middle = self.left + WIDTH / 2
        yield f'<text x="{middle}" y="{TOP - 14}" class="title">{self.title}</text>'
        yield from self.ticks()
        yield f'<rect x="{self.left}" y="{TOP}" width="{WIDTH}" height="{HEIGHT}" class="frame"/>'
        yield (f'<text x="{middle}" y="{TOP + HEIGHT + 36}" class="middle">{self.axis}</text>')
        if with_slope:
            yield from self.slope()
        for name, line in self.lines.items():
            path = "L".join(f"{self.x(x):.1f} {self.y(y):.1f}" for x, y in line)
            yield f'<path d="M{path}" class="line" stroke="{COLOURS[name]}"/>'
            for x, y in line:
                yield (f'<circle cx="{self.x(x):.1f}" cy="{self.y(y):.1f}" r="2.6" '
                       f'fill="{COLOURS[name]}"/>')


def label(power):
    digits = {"-": "⁻", **dict(zip("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹"))}
    return "10" + "".join(digits[c] for c in str(power))


def main():
    if len(sys.argv) != 3:
        sys.exit(__doc__.strip())
    data = read(sys.argv[1])
    step, mesh = data["step"], data["mesh"]

    def pairs(study, key):
        return {name: sorted((row[key], row[1]) for row in rows)
                for name, rows in study.items()}

    panels = [(Panel(0, "error against the step", "step, s", pairs(step, 0)), True),
              (Panel(1, "error against its cost", "processor time for a second of motion, s",
                     pairs(step, 2)), False),
              (Panel(2, "error against the mesh", "length of an edge, m", pairs(mesh, 0)), True)]
    width = LEFT + 3 * WIDTH + 2 * GAP + 20
    height = TOP + HEIGHT + BOTTOM
    out = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" '
           f'width="{width}" height="{height}">',
           '<style>text{font:12px sans-serif;fill:#222}.title{font-size:14px;text-anchor:middle}'
           '.middle{text-anchor:middle}.end{text-anchor:end}.grid{stroke:#ddd;fill:none}'
           '.frame{stroke:#888;fill:none}.line{fill:none;stroke-width:1.8}'
           '.slope{stroke:#555;fill:none;stroke-dasharray:4 3}</style>',
           f'<rect width="{width}" height="{height}" fill="#fff"/>']
    for panel, with_slope in panels:
        out += panel.draw(with_slope)
    for i, (name, colour) in enumerate(COLOURS.items()):
        x, y = LEFT + i * 262, height - 14
        out.append(f'<path d="M{x} {y - 4}h26" class="line" stroke="{colour}"/>')
        out.append(f'<text x="{x + 32}" y="{y}">{LABELS[name]}</text>')
    out.append("</svg>")
    with open(sys.argv[2], "w", encoding="utf-8") as file:
        file.write("\n".join(out) + "\n")


if __name__ == "__main__":
    main()
