"""find_base.py PORT: you should see the kind of base within three seconds. No wheel turns."""

import sys

from vsx_hw.detect import detect_base

print(f"{sys.argv[1]}: {detect_base(sys.argv[1])}")
