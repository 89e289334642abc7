"""The client and the ROS 2 node of examples/:
one talks to a process, the other to a stand-in for rclpy.
"""

import json
import runpy
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import isi
from tests.documented import blocks
from tests.live_processes import connect, socket_of
from tests.ros_bus import Bus, String
from tests.small_bundle import TRIPLES, without_words, written

EXAMPLES = Path(__file__).parent.parent / "examples"


def test_the_client_inserts_observes_and_asks(tmp_path: Path) -> None:
    home, path = written(tmp_path / "home", without_words()), tmp_path / "socket"
    with socket_of(home, path):
        connect(path)
        client = subprocess.run(
            [sys.executable, EXAMPLES / "live_client.py", path], capture_output=True, check=True
        )
    updated, found = client.stdout.decode().splitlines()
    assert updated == "['espresso machine']"
    assert found.startswith("['turn on'")
    assert [change.do for change in isi.open(home).history] == ["insert", "observe", "undo"]


def test_the_code_of_the_page_runs_as_it_stands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written(tmp_path / "home", without_words())
    monkeypatch.chdir(tmp_path)
    left: dict[str, Any] = {}
    first, second = blocks("live.md", "python")
    exec(compile(first, "first block", "exec"), left)  # noqa: S102
    assert left["answers"].answers[0].given
    exec(compile(second, "second block", "exec"), left)  # noqa: S102
    assert (
        left["facts"]
        == left["triples"][len(TRIPLES) :]
        == [("espresso machine", "atLocation", "kitchen")]
    )
    assert len(left["changes"]) == 3


def test_the_ros_node_answers_on_a_topic(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    home, bus = written(tmp_path / "home", without_words()), Bus()
    for name, module in bus.modules().items():
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.setattr(sys, "argv", ["ros2_node.py", str(home)])
    requests = [
        (
            "/isi/facts",
            {
                "insert": "espresso machine",
                "facts": [["espresso machine", "atLocation", "kitchen"]],
                "id": 1,
            },
        ),
        ("/isi/ask", {"ask": ["espresso machine", "atLocation", None], "top": 1, "id": 2}),
        ("/isi/ask", {"ask": ["espresso machine"], "id": 3}),
        ("/isi/other", {"undo": True}),
    ]
    for topic, request in requests:
        bus.publish(topic, String(json.dumps(request)))
    bus.publish("/isi/facts", String("no JSON"))
    runpy.run_path(str(EXAMPLES / "ros2_node.py"), run_name="__main__")
    inserted, found, refused, broken = (
        json.loads(message.data) for message in bus.delivered["/isi/answers"]
    )
    assert (inserted["id"], inserted["inserted"]) == (1, ["espresso machine"])
    assert (found["id"], found["answers"][0]["entity"], found["answers"][0]["given"]) == (
        2,
        "kitchen",
        True,
    )
    assert (refused["id"], list(broken)) == (3, ["error"])
    assert not bus.running
    with isi.open(home, journal=True) as again:  # the node has left it
        assert again.inserted.keys() == {"espresso machine"}
