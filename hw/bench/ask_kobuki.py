"""ask_kobuki.py PORT [--factory-gains]: you should hear one note, and see what the base is. No wheel turns.

Versions, the board's identity, currents of the motors [10 mA], cliff sensors (right, centre, left, 4095 is 3.3 V), and
the gains of the wheels' controller. Kind 0 is the factory's, P 100, I 0.1, D 2; --factory-gains sets it.
"""

import sys
import time

from vsx_hw.kobuki import protocol
from vsx_hw.kobuki.protocol import encode_frame
from vsx_hw.kobuki.stream import StreamParser
from vsx_hw.transport import SerialTransport

transport, parser, told = SerialTransport(sys.argv[1], protocol.BAUD), StreamParser(), {}
if "--factory-gains" in sys.argv:
    transport.write(encode_frame(protocol.factory_gains_payload()))
transport.write(
    encode_frame(protocol.sound_payload(440.0, 200), protocol.request_versions_payload(), protocol.get_gains_payload())
)
end_s = time.monotonic() + 2.0
while time.monotonic() < end_s:
    for feedback in parser.feed(transport.read(0.1)):
        told |= {name: value for name, value in feedback._asdict().items() if value is not None}
for name in ("hardware_version", "firmware_version", "udid", "current", "cliff_adc"):
    print(f"{name}: {told.get(name, 'not told')}")
gains = told.get("controller")
print(
    f"gains: kind {gains.kind}, {gains.p / 1e3:g}, {gains.i / 1e3:g}, {gains.d / 1e3:g}" if gains else "gains: not told"
)
transport.close()
