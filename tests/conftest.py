"""For all tests."""

import signal

# A shell that starts the suite in its background lets it ignore Ctrl-C, and with it every program that a test starts.
signal.signal(signal.SIGINT, signal.default_int_handler)
