"""Turns a coarse path of arcs and lines into paths that the base can drive: one with stops, and one smooth if possible.

The cost of a programme grows with the cube of its pieces. So long paths are fitted in a sliding window: of a window of
a few pieces the first ones are kept, and the next window begins there, with the same position and heading. The
curvature is zero at each joint, so the base drives on. A window ends on the coarse path, best in a straight line, where
no curve is squeezed; the next window may move that point. Where no window fits, the base stops."""

import itertools
from dataclasses import replace

from vsx_ros.config import PlannerConfig
from vsx_ros.geometry.se2 import SE2
from vsx_ros.planning.coarse_path import CoarsePath
from vsx_ros.planning.corridor import Corridor
from vsx_ros.planning.joint_qp import HeadingSequence, merge_segments
from vsx_ros.planning.path import Path, certified
from vsx_ros.planning.pieces import Piece
from vsx_ros.planning.smoothing import fit, reverse_legs

_MOST_PIECES, _IN_NEED = 5, 8  # in a window; in one where no smaller one fits
_OVERLAP = 2  # pieces of a window that the next one fits again
_FEWER = 3  # pieces less than that at which a window may end
_ENDS = 3  # of a window, tried until one fits
_CUT_M = 0.1  # a window may end in the middle of straight lines longer than this
_LONG_RADII = 3.0  # longer lines are pieces of their own but for their ends: one polynomial bends too early
_PIECE_RADII = (4.0, 0.5)  # longer pieces are divided in the next straight line; then shorter ones, for more freedom
_ZIGZAG_RAD = 0.3  # turns of a zigzag: bends so short cannot pass from one side to the other smoothly


def smoothed(coarse: CoarsePath, start: SE2, goal: SE2, config: PlannerConfig, corridor: Corridor) -> list[Path]:
    """The coarse path, with stops where its curvature jumps, and a version that is smooth as far as possible."""
    pieces = tuple(_SlidingFit(coarse, start, goal, config, corridor).pieces)
    smooth = certified(start, goal, pieces, "Bernstein coefficients")
    return [certified(start, goal, coarse.pieces(start), "arcs and lines"), smooth]


def _straightened(sequence: HeadingSequence) -> HeadingSequence:
    """Without zigzags: neighbours that bend a little, to different sides, are one piece with the sum of their turns."""
    turns: list[float] = []
    directions: list[int] = []
    members: list[tuple[int, ...]] = []
    for turn, direction, segments in zip(sequence.turns, sequence.directions, sequence.members):
        small = turns and directions[-1] == direction and max(abs(turns[-1]), abs(turn)) < _ZIGZAG_RAD
        if small and turns[-1] * turn <= 0.0:
            turns[-1], members[-1] = turns[-1] + turn, members[-1] + segments
        else:
            turns.append(turn)
            directions.append(direction)
            members.append(segments)
    joints = tuple(a == b for a, b in itertools.pairwise(directions))
    return replace(sequence, turns=tuple(turns), directions=tuple(directions), joints=joints, members=tuple(members))


