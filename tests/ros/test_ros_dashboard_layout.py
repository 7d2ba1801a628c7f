"""What the page shows lies beside each other and stays in place, on a desk and on a phone, in a real browser."""

import pytest

pytest.importorskip("rospy")

from chromium import EXECUTABLE
from served_page import ServedPage

from vsx_ros.ros.dashboard.server import Answer

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


@pytest.mark.parametrize("window", [DESK, LAPTOP, PHONE])
@pytest.mark.parametrize("zoomed", [False, True])
def test_the_sheet_hides_no_chosen_place(page: ServedPage, window: tuple[int, int], zoomed: bool) -> None:
    page.open(*window)
    if zoomed:
        page.value("(Object.assign(view, {x: 0.5, y: -1.5, pxPerM: 1.5 * view.pxPerM, follows: false}), paint())")
    before = page.value("[view.x, view.y, view.pxPerM, view.follows]")
    low = page.value("toMap(view.w / 2, view.h - 30)")
    page.answers["plan"] = Answer(False, "there is no way to this place: " + 8 * "it lies in the zone of the carpet, ")
    page.click_map(*low)
    page.wait("$('sheet').innerText.includes('carpet')")
    assert page.value("chosen.place") == pytest.approx(low, abs=0.02)
    assert page.at(*low)[1] + 10 < box(page, "#sheet")[1]
    assert page.at(*low)[1] > box(page, "#map")[1]
    page.browser.key("Escape")
    if not zoomed:
        fitted = page.value("(document.getElementById('fit').click(), [view.x, view.y, view.pxPerM, view.follows])")
        assert fitted == pytest.approx(before)


@pytest.mark.parametrize("window", [DESK, LAPTOP, PHONE])
def test_a_zone_can_have_corners_at_the_lower_edge_of_the_map(page: ServedPage, window: tuple[int, int]) -> None:
    page.open(*window)
    before = page.value("[view.x, view.y, view.pxPerM, view.follows]")
    page.browser.click("#drawZone")
    corners = [(-0.9, -1.9), (1.5, -1.9), (4.4, -1.9)]
    for k, corner in enumerate(corners):
        page.click_map(*corner)
        assert page.value("draft.points.length") == k + 1
    page.browser.key("Escape")
    assert page.value("[view.x, view.y, view.pxPerM, view.follows]") == pytest.approx(before)
