"""A stand-in for the few names of rclpy and std_msgs that examples/ros2_node.py uses:
topics in one process.

``spin`` delivers the messages that were published, in their order, calls each timer as often as
there are messages, and then raises what rclpy raises when ROS is shut down from outside.
"""

from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass
from types import ModuleType
from typing import Any


@dataclass
class String:
    data: str = ""


class ExternalShutdownException(Exception):
    pass


class Bus:
    """Subscriptions by topic, waiting messages, and all that were delivered by topic."""

    def __init__(self) -> None:
        self.subscribed: dict[str, list[Callable[[Any], None]]] = defaultdict(list)
        self.waiting: list[tuple[str, Any]] = []
        self.delivered: dict[str, list[Any]] = defaultdict(list)
        self.timers: list[Callable[[], object]] = []
        self.running = False

    def publish(self, topic: str, message: Any) -> None:
        assert isinstance(message, String)
        assert isinstance(message.data, str)
        self.waiting.append((topic, message))

    def spin(self, node: Any) -> None:
        assert self.running
        assert isinstance(node, self.node())
        while self.waiting:
            topic, message = self.waiting.pop(0)
            self.delivered[topic].append(message)
            for callback in self.subscribed[topic]:
                callback(message)
            for callback in self.timers:
                callback()
        raise ExternalShutdownException

    def node(self) -> type:
        return self.modules()["rclpy.node"].Node  # type: ignore[no-any-return]

    def modules(self) -> dict[str, ModuleType]:
        """The modules by name, for ``sys.modules``."""
        if "made" in vars(self):
            return self.made
        bus = self

        class Publisher:
            def __init__(self, topic: str) -> None:
                self.topic = topic

            def publish(self, message: Any) -> None:
                bus.publish(self.topic, message)

        class Node:
            def __init__(self, _: str) -> None:
                assert bus.running

            def create_publisher(self, kind: type, topic: str, _: int) -> Publisher:
                assert kind is String
                return Publisher(topic)

            def create_subscription(
                self, kind: type, topic: str, callback: Callable[[Any], None], _: int
            ) -> None:
                assert kind is String
                bus.subscribed[topic].append(callback)

            def create_timer(self, _: float, callback: Callable[[], object]) -> None:
                bus.timers.append(callback)

        self.made = {
            name: ModuleType(name)
            for name in ("rclpy", "rclpy.node", "rclpy.executors", "std_msgs", "std_msgs.msg")
        }
        vars(self.made["rclpy"]).update(
            init=lambda: vars(self).update(running=True),
            try_shutdown=lambda: vars(self).update(running=False),
            spin=self.spin,
        )
        vars(self.made["rclpy.node"])["Node"] = Node
        vars(self.made["rclpy.executors"])["ExternalShutdownException"] = ExternalShutdownException
        vars(self.made["std_msgs.msg"])["String"] = String
        return self.made
