"""Makes the table and the reliability diagram of the ground map's free cells from their rows."""

import math
from collections.abc import Sequence

import numpy as np
from certainty_bins import EDGES

from vsx_ros.experiments.rows import Row

_NINETY_NINE = (0.0075, 0.0125)  # "free with 99 %"
_SIZE_PX, _MARGIN_PX, _LEAST = 420, 56, 2e-4
_TICKS = (0.001, 0.01, 0.1, 1.0)
_COLORS = {"without SLAM": "#2563a8", "with SLAM": "#c2571a"}


def table(rows: Sequence[Row]) -> list[str]:
    """What becomes of things at the robot's height, the labs that failed, and one line per bin."""
    groups = _groups(rows)
    lines = ["Cells with something at 0.1 to 0.6 m:", ""]
    for name, of in groups.items():
        for kind in ("thin", "others"):
            counts = np.sum([row.result["things"][kind] for row in of], axis=0)
            free, occupied, unknown = (f"{100 * share:.0f} %" for share in counts / max(1, counts.sum()))
            lines.append(f"- {name}, {kind}: {free} free, {occupied} occupied, {unknown} unknown")
    failed = sum("failed" in row.result for row in rows)
    lines += [f"- {failed} of {len(rows)} labs failed and are left out"] if failed else []
    named = " | ".join(f"{name}: cells | told [%] | free [%]" for name in groups)
    lines += ["", f"| free cells told as | {named} |", "|" + "---|" * (1 + 3 * len(groups))]
    for k, (low, high) in enumerate(zip(EDGES, EDGES[1:])):
        cells = [_cells(of, [k]) for of in groups.values()]
        lines.append(f"| {_percent(1 - high)} to {_percent(1 - low)} % free | " + " | ".join(cells) + " |")
    chosen = [k for k, edge in enumerate(EDGES[:-1]) if _NINETY_NINE[0] <= edge < _NINETY_NINE[1]]
    cells = [_cells(of, chosen) for of in groups.values()]
    lines.append("| **free with 99 %** (must: within 1, aim: 0.3) | " + " | ".join(cells) + " |")
    return lines


def diagram(rows: Sequence[Row]) -> str:
    """SVG: told probability of an obstacle against the share of cells that have one, both logarithmic; the lines join
    the bins, and bars are 95 % intervals over the labs."""
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_SIZE_PX} {_SIZE_PX}" font-family="sans-serif" '
        'font-size="12"><rect width="100%" height="100%" fill="white"/>'
    ]
    for tick in _TICKS:
        at, name = _px(tick), f"{100 * tick:g} %"
        parts.append(
            _line(at, _SIZE_PX - _MARGIN_PX, at, 12, "#ddd")
            + _line(_MARGIN_PX, _flip(at), _SIZE_PX - 12, _flip(at), "#ddd")
        )
        parts.append(f'<text x="{at}" y="{_SIZE_PX - 38}" text-anchor="middle">{name}</text>')
        parts.append(f'<text x="{_MARGIN_PX - 5}" y="{_flip(at) + 4}" text-anchor="end">{name}</text>')
    parts.append(_line(_px(_LEAST), _flip(_px(_LEAST)), _px(1.0), _flip(_px(1.0)), "#999", 'stroke-dasharray="4"'))
    parts.append(
        f'<text x="{_SIZE_PX / 2}" y="{_SIZE_PX - 14}" text-anchor="middle">told: a free cell holds an obstacle</text>'
    )
    parts.append(
        f'<text transform="translate(14 {_SIZE_PX / 2}) rotate(-90)" text-anchor="middle">'
        "true share of those cells</text>"
    )
    for k, (name, of) in enumerate(_groups(rows).items()):
        parts.append(_curve(of, _COLORS[name]))
        parts.append(
            f'<text x="{_MARGIN_PX + 14}" y="{30 + 16 * k}" fill="{_COLORS[name]}">{name}, {len(of)} labs</text>'
        )
    return "\n".join([*parts, "</svg>", ""])


def _curve(rows: Sequence[Row], color: str) -> str:
    n, wrong, told = (np.array([row.result[name] for row in rows]) for name in ("cells", "wrong", "told"))
    places, parts = [], []
    for k in np.flatnonzero(n.sum(axis=0) >= 200):
        x, share = _px(told[:, k].sum() / n[:, k].sum()), wrong[:, k].sum() / n[:, k].sum()
        spread = np.sqrt(np.square(wrong[:, k] - share * n[:, k]).sum()) / n[:, k].sum()
        low, high = (_flip(_px(min(1.0, max(_LEAST, share + sign * 1.96 * spread)))) for sign in (-1, 1))
        places.append(f"{x:.1f},{_flip(_px(max(_LEAST, share))):.1f}")
        parts.append(_line(x, low, x, high, color))
    return f'<polyline points="{" ".join(places)}" fill="none" stroke="{color}" stroke-width="2"/>' + "".join(parts)


def _groups(rows: Sequence[Row]) -> dict[str, list[Row]]:
    good = [row for row in rows if "failed" not in row.result]
    groups = {name: [row for row in good if row.asked["slam"] is slam] for name, slam in
              (("without SLAM", False), ("with SLAM", True))}  # fmt: skip
    return {name: of for name, of in groups.items() if of}


def _cells(rows: Sequence[Row], bins: Sequence[int]) -> str:
    n, wrong, told = (
        sum(float(row.result[name][k]) for row in rows for k in bins) for name in ("cells", "wrong", "told")
    )
    return f"{n:.0f} | {_percent(1 - told / n)} | {_percent(1 - wrong / n)}" if n else "0 | - | -"


def _percent(share: float) -> str:
    return f"{100 * share:.2f}".rstrip("0").rstrip(".")


def _px(share: float) -> float:
    """The place on an axis from _LEAST to 1."""
    return round(_MARGIN_PX + (_SIZE_PX - _MARGIN_PX - 12) * (1.0 - math.log(share) / math.log(_LEAST)), 1)


def _flip(x_px: float) -> float:
    return _SIZE_PX - x_px


def _line(x0: float, y0: float, x1: float, y1: float, color: str, more: str = "") -> str:
    return f'<line x1="{x0:.1f}" y1="{y0:.1f}" x2="{x1:.1f}" y2="{y1:.1f}" stroke="{color}" {more}/>'
