"""``examples/send_a_goal.py`` beside a robot that explores."""

from __future__ import annotations

import itertools
import math
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

pytest.importorskip("rospy")

from test_ros_clients import AHEAD_M, base_in, pause, wait_until_standing
from waiting import PATIENCE_S

from vsx_ros.geometry.se2 import SE2
from vsx_ros.ros import topics

if TYPE_CHECKING:
    from conftest import Stack

pytestmark = pytest.mark.ros

EXAMPLE = Path(__file__).resolve().parents[2] / "examples/send_a_goal.py"


def send(stack: Stack, goal: SE2) -> subprocess.CompletedProcess[str]:
    numbers = [f"{goal.x:.3f}", f"{goal.y:.3f}", f"{math.degrees(goal.theta):.2f}"]
    command = [sys.executable, str(EXAMPLE), *numbers]
    return subprocess.run(
        command, env=stack.environment, capture_output=True, text=True, timeout=PATIENCE_S, check=False
    )


def test_a_goal_nearby_is_reached_and_the_exploration_goes_on(stack: Stack) -> None:
    """Ahead is what the robot was about to drive over, perhaps in an arc; behind is where it came from."""
    for way_m, turn_rad in itertools.product((AHEAD_M, -AHEAD_M), (0.0, 0.4, -0.4)):
        pause(stack)  # the example lets the exploration go on
        wait_until_standing(stack)
        done = send(stack, base_in(topics.MAP_FRAME) @ SE2.exp(way_m, turn_rad))
        if done.returncode == 0:
            break
    assert done.stdout.startswith("SUCCEEDED: "), done.stdout + done.stderr
    stack.wait_until_driving()


def test_a_goal_is_answered_with_a_reason_and_the_exploration_goes_on(stack: Stack) -> None:
    """Beyond the walls: whatever the robot has mapped by now, it cannot go there."""
    stack.wait_until_driving()
    done = send(stack, SE2(50.0, 0.0, 0.0))
    state, _, reason = done.stdout.partition(": ")
    assert (done.returncode, state) == (1, "ABORTED"), done.stderr
    assert "goal" in reason
    stack.wait_until_driving()
