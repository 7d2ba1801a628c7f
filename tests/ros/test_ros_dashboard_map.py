"""The map of the page as a tool, by mouse, fingers and keys in a real browser: look around, go, draw, name."""

import math

import pytest

pytest.importorskip("rospy")

from chromium import EXECUTABLE
from served_page import ServedPage

from vsx_ros.occupancy.zones import ZoneKind, zone_of
from vsx_ros.ros.dashboard.server import Answer

pytestmark = pytest.mark.skipif(EXECUTABLE is None, reason="no chromium is installed")

WINDOWS = [(1440, 900), (390, 844)]
WAY = {"goal": [1.0, 1.5, 0.0], "points": [[0.0, 0.0], [0.5, 1.2], [1.0, 1.5]], "length_m": 2.0, "seconds": 9.0}


def place(page: ServedPage, px: float, py: float) -> list[float]:
    """What place on the map [m] is at a pixel of the canvas."""
    return list(page.value(f"toMap({px}, {py})"))


def test_a_place_and_its_pixel_belong_together_and_all_is_shown_at_first(page: ServedPage) -> None:
    page.open()
    for x, y in ((-1.0, -2.0), (4.5, 2.0), (0.0, 0.0)):
        px, py = page.value(f"toScreen({x}, {y})")
        assert 0.0 <= px <= page.value("view.w")
        assert 0.0 <= py <= page.value("view.h")
        assert place(page, px, py) == pytest.approx([x, y], abs=1e-9)
    assert page.value("toScreen(1, 0)[0] > toScreen(0, 0)[0] && toScreen(0, 1)[1] < toScreen(0, 0)[1]")


def test_the_wheel_zooms_about_the_pointer_which_is_named_in_metres(page: ServedPage) -> None:
    page.open()
    where = page.at(1.0, 0.5)
    page.browser.mouse("Moved", *where)
    page.wait("$('where').textContent.startsWith('x 1.0')")
    before = page.value("view.pxPerM")
    page.browser.mouse("Wheel", *where, deltaX=0, deltaY=-300)
    page.wait(f"view.pxPerM > 1.2 * {before}")
    assert page.at(1.0, 0.5) == pytest.approx(where, abs=0.5)
    page.browser.mouse("Wheel", *where, deltaX=0, deltaY=100_000)
    page.wait("view.pxPerM === 2")  # however far
    page.browser.mouse("Wheel", *where, deltaX=0, deltaY=-100_000)
    page.wait("view.pxPerM === 800")
    page.browser.click("#fit")
    assert page.value("view.pxPerM") == pytest.approx(before)


def test_the_map_follows_a_drag_and_a_drag_chooses_no_place(page: ServedPage) -> None:
    page.open()
    (x, y), scale = page.at(1.0, 0.5), page.value("view.pxPerM")
    page.browser.mouse("Pressed", x, y)
    page.browser.mouse("Moved", x + 40, y + 30)
    page.browser.mouse("Moved", x + 80, y - 20)
    page.browser.mouse("Released", x + 80, y - 20)
    assert page.at(1.0, 0.5) == pytest.approx((x + 80, y - 20), abs=0.5)
    assert page.value("view.pxPerM") == scale
    assert page.value("$('sheet').hidden")
    assert page.done == []


def test_two_fingers_zoom_about_their_middle(page: ServedPage) -> None:
    page.open(390, 844)
    (x, y), scale = page.at(1.5, 0.0), page.value("view.pxPerM")
    page.browser.touch("Start", (x - 30, y), (x + 30, y))
    page.browser.touch("Move", (x - 60, y), (x + 60, y))
    page.browser.touch("Move", (x - 90, y + 10), (x + 90, y + 10))
    page.browser.touch("End")
    page.wait(f"view.pxPerM > 2 * {scale}")
    assert page.value("view.pxPerM") == pytest.approx(3.0 * scale, rel=0.05)
    assert page.at(1.5, 0.0) == pytest.approx((x, y + 10), abs=6.0)
    assert page.value("$('sheet').hidden")


def test_keys_move_and_zoom_and_enter_chooses_the_middle(page: ServedPage) -> None:
    page.open()
    page.value("$('map').focus()")
    before = page.value("[view.x, view.y, view.pxPerM]")
    for key in ("ArrowRight", "ArrowUp", "+"):
        page.browser.key(key)
    x, y, scale = page.value("[view.x, view.y, view.pxPerM]")
    assert x > before[0]
    assert y > before[1]
    assert scale > before[2]
    page.browser.key("Enter")
    assert page.wait("chosen.place") == pytest.approx([x, y])
    page.browser.key("Escape")
    assert page.wait("$('sheet').hidden && chosen.place === null")
    page.browser.key("0")
    assert page.value("[view.x, view.y, view.pxPerM]") == pytest.approx(before)


