"""The live run, as a program: a Ctrl-C ends it in one sentence even while its modules are being read."""

import sys

from vsx_ros.cli.exit_codes import STOPPED

try:
    from vsx_ros.ros.run import main

    sys.exit(main())
except KeyboardInterrupt:
    sys.stderr.write("vsx: stopped by the operator\n")
    sys.exit(STOPPED)
