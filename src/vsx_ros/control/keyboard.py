"""A keyboard that drives: a held key moves, releasing it stops the robot."""

import re

KEYS = "arrows or w a s d: drive   space: stop   + -: speed   q: quit"

# A held key repeats 10 to 30 times a second, after a first pause of up to half a second.
_FIRST_HELD_FOR_S, _HELD_FOR_S = 0.55, 0.25
_FASTER = 1.1  # times, by each press of +
_MOVES = {"w": (1.0, 0.0), "s": (-1.0, 0.0), "a": (0.0, 1.0), "d": (0.0, -1.0)}
_ARROWS = {"A": "w", "B": "s", "C": "d", "D": "a"}
_ARROW = re.compile(r"\x1b[\[O]([A-D])|.", re.DOTALL)


def keys(text: str) -> list[str]:
    """The keys in the text of a terminal; w a s d for arrows, which are three characters in both terminal modes."""
    return [_ARROWS.get(match[1], match[0]) for match in _ARROW.finditer(text)]


class KeyboardDrive:
    """v_m_s, omega_rad_s: the speeds of the keys. Times are of any clock that never stops."""

    def __init__(self, v_m_s: float, omega_rad_s: float) -> None:
        self.v_m_s, self.omega_rad_s = v_m_s, omega_rad_s
        self._speeds, self._until_s = (0.0, 0.0), 0.0

    def press(self, key: str, now_s: float) -> None:
        """w a s d move, space stops, + and - change the speeds."""
        if key in _MOVES:
            forward, left = _MOVES[key]
            self._speeds = forward * self.v_m_s, left * self.omega_rad_s
            self._until_s = now_s + (_HELD_FOR_S if now_s < self._until_s else _FIRST_HELD_FOR_S)
        elif key == " ":
            self._speeds, self._until_s = (0.0, 0.0), now_s + _FIRST_HELD_FOR_S
        elif key in ("+", "-"):
            factor = _FASTER if key == "+" else 1.0 / _FASTER
            self.v_m_s, self.omega_rad_s = self.v_m_s * factor, self.omega_rad_s * factor

    def speeds(self, now_s: float) -> tuple[float, float] | None:
        """Forward [m/s] and to the left [rad/s], for the held key; None when no key is held."""
        return self._speeds if now_s < self._until_s else None
