"""The exit code of each way an exploration ends, live or in lock-step."""

from __future__ import annotations

from vsx_ros.exploration.decision import Outcome
from vsx_ros.runs.exit_codes import DONE, FAILED, LOST, STOPPED

EXIT_CODES = {
    Outcome.EXPLORED: DONE,
    Outcome.HOME: DONE,
    Outcome.STOPPED: STOPPED,
    Outcome.BOXED_IN: FAILED,
    Outcome.NOT_STARTED: FAILED,
    Outcome.LOST: LOST,
    Outcome.STRANDED: FAILED,
    Outcome.BLOCKED: FAILED,
}
