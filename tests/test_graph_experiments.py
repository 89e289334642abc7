"""An experiment on a graph of the second pipeline gives the results of the first
pipeline's stages on that graph.
"""

from pathlib import Path

import pandas as pd
import pytest
import yaml

from isi.tables import paths
from stages.explore import GRAPH_ENTITIES, GRAPH_QUERIES, GRAPH_RUNS, GRAPH_TRIPLES
from stages.files import ENTITIES, TRIPLES
from stages.params import CONDITIONS
from stages.vary import VARIANT_QUERIES, VARIANT_RUNS
from tests import stage_run
from tests.beyond_entries import GRAPH, ROOT, SESSIONS, WORDS, copy_pipelines, list_entries

FIRST = {name: GRAPH[name] for name in ("initializers", "changes")} | {
    "title": "first",
    "group": "baselines",
    "experiments": ["paper"],
    "size": 3,
    "seeds": 2,
    "finetuned": False,
    "trained": True,
}


@pytest.fixture
def workspace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A folder with both pipelines; the second one has the graph ``paper`` of the
    first one under another name.
    """
    monkeypatch.chdir(tmp_path)
    copy_pipelines(tmp_path)
    paths.DATA.mkdir()
    paths.RAW.symlink_to(ROOT / paths.RAW)
    params = yaml.safe_load(paths.PARAMS.read_text(encoding="utf-8"))
    params["experiments"]["paper"] |= {
        "graph": {"source": "published"},
        "sessions": SESSIONS,
        "full_curves": [],
        **dict.fromkeys(CONDITIONS),
    }
    params["sweep"]["experiments"] = []
    params["words"] = WORDS
    params["compute"] |= {"workers": 1, "stack": 2}
    paths.PARAMS.write_text(yaml.safe_dump(params), encoding="utf-8")
    list_entries(graphs={"again": GRAPH}, variants={"first": FIRST})


@pytest.mark.usefixtures("workspace")
def test_an_experiment_on_a_graph_is_what_the_first_pipeline_would_have_run() -> None:
    for command in (
        "mine published",
        "build_graph paper",
        "embed_words paper",
        "make_sessions paper",
        "vary first",
        "explore again",
    ):
        stage_run.run(command)
    for table, theirs in (
        (GRAPH_ENTITIES, ENTITIES.read(experiment="paper")),
        (GRAPH_TRIPLES, TRIPLES.read(experiment="paper")),
        (GRAPH_RUNS, VARIANT_RUNS.read(variant="first")),
        (GRAPH_QUERIES, VARIANT_QUERIES.read(variant="first")),
    ):
        table_of_graph = table.read(graph="again")
        assert len(table_of_graph) > 0
        for column in ("source", "experiment"):
            if column in table_of_graph:
                assert set(table_of_graph[column]) == {"again"}
                table_of_graph, theirs = (
                    table_of_graph.drop(columns=column),
                    theirs.drop(columns=column),
                )
        pd.testing.assert_frame_equal(table_of_graph, theirs, check_exact=True)


@pytest.mark.usefixtures("workspace")
def test_a_graph_with_too_few_entities_is_refused_and_nothing_is_written() -> None:
    list_entries(graphs={"again": GRAPH | {"sessions": SESSIONS | {"sizes": [500]}}})
    expected = (
        r"^explore: beyond/params\.yaml: graphs\.again: .*sessions\.sizes: expected a smaller size"
    )
    with pytest.raises(SystemExit, match=expected):
        stage_run.run("explore again")
    assert not GRAPH_RUNS.path(graph="again").parent.exists()
