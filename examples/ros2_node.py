"""A ROS 2 node with a live embedding: python examples/ros2_node.py FOLDER

The topics carry ``std_msgs/String`` with a request or an answer of docs/live.md in JSON. Changes
come on /isi/facts and queries on /isi/ask, so that a bag of /isi/facts alone can be played again;
the answers to both leave on /isi/answers, with the ``id`` of the request. The node has been tested
with a stand-in for rclpy (tests/ros_bus.py), not with ROS 2.
"""

import sys
from contextlib import suppress

import rclpy
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from std_msgs.msg import String

import isi
from isi.live.stream import answer, take_step

WAITING = 100  #: Messages that may wait on a topic.


class LiveNode(Node):
    """Answers the requests of two topics on a third one.
    Its callbacks run one at a time, as rclpy's default is.
    """

    def __init__(self, home: isi.LiveEmbedding) -> None:
        super().__init__("isi")
        self.home = home
        self.answers = self.create_publisher(String, "/isi/answers", WAITING)
        for topic in ("/isi/facts", "/isi/ask"):
            self.create_subscription(String, topic, self.respond, WAITING)
        steps = home.groups.preparation()
        self.create_timer(0.1, lambda: take_step(steps))

    def respond(self, request: String) -> None:
        """Publish the answer to a request; a change is in the journal by then."""
        self.answers.publish(
            String(data=answer(self.home, request.data.encode(errors="replace")).decode().rstrip())
        )


def main() -> None:
    rclpy.init()
    stopped = KeyboardInterrupt, ExternalShutdownException
    with isi.open(sys.argv[1], journal=True) as home, suppress(*stopped):
        rclpy.spin(LiveNode(home))
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
