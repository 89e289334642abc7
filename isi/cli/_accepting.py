"""What a user has edited on purpose becomes what its stage wrote, as far as stages can tell."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path

from isi.cli._checking import Checking, is_tensors, schema_of
from isi.errors import InputError, NotAsWritten
from isi.pipeline import Maker, declared, dependencies, maker_now
from isi.process import only_one
from isi.tables import io
from isi.tables.content import digest_of_table, digest_of_tensors
from isi.tables.origin import SUFFIXES
from isi.tables.provenance import ACCEPTED, CONTENT, OWN, Metadata, Provenance, metadata_of


def accept(files: Sequence[Path], checking: Checking) -> Iterator[str]:
    """Write the digest of each file's values anew; what DVC makes of that, file by file.

    Raises:
        InputError: where one is no table or tensors of the pipeline, or breaks a rule, by itself or beside others of
            its experiment, or one of these was edited, too; then all stay as they were.
    """
    made = {path: _made(path, checking) for path in files}
    with ExitStack() as held:
        for stage in sorted(set(map(_held, made.values()))):
            held.enter_context(only_one(stage))
        _write_all(made, checking)
    for stage in dict.fromkeys(map(str, made.values())):
        names = ", ".join(str(path) for path, by in made.items() if str(by) == stage)
        yield f"{names}: accepted. `dvc commit --force {stage}` makes DVC keep it, until it runs that stage again"
    yield "`dvc repro` then runs what depends on it; without the commit, it would undo the edit first"


def _held(by: Maker) -> str:
    """What a stage holds while it runs (``isi.stage``)."""
    return "@".join(filter(None, [by.stage, "-".join(by.arguments.values())]))


def _write_all(made: Mapping[Path, Maker], checking: Checking) -> None:
    """All of them or none."""
    before = {path: path.read_bytes() for path in made}
    try:
        for path, by in made.items():
            _write(path, by, checking)
        for experiment in sorted({by.arguments["experiment"] for by in made.values() if "experiment" in by.arguments}):
            for finding in checking.between(experiment):
                if Path(finding.args[0]) in made or isinstance(finding, NotAsWritten):
                    raise finding
    except BaseException:
        for path, content in before.items():
            io.atomically(path, lambda temporary, content=content: temporary.write_bytes(content))  # type: ignore[misc]
        raise


def _made(path: Path, checking: Checking) -> Maker:
    by = maker_now(path, checking.everything)
    if not path.is_file():
        raise InputError(path, "", "no such file" if by is None else f"no such file: `dvc repro {by}` makes it")
    if by is None or not (schema_of(path) or is_tensors(path)):
        raise InputError(path, "", "expected a table or tensors of the pipeline, as a stage writes it")
    return by


def _write(path: Path, by: Maker, checking: Checking) -> None:
    schema, stated = schema_of(path), metadata_of(path)
    metadata = dict(stated if OWN in stated else _metadata(by, checking))
    if schema:
        table, _ = io.opened(path, schema)
        if stated.get(CONTENT) == digest_of_table(table, schema.columns):
            return
        metadata[ACCEPTED] = stated.get(ACCEPTED, stated.get(CONTENT, ""))
        io.write_table(path, table, schema, metadata)
        return
    tensors, _ = io.opened_tensors(path)
    io.check_finite(path, tensors)
    if stated.get(CONTENT) != digest_of_tensors(tensors):
        metadata[ACCEPTED] = stated.get(ACCEPTED, stated.get(CONTENT, ""))
        io.write_tensors_with(path, tensors, metadata)


def _metadata(by: Maker, checking: Checking) -> Metadata:
    """Of a file that another program has written, and that says nothing of itself: as its stage would say it now."""
    provenance = Provenance(by.stage, declared(by.stage, by.arguments, checking.everything))
    for listed in map(Path, dependencies(by)):
        for path in sorted(listed.rglob("*")) if listed.is_dir() else [listed]:
            if path.suffix in SUFFIXES and CONTENT in (metadata := metadata_of(path)):
                provenance.seen(path, metadata)
    return provenance.metadata()
