"""Line drawings as SVG, which take their colours from the page, so they are readable in light and in dark.

Coordinates of a drawing are pixels, right and down. `Frame` converts data to them, with axes on the left and below.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
from numpy.typing import ArrayLike

MARGIN_LEFT, MARGIN_RIGHT, MARGIN_TOP, MARGIN_BOTTOM = 46.0, 10.0, 10.0, 34.0
SHARE_WITH_ROOM, BESIDE, LETTERS = 0.7, 7.0, 8.0
STEPS = (1.0, 2.0, 5.0, 10.0)


@dataclass(frozen=True, slots=True)
class Frame:
    """Area in which data is drawn.

    Args:
        width, height: Size of the drawing in pixels.
        x, y: Least and greatest value on either axis.
    """

    width: float
    height: float
    x: tuple[float, float]
    y: tuple[float, float]

    @classmethod
    def true_to_scale(cls, width: float, height: float, x: tuple[float, float], y: tuple[float, float]) -> Frame:
        """A frame with one scale on both axes; the ranges are widened as needed."""
        across, down = width - MARGIN_LEFT - MARGIN_RIGHT, height - MARGIN_TOP - MARGIN_BOTTOM
        scale = max((x[1] - x[0]) / across, (y[1] - y[0]) / down)
        return cls(width, height, _widened(x, scale * across), _widened(y, scale * down))

    def at(self, x: ArrayLike, y: ArrayLike) -> np.ndarray:
        """Pixels of points, shape (..., 2)."""
        across = (np.asarray(x, np.float64) - self.x[0]) / (self.x[1] - self.x[0])
        up = (np.asarray(y, np.float64) - self.y[0]) / (self.y[1] - self.y[0])
        left, top, width, height = self._inner
        return np.stack(np.broadcast_arrays(left + across * width, top + (1.0 - up) * height), axis=-1)

    def length(self, x: float) -> float:
        """Pixels of a length along the axis below."""
        return x / (self.x[1] - self.x[0]) * self._inner[2]

    @property
    def _inner(self) -> tuple[float, float, float, float]:
        return (
            MARGIN_LEFT,
            MARGIN_TOP,
            self.width - MARGIN_LEFT - MARGIN_RIGHT,
            self.height - MARGIN_TOP - MARGIN_BOTTOM,
        )

    def line(self, x: ArrayLike, y: ArrayLike, style: str) -> str:
        """A line through points, interrupted where a coordinate is NaN."""
        points = self.at(x, y)
        parts, begins = [], True
        for across, down in points.tolist():
            if not (math.isfinite(across) and math.isfinite(down)):
                begins = True
                continue
            parts.append(f"{'M' if begins else 'L'}{across:.1f} {down:.1f}")
            begins = False
        return f'<path class="{style}" d="{"".join(parts)}"/>'

    def dot(self, x: float, y: float, style: str, radius: float = 3.5) -> str:
        """A point."""
        across, down = self.at(x, y).tolist()
        return f'<circle class="{style}" cx="{across:.1f}" cy="{down:.1f}" r="{radius:g}"/>'

    def circle(self, x: float, y: float, radius: float, style: str) -> str:
        """A circle whose radius is in units of the axis below."""
        return self.dot(x, y, style, round(self.length(radius), 1))

    def text(self, x: float, y: float, text: str, style: str, *, below: bool = False) -> str:
        """Text beside a point, above or below it: on the right, or on the left if the right has no room."""
        across, down = self.at(x, y).tolist()
        has_room = across < self.width * SHARE_WITH_ROOM
        across, anchor = (across + BESIDE, "") if has_room else (across - BESIDE, " end")
        down = down + BESIDE + LETTERS if below else max(down - BESIDE, MARGIN_TOP + LETTERS)
        return f'<text class="{style}{anchor}" x="{across:.1f}" y="{down:.1f}">{escape(text)}</text>'

    def axes(self, x_name: str, y_name: str) -> str:
        """Both axes, with a grid at round numbers."""
        left, top, width, height = self._inner
        parts = []
        for value in round_numbers(self.x, 6):
            across = self.at(value, self.y[0])[0]
            parts.append(f'<path class="grid" d="M{across:.1f} {top:g}V{top + height:g}"/>')
            parts.append(f'<text class="tick middle" x="{across:.1f}" y="{top + height + 14:g}">{value:g}</text>')
        for value in round_numbers(self.y, 6):
            down = self.at(self.x[0], value)[1]
            parts.append(f'<path class="grid" d="M{left:g} {down:.1f}H{left + width:g}"/>')
            parts.append(f'<text class="tick end" x="{left - 5:g}" y="{down + 3.5:.1f}">{value:g}</text>')
        parts.append(
            f'<text class="tick middle" x="{left + width / 2:g}" y="{self.height - 4:g}">{escape(x_name)}</text>'
        )
        middle = top + height / 2
        parts.append(
            f'<text class="tick middle" transform="translate(11 {middle:g})rotate(-90)">{escape(y_name)}</text>'
        )
        return "".join(parts)

    def drawing(self, parts: Sequence[str], title: str) -> str:
        """The whole drawing."""
        return (
            f'<svg role="img" viewBox="0 0 {self.width:g} {self.height:g}" width="{self.width:g}">'
            f"<title>{escape(title)}</title>{''.join(parts)}</svg>"
        )


def round_numbers(span: tuple[float, float], most: int) -> list[float]:
    """Round numbers within a span at equal distances, at most ``most``."""
    low, high = span
    if not (math.isfinite(low) and math.isfinite(high) and high > low):
        return []
    power = 10.0 ** math.floor(math.log10((high - low) / most))
    step = next(power * factor for factor in STEPS if (high - low) / (power * factor) <= most)
    numbers = np.arange(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1) * step
    return [round(value, 10) + 0.0 for value in numbers.tolist()]


def _widened(span: tuple[float, float], length: float) -> tuple[float, float]:
    middle = (span[0] + span[1]) / 2.0
    return middle - length / 2.0, middle + length / 2.0
