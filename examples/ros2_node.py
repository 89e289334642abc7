"""A ROS 2 node with a home: ``python examples/ros2_node.py --ros-args -p home:=FOLDER``

``std_msgs/String`` carries the requests and answers of docs/live.md in JSON: changes come on the
topic ``facts`` and questions on ``ask``, so that a bag of ``facts`` alone can be played again; the
answers leave on ``answers``, with the ``id`` of the request. (A service with a text in its request
needs a package of its own with its ``.srv``.) The service ``undo``, a ``std_srvs/Trigger``, takes
the last change back. All names are relative: a namespace or a remapping moves them.

Parameter: ``home``, the folder.

The node was run with a stand-in for rclpy that delivers messages within one process
(tests/ros_bus.py). It was not run with ROS 2: quality of service, executors and shutdown are as its
documentation says.
"""

import json
from collections.abc import Sequence
from contextlib import suppress
from functools import partial

import rclpy
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
from rclpy.node import Node
from std_msgs.msg import String
from std_srvs.srv import Trigger

import isi
from isi.home.stream import answer, prepared_beside

WAITING = 100  #: Messages that may wait on a topic.
#: The verbs of each topic, so that ``facts`` has all changes.
VERBS = {
    "facts": ("tell", "move", "remove", "undo"),
    "ask": ("ask", "facts", "nearest", "explain", "history", "stale"),
}


class LiveNode(Node):
    """Changes wait for each other, and so do questions; the executor has a thread for each of these
    groups, so that no callback keeps the node from receiving.
    """

    def __init__(self) -> None:
        super().__init__("isi")
        folder = self.declare_parameter("home", "home").value
        self.home = isi.open(folder)
        self.answers = self.create_publisher(String, "answers", WAITING)
        changes, questions = MutuallyExclusiveCallbackGroup(), MutuallyExclusiveCallbackGroup()
        for topic, group in (("facts", changes), ("ask", questions)):
            respond = partial(self.respond, VERBS[topic])
            self.create_subscription(String, topic, respond, WAITING, callback_group=group)
        self.create_service(Trigger, "undo", self.undo, callback_group=changes)

    def respond(self, verbs: Sequence[str], request: String) -> None:
        """Publish the answer to a request; a change is stored by then."""
        found = answer(self.home, request.data.encode(errors="replace"), verbs)
        self.answers.publish(String(data=found.decode().rstrip()))

    def undo(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        """Take the last change back; the message is the answer in JSON."""
        response.message = answer(self.home, json.dumps({"undo": True}).encode()).decode().rstrip()
        response.success = "error" not in json.loads(response.message)
        return response


def main() -> None:
    rclpy.init()
    node, executor = LiveNode(), MultiThreadedExecutor(num_threads=2)
    executor.add_node(node)
    stopped = suppress(KeyboardInterrupt, ExternalShutdownException)
    with node.home, prepared_beside(node.home), stopped:
        executor.spin()
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
