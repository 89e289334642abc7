"""``isi export``: writes the graph of an experiment or of a home, and predicted triples,
for other tools.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal
from urllib.parse import quote

import networkx as nx
import numpy as np
import pandas as pd
import torch
from cyclopts import Parameter

from isi import config
from isi.cli import FROM_ZERO
from isi.cli.entity import open_home
from isi.cli.output import Replace, is_device, write_outputs
from isi.errors import InputError, extra, suggestion
from isi.evaluation.ranks import parts
from isi.graph.graph import (
    ENTITIES,
    GRAPH_ENTITIES,
    GRAPH_TRIPLES,
    HEAD,
    RELATION,
    TAIL,
    TRIPLES,
    Graph,
)
from isi.models.stack import Embedding
from isi.sources.names import ENTITY
from isi.tables import paths
from isi.tables.table import as_text

if TYPE_CHECKING:
    import rdflib

NAME = re.compile(r"[a-z][a-z0-9_]*")  #: Name of an experiment.
TRIPLE, PREDICTED = ["head", "relation", "tail"], ["head", "relation", "tail", "score", "rank"]
#: Characters of valid names that XML cannot hold (control characters are in no name).
NOT_XML = re.compile("[\ufffe\uffff]")


def _check_name(_: object, name: str | None) -> None:
    if name is not None and not NAME.fullmatch(name):
        raise ValueError("expected a lower-case letter, then lower-case letters, digits or _")


def export(
    experiment: Annotated[
        str | None,
        Parameter(
            validator=_check_name,
            help="an experiment of params.yaml, or a graph of beyond/params.yaml",
        ),
    ] = None,
    *,
    format: Annotated[
        Literal["graphml", "pykeen-tsv", "turtle"],
        Parameter(help="output format"),
    ],
    out: Annotated[Path, Parameter(help="file to write")],
    embedding: Annotated[
        Path | None,
        Parameter(name="--home", help="folder of a home, instead of EXPERIMENT"),
    ] = None,
    predictions: Annotated[
        int,
        Parameter(
            validator=FROM_ZERO,
            help="with --home: predicted tails per head and relation, but known triples",
        ),
    ] = 0,
    labels: Annotated[
        bool, Parameter(help="in RDF, also write kinds and phrases of entities")
    ] = False,
    replace: Replace = False,
) -> None:
    """Read a graph, predict triples if requested, and write both."""
    if out.suffix == ".gz":
        raise InputError(out, "", "expected a name without .gz: the output is not compressed")
    if (embedding is None) == (experiment is None):
        raise InputError("", "", "expected either EXPERIMENT or --home DIR")
    if predictions and embedding is None:
        raise InputError("--predictions", "", "expected --home DIR, whose model predicts")
    exported = of_bundle(embedding, predictions) if embedding else of_experiment(str(experiment))
    files = FORMATS[format](exported, out, labels)
    write_outputs(files, exported.files, replace)
    more = f" and {len(exported.predictions):,} predictions" * bool(predictions)
    written = ", ".join(map(str, files))
    print(
        f"{len(exported.entities):,} entities, {len(exported.triples):,} triples{more}: {written}",
        file=sys.stderr if is_device(out) else sys.stdout,
    )


@dataclass(frozen=True)
class GraphExport:
    """The tables to export."""

    name: str
    entities: pd.DataFrame  #: columns entity, kind, phrase
    triples: pd.DataFrame  #: columns head, relation, tail, count
    predictions: pd.DataFrame  #: columns head, relation, tail, score, rank; empty unless requested
    files: Sequence[Path]  #: that were read, or their folder


def of_experiment(experiment: str) -> GraphExport:
    """A graph of either pipeline; InputError if it is unknown."""
    files = ENTITIES.path(experiment=experiment), TRIPLES.path(experiment=experiment)
    second = GRAPH_ENTITIES.path(graph=experiment), GRAPH_TRIPLES.path(graph=experiment)
    if not files[0].exists():
        experiments = [*(config.read(paths.PARAMS).get("experiments") or ())]
        known = [*experiments, *(config.read(paths.BEYOND_PARAMS).get("graphs") or ())]
        if experiment not in known and not second[0].exists():
            expected = (
                f"expected one of {', '.join(known)}, got "
                f"{experiment[:80]!r}{suggestion(experiment, known)}"
            )
            raise InputError("EXPERIMENT", "", expected)
        files = files if experiment in experiments and not second[0].exists() else second
    entities, triples = as_text(ENTITIES.read_file(files[0])), as_text(TRIPLES.read_file(files[1]))
    return GraphExport(experiment, entities, triples, pd.DataFrame(columns=PREDICTED), files)


def of_bundle(folder: Path, most: int) -> GraphExport:
    """The known triples of a home, each with count 1,
    and ``most`` predictions per head and relation.
    """
    with open_home(folder) as live:
        opened, name = live.now, folder.resolve().name
    columns = {"entity": opened.entity_names, "kind": opened.kinds, "phrase": opened.phrases}
    entities = pd.DataFrame(columns).replace({"kind": {"": ENTITY}})
    entities["phrase"] = entities["phrase"].where(entities["phrase"] != "", entities["entity"])
    triples = pd.DataFrame(opened.named_triples(), columns=TRIPLE).assign(count=1)
    not_predicted = torch.from_numpy(np.concatenate([opened.triples, opened.retracted]))
    kinds = torch.from_numpy(pd.factorize(entities["kind"])[0].astype("int64"))
    counts = torch.ones(len(not_predicted), dtype=torch.int64)
    graph = Graph(opened.entity_names, opened.relation_names, not_predicted, counts, kinds)
    predictions = best_tails(graph, opened.embedding, most)
    name = name if NAME.fullmatch(name) else "embedding"
    return GraphExport(name, entities, triples, predictions, [folder])


def best_tails(graph: Graph, embedding: Embedding, most: int) -> pd.DataFrame:
    """Link prediction: for each relation and head, the ``most`` best tails,
    without triples of the graph.

    The heads of a relation are all entities of the kinds that its triples have as heads. Ranks
    start at 1; ties go to the lower entity id.
    """
    names, rows = np.array(graph.entities, dtype=object), list[tuple[Any, ...]]()
    for relation, label in enumerate(graph.relations if most else ()):
        triples = graph.triples[graph.triples[:, RELATION] == relation]
        heads = torch.nonzero(torch.isin(graph.kinds, graph.kinds[triples[:, HEAD]]))[:, 0]
        for part in parts(heads, len(names)):
            scores = embedding.score_tails(part[None], torch.full_like(part, relation)[None])[0]
            present = triples[torch.isin(triples[:, HEAD], part)]
            known = torch.searchsorted(part, present[:, HEAD].contiguous()), present[:, TAIL]
            scores[known] = -torch.inf
            best = scores.sort(dim=-1, descending=True, stable=True)
            values, tails = best.values[:, :most].numpy(), best.indices[:, :most].numpy()
            for row, place in np.argwhere(values > -np.inf).tolist():
                head, tail = names[part[row]], names[tails[row, place]]
                rows.append((head, label, tail, values[row, place].item(), place + 1))
    return pd.DataFrame(rows, columns=PREDICTED)


Files = dict[Path, str]  #: Contents by path.


def graphml(export: GraphExport, path: Path, _labels: bool) -> Files:
    """GraphML, for networkx, Gephi and yEd: an edge per triple, with count, and per prediction,
    with score and rank.
    """
    graph, content = nx.MultiDiGraph(name=export.name), BytesIO()
    graph.add_nodes_from(
        export.entities.set_index("entity")[["kind", "phrase"]].to_dict("index").items()
    )
    for table in (export.triples[[*TRIPLE, "count"]], export.predictions[PREDICTED]):
        for row in table.to_dict("records"):
            attributes = {
                str(name): value for name, value in row.items() if name not in ("head", "tail")
            }
            graph.add_edge(row["head"], row["tail"], graph.number_of_edges(), **attributes)
    nx.write_graphml_xml(graph, content)
    text = content.getvalue().decode()
    if wrong := NOT_XML.search(text):
        others = ", ".join(name for name in FORMATS if name != "graphml")
        raise InputError(
            path, "", f"XML cannot hold the character {wrong[0]!a} of a name: write {others}"
        )
    return {path: text}


def rdf_of(export: GraphExport, labels: bool) -> rdflib.Graph:
    """RDF: each triple is asserted; each prediction is reified,
    as five triples that do not assert it.
    """
    with extra("rdf"):
        import rdflib
        from rdflib import RDF, RDFS, Namespace, URIRef

    base, graph = Namespace(f"urn:isi:{export.name}:"), rdflib.Graph(bind_namespaces="none")
    for prefix in ("entity", "relation", "kind", "prediction"):
        graph.bind(prefix, base[f"{prefix}:"])
    graph.bind("rdf", RDF)

    def node(kind: str, name: object) -> URIRef:
        return base[f"{kind}:{quote(str(name), safe='')}"]

    for head, relation, tail in export.triples[TRIPLE].itertuples(index=False):
        graph.add((node("entity", head), node("relation", relation), node("entity", tail)))
    if labels:
        graph.bind("rdfs", RDFS)
        for entity, kind, phrase in export.entities[["entity", "kind", "phrase"]].itertuples(
            index=False
        ):
            graph.add((node("entity", entity), RDF.type, node("kind", kind)))
            graph.add((node("entity", entity), RDFS.label, rdflib.Literal(phrase)))
    for number, (head, relation, tail, score, rank) in enumerate(
        export.predictions.itertuples(index=False), 1
    ):
        about = {
            RDF.subject: node("entity", head),
            RDF.predicate: node("relation", relation),
            RDF.object: node("entity", tail),
            node("prediction", "score"): rdflib.Literal(score),
            node("prediction", "rank"): rdflib.Literal(rank),
        }
        for predicate, value in about.items():
            graph.add((node("prediction", number), predicate, value))
    return graph


def pykeen_tsv(export: GraphExport, path: Path, _labels: bool) -> Files:
    """TSV without a header, for PyKEEN's ``TriplesFactory.from_path``;
    predictions go into a second file.
    """
    tables = {path: export.triples[TRIPLE]}
    if len(export.predictions):
        if is_device(path):
            raise InputError(path, "", "expected a file: predictions go into a second one")
        tables[path.with_name(f"{path.stem}.predictions{path.suffix}")] = export.predictions
    form: dict[str, Any] = {"sep": "\t", "header": False, "index": False, "lineterminator": "\n"}
    return {file: table.to_csv(**form) for file, table in tables.items()}


FORMATS: dict[str, Callable[[GraphExport, Path, bool], Files]] = {
    "graphml": graphml,
    "pykeen-tsv": pykeen_tsv,
    "turtle": lambda export, path, labels: {
        path: rdf_of(export, labels).serialize(format="turtle")
    },
}
