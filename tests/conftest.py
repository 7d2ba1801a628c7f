"""For all tests."""

import signal
from collections.abc import Iterator
from pathlib import Path

import hypothesis
import pytest
from chromium import EXECUTABLE, Chromium

import vsx_ros  # noqa: F401  # before any test imports cv2, which reads its limit then

# A shell that starts the suite in its background lets it ignore Ctrl-C, and with it every program that a test starts;
# nohup does so with SIGHUP.
signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGHUP, signal.SIG_DFL)


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup() -> None:
    """Programs that a test starts ignore SIGTERM when an earlier test has left it ignored, and never end."""
    signal.signal(signal.SIGTERM, signal.SIG_DFL)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest files come first, so that no worker is left alone with one at the end of all."""
    tests = Path(__file__).parent

    def is_short(item: pytest.Item) -> bool:
        room = item.path.relative_to(tests).parts[0]
        return room not in ("cli", "ros", "system") and not item.get_closest_marker("ros")

    items.sort(key=is_short)


# No test may fail because the machine is busy, or by chance: --hypothesis-profile=exploring draws other examples.
hypothesis.settings.register_profile("exploring", deadline=None)
hypothesis.settings.register_profile("repeating", deadline=None, derandomize=True)
hypothesis.settings.load_profile("repeating")


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Chromium]:
    if EXECUTABLE is None:
        pytest.skip("no chromium is installed")
    with Chromium(tmp_path_factory.mktemp("profile")) as chromium:
        yield chromium
