"""The condition of a node's components, as /diagnostics."""

import threading
from collections.abc import Container

import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from vsx_hw.errors import DeviceError
from vsx_hw.readings import LinkStatus
from vsx_ros.ros import threads, topics

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


class Diagnostics:
    """Publishes the last known condition of the node's components once a second (REP 107), an error at once."""

    def __init__(self, hardware_id: str = "") -> None:
        self._hardware_id = hardware_id or rospy.get_name()
        self._components: dict[str, tuple[int, str, dict[str, str]]] = {}
        self._lock = threading.Lock()
        self._publisher = rospy.Publisher(topics.DIAGNOSTICS, DiagnosticArray, queue_size=5)
        threads.every(1.0, "diagnostics", self._publish)

    def set(self, component: str, level: int, message: str, **values: object) -> None:
        """Replace what is known of a component; ``values`` become key-value strings."""
        with self._lock:
            before = self._components.get(component)
            self._components[component] = (level, message, {k: str(v) for k, v in values.items()})
        if level == ERROR and before is not None and before[0] != ERROR:
            self._publish({component})

    def device(self, component: str, status: LinkStatus, **values: object) -> None:
        """The link to a device. Raises DeviceError, which ends the node, where the driver's thread has ended."""
        if not status.alive:
            raise DeviceError(f"{status.device}: the driver's thread has ended; the node begins anew")
        level = OK if status.connected else ERROR
        self.set(component, level, status.message, device=status.device, **values, **status.counters)

    def _publish(self, only: Container[str] | None = None) -> None:
        array = DiagnosticArray()
        array.header.stamp = rospy.Time.now()
        node = rospy.get_name().lstrip("/")
        with self._lock:
            for component, (level, message, values) in self._components.items():
                if only is not None and component not in only:
                    continue
                pairs = [KeyValue(key, value) for key, value in values.items()]
                array.status.append(DiagnosticStatus(level, f"{node}: {component}", message, self._hardware_id, pairs))
        self._publisher.publish(array)
