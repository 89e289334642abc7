"""BEHAVIOR-1K's scenes as the package has them (`read_files.yaml` has a small folder)."""

from importlib.metadata import distributions
from pathlib import Path

import pytest

from isi.config import read as read_params
from isi.sources.behavior import STEPS
from stages.pipeline import BEYOND_PARAMS
from tests.observing import observations_of

ROOT = Path(__file__).parent.parent


@pytest.mark.skipif(
    ("bddl", "3.6.0") not in {(package.name, package.version) for package in distributions()},
    reason="needs the package bddl 3.6.0",
)
def test_the_package_read_as_shipped_has_51_scenes_and_all_their_instances() -> None:
    shipped = read_params(ROOT / BEYOND_PARAMS)["graphs"]["behavior"]["source"]
    settings = {key: value for key, value in shipped.items() if key not in ("reader", "from")}
    assert (shipped["reader"], shipped["from"]) == ("behavior", "package")
    assert settings.keys() == {"structure", "names", "affordances"}
    observed = observations_of(shipped)
    observations, kinds = observed.table, observed.kinds
    assert observations["scene"].nunique() == 51
    assert observed.counts == dict(zip(STEPS, (36_164, 34_950), strict=True))
    assert observations.loc[observations["relation"] == "atLocation", "count"].sum() == 34_950
    assert kinds["kind"].value_counts().to_dict() == {"object": 522, "room": 39, "affordance": 25}