class _SlidingFit:
    """``pieces`` are final and lead to the pose ``_at``, from which the segments from ``_first`` on are left."""

    def __init__(self, coarse: CoarsePath, start: SE2, goal: SE2, config: PlannerConfig, corridor: Corridor) -> None:
        self._way, self._cuts = coarse.joined().cut(_CUT_M, _LONG_RADII)
        self._arcs = self._way.arcs(start)
        self._lengths = self._way.lengths.tolist()
        self._breaks = tuple(self._breaks_every(radii / coarse.phi) for radii in _PIECE_RADII)
        self._goal, self._config, self._corridor = goal, config, corridor
        self.pieces: list[Piece] = []
        self._at, self._first, self._joined = start, 0, False
        self._tail: list[Piece] = []  # of the window before, to the coarse path at segment ``_tail_last``
        self._tail_last = 0
        self._guide: list[Piece | None] = list(self._arcs)  # for each segment; None: part of the one before
        while self._first < len(self._arcs):
            self._go_on()

    def _breaks_every(self, longest_m: float) -> frozenset[int]:
        """Cuts at which a new piece begins: in long lines, and where a piece would become longer than longest_m."""
        breaks, piece_m, bend, before_m = set(), 0.0, 0, 0.0
        for i, (turn, length_m) in enumerate(zip(self._way.turns.tolist(), self._lengths)):
            if turn * bend < 0 or length_m * before_m < 0.0:
                piece_m, bend = 0.0, 0
            piece_m, bend, before_m = piece_m + abs(length_m), turn or bend, length_m
            long = i in self._cuts and length_m != self._lengths[i + 1]  # halves are equal, ends and middle are not
            if i in self._cuts and (long or piece_m > longest_m):
                breaks.add(i)
                piece_m, bend = 0.0, 0
        return frozenset(breaks)

    def _go_on(self) -> None:
        if self._fit_window(_MOST_PIECES):
            return
        if self._tail:  # the rest of the window before leads back to the coarse path
            self.pieces += self._tail
            self._at, self._first, self._joined = self._tail[-1].end, self._tail_last, self._goes_on(self._tail_last)
            self._tail = []
        elif self._fit_window(_IN_NEED):
            return
        elif self._joined:
            self._joined = False
        else:
            self._take_arcs()

    def _fit_window(self, most_pieces: int) -> bool:
        """Fit a window from ``_at``; False if none fits."""
        for last in self._ends(most_pieces):
            tried: list[HeadingSequence] = []
            found = [self._sequence(last, breaks) for breaks in self._breaks]
            sequences = [sequence for sequence in found if sequence is not None]
            for sequence in [*sequences, *map(_straightened, sequences[:1])]:
                if sequence in tried:
                    continue
                tried.append(sequence)
                path = self._fitted(sequence, last)
                if path is not None:
                    self._keep(sequence, path, last)
                    return True
        return False

    def _goes_on(self, last: int) -> bool:
        """Whether the base need not stop before a segment."""
        return last < len(self._lengths) and self._lengths[last - 1] * self._lengths[last] > 0.0

    def _ends(self, most_pieces: int) -> list[int]:
        """The segments before which the next window may end, best first."""
        sequence = self._sequence(len(self._arcs), self._breaks[0])
        if sequence is None:
            return []
        members = [[self._first + i for i in piece] for piece in sequence.members]
        if len(members) <= most_pieces:
            whole = [len(self._arcs)]
            members = members[:-1]
        else:
            whole, members = [], members[:most_pieces]
        ends = []
        for piece in reversed(members[-_FEWER - 1 :]):
            cuts = [i for i in piece if i in self._cuts]
            last = (cuts[-1] if cuts and self._goes_on(piece[-1] + 1) else piece[-1]) + 1
            in_reverse = self._lengths[last - 1] < 0.0 and self._goes_on(last)
            ends.append((in_reverse, not cuts and self._goes_on(last), last))
        return whole + [last for *_, last in sorted(ends, key=lambda end: end[:2])][:_ENDS]

    def _sequence(self, last: int, breaks: frozenset[int]) -> HeadingSequence | None:
        end = self._arcs[last - 1].end if last < len(self._arcs) else self._goal
        shifted = frozenset(cut - self._first for cut in breaks)
        sequence = merge_segments(self._way.part(self._first, last), end.theta - self._at.theta, shifted)
        if sequence is None:
            return None
        return replace(sequence, joined_ends=(self._joined, self._goes_on(last)))

    def _fitted(self, sequence: HeadingSequence, last: int) -> Path | None:
        """The path of a window, from ``_at`` to the coarse path."""
        if len(sequence.turns) > 2 * _IN_NEED:
            return None
        end = self._arcs[last - 1].end if last < len(self._arcs) else self._goal
        members = [[self._first + i for i in piece] for piece in sequence.members]
        known = all(self._guide[piece[0]] is not None for piece in members)
        guide = self._guide if known else self._arcs
        runs = [[arc for arc in (guide[i] for i in piece) if arc is not None] for piece in members]
        rooms = [self._config.max_reverse_m for _ in reverse_legs(sequence)]
        if self._joined and sequence.directions[0] < 0:
            rooms[0] -= self._reversed_m()
        if self._goes_on(last) and sequence.directions[-1] < 0:
            rooms[-1] -= sum(itertools.takewhile(lambda m: m > 0.0, (-length for length in self._lengths[last:])))
        return fit(sequence, runs, self._at, end, self._config.phi_rad_m, self._corridor, rooms)

    def _reversed_m(self) -> float:
        """How far the last pieces go in reverse [m]."""
        total = 0.0
        for piece in reversed(self.pieces):
            if piece.direction > 0:
                break
            total += piece.length_m
        return total

    def _keep(self, sequence: HeadingSequence, path: Path, last: int) -> None:
        """Take over the first pieces of a window, or all of the last one."""
        n = len(path.pieces)
        kept = n if last == len(self._arcs) else max(1, n - _OVERLAP)
        self.pieces += path.pieces[:kept]
        self._tail, self._tail_last = list(path.pieces[kept:]), last
        if kept == n:
            self._at, self._joined, next_ = path.end, self._goes_on(last), last
        else:
            self._at, self._joined = path.pieces[kept].start, sequence.joints[kept - 1]
            next_ = self._first + sequence.members[kept][0]
        self._guide[self._first : last] = [None] * (last - self._first)
        for piece, members in zip(path.pieces[kept:], sequence.members[kept:]):
            self._guide[self._first + members[0]] = piece
        self._first = next_

    def _take_arcs(self) -> None:
        """Take over the arcs and lines of the next piece, between which the base stops."""
        sequence = self._sequence(len(self._arcs), self._breaks[0])
        count = len(self._arcs) - self._first if sequence is None else sequence.members[0][-1] + 1
        self.pieces += self._arcs[self._first : self._first + count]
        self._first += count
        self._at, self._joined = self.pieces[-1].end, False
