"""Copy the pipeline, with the params of a quick run and any other changes,
into a folder for ``dvc repro``.

A params.yaml in the folder that was edited there stays, with the changes of --set and --drop alone.
"""

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML

from isi.cli import settings
from isi.config import read, value_of
from isi.errors import InputError, suggestion
from isi.process import Parser, errors_in_one_line
from stages.check_params import load

ROOT = Path(__file__).parent.parent
COPIED = ("isi", "stages", "data/raw", "dvc.yaml", "pyproject.toml")

YAML_1_2 = YAML()  # keeps the comments
#: The value that means: remove the key.
DROP = "<dropped>"
#: What `dvc init --no-scm` writes, without analytics and the check for updates.
DVC_CONFIG = "[core]\n    no_scm = True\n    analytics = false\n    check_update = false\n"
#: A copy of the params that this tool wrote into a workspace.
WRITTEN = ".dvc/tmp/params.yaml"
#: Changes for a run of about five minutes: fewer seeds, sizes and epochs, and the mean as the only
#: control.
QUICK: dict[str, Any] = {
    "experiments.paper_transfer": DROP,
    "initializers.gaussian": DROP,
    "initializers.es_permuted": DROP,
    "initializers.kind_mean": DROP,
    "initializers.soft_hybrid": DROP,
    "experiments.paper.sessions.seeds": 4,
    "experiments.paper.sessions.sizes": [1, 5],
    "experiments.paper.finetuned.seeds": 2,
    "experiments.ai2thor.sessions.seeds": 4,
    "experiments.ai2thor.sessions.sizes": [1, 5],
    "experiments.transfer.sessions.seeds": 4,
    "training.max_epochs": 60,
    "finetuning.max_epochs": 40,
    "sweep.experiments": ["ai2thor"],
    "sweep.k": [1, 4, 8, 18, 30],
    "sweep.seeds": 3,
    "sweep.finetuned_seeds": 3,
    "trajectory.epochs": 40,
    "explorer.size": 5,
    "explorer.seed": 3,
    "cross_validation.folds": 3,
    "cross_validation.dimension": [40],
    "cross_validation.ratio": [],
    "cross_validation.learning_rate": [0.2],
    "cross_validation.weight_decay": [],
}


def make(folder: Path, changes: dict[str, Any], source: Path = ROOT / "params.yaml") -> None:
    """Create or refresh a workspace with the params of ``source``, changed;
    the outputs of its last run stay.
    """
    for name in COPIED:
        target = folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        if (ROOT / name).is_dir():
            shutil.rmtree(target, ignore_errors=True)
            shutil.copytree(ROOT / name, target, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy2(ROOT / name, target)
    params = YAML_1_2.load(source)
    change_all(params, changes)
    YAML_1_2.dump(params, folder / "params.yaml")
    if not (folder / ".dvc").exists():
        (folder / ".dvc/tmp").mkdir(parents=True)
        (folder / ".dvc/config").write_text(DVC_CONFIG, encoding="utf-8")
    shutil.copy2(ROOT / ".dvcignore", folder)


def change(params: dict[str, Any], key: str, value: Any) -> None:
    """Set the value at a dotted key, or drop the key."""
    *parents, last = key.split(".")
    for parent in parents:
        params = params.setdefault(parent, {})
    if value is DROP:
        params.pop(last, None)
    else:
        params[last] = value


def change_all(params: dict[str, Any], changes: dict[str, Any]) -> None:
    """Apply the changes whose parent key exists;
    a name whose key is dropped is also removed from all lists.
    """
    for key, value in changes.items():
        parent = key.rpartition(".")[0]
        if not parent or value_of(params, parent) is not None:
            change(params, key, value)
    forget(params, {key.rpartition(".")[2] for key, value in changes.items() if value is DROP})


def check_keys(changes: dict[str, Any], params: Any, every: Any) -> None:
    """InputError for a change below a key that the params lack, and for a key to drop that neither
    they nor the params of all runs have.
    """
    for key, value in changes.items():
        parent, _, last = key.rpartition(".")
        holders = [value_of(values, parent) if parent else values for values in (params, every)]
        is_known = isinstance(holders[0], dict)
        if value is DROP:
            is_known = any(isinstance(holder, dict) and last in holder for holder in holders)
        if not is_known:
            hint = suggestion(key, dotted(params))
            option = "--drop" if value is DROP else "--set"
            raise InputError(option, key, f"expected a key of the params of this run{hint}")


def dotted(values: Any, before: str = "") -> Iterator[str]:
    """The keys of nested mappings, with dots between them."""
    for key, value in values.items() if isinstance(values, dict) else ():
        yield f"{before}{key}"
        yield from dotted(value, f"{before}{key}.")


def forget(values: Any, names: set[str]) -> None:
    """Remove names from every list in a tree of mappings."""
    for value in values.values() if isinstance(values, dict) else ():
        if isinstance(value, list):
            value[:] = [item for item in value if not (isinstance(item, str) and item in names)]
        forget(value, names)


def main() -> None:
    parser = Parser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument(
        "--set", nargs="*", default=[], metavar="KEY=VALUE", help="params to change; values in YAML"
    )
    parser.add_argument("--drop", nargs="*", default=[], metavar="KEY", help="params to remove")
    given = parser.parse_args()
    with errors_in_one_line("workspace"):
        try:
            changes = settings(given.set)
        except ValueError as error:
            raise InputError("--set", "", str(error)) from error
        make_checked(given.folder, changes | dict.fromkeys(given.drop, DROP))


def make_checked(folder: Path, changes: dict[str, Any]) -> None:
    """Make a workspace with the quick params, or with those in it if they were edited there;
    InputError if refused.
    """
    params, written = folder / "params.yaml", folder / WRITTEN
    before = read(params) and params.read_bytes() if params.exists() and written.exists() else b""
    if edited := before and before != written.read_bytes():
        print(
            f"workspace: {params} was edited and stays; without it, "
            f"{ROOT / params.name} is used again"
        )
    source = params if edited else ROOT / params.name
    values = read(source)
    if not edited:
        change_all(values, QUICK)
    check_keys(changes, values, read(ROOT / params.name))
    make(folder, changes if edited else QUICK | changes, source)
    try:
        load(params)
    except InputError:
        if before:
            params.write_bytes(before)
        else:
            params.unlink()
        raise
    if not edited:
        shutil.copy2(params, written)


if __name__ == "__main__":
    main()
