"""How well and how fast the SLAM works: ``PYTHONPATH=src:hw python benchmarks/slam.py [section ...]``.

Sections: loops, arcs, turns, kidnap, tour, laps, timing, live, pictures, lenses (all by default or with ``all``). The
table goes to stdout, progress to stderr. All but timing, live, pictures and the times of tour repeats exactly.
benchmarks/README.md explains the drives and the figures.
"""

import argparse
import json
import os
import sys
from pathlib import Path

import cv2
import numpy as np
from seeds import seed_range
from slam_accuracy import Row, arcs, kidnappings, loops, turns
from slam_large import laps, tour
from slam_lenses import lenses
from slam_timing import live, pictures, timing

from vsx_ros.kernels.warmup import warm_up

SECTIONS = {
    "loops": loops,
    "arcs": arcs,
    "turns": turns,
    "kidnap": kidnappings,
    "tour": tour,
    "laps": laps,
    "timing": timing,
    "live": live,
    "pictures": pictures,
    "lenses": lenses,
}


def table(rows: list[Row]) -> str:
    def number(value: float | None) -> str:
        return "" if value is None else f"{value:.3g}"

    lines = [f"{'':58}{'must':>7}{'aim':>7}{'median':>9}{'worst':>9}{'n':>4}  reached"]
    for row in rows:
        middle, worst = number(float(np.median(row.values))), number(row.worst())
        name = f"{row.name} [{row.unit}]" if row.unit else row.name
        goal = ("" if row.must is None else (">= " if row.more else "<= ")) + number(row.must)
        lines.append(
            f"{name:58}{goal:>7}{number(row.aim):>7}{middle:>9}{worst:>9}{len(row.values):>4}  {row.verdict()}"
        )
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sections", nargs="*", metavar="SECTION", help=", ".join([*SECTIONS, "all"]))
    parser.add_argument(
        "--seeds", type=seed_range, default=range(100, 110), metavar="A-B", help="labs (default 100-109)"
    )
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write every value there")
    parser.add_argument("--keep", type=Path, metavar="FOLDER", help="keep rendered drives there and use them again")
    args = parser.parse_args()
    wanted = args.sections if args.sections and "all" not in args.sections else list(SECTIONS)
    if unknown := set(wanted) - set(SECTIONS):
        parser.error(f"there is no section {', '.join(sorted(unknown))}")
    cv2.setNumThreads(1)
    warm_up()
    rows = {name: [row for row in SECTIONS[name](args.seeds, args.keep) if row.values] for name in wanted}
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    print(table([row for section in rows.values() for row in section]))
    if args.json:
        plain = {
            name: [row._asdict() | {"reached": row.verdict()} for row in section] for name, section in rows.items()
        }
        args.json.write_text(json.dumps(plain, indent=1) + "\n")
    sys.exit(any(row.verdict() == "MISSED" for section in rows.values() for row in section))


if __name__ == "__main__":
    main()
