"""The operator's hands on the page in a real browser: buttons, the space bar, the stick; and what eyes need."""

import pytest

pytest.importorskip("rospy")

from chromium import EXECUTABLE
from served_page import CONTRASTS, ServedPage
from waiting import wait_for

from vsx_ros.robot import STOP, VelocityCommand

pytestmark = pytest.mark.skipif(EXECUTABLE is None, reason="no chromium is installed")

DESK, PHONE = (1440, 900), (390, 844)
LEAST_PX = 44


def box(page: ServedPage, name: str) -> list[float]:
    """Left, top, right and bottom of an element in the window [px]."""
    found = f"document.querySelector('{name}').getBoundingClientRect()"
    return list(page.value(f"(b => [b.left, b.top, b.right, b.bottom])({found})"))


def drives(page: ServedPage) -> list[VelocityCommand]:
    """What the stick told the base."""
    return [value for name, value in page.done if name == "drive" and value is not None]


def stands_and_is_silent(page: ServedPage) -> None:
    """The stick tells the base to stand, and says nothing more."""
    wait_for(lambda: drives(page)[-1] == STOP, "the stop", lambda: drives(page)[-3:])
    count = len(page.done)
    page.value("new Promise(done => setTimeout(done, 600))")
    assert len(page.done) == count


def test_pause_and_resume_are_one_button(page: ServedPage) -> None:
    page.open()
    assert page.value("$('pause').textContent") == "Pause"
    page.browser.click("#pause")
    page.wait("$('said').textContent === 'Pause is done.'")
    page.post("mission", {"state": "paused", "reason": "paused by the operator"})
    page.wait("$('pause').textContent === 'Resume'")
    page.browser.click("#pause")
    page.wait("$('said').textContent === 'Resume is done.'")
    assert page.done == [("pause", None), ("resume", None)]


def test_a_known_dock_is_offered_and_what_it_does_is_told(page: ServedPage) -> None:
    page.open()
    status = {"state": "idle", "reason": "", "tries": 0, "docked": False, "known": False, "battery_left_s": 8520}
    page.post("dock", status)
    page.wait("$('numbers').textContent.includes('2 h 22 min')")
    assert page.value("$('dock').hidden")
    page.post("dock", status | {"known": True})
    page.wait("!$('dock').hidden && $('dock').textContent === 'Charge'")
    page.browser.click("#dock")
    page.wait("$('said').textContent === 'Dock is done.'")
    page.post("dock", status | {"state": "docked", "reason": "on the dock, and it charges", "docked": True})
    page.wait("$('dock').textContent === 'Leave dock' && $('why').textContent.includes('dock: on the dock')")
    page.browser.click("#dock")
    page.wait("$('said').textContent === 'Undock is done.'")
    assert page.done == [("dock", None), ("undock", None)]


@pytest.mark.parametrize("window", [DESK, PHONE])
def test_stop_asks_and_the_emergency_stop_stays_in_reach_meanwhile(page: ServedPage, window: tuple[int, int]) -> None:
    page.open(*window)
    page.browser.click("#stop")
    assert page.done == []
    page.browser.click("#stopNot")
    assert page.value("$('stopAsks').hidden")
    page.browser.click("#stop")
    page.browser.click("#estop")
    page.wait("$('said').textContent === 'Estop is done.'")
    page.browser.click("#stopAsks [data-command=stop]")
    page.wait("$('said').textContent === 'Stop is done.' && $('stopAsks').hidden")
    assert [name for name, _ in page.done] == ["estop", "stop"]


