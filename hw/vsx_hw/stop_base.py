"""Stop the wheels of a base that nobody drives any longer: what systemd runs after the driver's end.

stop_base PORT [kobuki|create|create2]; without a kind, the stop bytes of the base that answers.
"""

import sys

from vsx_hw.bases import BASES, detect_base
from vsx_hw.errors import DeviceError
from vsx_hw.watchdog import take_over


def main() -> None:
    """Exit code 0 when the bytes were sent, 1 for wrong arguments, 2 when the port could not be had."""
    arguments = sys.argv[1:]
    if len(arguments) not in (1, 2) or (len(arguments) == 2 and arguments[1] not in BASES):
        sys.exit(f"stop_base PORT [{'|'.join(BASES)}]")
    port = arguments[0]
    try:
        base = BASES[arguments[1] if len(arguments) == 2 else detect_base(port)]
    except DeviceError as error:
        sys.stderr.write(f"stop_base: {error}\n")
        sys.exit(2)
    sys.exit(0 if take_over(port, base.baud, base.stop_bytes().farewell) else 2)
