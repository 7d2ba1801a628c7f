"""An emulated battery: charge counted from the current, voltage from the charge and the current."""

from typing import NamedTuple


class Cells(NamedTuple):
    """One kind of battery. Open-circuit voltage runs linearly from empty to full. idle_a: drawn by base, camera and
    computer at rest; drive_a_s_m: in addition, per m/s of the faster wheel; charge_a: what the dock delivers."""

    capacity_ah: float
    empty_v: float
    full_v: float
    resistance_ohm: float
    idle_a: float
    drive_a_s_m: float
    charge_a: float


# Kobuki: 2.2 Ah last three hours, charging takes an hour and a half. Create: 3 Ah, two to three hours each.
KOBUKI_CELLS = Cells(
    capacity_ah=2.2, empty_v=13.2, full_v=16.5, resistance_ohm=0.1, idle_a=0.6, drive_a_s_m=0.8, charge_a=1.5
)
CREATE_CELLS = Cells(
    capacity_ah=2.7, empty_v=13.0, full_v=16.2, resistance_ohm=0.1, idle_a=0.8, drive_a_s_m=1.0, charge_a=1.3
)
TRICKLE_A = 0.05  # into a full battery


class EmulatedBattery:
    """fraction in [0, 1] may be set. pace: how many times faster than a real one it drains and charges."""

    def __init__(self, cells: Cells, fraction: float = 0.9) -> None:
        self._cells, self.fraction, self.pace = cells, fraction, 1.0
        self.current_a = -cells.idle_a
        """Positive: into the battery."""
        self._then_ns: int | None = None

    def advance(self, time_ns: int, wheel_m_s: float, charger: bool) -> None:
        """Let time pass until time_ns with this speed of the faster wheel. charger: one delivers current."""
        cells = self._cells
        delivered = (cells.charge_a if self.fraction < 1.0 else TRICKLE_A) if charger else 0.0
        drawn = cells.idle_a + cells.drive_a_s_m * abs(wheel_m_s)
        self.current_a = delivered if charger else -drawn
        if self._then_ns is not None:
            hours = max(0, time_ns - self._then_ns) / 3.6e12 * self.pace
            self.fraction = min(1.0, max(0.0, self.fraction + hours * self.current_a / cells.capacity_ah))
        self._then_ns = time_ns

    @property
    def voltage_v(self) -> float:
        """At the terminals."""
        cells = self._cells
        return cells.empty_v + self.fraction * (cells.full_v - cells.empty_v) + self.current_a * cells.resistance_ohm

    @voltage_v.setter
    def voltage_v(self, volt: float) -> None:
        """Set the charge that goes with it."""
        cells = self._cells
        self.fraction = (volt - self.current_a * cells.resistance_ohm - cells.empty_v) / (cells.full_v - cells.empty_v)

    @property
    def charge_mah(self) -> int:
        """What is left."""
        return round(1000.0 * self.fraction * self._cells.capacity_ah)

    @property
    def capacity_mah(self) -> int:
        """What a full one holds."""
        return round(1000.0 * self._cells.capacity_ah)
