"""A stick over a network: only what comes in time from a hand that still holds it moves the base."""

import itertools

import pytest

from vsx_ros.control.joystick import Joystick
from vsx_ros.robot import STOP, VelocityCommand

IN_TIME_S, LATE_S = 0.3, 0.6


def held(stick: Joystick, now_s: float = 0.0) -> int:
    """The ticket of a stick that was just touched."""
    answer = stick.move(now_s, 1.0, 0.0, 0)
    assert answer.command is None
    return answer.ticket


def test_the_first_movement_only_fetches_a_ticket_and_the_next_ones_drive() -> None:
    stick = Joystick(0.2, 0.6)
    ticket = held(stick)
    for k in range(1, 20):
        answer = stick.move(0.1 * k, 0.5, -1.0, ticket)
        assert answer.command == VelocityCommand(0.1, -0.6)
        assert answer.reason == ""
        ticket = answer.ticket


def test_a_movement_that_was_held_up_on_its_way_is_refused_and_the_next_one_drives_again() -> None:
    stick = Joystick(0.2, 0.6)
    ticket = held(stick)
    late = stick.move(LATE_S, 1.0, 0.0, ticket)
    assert late.command is None
    assert "too late" in late.reason
    assert stick.move(LATE_S + IN_TIME_S, 1.0, 0.0, late.ticket).command == VelocityCommand(0.2, 0.0)


def test_a_ticket_is_valid_once() -> None:
    stick = Joystick(0.2, 0.6)
    ticket = held(stick)
    assert stick.move(0.1, 1.0, 0.0, ticket).command is not None
    assert stick.move(0.1, 1.0, 0.0, ticket).command is None


def test_the_centre_stops_whatever_ticket_it_shows() -> None:
    for ticket in (0, 1, 77):
        assert Joystick(0.2, 0.6).move(5.0, 0.0, 0.0, ticket) == (STOP, 0, "")


@pytest.mark.parametrize("order", list(itertools.permutations(range(3))))
def test_however_the_network_shuffles_the_last_words_nothing_moves_after_the_centre(order: tuple[int, ...]) -> None:
    """Two movements, one of them never answered, and the centre, in any order."""
    stick = Joystick(0.2, 0.6)
    ticket = held(stick)
    words = [(1.0, ticket), (1.0, ticket), (0.0, 0)]
    told = [(words[k][0], stick.move(0.1, words[k][0], 0.0, words[k][1]).command) for k in order]
    after = told[[forward for forward, _ in told].index(0.0) + 1 :]
    assert all(command is None for _, command in after)


def test_two_hands_on_the_stick_move_nothing_until_one_lets_go() -> None:
    stick = Joystick(0.2, 0.6)
    first, second = held(stick), held(stick)
    for _ in range(3):
        answers = stick.move(0.1, 1.0, 0.0, first), stick.move(0.1, -1.0, 0.0, second)
        assert [answer.command for answer in answers] == [None, None]
        first, second = (answer.ticket for answer in answers)
    assert stick.move(0.1, -1.0, 0.0, second).command == VelocityCommand(-0.2, 0.0)
