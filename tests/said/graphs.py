"""Mistakes in what is typed: of graphs (``isi graph``, ``export``, ``check``)."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from isi.tables import catalogue, paths
from tests.kept import NAMES, small, written
from tests.lawful import alter
from tests.said.calls import Typed, params, put
from tests.test_export import ENTITIES, TRIPLES, graph, lay_out

HOUSES = "--reader mp3d_houses --set category=mpcat40 --set 'rooms={k: kitchen}' --set vocabulary=v.yaml"
TURTLE = "export home --format turtle --out x"


def smaller() -> None:
    lay_out()
    graph(ENTITIES[:4], TRIPLES[:3])


def misnamed() -> None:
    lay_out()
    alter(paths.entities("home"), lambda entities: entities.replace("fill", "fi\tll"), catalogue.ENTITIES, anew=True)


def misspelt() -> None:
    lay_out()
    paths.PARAMS.write_text("embedding: {family: distmlt, dimension: 2, init_range: 0.1}\n", encoding="utf-8")


def elsewhere() -> None:
    lay_out()
    folder = paths.explored("there", "entities").parent
    folder.parent.mkdir(parents=True, exist_ok=True)
    paths.entities("home").parent.rename(folder)


def texts() -> None:
    columns = {"head": ["a"], "relation": ["b"], "tail": ["c"], "count": ["2"]}
    pd.DataFrame(columns).to_parquet("log.parquet")


GRAPH_CASES = [
    Typed("no file", "graph",
          "the following arguments are required: FILE; see --help", status=2),
    Typed("no such file", "graph none.csv",
          "none.csv: expected a table of UTF-8 text ([Errno 2] No such file or directory: 'none.csv')"),
    Typed("the file as a setting", "graph log.csv --set path=other.csv",
          "--set: path: expected another setting: it is given"),
    Typed("the reader as a setting", "graph log.csv --set reader=rdf",
          "--set: reader: expected another setting: it is given"),
    Typed("a reader that reads no file", "graph log.csv --reader published",
          "reader published: expected one that reads a file"),
    Typed("a setting without a value", "graph log.csv --set room",
          "argument --set: expected KEY=VALUE, the value in YAML, got 'room'; see --help", status=2),
    Typed("a setting that is no YAML", "graph log.csv --set kinds={",
          "argument --set: expected KEY=VALUE, the value in YAML, got 'kinds={'; see --help", status=2),
    Typed("a setting that is nested too deep", f"graph log.csv --set kinds={'[' * 3000}",
          f"argument --set: expected KEY=VALUE, the value in YAML, got 'kinds={'[' * 21}...{'[' * 28}'; see --help",
          status=2),
    Typed("a setting without a key", "graph log.csv --set =3",
          "argument --set: expected KEY=VALUE, the value in YAML, got '=3'; see --help", status=2),
    Typed("a setting of no type", "graph log.csv --set 'kinds=!!bool x'",
          "argument --set: expected KEY=VALUE, the value in YAML, got 'kinds=!!bool x'; see --help", status=2),
    Typed("a setting of an impossible day", "graph log.csv --set kinds=2024-02-31",
          "argument --set: expected KEY=VALUE, the value in YAML, got 'kinds=2024-02-31'; see --help", status=2),
    Typed("a number of thousands of digits", f"graph log.csv --min-count {'9' * 5000}",
          f"argument --min-count: expected a whole number from 1, got '{'9' * 40}'; see --help", status=2),
    Typed("a setting that the reader does not have", "graph log.csv --set room=kitchen",
          "--set.room: unknown key"),
    Typed("a setting of another type", "graph log.csv --set household=often",
          "--set.household: Input should be a valid boolean, got 'often'"),
    Typed("a setting that lacks something", "graph log.csv --set 'kinds={atLocation: thing}'",
          "--set.kinds.atLocation: Input should be a valid dictionary or instance of Ends, got 'thing'"),
    Typed("a count of none", "graph log.csv --min-count 0",
          "argument --min-count: expected a whole number from 1, got '0'; see --help", status=2),
    Typed("triples that are rarer than asked for", "graph log.csv --min-count 9",
          "log.csv: no triple was observed 9 times"),
    Typed("files that give an entity two kinds", "graph log.csv more.csv --set household=true",
          "more.csv: entity 'fill': expected kind 'affordance', got 'object'",
          before=put(log__csv="head,relation,tail\nmug,hasAffordance,fill\n",
                          more__csv="head,relation,tail\nfill,atLocation,kitchen\n")),
    Typed("a file whose form is not plain", "graph a.txt",
          "a.txt: expected a file whose form is plain; else name its reader by --reader: ai2thor, ai2thor_scene, "
          "behavior, mp3d_houses, mp3d_tallies, procthor_houses, published, rdf, robothor, table, triples_with_ids",
          before=put(a__txt="x")),
    Typed("JSON whose keys tell nothing", "graph a.json",
          "a.json: expected a file whose form is plain; else name its reader by --reader: ai2thor, ai2thor_scene, "
          "behavior, mp3d_houses, mp3d_tallies, procthor_houses, published, rdf, robothor, table, triples_with_ids",
          before=put(a__json="{}")),
    Typed("JSON that is none", "graph a.json",
          "a.json: expected JSON: Expecting property name enclosed in double quotes: line 1 column 2 (char 1)",
          before=put(a__json="{")),
    Typed("JSON in another encoding", "graph a.json",
          "a.json: expected UTF-8 text ('utf-8' codec can't decode byte 0xff in position 0: invalid start byte)",
          before=put(a__json=b"\xff")),
    Typed("lists in lists, 200,000 deep", "graph a.json",
          "a.json: expected JSON: lists and mappings are too deep in each other", before=put(a__json="[" * 200_000)),
    Typed("a file where the folder is to be", "graph log.csv --out log.csv",
          "log.csv: cannot be written (its folder is a file)"),
    Typed("a column of another type", "graph log.parquet",
          "log.parquet: column 'count': expected whole numbers, got large_string", before=texts),
    Typed("a folder of houses that there is not", f"graph nowhere {HOUSES}",
          "nowhere: expected a folder with *.house files, unpacked",
          before=put(v__yaml="structure: [wall]\nsame_as: {}\n")),
    Typed("a category of the vocabulary that is structure, too", f"graph nowhere {HOUSES}",
          "v.yaml: same_as: 'wall' is in structure, too",
          before=put(v__yaml="structure: [wall]\nsame_as: {wall: painting}\n")),
    Typed("a digest of a gensim download", "graph log.csv",
          "params.yaml: words.sha256: expected null for a gensim download, which nothing checks: download it, and "
          "name the file", before=params({"words.source": "word2vec-google-news-300", "words.sha256": "0" * 64})),
    Typed("a source of words whose name is too long", "graph log.csv",
          "'xxxxxxxxxxxxxxxxxxxxxxxxxxx...xxxxxxxxxxxxxxxxxxxxxxxxxxxx': expected a file of word vectors (File name "
          "too long)", before=params({"words.source": "x" * 300})),
]  # fmt: skip

EXPORT_CASES = [
    Typed("no form", "export home --out x",
          "the following arguments are required: --format; see --help", status=2),
    Typed("a name that is none", "export ../home --format turtle --out x",
          "argument EXPERIMENT: expected a name of lower-case letters, digits and _, got '../home'; see --help",
          status=2),
    Typed("neither an experiment nor an embedding", "export --format turtle --out x",
          "expected either EXPERIMENT or --embedding DIR"),
    Typed("both", "export home --embedding home --format turtle --out x",
          "expected either EXPERIMENT or --embedding DIR"),
    Typed("an experiment that there is not", "export transfr --format turtle --out x",
          "EXPERIMENT: expected one of ai2thor, transfer, published, behavior, virtualhome, robothor, thor_u, got "
          "'transfr'; did you mean 'transfer'?"),
    Typed("a graph of the second pipeline that there is not yet", "export virtualhome --format turtle --out x",
          "data/beyond/graphs/virtualhome/entities.parquet: missing: run "
          "`dvc repro beyond/dvc.yaml:explore@virtualhome`, which makes it"),
    Typed("an experiment without a graph", "export transfer --format turtle --out x",
          "data/graph/transfer/entities.parquet: missing: run `dvc repro build_graph@transfer`, which makes it"),
    Typed("a number that is none", f"{TURTLE} --predictions many",
          "argument --predictions: expected a whole number, got 'many'; see --help", status=2),
    Typed("a seed of an embedding", "export --embedding home --format turtle --out x --seed 1",
          "--seed: expected an experiment, which has a model for each seed"),
    Typed("a seed without a model", f"{TURTLE} --predictions 1 --seed 5",
          "data/embeddings/home/joint.safetensors: seed 5: expected one of 4, 7", before=lay_out),
    Typed("a model of another graph", f"{TURTLE} --predictions 1",
          "data/embeddings/home/joint.safetensors: expected entities, relations and numbers of a relation's row (4, "
          "2, 2) as in the graph, got (5, 2, 2)", before=smaller),
    Typed("an unknown family in params", f"{TURTLE} --predictions 1",
          "params.yaml: families.distmlt: expected one of analogy, complex, distmult, rotate, transe, got "
          "'distmlt'; did you mean 'distmult'?", before=misspelt),
    Typed("predictions of a graph of the second pipeline", "export there --format turtle --out x --predictions 1",
          "--predictions: there: expected an experiment of params.yaml: of a graph of the second pipeline, no model "
          "is kept", before=elsewhere),
    Typed("a name that no tool would read", "export --embedding home --format turtle --out x",
          "home/entities.tsv: column 'entity': expected a name without control characters, space around it or "
          "'../', got '../x'", before=lambda: written(Path("home"), small(entity_names=["../x", *NAMES[1:]]))),
    Typed("a tab in a name of an experiment", TURTLE,
          "data/graph/home/entities.parquet: row 0 (entity 'fi\\tll'): expected 'entity' to be a name, not blank, "
          "of 1,000 characters at most and no control character", before=misnamed),
    Typed("a compressed file", "export --embedding home --format turtle --out x.gz",
          "x.gz: expected another name: what is written is not compressed"),
    Typed("a folder where the file is to be", "export --embedding home --format turtle --out home",
          "home: cannot be written (Is a directory)"),
    Typed("a file where the folder is to be", "export --embedding home --format property-csv --out log.csv",
          "log.csv/nodes.csv: cannot be written (its folder is a file)"),
    Typed("no name of a file", "export --embedding home --format turtle --out .",
          ".: expected the name of a file"),
]  # fmt: skip

CHECK_CASES = [
    Typed("to accept what is no table of the pipeline", "check --accept params.yaml",
          "params.yaml: expected a table or tensors of the pipeline, as a stage writes it"),
    Typed("to accept what is not there", "check --accept data/runs/ai2thor/es.parquet",
          "data/runs/ai2thor/es.parquet: no such file: `dvc repro insert@ai2thor-es` makes it"),
]  # fmt: skip
