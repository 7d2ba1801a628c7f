"""Looking all round in a grid."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from vsx_ros.kernels import kernel


@kernel
def mark_seen(blocked: Any, views: Any, reach: float, seen: Any) -> None:
    """Mark in seen (H, W) what rays from the views (N, 2; row, column) meet, up to the first blocked cell.

    reach in cells. Rays are one cell apart at full reach and walk from cell to cell (Amanatides and Woo 1987).
    """
    rows, columns = blocked.shape
    rays = max(8, int(math.ceil(2.0 * math.pi * reach)))
    for v in range(views.shape[0]):
        for k in range(rays):
            angle = 2.0 * math.pi * k / rays
            dx, dy = math.cos(angle), math.sin(angle)
            row, column = views[v, 0], views[v, 1]
            step_x, step_y = (1 if dx > 0.0 else -1), (1 if dy > 0.0 else -1)
            per_x = 1.0 / abs(dx) if dx != 0.0 else np.inf
            per_y = 1.0 / abs(dy) if dy != 0.0 else np.inf
            next_x, next_y = 0.5 * per_x, 0.5 * per_y
            travelled = 0.0
            while travelled <= reach and 0 <= row < rows and 0 <= column < columns:
                seen[row, column] = True
                if blocked[row, column]:
                    break
                if next_x < next_y:
                    travelled = next_x
                    next_x += per_x
                    column += step_x
                else:
                    travelled = next_y
                    next_y += per_y
                    row += step_y
