"""Loss curves as inline SVG: one small chart a stage, logarithmic, in the page's own colours."""

from __future__ import annotations

import math
from html import escape

_WIDTH, _HEIGHT = 320, 150
_LEFT, _RIGHT, _TOP, _BOTTOM = 44, 8, 10, 24


def loss_chart(title: str, points: list[tuple[int, float]]) -> str:
    """An <svg> of `points` (iteration, loss), at least one."""
    xs, ys = [x for x, _ in points], [math.log10(max(y, 1e-9)) for _, y in points]
    low, high = min(ys), max(ys)
    if high - low < 0.02:  # hardly any change: leave it flat instead of blowing up noise
        low, high = low - 0.01, high + 0.01
    last = max(max(xs), 1.0)

    def at(x: float, y: float) -> str:
        across = _LEFT + (_WIDTH - _LEFT - _RIGHT) * x / last
        down = _TOP + (_HEIGHT - _TOP - _BOTTOM) * (high - y) / (high - low)
        return f"{across:.1f},{down:.1f}"

    line = " ".join(at(x, y) for x, y in zip(xs, ys, strict=True))
    floor, name = _HEIGHT - _BOTTOM, escape(title)
    said = f"{name}: loss from {points[0][1]:.3g} to {points[-1][1]:.3g} in {last:.0f} iterations"
    return (
        f'<svg class="chart" viewBox="0 0 {_WIDTH} {_HEIGHT}" role="img" aria-label="{said}">'
        f'<path class="axis" d="M{_LEFT} {_TOP}V{floor}H{_WIDTH - _RIGHT}"/>'
        f'<polyline class="curve" points="{line}"/>'
        f'<text x="{_LEFT - 5}" y="{_TOP + 8}" class="end">{10**high:.3g}</text>'
        f'<text x="{_LEFT - 5}" y="{floor}" class="end">{10**low:.3g}</text>'
        f'<text x="{_LEFT}" y="{_HEIGHT - 8}">0</text>'
        f'<text x="{_WIDTH - _RIGHT}" y="{_HEIGHT - 8}" class="end">{last:.0f}</text></svg>'
    )
