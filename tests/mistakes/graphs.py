"""Mistakes in command lines about graphs (``isi graph``, ``export``)."""

from pathlib import Path

import pandas as pd

from isi.graph import graph as tables
from tests.example_tables import change_table
from tests.mistakes.calls import Typed, params, put
from tests.small_bundle import NAMES, small, written
from tests.small_experiment import write_experiment

HOUSES = (
    "--reader mp3d_houses --set category=mpcat40 --set 'rooms={k: kitchen}' --set vocabulary=v.yaml"
)
TURTLE = "export home --format turtle --out x"


def misnamed() -> None:
    write_experiment()
    change_table(
        tables.ENTITIES,
        tables.ENTITIES.path(experiment="home"),
        lambda rows: rows.replace("fill", "fi\tll"),
    )


def texts() -> None:
    columns = {"head": ["a"], "relation": ["b"], "tail": ["c"], "count": ["two"]}
    pd.DataFrame(columns).to_parquet("log.parquet")


GRAPH_CASES = [
    Typed("no such file", "graph none.csv", "none.csv"),
    Typed("the file as a setting", "graph log.csv --set path=other.csv", "--set|path"),
    Typed("the reader as a setting", "graph log.csv --set reader=rdf", "--set|reader"),
    Typed("a reader that reads no file", "graph log.csv --reader published", "reader published"),
    Typed("a setting without a value", "graph log.csv --set room", "--set", status=2),
    Typed("a setting that is no YAML", "graph log.csv --set kinds={", "--set", status=2),
    Typed(
        "a setting that is nested too deep",
        f"graph log.csv --set kinds={'[' * 3000}",
        "--set",
        status=2,
    ),
    Typed("a setting without a key", "graph log.csv --set =3", "--set", status=2),
    Typed("a setting of no type", "graph log.csv --set 'kinds=!!bool x'", "--set", status=2),
    Typed(
        "a setting of an impossible day", "graph log.csv --set kinds=2024-02-31", "--set", status=2
    ),
    Typed(
        "a number of thousands of digits",
        f"graph log.csv --min-count {'9' * 5000}",
        "--min-count",
        status=2,
    ),
    Typed(
        "a setting that the reader does not have", "graph log.csv --set room=kitchen", "--set|room"
    ),
    Typed("a setting of another type", "graph log.csv --set household=often", "--set|household"),
    Typed(
        "a setting that lacks something",
        "graph log.csv --set 'kinds={atLocation: thing}'",
        "--set|kinds.atLocation",
    ),
    Typed("a count of none", "graph log.csv --min-count 0", "--min-count", status=2),
    Typed("triples that are rarer than asked for", "graph log.csv --min-count 9", "log.csv"),
    Typed(
        "files that give an entity two kinds",
        "graph log.csv more.csv --set household=true",
        "more.csv|entity 'fill'",
        before=put(
            log__csv="head,relation,tail\nmug,hasAffordance,fill\n",
            more__csv="head,relation,tail\nfill,atLocation,kitchen\n",
        ),
    ),
    Typed("a file whose form is not plain", "graph a.dat", "a.dat", before=put(a__dat="x")),
    Typed("JSON whose keys tell nothing", "graph a.json", "a.json", before=put(a__json="{}")),
    Typed("JSON that is none", "graph a.json", "a.json", before=put(a__json="{")),
    Typed("JSON in another encoding", "graph a.json", "a.json", before=put(a__json=b"\xff")),
    Typed(
        "lists in lists, 200,000 deep", "graph a.json", "a.json", before=put(a__json="[" * 200_000)
    ),
    Typed("a file where the folder is to be", "graph log.csv --out log.csv", "log.csv"),
    Typed("a column of another type", "graph log.parquet", "log.parquet|count", before=texts),
    Typed(
        "a folder of houses that there is not",
        f"graph nowhere {HOUSES}",
        "nowhere",
        before=put(v__yaml="structure: [wall]\nsame_as: {}\n"),
    ),
    Typed(
        "a category of the vocabulary that is structure, too",
        f"graph nowhere {HOUSES}",
        "v.yaml|same_as",
        before=put(v__yaml="structure: [wall]\nsame_as: {wall: painting}\n"),
    ),
    Typed(
        "a digest of a gensim download",
        "graph log.csv",
        "params.yaml|words.sha256",
        before=params({"words.source": "word2vec-google-news-300", "words.sha256": "0" * 64}),
    ),
    Typed(
        "a source of words whose name is too long",
        "graph log.csv",
        "'xxxxxxxxxxxxxxxxxxxxxxxxxxx...xxxxxxxxxxxxxxxxxxxxxxxxxxxx'",
        before=params({"words.source": "x" * 300}),
    ),
]

EXPORT_CASES = [
    Typed("a name that is none", "export ../home --format turtle --out x", "EXPERIMENT", status=2),
    Typed(
        "neither an experiment nor an embedding", "export --format turtle --out x", "--embedding"
    ),
    Typed("both", "export home --embedding home --format turtle --out x", "--embedding"),
    Typed(
        "an experiment that there is not", "export transfr --format turtle --out x", "EXPERIMENT"
    ),
    Typed(
        "a graph of the second pipeline that there is not yet",
        "export virtualhome --format turtle --out x",
        "data/beyond/graphs/virtualhome/entities.parquet|missing",
    ),
    Typed(
        "an experiment without a graph",
        "export transfer --format turtle --out x",
        "data/graph/transfer/entities.parquet|missing",
    ),
    Typed("a number that is none", f"{TURTLE} --predictions many", "--predictions", status=2),
    Typed("predictions without a model", f"{TURTLE} --predictions 1", "--predictions"),
    Typed(
        "a name that no XML can hold",
        "export --embedding home --format graphml --out x",
        "x|uffff|turtle",
        before=lambda: written(Path("home"), small(entity_names=["a\uffff", *NAMES[1:]])),
    ),
    Typed(
        "a tab in a name of an experiment",
        TURTLE,
        "data/graph/home/entities.parquet|row 0 (entity 'fi\\tll')",
        before=misnamed,
    ),
    Typed("a compressed file", "export --embedding home --format turtle --out x.gz", "x.gz"),
    Typed(
        "a folder where the file is to be",
        "export --embedding home --format turtle --out home",
        "home",
    ),
    Typed("no name of a file", "export --embedding home --format turtle --out .", "."),
]