def test_the_scale_bar_is_as_long_as_it_says(page: ServedPage) -> None:
    page.open()
    page.value("(view.pxPerM = 70, view.follows = false)")
    page.value("Object.values(layers).forEach(layer => { layer.shown = false; })")
    row = "$('map').getContext('2d').getImageData(0, Math.round(view.h) - 14, 300, 1).data"
    inked = page.value(f"(paint(), [...{row}].filter((value, i) => i % 4 === 3 && value > 200).length)")
    assert 70 <= inked <= 78  # 1 m and its halo


def test_layers_can_be_switched_and_walls_lie_over_frontiers(page: ServedPage) -> None:
    page.open()
    inks = {
        "known ground": "map-free", "walls": "map-wall", "frontiers": "map-frontier", "views": "map-view",
        "keyframes": "map-keyframe", "zones": "map-no-go", "rooms": "map-room", "plan": "map-plan",
    }  # fmt: skip
    find = "[...document.querySelectorAll('.layer')].find(button => button.textContent === '%s')"
    order = page.value("[...document.querySelectorAll('.layer')].map(button => button.textContent)")
    assert order.index("walls") > order.index("frontiers")  # from the lowest to the topmost
    for title, ink in inks.items():
        button = find % title
        [shown_px] = page.pixels("map", "paint()", ink)
        assert shown_px > 12, title
        page.value(f"{button}.click()")
        assert page.value(f"{button}.getAttribute('aria-pressed')") == "false"
        [left_px] = page.pixels("map", "paint()", ink)
        assert left_px < 0.1 * shown_px, title  # a few at the edges of other lines
        page.value(f"{button}.click()")
    button = find % "planes"
    assert page.pixels("map", "paint()", "map-plane") == [0]
    page.value(f"{button}.click()")
    assert page.pixels("map", "paint()", "map-plane")[0] > 0
    page.value("Object.entries(layers).forEach(([name, layer]) => { layer.shown = /walls|frontiers/.test(name); })")
    walls = page.pixels("map", "paint()", "map-wall")[0]
    page.value("known.frontiers.borders = [[[2.025, -1.0], [2.025, -1.2], [2.025, -1.4]]]")  # on a wall
    assert page.pixels("map", "paint()", "map-wall")[0] == walls


@pytest.mark.parametrize("window", WINDOWS)
def test_go_here_shows_the_plan_first_and_drives_only_when_told(page: ServedPage, window: tuple[int, int]) -> None:
    page.answers["plan"] = Answer(True, "2.0 m, about 9 s", WAY)
    page.open(*window)
    page.click_map(1.0, 1.5)
    page.wait("$('go') && !$('go').disabled")
    assert [name for name, _ in page.done] == ["plan"]
    asked = page.done[0][1]
    assert (asked["x"], asked["y"]) == pytest.approx((1.0, 1.5), abs=0.03)
    sheet = page.value("$('sheet').innerText")
    assert "2.0 m, about 9 s" in sheet
    assert "in room 1" in sheet
    page.value("delete known.plan; delete known.mission.goal")
    assert page.pixels("map", "paint()", "map-plan")[0] > 50
    page.browser.click("#go")
    page.wait("$('sheet').hidden && $('said').textContent === 'Go is done.'")
    assert page.done[1] == ("go", asked)
    assert page.value("chosen.way") is None


def test_where_there_is_no_way_it_says_why_and_drives_nowhere(page: ServedPage) -> None:
    page.answers["plan"] = Answer(False, "the goal at (3.00, -1.00) lies in the zone 'rug'")
    page.open()
    page.click_map(3.0, -1.0)
    page.wait("$('sheet').innerText.includes(\"lies in the zone 'rug'\")")
    assert page.value("$('go').disabled")
    assert "in zone rug (no-go)" in page.value("$('sheet').innerText")


def test_a_drive_to_a_users_goal_can_be_ended(page: ServedPage) -> None:
    page.open()
    assert page.value("$('endDrive').hidden")
    page.post("mission", {"state": "user goal", "reason": "driving to a goal of /dashboard"})
    page.wait("!$('endDrive').hidden")
    page.browser.click("#endDrive")
    page.wait("$('said').textContent === 'End-drive is done.'")
    assert page.done == [("end-drive", None)]


