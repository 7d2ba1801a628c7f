"""The base never cuts what the follower may command, unless somebody says so, and then it says so, too."""

import math
import threading
from types import SimpleNamespace

import pytest

pytest.importorskip("rospy")

import rospy

from vsx_hw.safety import SpeedLimits
from vsx_hw.watchdog import StopBytes
from vsx_ros.config import Config, LimitsConfig
from vsx_ros.errors import ConfigError
from vsx_ros.ros import base_drivers
from vsx_ros.ros.base_drivers import (
    BASES,
    BaseEntry,
    BaseSettings,
    Listeners,
    base_driver,
    base_settings,
    base_watchdogs,
    speed_limits,
    supervisor,
)
from vsx_ros.ros.nodes import mobile_base


@pytest.fixture
def parameters(monkeypatch: pytest.MonkeyPatch) -> dict[str, float]:
    given: dict[str, float] = {}
    monkeypatch.setattr(rospy, "get_param", given.get)
    return given


@pytest.fixture
def warnings(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    said: list[str] = []
    monkeypatch.setattr(rospy, "logwarn", lambda form, *values: said.append(form % values))
    return said


@pytest.mark.parametrize(
    ("limits", "caps"),
    [
        (LimitsConfig(), SpeedLimits(0.5, 1.5)),
        (LimitsConfig(v_m_s=0.6, omega_rad_s=0.4), SpeedLimits(0.6, 1.5)),
        (LimitsConfig(v_m_s=0.7, omega_rad_s=3.2), SpeedLimits(0.7, 3.2)),
    ],
)
@pytest.mark.usefixtures("parameters")
def test_what_is_configured_can_be_driven(limits: LimitsConfig, caps: SpeedLimits, warnings: list[str]) -> None:
    assert speed_limits(limits) == caps
    assert warnings == []


def test_a_lower_cap_is_obeyed_and_told(parameters: dict[str, float], warnings: list[str]) -> None:
    parameters |= {"~max_vel": 0.2, "~max_angular_vel": 1.0}
    assert speed_limits(LimitsConfig()) == SpeedLimits(0.2, 1.0)
    assert len(warnings) == 1
    assert "max_vel is 0.2, less than the configured limit of 0.3" in warnings[0]


@pytest.mark.parametrize("value", [0.0, -0.3, math.nan, math.inf, "fast", None, "nan"])
@pytest.mark.parametrize(
    "name",
    ["max_vel", "max_angular_vel", "cmd_vel_timeout", "odom_linear_scale_correction", "odom_angular_scale_correction"],
)
def test_a_number_that_takes_no_limit_is_refused(name: str, value: object, parameters: dict[str, object]) -> None:
    """A negative limit would limit nothing."""
    parameters |= {f"~{name}": value}
    with pytest.raises(ConfigError, match=f"{name} is {value!r}; give a number above 0"):
        supervisor(Config(), base_settings(Config()))


@pytest.mark.usefixtures("warnings")
def test_numbers_above_0_are_taken(parameters: dict[str, object]) -> None:
    parameters |= {"~cmd_vel_timeout": "0.5", "~odom_linear_scale_correction": 1, "~max_vel": 0.1}
    settings = base_settings(Config())
    assert (settings.command_timeout_s, settings.linear_scale, settings.angular_scale) == (0.5, 1.0, 1.0)
    assert speed_limits(LimitsConfig()) == SpeedLimits(0.1, 1.5)


@pytest.mark.parametrize("silence", ["", "no reading"])
@pytest.mark.parametrize("stands", [True, False])
def test_the_watchdogs_are_let_go_only_once_the_wheels_surely_stand(stands: bool, silence: str) -> None:
    released: list[bool] = []
    node = SimpleNamespace(
        _driver=SimpleNamespace(close=lambda: stands),
        _watchdogs=SimpleNamespace(release=lambda: released.append(True)),
        _health=SimpleNamespace(silence=silence),
    )
    mobile_base.MobileBaseNode.close(node)  # type: ignore[arg-type]  # a bare one
    assert released == [True] * (stands and not silence)


def test_a_base_at_a_port_takes_no_words_behind_a_colon() -> None:
    with pytest.raises(ConfigError, match="'kobuki:left': give kobuki, "):
        base_driver(BaseSettings("kobuki:left", "/dev/null"), Listeners(print, print, print))


def test_a_driver_that_hangs_at_the_end_is_left_to_the_watchdogs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(mobile_base, "_CLOSE_S", 0.05, raising=False)
    released: list[bool] = []
    let_go = threading.Event()
    node = SimpleNamespace(
        _driver=SimpleNamespace(close=lambda: not let_go.wait(5.0)),
        _watchdogs=SimpleNamespace(release=lambda: released.append(True)),
        _health=SimpleNamespace(silence=""),
    )
    mobile_base.MobileBaseNode.close(node)  # type: ignore[arg-type]  # a bare one
    let_go.set()
    assert released == []


@pytest.mark.parametrize("baud", [(), (-9600,)])
def test_stop_bytes_without_a_baud_rate_are_refused(
    baud: tuple[()] | tuple[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """At 0 baud the watchdogs would hang up instead of stopping the base."""
    monkeypatch.setattr(base_drivers, "Watchdogs", lambda *_: pytest.fail("a watchdog starts"))
    monkeypatch.setitem(BASES, "mine", BaseEntry(print, StopBytes(b"halt", b"farewell"), *baud))
    with pytest.raises(ConfigError, match="'mine' has stop bytes and the baud rate"):
        base_watchdogs(BaseSettings("mine", "/dev/null"))
