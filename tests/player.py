"""A substitute for the simulator's player: it speaks its protocol over HTTP, with recorded scenes.

It is a separate program (``install`` writes it), which the simulator's own controller starts.
"""

import json
import os
import random
import shlex
import sys
import time
from collections.abc import Mapping, Sequence
from http.client import HTTPConnection
from itertools import pairwise
from pathlib import Path
from typing import Any

BOUNDARY = "a-line-that-is-in-no-message"


def install(
    folder: Path, scenes: Mapping[str, object], *misbehaviours: Mapping[str, object]
) -> Path:
    """Write the program of a player.

    Args:
        folder: folder of the program and its data.
        scenes: objects by floor plan.
        misbehaviours: each with the key ``at``, an action (``Start``: before the first), and
            ``does``: ``die``, ``hang``, or ``fail`` with a ``code`` and a ``message``. Optional:
            ``scene``, the only scene of it, and ``times``, its maximum number.

    Returns:
        the program, which appends each action that it receives to the file ``actions`` in its
        folder.
    """
    folder.mkdir(parents=True, exist_ok=True)
    known = {"scenes": scenes, "misbehaviours": [dict(one) for one in misbehaviours]}
    (folder / "known.json").write_text(json.dumps(known), encoding="utf-8")
    program = folder / "player"
    command = shlex.join([sys.executable, "-S", __file__, str(folder)])
    site = os.pathsep.join(path for path in sys.path if path.endswith("site-packages"))
    program.write_text(
        f'#!/bin/sh\nPYTHONPATH={shlex.quote(site)} exec {command} "$@"\n', encoding="utf-8"
    )
    program.chmod(0o755)
    return program


def actions(folder: Path) -> list[str]:
    """Lines of all actions that a player received:
    name, floor plan (empty before the first), process id.
    """
    return (folder / "actions").read_text(encoding="utf-8").splitlines()


class Player:
    """State and behaviour of a player, independent of the connection."""

    def __init__(self, folder: Path, arguments: Sequence[str]) -> None:
        known = json.loads((folder / "known.json").read_text(encoding="utf-8"))
        self.folder, self.scenes, self.misbehaviours = (
            folder,
            known["scenes"],
            known["misbehaviours"],
        )
        options = dict(pairwise(arguments))
        self.width, self.height = int(options["-screen-width"]), int(options["-screen-height"])
        self.scene, self.objects = "", []
        self.sequence = 0

    def answer(self, action: Mapping[str, Any]) -> dict[str, Any]:
        """Metadata after an action."""
        name, returned = action["action"], None
        self.sequence = action["sequenceId"]
        if name == "Reset":
            self.scene = action["sceneName"]
            self.objects = self.scenes.get(self.plan, [])
        with (self.folder / "actions").open("a", encoding="utf-8") as file:
            file.write(f"{name} {self.plan} {os.getpid()}\n")
        if name == "ChangeResolution":
            self.width, self.height = action["x"], action["y"]
        elif name == "GetScenesInBuild":
            returned = [
                plan + "_physics" * plan.removeprefix("FloorPlan").isdigit() for plan in self.scenes
            ]
        elif name == "InitialRandomSpawn":
            self.objects = spawned(self.objects, action["randomSeed"])
        return self.metadata(name, returned, self.misbehave(name))

    @property
    def plan(self) -> str:
        return self.scene.removesuffix("_physics")

    def metadata(
        self, action: str = "", returned: object = None, failed: Mapping[str, Any] | None = None
    ) -> dict[str, Any]:
        agent = {
            "sceneName": self.scene,
            "screenWidth": self.width,
            "screenHeight": self.height,
            "lastAction": action,
            "lastActionSuccess": failed is None,
            "errorCode": (failed or {}).get("code", ""),
            "errorMessage": (failed or {}).get("message", ""),
            "actionReturn": returned,
            "thirdPartyCameras": [],
            "objects": self.objects,
        }
        return {"sequenceId": self.sequence, "activeAgentId": 0, "agents": [agent]}

    def hello(self) -> dict[str, Any]:
        """Metadata of the first message."""
        self.misbehave("Start")
        return self.metadata("", None, None)

    def misbehave(self, action: str) -> Mapping[str, Any] | None:
        """Do the misbehaviour that is due at an action: die, hang, or return the failure;
        None if none is due.
        """
        for place, one in enumerate(self.misbehaviours):
            log = self.folder / f"misbehaved-{place}"
            times = log.stat().st_size if log.exists() else 0
            if (
                one["at"] != action
                or one.get("scene", self.plan) != self.plan
                or times >= one.get("times", times + 1)
            ):
                continue
            with log.open("a", encoding="utf-8") as file:
                file.write(".")
            if one["does"] == "die":
                os._exit(3)
            if one["does"] == "hang":
                parent = os.getppid()
                while os.getppid() == parent:
                    time.sleep(0.05)
                os._exit(0)
            return dict(one)
        return None

    @property
    def image(self) -> bytes:
        return bytes(3 * self.width * self.height)


def spawned(objects: Sequence[dict[str, Any]], seed: int) -> list[dict[str, Any]]:
    """The objects, with the receptacles of those that can be picked up shuffled among them."""
    moved = [place for place, thing in enumerate(objects) if thing.get("pickupable")]
    places = [objects[place].get("parentReceptacles") for place in moved]
    random.Random(seed).shuffle(places)
    new = dict(zip(moved, places, strict=True))
    return [
        {
            **thing,
            "parentReceptacles": new.get(place, thing.get("parentReceptacles")),
            "receptacleObjectIds": None,
        }
        for place, thing in enumerate(objects)
    ]


def over_http(player: Player) -> None:
    """Post each answer; the response holds the next action."""
    metadata = player.hello()
    while True:
        connection = HTTPConnection(os.environ["AI2THOR_HOST"], int(os.environ["AI2THOR_PORT"]))
        kind = f"multipart/form-data; boundary={BOUNDARY}"
        connection.request("POST", "/train", form(metadata, player.image), {"Content-Type": kind})
        action = json.loads(connection.getresponse().read())
        connection.close()
        if "action" not in action:
            return
        metadata = player.answer(action)


def form(metadata: Mapping[str, Any], image: bytes) -> bytes:
    """An answer as a multipart form; the controller requires this spelling of the headers."""
    texts = {"metadata": json.dumps(metadata), "token": os.environ["AI2THOR_CLIENT_TOKEN"]}
    part = (
        f"--{BOUNDARY}\r\nContent-Type: text/plain; charset=utf-8\r\n"
        "Content-disposition: form-data; name="
    )
    parts = [f'{part}"{name}"\r\n\r\n{text}\r\n' for name, text in texts.items()]
    frame = (
        f"--{BOUNDARY}\r\nContent-Type: image/raw\r\n"
        'Content-disposition: form-data; name="image"; filename="image"'
    )
    return (
        "".join(parts).encode()
        + f"{frame}\r\n\r\n".encode()
        + image
        + f"\r\n--{BOUNDARY}--\r\n".encode()
    )


def main() -> None:
    folder, *arguments = sys.argv[1:]
    player = Player(Path(folder), arguments)
    over_http(player)


if __name__ == "__main__":
    main()