@pytest.mark.parametrize("window", [DESK, PHONE])
def test_the_emergency_stop_is_large_and_in_reach_wherever_the_page_is(
    page: ServedPage, window: tuple[int, int]
) -> None:
    page.open(*window)
    for share in (0.0, 0.5, 1.0):
        page.value(f"window.scrollTo(0, {share} * document.body.scrollHeight)")
        left, top, right, bottom = box(page, "#estop")
        assert right - left >= LEAST_PX
        assert bottom - top >= LEAST_PX
        assert left >= 0
        assert top >= 0
        assert right <= window[0]
        assert bottom <= window[1]
        centre = (left + right) / 2, (top + bottom) / 2
        assert page.value(f"document.elementFromPoint{centre}.id") == "estop"  # nothing lies over it


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_emergency_stop_can_be_read_under_the_pointer(page: ServedPage, scheme: str) -> None:
    page.open(scheme=scheme)
    left, top, right, bottom = box(page, "#estop")
    before = page.value("getComputedStyle($('estop')).backgroundColor")
    page.browser.mouse("Moved", (left + right) / 2, (top + bottom) / 2)
    page.wait(f"getComputedStyle($('estop')).backgroundColor !== '{before}'")
    ratio = {words: ratio for ratio, words in page.value(CONTRASTS)}["E-STOP"]
    assert 4.5 <= ratio <= 21.0


def test_the_tab_key_reaches_everything(page: ServedPage) -> None:
    page.open()
    page.value("document.activeElement.blur()")
    reached = set()
    for _ in range(40):
        page.browser.key("Tab")
        reached.add(page.value("document.activeElement.id || document.activeElement.textContent"))
    tools = {"pause", "stop", "estop", "drawZone", "byHand", "zoomIn", "zoomOut", "fit", "map"}
    assert {*tools, "frontiers", "planes", "Remove", "Name", "events", "health"} <= reached


def test_the_space_bar_stops_wherever_the_focus_is_and_once(page: ServedPage) -> None:
    page.open()
    for focus in ("document.activeElement.blur()", "$('map').focus()", "$('pause').focus()", "$('stick').focus()"):
        page.value(focus)
        page.browser.key(" ", " ", up=False)
        page.browser.call("Input.dispatchKeyEvent", type="keyDown", key=" ", text=" ", autoRepeat=True)
        page.browser.call("Input.dispatchKeyEvent", type="keyUp", key=" ")
        page.wait("$('said').textContent === 'Estop is done.'")
        page.value("$('said').textContent = ''")
    assert page.done == [("estop", None)] * 4


@pytest.mark.parametrize("window", [DESK, PHONE])
def test_the_stick_drives_while_it_is_held_and_letting_go_stops(page: ServedPage, window: tuple[int, int]) -> None:
    page.open(*window)
    page.browser.click("#byHand")
    page.value("$('stick').scrollIntoView({block: 'center'})")
    left, top, right, bottom = box(page, "#stick")
    x, y, reach = (left + right) / 2, (top + bottom) / 2, (right - left) / 2
    if window == PHONE:
        page.browser.touch("Start", (x, y))
        page.browser.touch("Move", (x, y - 2.0 * reach))
    else:
        page.browser.mouse("Pressed", x, y)
        page.browser.mouse("Moved", x, y - 2.0 * reach)
    page.wait("hand.sent >= 4")
    assert VelocityCommand(0.2, 0.0) == drives(page)[-1]  # full speed ahead, however far it is pulled
    if window == PHONE:
        page.browser.touch("Move", (x - 0.5 * reach, y))
    else:
        page.browser.mouse("Moved", x - 0.5 * reach, y)
    page.wait("hand.left > 0.45 && hand.left < 0.55")
    sent = page.value("hand.sent")
    page.wait(f"hand.sent >= {sent} + 3")
    assert drives(page)[-1] == pytest.approx((0.0, 0.3), abs=0.02)
    if window == PHONE:
        page.browser.touch("End")
    else:
        page.browser.mouse("Released", x - 0.5 * reach, y)
    page.wait("!hand.holds")
    stands_and_is_silent(page)


