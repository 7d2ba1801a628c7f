"""``vsx doctor``: all checks, and how their findings are shown."""

import argparse
import json
import os
import sys
from collections.abc import Iterator
from pathlib import Path

from vsx_ros.cli.check_devices import check_devices
from vsx_ros.cli.check_machine import FAIL, WARN, Finding, check_machine, check_speed
from vsx_ros.cli.check_network import check_network
from vsx_ros.runs.process import DONE, FAILED

_COLOURS = {"ok": "32", "note": "36", "warn": "33", "fail": "31"}


def doctor(args: argparse.Namespace) -> int:
    """Print every finding as soon as it is known."""
    findings = []
    for finding in _findings(args):
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


def _findings(args: argparse.Namespace) -> Iterator[Finding]:
    yield from check_machine(Path("/"), Path.cwd())
    yield from check_network(os.environ)
    yield from check_devices(Path("/"), os.environ, args.hw)
    if not args.quick:
        yield check_speed()


def line(finding: Finding, *, colour: bool) -> str:
    """The finding as a line, its remedy on a second one."""
    level = f"{finding.level:5}"
    if colour:
        level = f"\x1b[{_COLOURS[finding.level]}m{level}\x1b[0m"
    said = f"{level}{finding.area:12} {finding.text}"
    return f"{said}\n{'':18}-> {finding.remedy}" if finding.remedy else said
