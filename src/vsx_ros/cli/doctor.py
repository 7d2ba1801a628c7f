"""``vsx doctor``: runs all checks and prints their findings; also checks whether ROS nodes of this machine can find a
master and be found."""

import argparse
import email.utils
import http.client
import json
import os
import socket
import sys
import time
import xmlrpc.client
from collections.abc import Iterator, Mapping
from contextlib import closing
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from vsx_ros.cli.check_devices import check_devices
from vsx_ros.cli.check_machine import FAIL, NOTE, OK, WARN, Finding, check_machine, check_speed
from vsx_ros.ros.environment import DEFAULT_MASTER, MASTER_PORT
from vsx_ros.runs.process import DONE, FAILED

_COLOURS = {"ok": "32", "note": "36", "warn": "33", "fail": "31"}
_ANSWER_S = 2.0  # the same machine or network answers in milliseconds
_SKEW_S = 1.5  # A larger clock difference is reported; HTTP dates are whole seconds, so a smaller one is not visible

_LOOPBACK = ("127.", "::1")


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
    """The finding as a line, with its remedy on a second line."""
    level = f"{finding.level:5}"
    if colour:
        level = f"\x1b[{_COLOURS[finding.level]}m{level}\x1b[0m"
    said = f"{level}{finding.area:12} {finding.text}"
    return f"{said}\n{'':18}-> {finding.remedy}" if finding.remedy else said


def check_network(environment: Mapping[str, str]) -> Iterator[Finding]:
    """Findings about ROS_MASTER_URI, ROS_HOSTNAME, ROS_IP and the clocks."""
    uri = environment.get("ROS_MASTER_URI", DEFAULT_MASTER)
    try:
        parts = urlsplit(uri)
        host, port = parts.hostname or "", parts.port or MASTER_PORT
    except ValueError:
        host = ""
    if not host:
        yield Finding("master", FAIL, f"ROS_MASTER_URI={uri} is no address", f"export ROS_MASTER_URI={DEFAULT_MASTER}")
        return
    address = _address(host)
    yield from _own_name(environment, address)
    if address is None:
        remedy = f"correct ROS_MASTER_URI, or add a line 'ADDRESS {host}' to /etc/hosts"
        yield Finding("master", FAIL, f"the name {host!r} in ROS_MASTER_URI={uri} has no address", remedy)
        return
    yield from _master(uri, host, port, _is_here(address))


def _address(name: str) -> str | None:
    try:
        return str(socket.getaddrinfo(name, None, socket.AF_INET)[0][4][0])
    except OSError:
        return None


def _is_here(address: str) -> bool:
    """Whether this is an address of this machine: only then can a socket be bound to it."""
    with socket.socket() as probe:
        try:
            probe.bind((address, 0))
        except OSError:
            return False
    return True


def _own_name(environment: Mapping[str, str], master: str | None) -> Iterator[Finding]:
    """Check the name under which other nodes find the nodes of this machine."""
    variable = next((name for name in ("ROS_HOSTNAME", "ROS_IP") if environment.get(name)), "")
    name = environment[variable] if variable else socket.gethostname()
    said = f"{variable}={name}" if variable else f"this machine's name {name!r}"
    address = _address(name)
    remote = master is not None and not _is_here(master)
    remedy = (
        "export ROS_IP=<this machine's address in the robot's network>" if remote else "export ROS_HOSTNAME=localhost"
    )
    if address is None:
        yield Finding("hostname", FAIL, f"{said} has no address, nodes cannot find each other", remedy)
    elif not _is_here(address):
        yield Finding("hostname", FAIL, f"{said} is {address}, which is no address of this machine", remedy)
    elif remote and address.startswith(_LOOPBACK):
        yield Finding("hostname", FAIL, f"{said} is {address}, which the master's machine cannot reach", remedy)
    else:
        yield Finding("hostname", OK, f"{said} is {address}")


def _master(uri: str, host: str, port: int, here: bool) -> Iterator[Finding]:
    try:
        topics, date = _ask(host, port, "getPublishedTopics", "")
    except (OSError, http.client.HTTPException, xmlrpc.client.Error, ValueError) as error:
        if here:
            yield Finding("master", NOTE, f"none runs at {uri}; 'vsx explore' and roslaunch bring one")
        else:
            remedy = "start roscore there, check network and firewall, or unset ROS_MASTER_URI"
            yield Finding("master", FAIL, f"no ROS master answers at {uri} ({error})", remedy)
        return
    yield Finding("master", OK, f"{uri} answers, {len(topics)} topics are published")
    skew_s = (date - time.time()) if date is not None else 0.0
    if abs(skew_s) > _SKEW_S:
        remedy = "synchronise both machines: sudo apt-get install chrony"
        yield Finding("clock", FAIL, f"the master's clock is {skew_s:+.0f} s from this machine's", remedy)
    else:
        yield Finding("clock", OK, "agrees with the master's to a second")
    simulated, _ = _ask(host, port, "getParam", "/use_sim_time", fallback=False)
    if simulated is True and "/clock" not in [name for name, _ in topics]:
        remedy = "rosparam delete /use_sim_time, or play the bag with --clock"
        yield Finding("clock", WARN, "/use_sim_time is set and nobody publishes /clock: every node waits", remedy)


def _ask(host: str, port: int, method: str, *words: str, fallback: Any = None) -> tuple[Any, float | None]:
    """Ask the master: its answer, or fallback if it has none, and the time of its clock [s]."""
    with closing(http.client.HTTPConnection(host, port, timeout=_ANSWER_S)) as connection:
        body = xmlrpc.client.dumps(("/vsx_doctor", *words), method)
        connection.request("POST", "/RPC2", body, {"Content-Type": "text/xml"})
        response = connection.getresponse()
        answer: Any = xmlrpc.client.loads(response.read())[0][0]
        stated = response.getheader("Date")
    date = email.utils.parsedate_to_datetime(stated).timestamp() if stated else None
    code, _, value = answer
    return (value if code == 1 else fallback), date