@pytest.mark.parametrize("window", WINDOWS)
def test_a_zone_is_drawn_by_its_corners(page: ServedPage, window: tuple[int, int]) -> None:
    page.open(*window)
    page.browser.click("#drawZone")
    corners = [(0.2, 0.3), (1.5, 0.3), (1.5, 1.4), (1.2, 1.8)]
    for corner in corners:
        page.click_map(*corner)
    assert page.value("$('corners').textContent") == "4 corners."
    page.browser.click("#undo")
    page.value("$('zoneName').value = 'the stairs'")
    page.browser.click("#saveZone")
    page.wait("$('sheet').hidden && draft === null")
    [(name, told)] = page.done
    assert name == "zones"
    zone = zone_of(told["add"])
    assert (zone.name, zone.kind) == ("the stairs", ZoneKind.NO_GO)
    assert [math.dist(a, b) < 0.03 for a, b in zip(zone.points, corners[:3], strict=True)] == [True] * 3
    page.click_map(0.0, 0.0)
    assert page.wait("chosen.place")  # a click means a place again


@pytest.mark.parametrize("kind", list(ZoneKind))
def test_every_kind_of_zone_can_be_drawn(page: ServedPage, kind: ZoneKind) -> None:
    page.open()
    page.browser.click("#drawZone")
    page.value(f"($('zoneKind').value = {kind.value!r}, $('zoneKind').dispatchEvent(new Event('change')))")
    least = 2 if kind is ZoneKind.WALL else 3
    for k, corner in enumerate(((0.2, 0.3), (1.5, 0.3), (1.5, 1.4))[:least]):
        assert page.value("$('saveZone').disabled"), k
        page.click_map(*corner)
    assert page.value("$('speedBox').checkVisibility()") is (kind is ZoneKind.SLOW)
    page.browser.click("#saveZone")
    page.wait("$('sheet').hidden")
    zone = zone_of(page.done[0][1]["add"])
    assert (zone.kind, zone.v_m_s) == (kind, 0.1 if kind is ZoneKind.SLOW else None)
    assert zone.name == "zone 1"


def test_a_refused_zone_says_why_and_can_be_mended_or_given_up(page: ServedPage) -> None:
    page.answers["zones"] = Answer(False, "zone 'rug' has an area below 0.01 m2; draw it larger")
    page.open()
    page.browser.click("#drawZone")
    for corner in ((0.2, 0.3), (0.3, 0.3), (0.3, 0.4)):
        page.click_map(*corner)
    page.browser.click("#saveZone")
    page.wait("$('said').textContent.startsWith('Not done: zone') && draft.points.length === 3")
    page.browser.key("Escape")
    assert page.wait("$('sheet').hidden && draft === null")


def test_a_zone_is_removed_after_asking_once(page: ServedPage) -> None:
    page.open()
    page.browser.click("#zones button")
    assert page.value("document.querySelector('#zones button').textContent") == "Really remove?"
    assert page.done == []
    page.browser.click("#zones button")
    page.wait("$('said').textContent === 'Zones is done.'")
    assert page.done == [("zones", {"remove": "rug"})]


def test_a_room_is_named(page: ServedPage) -> None:
    page.open()
    page.browser.click("#rooms button")
    page.wait("document.activeElement === $('roomName')")
    for letter in "my den":  # also a space, which stops nothing here
        page.browser.key(letter, letter)
    page.browser.key("Enter", "\r")
    page.wait("$('sheet').hidden && $('said').textContent === 'Name-room is done.'")
    assert page.done == [("name-room", {"room": 1, "name": "my den"})]


def test_the_button_of_a_room_stays_while_its_figures_change(page: ServedPage) -> None:
    page.open()
    [rooms] = page.value("known.rooms.rooms")

    def post(*numbers: int, **changes: object) -> None:
        page.post("rooms", {"version": 1, "rooms": [{**rooms, "number": number, **changes} for number in numbers]})

    page.value("document.querySelector('#rooms button').focus()")
    x, y = page.value("(b => [b.x + 9, b.y + 9])(document.activeElement.getBoundingClientRect())")
    page.browser.mouse("Pressed", x, y)
    post(1, known_ratio=0.5)
    page.wait("$('rooms').textContent.includes('50 % known')")
    page.browser.mouse("Released", x, y)
    assert page.value("$('roomName').value") == "room 1"
    page.browser.key("Escape")
    page.value("document.querySelector('#rooms button').focus()")
    post(1, 2, name="den")
    page.wait("$('rooms').children.length === 2")
    page.browser.key("Enter", "\r")
    assert page.value("$('roomName').value") == "den"  # the present name
    post(2, name="study")
    page.wait("$('rooms').textContent.startsWith('study')")
    page.browser.click("#rooms button")
    assert page.value("$('roomName').value") == "study"  # of its own room
