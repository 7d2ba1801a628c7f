"""The serial port of a base, on a pseudo-terminal."""

import contextlib
import os
import pty

import pytest
import serial

from vsx_hw.errors import DeviceNotFound, DeviceTimeout
from vsx_hw.transport import SerialTransport


def test_the_missing_port_is_named_with_the_remedy(tmp_path):
    with pytest.raises(DeviceNotFound, match="no such port; plug the base in"):
        SerialTransport(str(tmp_path / "nothing"), 115200)


def test_a_base_that_takes_no_bytes_is_given_up_not_waited_for():
    master, slave = pty.openpty()
    transport = SerialTransport(os.ttyname(slave), 115200)
    with pytest.raises(DeviceTimeout, match="did not take"):
        transport.write(bytes(400_000))
    transport.close()
    os.close(master)
    os.close(slave)


@pytest.mark.parametrize("refusal", [None, ValueError("a terminal is no adapter")])
def test_an_adapter_is_asked_to_hold_nothing_back(refusal, monkeypatch):
    asked = []

    def low_latency(line, on):
        asked.append((line.port, on))
        if refusal is not None:
            raise refusal

    monkeypatch.setattr(serial.Serial, "set_low_latency_mode", low_latency)
    master, slave = pty.openpty()
    with contextlib.closing(SerialTransport(os.ttyname(slave), 115200)) as transport:
        assert asked == [(os.ttyname(slave), True)]
        os.write(master, b"heard\n")
        assert transport.read(1.0) == b"heard\n"
    os.close(master)
    os.close(slave)
