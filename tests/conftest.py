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
_DEFAULTS = {signal.SIGINT: signal.default_int_handler, signal.SIGTERM: signal.SIG_DFL, signal.SIGHUP: signal.SIG_DFL}
for number, handler in _DEFAULTS.items():
    signal.signal(number, handler)


@pytest.fixture(autouse=True)
def handlers_stay() -> Iterator[None]:
    """Programs that later tests start ignore SIGTERM, and never end, if a test leaves it ignored."""
    before = {number: signal.getsignal(number) for number in _DEFAULTS}
    yield
    after = {number: signal.getsignal(number) for number in _DEFAULTS}
    for number, handler in before.items():
        signal.signal(number, handler)
    assert after == before, "the test leaves signals handled otherwise"


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
