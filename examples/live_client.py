"""A client of ``isi live home --socket /tmp/home.socket``:
python examples/live_client.py /tmp/home.socket
"""

# %%
import json
import socket
import sys
from typing import Any


class Home:
    """A connection to a home: each call sends a request, and returns its answer."""

    def __init__(self, path: str) -> None:
        connection = socket.socket(socket.AF_UNIX)
        connection.connect(path)
        self.lines = connection.makefile("rw", encoding="utf-8")

    def __call__(self, **request: Any) -> dict[str, Any]:
        self.lines.write(json.dumps(request) + "\n")
        self.lines.flush()
        answer: dict[str, Any] = json.loads(self.lines.readline())
        if "error" in answer:
            raise ValueError(answer["error"])
        return answer


# %%
home = Home(sys.argv[1])
home(tell=[["espresso machine", "atLocation", "kitchen"]])
print(home(tell=[["espresso machine", "hasAffordance", "turn on"]])["updated"])
found = home(ask=["espresso machine", "hasAffordance", None], top=3)
print([answer["entity"] for answer in found["answers"]] if found["sure"] else "not sure")
home(undo=True)
