"""For all tests."""

import os
import signal
from collections.abc import Iterator
from pathlib import Path

import hypothesis
import pytest
from chromium import EXECUTABLE, Chromium
from warm_kernels import watched

import vsx_ros  # noqa: F401  # before any test imports cv2, which reads its limit then

# A shell that starts the suite in its background lets it ignore Ctrl-C, and with it every program that a test starts;
# nohup does so with SIGHUP.
_DEFAULTS = {signal.SIGINT: signal.default_int_handler, signal.SIGTERM: signal.SIG_DFL, signal.SIGHUP: signal.SIG_DFL}
for number, handler in _DEFAULTS.items():
    signal.signal(number, handler)
_DRIVEN = "dense", "exploration", "navigation", "occupancy", "planning", "slam", "system"


@pytest.fixture(autouse=True)
def handlers_stay() -> Iterator[None]:
    """Programs that later tests start ignore SIGTERM, and never end, if a test leaves it ignored."""
    before = {number: signal.getsignal(number) for number in _DEFAULTS}
    yield
    after = {number: signal.getsignal(number) for number in _DEFAULTS}
    for number, handler in before.items():
        signal.signal(number, handler)
    assert after == before, "the test leaves signals handled otherwise"


def room(item: pytest.Item) -> str:
    return item.path.relative_to(Path(__file__).parent).parts[0]


@pytest.fixture(scope="session", autouse=True)
def late_kernels(request: pytest.FixtureRequest) -> list[str]:
    """See ``watched``; empty where no test drives."""
    compiled = os.environ.get("NUMBA_DISABLE_JIT") != "1"
    return watched() if compiled and any(room(item) in _DRIVEN for item in request.session.items) else []


@pytest.fixture(autouse=True)
def kernels_are_warm(request: pytest.FixtureRequest, late_kernels: list[str]) -> Iterator[None]:
    """No drive waits for the compiler: what the stack calls in these rooms, the warm-up has compiled."""
    yield
    late = [*late_kernels]
    late_kernels.clear()
    assert not late or room(request.node) not in _DRIVEN, f"the warm-up leaves out {late}"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest files come first, so that no worker is left alone with one at the end of all."""

    def is_short(item: pytest.Item) -> bool:
        return room(item) not in ("cli", "ros", "system") and not item.get_closest_marker("ros")

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
