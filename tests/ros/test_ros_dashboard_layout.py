"""What the page shows lies beside each other and stays in place, on a desk and on a phone, in a real browser."""

import pytest

pytest.importorskip("rospy")

from chromium import EXECUTABLE
from served_page import ServedPage

pytestmark = pytest.mark.skipif(EXECUTABLE is None, reason="no chromium is installed")

DESK, LAPTOP, PHONE = (1440, 900), (1024, 768), (390, 844)
LONG = (
    "driving to a view of 4.0 m2 through the door of room 3, since all views nearby are seen or were given up [U = 2]"
)


def box(page: ServedPage, name: str) -> list[float]:
    """Left, top, right and bottom of an element in the window [px]."""
    found = f"document.querySelector('{name}').getBoundingClientRect()"
    return list(page.value(f"(b => [b.left, b.top, b.right, b.bottom])({found})"))


@pytest.mark.parametrize("window", [DESK, LAPTOP, PHONE])
def test_the_map_stays_in_place_whatever_is_said_above_it(page: ServedPage, window: tuple[int, int]) -> None:
    page.open(*window)
    page.post("mission", {"state": "mapping", "reason": "short"})
    page.wait("$('why').textContent === 'Short.'")
    before = box(page, "#map")
    page.post("mission", {"state": "held", "reason": LONG})
    page.post("held", {"by": "teleop", "since_ns": 10**18})
    page.wait("$('why').textContent.startsWith('Driving') && !$('banner').hidden")
    assert box(page, "#map") == before
    for name in ("drawZone", "byHand", "map"):  # the banner lies over nothing that is needed
        left, top, right, bottom = box(page, f"#{name}")
        assert page.value(f"document.elementFromPoint({(left + right) / 2}, {(top + bottom) / 2}).id") == name


@pytest.mark.parametrize("window", [DESK, LAPTOP, PHONE])
@pytest.mark.parametrize("held", ["", "emergency stop"])
def test_what_came_of_a_command_hides_neither_header_nor_banner(
    page: ServedPage, window: tuple[int, int], held: str
) -> None:
    page.open(*window)
    page.post("held", {"by": held, "since_ns": 10**18})
    page.wait(f"$('banner').hidden === {'false' if held else 'true'}")
    page.browser.click("#estop")
    page.wait("$('said').textContent === 'Estop is done.' && $('said').checkVisibility({visibilityProperty: true})")
    over = box(page, "#banner" if held else "header")
    left, top, right, bottom = box(page, "#said")
    assert 0 <= left < right <= window[0]
    assert over[3] <= top < bottom <= window[1]
    if window == PHONE:
        assert top < over[3] + 20  # below it at once
