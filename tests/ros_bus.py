"""A stand-in for the few names of rclpy, std_msgs and std_srvs that examples/ros2_node.py uses:
topics and services in one process.

``spin`` delivers what was published and called, in its order, to a thread for each callback group,
until nothing is left; then it raises what rclpy raises when ROS is shut down from outside.
"""

from collections import defaultdict
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from types import ModuleType
from typing import Any

Callback = Callable[..., Any]


@dataclass
class String:
    data: str = ""


class Trigger:
    """The type of a service without a request."""

    class Request:
        pass

    @dataclass
    class Response:
        success: bool = False
        message: str = ""


class ExternalShutdownException(Exception):
    pass


class MutuallyExclusiveCallbackGroup(ThreadPoolExecutor):
    """One thread, in which callbacks follow each other."""

    def __init__(self) -> None:
        super().__init__(1)


@dataclass
class Value:
    value: str


@dataclass
class Bus:
    """Topics and services by their full names, and what waits and was delivered."""

    namespace: str = ""
    parameters: dict[str, str] = field(default_factory=dict)
    subscribed: dict[str, list[tuple[Callback, ThreadPoolExecutor]]] = field(
        default_factory=lambda: defaultdict(list)
    )
    services: dict[str, tuple[Callback, ThreadPoolExecutor]] = field(default_factory=dict)
    waiting: list[tuple[str, Any]] = field(default_factory=list)
    delivered: dict[str, list[Any]] = field(default_factory=lambda: defaultdict(list))
    running: bool = False

    def publish(self, topic: str, message: Any) -> None:
        assert isinstance(message, String)
        assert isinstance(message.data, str)
        self.waiting.append((topic, message))

    def call(self, service: str) -> None:
        self.waiting.append((service, Trigger.Request()))

    def spin(self) -> None:
        assert self.running
        while self.waiting:
            waiting, self.waiting = self.waiting, []
            done = list[Future[Any]]()
            for name, message in waiting:
                self.delivered[name].append(message)
                for callback, group in self.subscribed[name]:
                    done.append(group.submit(callback, message))
                if name in self.services:
                    callback, group = self.services[name]
                    response = group.submit(callback, message, Trigger.Response())
                    self.delivered[name].append(response)
            for each in done:
                each.result()
        raise ExternalShutdownException

    def modules(self) -> dict[str, ModuleType]:
        """The modules by name, for ``sys.modules``."""
        bus = self

        class Node:
            def __init__(self, _: str) -> None:
                assert bus.running

            def declare_parameter(self, name: str, default: str) -> Value:
                return Value(bus.parameters.get(name, default))

            def create_publisher(self, kind: type, topic: str, _: int) -> Any:
                assert kind is String
                publisher = ModuleType("publisher")
                vars(publisher)["publish"] = lambda message: bus.publish(
                    f"{bus.namespace}/{topic}", message
                )
                return publisher

            def create_subscription(
                self, kind: type, topic: str, callback: Callback, _: int, callback_group: Any
            ) -> None:
                assert kind is String
                bus.subscribed[f"{bus.namespace}/{topic}"].append((callback, callback_group))

            def create_service(
                self, kind: type, name: str, callback: Callback, callback_group: Any
            ) -> None:
                assert kind is Trigger
                bus.services[f"{bus.namespace}/{name}"] = callback, callback_group

        class MultiThreadedExecutor:
            spin = bus.spin

            def __init__(self, num_threads: int) -> None:
                assert num_threads > 1

            def add_node(self, node: Any) -> None:
                assert isinstance(node, Node)

        names: dict[str, dict[str, Any]] = {
            "rclpy": {
                "init": lambda: vars(bus).update(running=True),
                "try_shutdown": lambda: vars(bus).update(running=False),
            },
            "rclpy.node": {"Node": Node},
            "rclpy.callback_groups": {
                "MutuallyExclusiveCallbackGroup": MutuallyExclusiveCallbackGroup
            },
            "rclpy.executors": {
                "ExternalShutdownException": ExternalShutdownException,
                "MultiThreadedExecutor": MultiThreadedExecutor,
            },
            "std_msgs": {},
            "std_msgs.msg": {"String": String},
            "std_srvs": {},
            "std_srvs.srv": {"Trigger": Trigger},
        }
        made = {name: ModuleType(name) for name in names}
        for name, content in names.items():
            vars(made[name]).update(content)
        return made
