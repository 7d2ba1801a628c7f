"""``examples/send_a_goal.py`` beside a robot that explores."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

pytest.importorskip("rospy")

if TYPE_CHECKING:
    from conftest import Stack

pytestmark = pytest.mark.ros

EXAMPLE = Path(__file__).resolve().parents[2] / "examples/send_a_goal.py"


def test_a_goal_is_answered_with_a_reason_and_the_exploration_goes_on(stack: Stack) -> None:
    """Beyond the walls: whatever the robot has mapped by now, it cannot go there."""
    stack.wait_until_driving()
    command = [sys.executable, str(EXAMPLE), "50", "0", "0"]
    done = subprocess.run(command, env=stack.environment, capture_output=True, text=True, timeout=120, check=False)
    state, _, reason = done.stdout.partition(": ")
    assert (done.returncode, state) == (1, "ABORTED"), done.stderr
    assert "goal" in reason
    stack.wait_until_driving()
