"""Battery and dock of the base as messages, and back."""

import math

from sensor_msgs.msg import BatteryState
from std_msgs.msg import MultiArrayDimension, MultiArrayLayout, UInt8MultiArray

from vsx_hw.readings import BatteryReading, DockSignals
from vsx_ros.ros import headers


def battery(reading: BatteryReading, stamp_ns: int) -> BatteryState:
    """The base's battery; values that it does not measure are NaN."""
    msg = BatteryState(header=headers.header("", stamp_ns), voltage=reading.voltage_v, percentage=reading.fraction)
    msg.current = math.nan if reading.current_a is None else reading.current_a
    msg.temperature = msg.charge = msg.capacity = msg.design_capacity = math.nan
    msg.present = True
    charging, discharging = BatteryState.POWER_SUPPLY_STATUS_CHARGING, BatteryState.POWER_SUPPLY_STATUS_DISCHARGING
    msg.power_supply_status = charging if reading.charging else discharging
    if reading.state == "charged":
        msg.power_supply_status = BatteryState.POWER_SUPPLY_STATUS_FULL
    return msg


def dock_ir(seen: DockSignals) -> UInt8MultiArray:
    """The beams on the right, the centre and the left receiver, as bits of ``DockBeam``; the label is the kind of
    base."""
    layout = MultiArrayLayout(dim=[MultiArrayDimension(label=seen.kind, size=3, stride=3)])
    return UInt8MultiArray(layout, bytes((seen.right, seen.center, seen.left)))


def is_nearly_empty(msg: BatteryState) -> bool:
    """At most a tenth is left (13.3 V on a Kobuki) and the battery is discharging."""
    discharging = msg.power_supply_status == BatteryState.POWER_SUPPLY_STATUS_DISCHARGING
    return bool(discharging and msg.percentage <= 0.1)
