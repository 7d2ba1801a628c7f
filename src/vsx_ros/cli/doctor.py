"""``vsx doctor``: check machine, ROS, devices, permissions and calibration

Checks what a run needs: Python and libraries, ROS, the ROS network, base and camera, permissions, calibration, disk,
and how fast this machine tracks. Each finding is ok, note, warn or fail and comes with what to do. No wheel turns. The
exit code is 1 when something fails, 0 otherwise.

examples: vsx doctor | vsx doctor --hw | vsx doctor --json --quick
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from vsx_ros.cli.finding import Finding

_COLOURS = {"ok": "32", "note": "36", "warn": "33", "fail": "31"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Its options."""
    parser.add_argument(
        "--hw", action="store_true", help="a robot must be here: open base and camera, and speak to them"
    )
    parser.add_argument("--json", action="store_true", help="print the findings as JSON: area, level, text, remedy")
    parser.add_argument("--quick", action="store_true", help="leave out the measurement of tracking (some seconds)")


def run(args: argparse.Namespace) -> int:
    """Print every finding as soon as it is known."""
    from vsx_ros.cli.finding import FAIL, WARN
    from vsx_ros.runs.exit_codes import DONE, FAILED

    findings = []
    for finding in examine(args.hw, args.quick):
        findings.append(finding)
        if not args.json:
            print(line(finding, colour=sys.stdout.isatty()), flush=True)
    failed = sum(finding.level == FAIL for finding in findings)
    if args.json:
        print(json.dumps([finding._asdict() for finding in findings], indent=1))
    else:
        warned = sum(finding.level == WARN for finding in findings)
        print(f"{failed} failed, {warned} to be improved" if failed or warned else "all is well")
    return FAILED if failed else DONE


def examine(speak: bool, quick: bool, root: Path = Path("/")) -> Iterator[Finding]:
    """All checks. speak: open the devices; quick: do not measure the tracking; root: where the file system begins."""
    from vsx_ros.cli.check_devices import check_devices
    from vsx_ros.cli.check_machine import check_machine
    from vsx_ros.cli.check_network import check_network
    from vsx_ros.cli.check_speed import check_speed

    yield from check_machine(root, Path.cwd())
    yield from check_network(os.environ)
    yield from check_devices(root, os.environ, speak)
    if not quick:
        yield check_speed()


def line(finding: Finding, *, colour: bool) -> str:
    """The finding as a line, its remedy on a second one."""
    level = f"{finding.level:5}"
    if colour:
        level = f"\x1b[{_COLOURS[finding.level]}m{level}\x1b[0m"
    said = f"{level}{finding.area:12} {finding.text}"
    return f"{said}\n{'':18}-> {finding.remedy}" if finding.remedy else said
