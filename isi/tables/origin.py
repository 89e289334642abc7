"""Whether files are what the stages that write them would write now, as far as their metadata tells."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from isi.errors import InputError
from isi.pipeline import declared, made_files, maker_now
from isi.tables import paths, provenance
from isi.tables.provenance import CONTENT, OWN, STAGE, inputs_of, metadata_of

#: Of files that bear metadata, but for kept embeddings, whose tensors bear none.
SUFFIXES = (".parquet", ".safetensors")


class PipelineOrigins:
    """By what ``dvc.yaml`` and ``params.yaml`` say now, of either pipeline."""

    def __init__(self, everything: Mapping[str, Any]) -> None:
        """``everything``: what ``params.yaml`` holds."""
        self._everything = everything
        self._faults: dict[Path, InputError | None] = {}

    def check(self, path: Path) -> None:
        """See that a file is of its stage, its params, and the inputs beside it, and that these are likewise.

        Raises:
            InputError: naming the file that is not. A file that no stage writes is not asked for, nor an input that is
                not there.
        """
        fault = self.fault(path)
        if fault:
            raise fault

    def check_first(self) -> None:
        """The same of all that the first pipeline has written but kept embeddings, which no stage of it reads."""
        for path, made in made_files(self._everything):
            kept = path.is_relative_to(paths.KEPT)
            if made.pipeline == paths.PIPELINE and path.suffix in SUFFIXES and not kept:
                self.check(path)

    def fault(self, path: Path) -> InputError | None:
        """The same as a value."""
        if path not in self._faults:
            self._faults[path] = None  # where a file says that it was made from itself
            try:
                self._faults[path] = self._found(path)
            except InputError as error:
                self._faults[path] = error
        return self._faults[path]

    def _found(self, path: Path) -> InputError | None:
        made = maker_now(path, self._everything)
        if made is None:
            return None
        metadata = metadata_of(path)
        if metadata.get(STAGE) != made.stage:
            got = metadata.get(STAGE, "none")
            return InputError(path, "", f"expected what stage {made.stage} writes, got that of {got}: {_anew(made)}")
        beside = {Path(name): digest for name, digest in inputs_of(metadata).items() if Path(name).exists()}
        for path_of_input in beside:
            if (fault := self.fault(path_of_input)) is not None:
                return fault
        if metadata.get(OWN) != provenance.own(made.stage, declared(made.stage, made.arguments, self._everything)):
            expected = f"was made under other params than there are now: {_anew(made)} (--force, if DVC finds none)"
            return InputError(path, "", expected)
        for path_of_input, digest in beside.items():
            if metadata_of(path_of_input).get(CONTENT) != digest:
                return InputError(path, "", f"was made from another {path_of_input} than is there: {_anew(made)}")
        return None


def _anew(made: object) -> str:
    return f"run `dvc repro {made}`"
