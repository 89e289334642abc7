"""The client and the ROS 2 node of examples/, and the code of docs/live.md:
one talks to a process, another to a stand-in for rclpy.
"""

import json
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

import isi
from tests.live_processes import connect, socket_of
from tests.ros_bus import Bus, String
from tests.small_bundle import home_of, without_words

EXAMPLES = Path(__file__).parent.parent / "examples"
MACHINE = "espresso machine"


@pytest.fixture
def home(tmp_path: Path) -> Path:
    return home_of(tmp_path / "home", without_words())


def test_the_client_tells_and_asks(home: Path, tmp_path: Path) -> None:
    path = tmp_path / "socket"
    with socket_of(home, path):
        connect(path)
        client = subprocess.run(
            [sys.executable, EXAMPLES / "live_client.py", path], capture_output=True, check=True
        )
    updated, found = client.stdout.decode().splitlines()
    assert updated == "['espresso machine']"
    assert found.startswith("['turn on'")
    assert [change.verb for change in isi.open(home).history()] == ["tell", "tell", "undo"]


def test_the_ros_node_answers_on_a_topic_and_by_a_service(
    home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bus = Bus("/robot", {"home": str(home)})
    for name, module in bus.modules().items():
        monkeypatch.setitem(sys.modules, name, module)
    requests = [
        ("facts", {"tell": [[MACHINE, "atLocation", "kitchen"]], "id": 1}),
        ("facts", {"tell": [[MACHINE, "hasAffordance", "turn on"]], "id": 2}),
        ("facts", {"ask": [MACHINE], "id": 3}),
        ("other", {"undo": True}),
    ]
    for topic, request in requests:
        bus.publish(f"/robot/{topic}", String(json.dumps(request)))
    bus.publish("/robot/ask", String("no JSON"))
    bus.call("/robot/undo")
    runpy.run_path(str(EXAMPLES / "ros2_node.py"), run_name="__main__")
    answers = [json.loads(message.data) for message in bus.delivered["/robot/answers"]]
    by_id = {found.get("id"): found for found in answers}
    assert (by_id[1]["inserted"], by_id[2]["updated"]) == ([MACHINE], [MACHINE])
    assert "error" in by_id[3]
    assert list(by_id[None]) == ["error"]
    _, undone = bus.delivered["/robot/undo"]
    assert undone.result().success
    assert json.loads(undone.result().message)["updated"] == [MACHINE]
    assert not bus.running
    with isi.open(home) as again:
        assert [row.fact for row in again.facts()[4:]] == [(MACHINE, "atLocation", "kitchen")]
