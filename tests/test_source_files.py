"""Files of packages, and files of a known hash."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError
from pathlib import Path

import pytest

from isi.errors import InputError
from isi.sources import _houses, _recording, behavior
from isi.sources._files import check_sha256


@pytest.mark.parametrize(
    ("find", "expected"),
    [
        (lambda: behavior.locate("package"), "package bddl: not installed, which has the scenes"),
        (lambda: _recording.locate("recording"), "package procthor: not installed, which has the recording"),
        (_houses.asset_types, "package procthor: not installed, which has the assets"),
    ],
)
def test_a_package_must_be_there_to_be_read(
    monkeypatch: pytest.MonkeyPatch, find: Callable[[], object], expected: str
) -> None:
    def absent(_name: str) -> None:
        raise PackageNotFoundError

    monkeypatch.setattr("isi.sources._files.distribution", absent)
    with pytest.raises(InputError, match=expected):
        find()


def test_a_file_is_read_from_its_start_when_its_hash_is_checked(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"content")
    with path.open("rb") as file:
        for expected in (None, hashlib.sha256(b"content").hexdigest()):
            check_sha256(path, file, expected)
            assert file.tell() == 0
        with pytest.raises(InputError, match=f"file: expected {'0' * 64} as its sha256, got "):
            check_sha256(path, file, "0" * 64)
