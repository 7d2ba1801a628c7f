"""A driver on a documented Create or Create 2, for the tests beside it."""

from contextlib import contextmanager

import pytest
from documented_line import Line
from documented_oi import OFF, PASSIVE, OpenInterface
from documented_oi_packets import Generation
from driving_host import Host
from waiting import wait_for

CREATE_1, CREATE_2 = Generation.CREATE_1, Generation.CREATE_2
KIND = {CREATE_1: "create", CREATE_2: "create2"}
both = pytest.mark.parametrize("generation", [CREATE_1, CREATE_2], ids=["create", "create2"])


@contextmanager
def driven(tmp_path, robot: OpenInterface, garbage: int = 0):
    """A driver on the robot; at the end it stands in a mode in which it charges, and nothing forbidden was sent."""
    with Line(robot, str(tmp_path / "create"), garbage) as line:
        with Host(KIND[robot.generation], line) as host:
            host.connected()
            yield host
        if line._master >= 0:
            wait_for(
                lambda: robot.mode == (OFF if robot.generation is CREATE_2 else PASSIVE), "the mode after the driver"
            )
            assert robot.body.left_m_s == robot.body.right_m_s == 0.0
    assert not robot.violations, f"{len(robot.violations)}: {sorted(set(robot.violations))}"


def drives(host: Host, want: tuple[float, float] = (0.2, 0.0)) -> None:
    """Drive until the body has that speed."""
    host.want = want
    body = host.line.robot.body
    wait_for(lambda: (body.speed_m_s, body.rate_rad_s) == pytest.approx(want, abs=0.02), f"the speed {want}")
