"""The operator holds the wheels of a robot that explores in lock-step: again and again, and nothing is blamed."""

from vsx_ros.config import Config
from vsx_ros.exploration.decision import MissionState
from vsx_ros.robot import EMERGENCY_STOP, STOP, OperatorHold, VelocityCommand
from vsx_ros.sim.generate import generate_world
from vsx_ros.sim.robot import EmulatedRobot, SimulationConfig
from vsx_ros.system import ExplorationSystem

SECOND = 10**9
HELD_NS, PATIENCE_NS = 7 * SECOND, 60 * SECOND
DRIVEN_M = 0.2
TURNING = VelocityCommand(0.0, 0.3)


class Run:
    """An exploration, and the operator's hand on it."""

    def __init__(self) -> None:
        config = Config()
        self.robot = EmulatedRobot(generate_world("lab", 20), 20, SimulationConfig(threads=1), config.robot)
        self.system = ExplorationSystem(self.robot.camera_given, self.robot.T_base_cam_given, config, 20)
        self.wanted, self.now_ns = STOP, 0
        self.driven_m = 0.0
        self.holds: list[tuple[int, int]] = []

    def step(self, obeyed: VelocityCommand, hold: OperatorHold | None = None) -> None:
        before = self.system.odometry.T_odom_base
        frame, odometry = self.robot.step(obeyed)
        self.wanted, self.now_ns = self.system.step(frame, odometry, held=hold).command, frame.stamp_ns
        self.driven_m += before.distance_to(odometry.T_odom_base)

    def explore(self) -> None:
        """Until the robot has driven and drives fast."""
        self.driven_m, since_ns = 0.0, self.now_ns
        mapping = False
        while not mapping or self.driven_m < DRIVEN_M or abs(self.wanted.v) < 0.1:
            self.step(self.wanted)
            mapping = self.system.mission.state is MissionState.MAPPING
            assert self.now_ns < since_ns + PATIENCE_NS

    def hold(self, by: str, obeyed: VelocityCommand) -> None:
        since_ns = self.now_ns
        while self.now_ns < since_ns + HELD_NS:
            self.step(obeyed, OperatorHold(by, since_ns))
            if self.now_ns > since_ns + SECOND:
                assert self.wanted == STOP
                assert self.system.mission.state is MissionState.HELD
        self.holds.append((since_ns, self.now_ns))


def test_emergency_stops_and_teleop_cost_no_goal_and_no_view() -> None:
    run = Run()
    for by, obeyed in ((EMERGENCY_STOP, STOP), ("teleop", TURNING), (EMERGENCY_STOP, STOP)):
        run.explore()
        run.hold(by, obeyed)
    run.explore()
    told = run.system.mission.drain_events()
    # Of some views the planner finds, after seconds, that no way leads there.
    blamed = [event for event in told if event.reason.startswith("goal blacklisted")]
    during = [e for e in blamed for since, until in run.holds if since - SECOND <= e.stamp_ns <= until + SECOND]
    assert during == []
    assert not [event for event in blamed if "no path" not in event.reason]
    assert len(run.system.mission.view_selector.blacklist.left(run.now_ns)) == len(blamed)
    assert sum(event.reason.startswith("the operator holds") for event in told) == 3
