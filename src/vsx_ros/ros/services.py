"""Services that take no question."""

from __future__ import annotations

from collections.abc import Callable

import rospy
from std_srvs.srv import Trigger, TriggerRequest, TriggerResponse

from vsx_hw.errors import DeviceError
from vsx_ros.errors import VsxError


def offer_trigger(name: str, act: Callable[[], str]) -> None:
    """``act`` returns the message of the answer; a VsxError or DeviceError of it is the answer of one that failed."""

    def answer(_: TriggerRequest) -> TriggerResponse:
        try:
            return TriggerResponse(True, act())
        except (VsxError, DeviceError) as error:
            return TriggerResponse(False, str(error))

    rospy.Service(name, Trigger, answer)