def test_a_second_finger_stops_while_the_first_one_holds_the_stick(page: ServedPage) -> None:
    page.open(*PHONE)
    page.browser.click("#byHand")
    page.value("$('stick').scrollIntoView({block: 'center'})")
    thumb, stop = (((a + c) / 2, (b + d) / 2) for a, b, c, d in (box(page, "#stick"), box(page, "#estop")))
    page.browser.touch("Start", thumb)
    page.browser.touch("Move", (thumb[0], thumb[1] - 60))
    page.wait("hand.sent >= 3")
    page.browser.touch("Start", (thumb[0], thumb[1] - 60), stop)
    page.wait("$('said').textContent === 'Estop is done.'")
    page.browser.touch("End")
    page.wait("!hand.holds")


def test_the_emergency_stop_waits_for_no_other_command(page: ServedPage) -> None:
    """A browser opens only six connections to a server."""
    page.open()
    page.hangs.add("pause")
    for _ in range(10):
        page.browser.click("#pause")
    page.browser.key(" ", " ")
    page.wait("$('said').textContent === 'Estop is done.'")
    assert ("estop", None) in page.done  # the server may hear a hanging pause after it


@pytest.mark.parametrize(
    "ends", ["$('stick').blur()", "$('byHand').click()", "window.dispatchEvent(new Event('blur'))"]
)
def test_arrow_keys_hold_the_stick_until_it_loses_them(page: ServedPage, ends: str) -> None:
    page.open()
    page.browser.click("#byHand")
    assert page.wait("document.activeElement === $('stick')")
    page.browser.key("ArrowUp", up=False)
    page.wait("hand.sent >= 3")
    assert drives(page)[-1] == VelocityCommand(0.2, 0.0)
    page.value(ends)
    page.wait("!hand.holds")
    stands_and_is_silent(page)


def test_a_stick_whose_page_goes_away_falls_silent(page: ServedPage) -> None:
    page.open()
    page.browser.click("#byHand")
    page.wait("document.activeElement === $('stick')")
    page.browser.key("ArrowUp", up=False)
    page.wait("hand.sent >= 3")
    page.browser.open("about:blank")
    page.browser.wait("document.readyState === 'complete' && location.href === 'about:blank'")

    def is_silent() -> bool:
        count = len(drives(page))
        page.browser.evaluate("new Promise(done => setTimeout(done, 600))")
        return len(drives(page)) == count

    wait_for(is_silent, "silence")  # the base stops by itself: half a second after the last movement


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("window", [DESK, PHONE])
def test_all_words_can_be_read_and_nothing_sticks_out(page: ServedPage, window: tuple[int, int], scheme: str) -> None:
    page.open(*window, scheme=scheme)
    page.post("held", {"by": "emergency stop", "since_ns": 10**18})
    page.wait("!$('banner').hidden")
    page.browser.click("#stop")
    page.click_map(3.0, -1.0)
    page.wait("!$('go').disabled")
    read = page.value(CONTRASTS)
    assert len(read) > 40
    assert min(read)[0] >= 4.5, min(read)
    assert page.value("document.documentElement.scrollWidth") <= window[0]
    assert page.value("getComputedStyle(document.body).backgroundColor") == (
        "rgb(14, 19, 25)" if scheme == "dark" else "rgb(242, 244, 247)"
    )


def test_on_a_phone_the_map_comes_before_camera_and_health_and_fingers_find_the_buttons(page: ServedPage) -> None:
    page.open(*PHONE)
    page.browser.click("#byHand")
    tops = [box(page, f"#{name}")[1] for name in ("mapCard", "cameraCard", "numbersCard", "healthCard")]
    assert tops == sorted(tops)
    assert box(page, "#map")[3] < PHONE[1] - 78  # all of the map is there at once, above the buttons
    shown = "[...document.querySelectorAll('button')].filter(b => b.getClientRects().length)"
    heights = page.value(f"{shown}.map(b => b.getBoundingClientRect().height)")
    assert len(heights) > 8
    assert min(heights) >= LEAST_PX
