"""Training of a bundle from a graph: settings are chosen on validation triples,
then all triples are trained on.

Loss, negatives and optimizer are the pipeline's, except that weight decay is ``DECAY`` / E (an
entity has a share of about 1 / E in the mean gradient of a batch; the paper's 0.001 holds rare
entities near zero), and that tables start in ±``INIT_RANGE`` (in ±0.01 the gradients of product
models almost vanish).
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from operator import itemgetter
from pathlib import Path
from typing import Any

import networkx as nx
import numpy as np
import pandas as pd
import torch
from torch import Tensor
from tqdm import tqdm

from isi.columns import COUNT, TRIPLE
from isi.config import Count, Option, Positive, Seed, check
from isi.errors import InputError, at
from isi.evaluation.filtered import EndQueries, end_queries, random_ranks
from isi.evaluation.ranking import padded_ids
from isi.graph.files import read_graph
from isi.graph.graph import (
    HEAD,
    RELATION,
    TAIL,
    Graph,
    GraphTables,
    MinedSource,
    build_graph,
    build_tables,
)
from isi.graph.sessions import TEST, TRAIN, VALID, Session, session_of, split
from isi.graph.vocabulary import Vocabulary, by_known_name, note_of_kinds
from isi.home.bundle import Bundle, Manifest
from isi.home.folder import is_home
from isi.home.home import Home, open_home
from isi.home.phrases import OF_MODEL, by_model, has_model, with_words
from isi.insertion.arguments import (
    TripleForms,
    checked_model,
    column_names,
    named_triples,
    naming_argument,
    of_arrow,
    options_by_name,
)
from isi.models.model import MODELS, compared_models
from isi.models.stack import Embedding, NotFinite, select, usual_torch
from isi.sources.names import ENTITY, Naming
from isi.sources.names import Name as KindName
from isi.sources.readers import check_names, cleaned
from isi.sources.triples import naming
from isi.tables.rules import MOST_OBSERVED
from isi.training.batches import DENSE_LIMIT, Negatives, is_dense, scaled_counts
from isi.training.fit import TrainConfig, fit, fit_for
from isi.training.trainer import Training

RATES = (0.1, 0.3)  #: Learning rates that are compared.
DECAY, INIT_RANGE = 0.01, 0.3
DRAWS = 4  #: Random choices of validation triples; each setting trains a model for each of them.
LEAST, MOST = 20, 200  #: Epochs of a setting.
FEWEST = 50  #: Test triples, unless they are over a fifth of all; of a large graph a tenth.
#: Maximum number of test triples, and this number times E.
MOST_HELD_OUT, MOST_SCORES = 1000, 2**25
#: On a large graph (not ``is_dense``): maximum number of observations in a batch; negatives of each
#: kind.
LARGEST_BATCH, SAMPLED = 1024, 3
#: Maximum number of observations of an epoch: this number, or this many per triple if that is more.
OBSERVED, PER_TRIPLE = 2**18, 10
#: Multiplications in a second in dense batches, numbers of vectors in a second in lists, seconds
#: for each update: they turn a budget of seconds into one of work, so that the result depends on
#: the arguments alone.
DENSE_RATE, LIST_RATE, OVERHEAD = 1.4e10, 1e8, 5e-4
#: Two relations repeat each other if they share more than this share of the pairs of either, and
#: this number.
REPEATED, FEWEST_REPEATED = 0.8, 5
#: Standard errors by which the reciprocal ranks of a model that has learned exceed others.
CLEARLY = 2.0


@dataclass(frozen=True)
class TrainingSummary:
    """How a bundle was trained, and filtered MRRs of test triples,
    which a model with its settings was not trained on.

    The bundle itself is trained on all triples. MRRs are None if no triple can leave training.
    """

    entities: int
    relations: int
    triples: int
    observations: int
    #: of an epoch: fewer than all if there are so many that counts were scaled down
    epoch_observations: int
    model: str
    learning_rate: float
    dimension: int
    epochs: int
    batch_size: int
    repeated: list[list[str]]  #: relations that repeat each other; one alone is symmetric
    test_triples: int  #: head and tail of each are queried
    mrr: float | None
    #: of candidates ranked by their number of training triples in the slot of the relation
    frequency: float | None
    chance: float | None  #: expectation of random ranks
    warning: str | None  #: a sentence

    @property
    def scaled(self) -> str | None:
        """A sentence, if counts were scaled down."""
        if self.epoch_observations == self.observations:
            return None
        return (
            f"Counts were scaled down: an epoch has {self.epoch_observations:,} observations, "
            "at least one of each triple"
        )

    def __str__(self) -> str:
        text = (
            f"{self.triples:,} triples ({self.observations:,} observations) of {self.entities:,}"
            f" entities and {self.relations:,} relations; model {self.model}, learning rate"
            f" {self.learning_rate:g}, {self.epochs} epochs in batches of {self.batch_size:,},"
            " chosen on validation triples."
        )
        if self.scaled:
            text += f"\n{self.scaled}."
        if self.repeated:
            named = ", ".join(" and ".join(map(repr, names)) for names in self.repeated)
            text += (
                f"\nTriples of symmetric, inverse or equal relations ({named}) are "
                "split together with those that"
            )
            text += " they repeat."
        if self.mrr is not None:
            text += (
                f"\nMRR of {self.test_triples:,} test triples: {self.mrr:.3f}; "
                "of answers by frequency"
            )
            text += (
                f" {self.frequency:.3f}, at random {self.chance:.3f}. In the end, "
                "all triples were trained on."
            )
        return text + f"\nWarning: {self.warning}." * bool(self.warning)


def tables_of(triples: TripleForms) -> GraphTables:
    """The graph of triples of names
    (forms: ``named_triples``; a table may have a column ``count``).

    InputError for a wrong triple, name or count.
    """
    with naming_argument("triples"):
        table: Any = of_arrow(triples)
        frame = pd.DataFrame(named_triples(table), columns=list(TRIPLE))
        frame.index.name = "triple"
        check_names(frame, "")
        frame = cleaned(frame)
        counted: Any = next(
            (name for name in column_names(table) if str(name).casefold() == COUNT), None
        )
        counts = np.asarray(table[counted]).tolist() if counted else [1] * len(frame)
        frame[COUNT] = check(counts, list[Count], COUNT, "")
        if not 0 < sum(counts) <= MOST_OBSERVED:
            raise InputError(
                "", "", f"expected 1 to {MOST_OBSERVED:,} observations, got {sum(counts):,}"
            )
        return build_tables(MinedSource("triples", frame, Naming()(frame, ())))


def described(tables: GraphTables, path: Path) -> tuple[GraphTables, str]:
    """``with_kinds`` of a table of entities (``naming``)."""
    named = naming(str(path), None, household=False)
    with at(path):
        return with_kinds(tables, named.kind_of, named.phrase_of)


def with_kinds(
    tables: GraphTables, kinds: Mapping[str, str], phrases: Mapping[str, str] | None = None
) -> tuple[GraphTables, str]:
    """The graph with kinds and phrases by entity (``by_known_name``),
    and a note of names that have no match.

    All other kinds and phrases stay. InputError if no name matches.
    """
    entities, listed = tables.entities, {**kinds, **(phrases or {})}
    names = entities["entity"].tolist()
    known = Vocabulary("entity", names)
    new_kinds, _ = by_known_name(kinds, known)
    new_phrases, _ = by_known_name(phrases or {}, known)
    matched, missing = by_known_name(listed, known)
    if not matched:
        got = note_of_kinds(missing, len(listed), [], known) or "none"
        raise InputError(
            "", "", f"expected the kind or the phrase of an entity of the graph, got {got}"
        )
    kind = [new_kinds.get(name, old) for name, old in zip(names, entities["kind"], strict=True)]
    phrase = [
        new_phrases.get(name, old) for name, old in zip(names, entities["phrase"], strict=True)
    ]
    without = [name for name, given in zip(names, kind, strict=True) if given == ENTITY and kinds]
    note = note_of_kinds(missing, len(listed), without, known)
    return replace(tables, entities=entities.assign(kind=kind, phrase=phrase)), note


def train(
    triples: TripleForms | str | Path | Home,
    *,
    kinds: Mapping[str, str] | None = None,
    vectors: str | Path | None = None,
    model: str | None = None,
    learning_rate: float | None = None,
    dimension: int = 100,
    budget: float = 60,
    seed: int = 0,
) -> Home:
    """Train an embedding of triples by name (in any form of ``isi.insert``), of a file that
    ``isi train`` reads, or of what a home knows by now: it is then the same home, with its kinds
    and its history.

    ``kinds``: by entity. ``vectors``: a word2vec or GloVe file, for the word vectors of names. The
    other arguments are those of ``train_bundle``. ``base.manifest.made`` of the result has its
    measures. Warns of what the file's reader counts, such as lines without a header, if the model
    has learned nothing, of counts that were scaled down, of names in ``kinds`` that match no
    entity, and of entities without a kind.

    Example:
        >>> import isi
        >>> facts = [("cup", "in", "kitchen"), ("pan", "in", "kitchen"), ("bed", "in", "bedroom")]
        >>> home = isi.train(facts, model="distmult", dimension=4)
        >>> home.base.manifest.made["entities"], home.ask("cup", "in").answers[0].entity
        (5, 'kitchen')
    """
    options = {
        "model": model,
        "learning_rate": learning_rate,
        "dimension": dimension,
        "budget": budget,
        "seed": seed,
    }
    path = check(vectors, str | Path | None, "", "argument 'vectors'")  # type: ignore[arg-type]
    file = None if path is None else Path(path)
    if isinstance(triples, str | Path) and is_home(Path(triples)):
        triples = open_home(triples)
    if isinstance(triples, Home):
        if kinds:
            raise InputError("argument 'kinds'", "", "expected none: a home has its kinds")
        warn(train_again(triples, file, **options))
        return triples
    if isinstance(triples, str | Path):
        tables, read = read_graph([triples])
        for path, counted in read.items():
            for label, number in counted.items():
                if label != "reader":
                    warnings.warn(f"{path}: {label}: {number:,}", stacklevel=2)
    else:
        tables = tables_of(triples)
    if kinds:
        with naming_argument("kinds"):
            named = check(options_by_name(kinds, "kinds"), dict[str, KindName], "", "")
            tables, note = with_kinds(tables, named)
        if note:
            warnings.warn(f"kinds: {note}", stacklevel=2)
    bundle, summary = train_bundle(tables, **options)  # type: ignore[arg-type]
    warn(summary)
    return Home(with_words(bundle, file))


def warn(summary: TrainingSummary) -> None:
    """Warn, in the name of a caller's caller, of what a training found wrong."""
    for sentence in filter(None, (summary.scaled, summary.warning)):
        warnings.warn(sentence, stacklevel=3)


def train_again(home: Home, vectors: Path | None = None, **options: Any) -> TrainingSummary:
    """Train a home again on all facts that hold, with its kinds; ``options``: of
    ``train_bundle``.
    """
    bundle, summary = train_bundle(tables_of_home(home), **options)
    words = home.base.manifest.words
    if vectors is None and words is not None and Path(words.source).is_file():
        vectors = Path(words.source)
    home.train_again(with_words(bundle, vectors))
    return summary


def tables_of_home(home: Home) -> GraphTables:
    """The graph of the facts that hold in a home, with their counts, kinds and phrases."""
    rows, now = home.facts, home.now
    listed = [(*row.fact, row.count) for row in rows]
    frame = pd.DataFrame(listed, columns=[*TRIPLE, COUNT])
    tables = build_tables(MinedSource("home", frame, Naming()(frame, ())))
    kinds = dict(zip(now.entity_names, now.kinds, strict=True))
    phrases = dict(zip(now.entity_names, now.phrases, strict=True))
    given = {name: kind for name, kind in kinds.items() if kind}
    return with_kinds(tables, given, phrases)[0]


@usual_torch()
def train_bundle(
    tables: GraphTables,
    *,
    model: str | None = None,
    learning_rate: float | None = None,
    dimension: int = 100,
    budget: float = 60,
    seed: int = 0,
) -> tuple[Bundle, TrainingSummary]:
    """Train an embedding of a graph. Equal arguments give equal bytes
    (with an equal number of PyTorch's threads).

    Args:
        tables: the graph (``build_tables``, ``read_graph``, ``tables_of``).
        model: a registered model; None: the best of ``compared_models`` for validation
            triples.
        learning_rate: of Adagrad; None: the best of ``RATES``.
        dimension: d, the length of an entity's vector.
        budget: seconds for the comparison, by an estimate of its work; one setting is always tried.
            Large counts are scaled down (``TrainingSummary.epoch_observations``).
        seed: root seed of splits, initial vectors, batches and negatives.

    Raises:
        InputError: names the wrong argument, or says that training diverged.
    """
    learning_rate = check(learning_rate, Positive | None, "", "argument 'learning_rate'")  # type: ignore[arg-type]
    budget = check(budget, Positive, "", "argument 'budget'")
    seed = check(seed, Seed, "", "argument 'seed'")
    dimension = check(dimension, Count, "", "argument 'dimension'")
    whole = build_graph(tables.entities, tables.triples)
    plan = plan_of(whole, dimension, budget)
    graph = plan.graph
    with naming_argument("model"):
        options_of = {
            name: dict(MODELS.get(name).defaults)
            for name in ([model] if model else compared_models())
        }
    rates = RATES if learning_rate is None else (learning_rate,)
    configs = {
        plan.config(name, options, rate, dimension, seed): name
        for rate in rates
        for name, options in options_of.items()
    }
    repeated = repeated_relations(graph)
    groups = groups_of(graph, repeated)
    splits = held_out(graph, groups, seed, max(1, min(DRAWS, DENSE_LIMIT // plan.cells)))
    tries = int(budget / plan.seconds / len(splits))
    config, epochs = compare(session_of(graph, torch.from_numpy(splits)), list(configs), tries)
    tested = np.where(splits[:1] == TEST, TEST, TRAIN).astype(np.int8)
    both = np.concatenate([tested, np.zeros_like(tested)])
    final = fit_for(session_of(graph, torch.from_numpy(both)), keys_of(both), config, epochs)
    of_train = select(final, torch.tensor([0]))
    summary = TrainingSummary(
        entities=len(graph.entities),
        relations=len(graph.relations),
        triples=len(graph.triples),
        observations=int(whole.counts.sum()),
        epoch_observations=int(graph.counts.sum()),
        model=configs[config],
        learning_rate=config.training.learning_rate,
        dimension=dimension,
        epochs=epochs,
        batch_size=plan.batch_size,
        repeated=[[graph.relations[relation] for relation in together] for together in repeated],
        **test_measures(graph, groups, torch.from_numpy(tested), of_train),
    )
    options = options_of[summary.model]
    whole_model = select(final, torch.tensor([1]))
    return bundle_of(tables, whole, whole_model, summary, options, config), summary


@dataclass(frozen=True)
class Plan:
    """How a graph is trained, so that one setting at least fits into a budget of seconds."""

    graph: Graph  #: with counts that may be scaled down
    batch_size: int
    negatives: Negatives
    cells: int  #: of a dense table of scores: R · E²
    seconds: float  #: of an epoch of one model, by an estimate of its work

    def config(
        self, name: str, options: Mapping[str, Option], rate: float, dimension: int, seed: int
    ) -> TrainConfig:
        """How a model is trained when settings are compared."""
        training = Training(
            batch_size=self.batch_size,
            learning_rate=rate,
            weight_decay=DECAY / len(self.graph.entities),
            max_epochs=LEAST,
            evaluate_every=5,
            patience=4,
        )
        model = checked_model(name, options, dimension)
        return TrainConfig(seed, model, dimension, INIT_RANGE, self.negatives, training)


def plan_of(whole: Graph, dimension: int, budget: float) -> Plan:
    """Counts, batches and negatives by the size of a graph and the budget."""
    dense = is_dense(whole)
    mode, ratio = ("expected", 9) if dense else ("sampled", SAMPLED)
    most = max(OBSERVED, PER_TRIPLE * len(whole.triples))
    if not dense:  # time grows with the observations, and one setting is always tried
        seconds_each = dimension * (1 + 3 * ratio) / LIST_RATE
        most = min(most, int(budget / (LEAST * DRAWS * seconds_each)))
    graph = replace(whole, counts=scaled_counts(whole.counts, max(most, len(whole.triples))))
    entities, relations = len(graph.entities), len(graph.relations)
    observed, cells = int(graph.counts.sum()), relations * entities**2
    batch_size = max(1, min(observed // 10, observed if dense else LARGEST_BATCH))
    updates = observed / batch_size
    listed = observed * (1 + 3 * ratio) + updates * (entities + relations)
    work = updates * cells * 6 / DENSE_RATE if dense else listed / LIST_RATE
    seconds = updates * OVERHEAD + dimension * work
    negatives = check({"mode": mode, "ratio": ratio}, Negatives, "", "")
    return Plan(graph, batch_size, negatives, cells, seconds)


def bundle_of(
    tables: GraphTables,
    graph: Graph,
    trained: Embedding,
    summary: TrainingSummary,
    options: Mapping[str, Option],
    config: TrainConfig,
) -> Bundle:
    """The bundle of one model that all triples of a graph have trained."""
    made = {
        "seed": config.root,
        "weight_decay": config.training.weight_decay,
        "init_range": config.init_range,
        "ratio": config.negatives.ratio,
        **asdict(summary),
    }
    kinds = ["" if kind == ENTITY else kind for kind in tables.entities["kind"].astype(str)]
    phrases = list(tables.entities["phrase"].astype(str))
    # without the sentence model, a home takes the words of its vocabulary
    words, source = None, None
    if has_model():
        words, source = np.stack(list(map(by_model, phrases))), OF_MODEL
    manifest = Manifest(
        model_name=summary.model, model_options=dict(options), words=source, made=made
    )
    return Bundle(
        manifest,
        trained.entity[0].numpy(),
        trained.relation[0].numpy(),
        graph.entities,
        kinds,
        phrases,
        graph.relations,
        graph.triples.numpy(),
        words,
        graph.counts.numpy(),
    )


def keys_of(splits: np.ndarray | Tensor) -> Tensor:
    """Keys of the random streams of a stack with one model for each row of splits, (M, T);
    shape (M, 2).
    """
    return torch.tensor([[0, model] for model in range(len(splits))])


def repeated_relations(graph: Graph) -> list[list[int]]:
    """Relations that have the same pairs of entities, as they are or swapped;
    a symmetric one may stand alone.

    A model answers triples of the one from triples of the other without any knowledge of the
    entities.
    """
    head, relations, tail = graph.triples.numpy().T
    number = len(graph.entities)
    pairs = pd.DataFrame(
        {"relation": relations, "pair": head * number + tail, "swapped": tail * number + head}
    )
    pairs = pairs[head != tail]
    sizes = pairs["relation"].value_counts()
    repeats = nx.Graph()
    for column in ("pair", "swapped"):
        both = pairs.merge(pairs, left_on="pair", right_on=column)
        for (relation, other), shared in both[["relation_x", "relation_y"]].value_counts().items():
            enough = shared >= FEWEST_REPEATED and shared > REPEATED * min(
                sizes[relation], sizes[other]
            )
            if enough and (relation != other or column == "swapped"):
                repeats.add_edge(relation, other)
    return sorted(map(sorted, nx.connected_components(repeats)))


def groups_of(graph: Graph, repeated: Sequence[Sequence[int]]) -> np.ndarray:
    """The first triple, an id, that has the two entities of each triple and a relation
    that repeats its own; (T,).
    """
    head, relation, tail = graph.triples.numpy().T
    together = np.arange(len(graph.relations))
    is_repeated = np.zeros(len(graph.relations), dtype=bool)
    for relations in repeated:
        together[list(relations)] = relations[0]
        is_repeated[list(relations)] = True
    triples = np.arange(len(relation))
    alone = np.where(is_repeated[relation], -1, triples)
    keys = np.stack(
        [together[relation], np.minimum(head, tail), np.maximum(head, tail), alone], axis=1
    )
    _, first, group = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    return first[group.reshape(-1)]


def held_out(graph: Graph, groups: np.ndarray, seed: int, draws: int) -> np.ndarray:
    """Splits, (draws, T), with the same test triples and different validation triples;
    every name is in train.

    Triples of a group, (T,), have the same split.
    """
    number, most = len(graph.triples), MOST_SCORES // len(graph.entities)
    tests = min(max(number // 10, min(FEWEST, number // 5)), most, MOST_HELD_OUT)
    first = split_groups(graph, groups, np.arange(number), seed, 0, 0.0, tests / number)
    rest, splits = np.flatnonzero(first == TRAIN), np.tile(first, (draws, 1))
    for draw, row in enumerate(splits, 1):
        row[rest] = split_groups(graph, groups, rest, seed, draw, min(0.1, tests / number), 0.0)
    return splits


def split_groups(
    graph: Graph,
    groups: np.ndarray,
    triples: np.ndarray,
    root: int,
    seed: int,
    valid: float,
    test: float,
) -> np.ndarray:
    """``split`` of some triples, ids (N,), in which those of a group have
    the same split; (N,), int8.
    """
    wholes, group = np.unique(groups[triples], return_inverse=True)
    splits = split(graph.part(wholes), root, seed, valid, test)[group]
    relation = graph.triples[:, RELATION].numpy()[triples]
    for lost in np.setdiff1d(relation, relation[splits == TRAIN]):
        splits[group == group[relation == lost][0]] = TRAIN
    return splits


def compare(
    session: Session, configs: Sequence[TrainConfig], affordable: int
) -> tuple[TrainConfig, int]:
    """The best configuration by MRR* of the ends of validation triples, and its epochs;
    the first without such triples.

    ``affordable``: number of epochs in all; limits the configurations that are compared, and their
    epochs.
    """
    if not (session.splits == VALID).any():
        return configs[0], LEAST
    compared, failed, tried = (
        configs[: max(1, affordable // LEAST)],
        None,
        list[tuple[float, TrainConfig, int]](),
    )
    epochs = min(MOST, max(LEAST, affordable // len(compared)))
    for config in tqdm(compared, "settings", leave=False, disable=None):
        training = config.training.model_copy(update={"max_epochs": epochs})
        try:
            changed = replace(config, training=training)
            _, looks = fit(session, keys_of(session.splits), changed)
            by_draw = pd.concat(looks).pivot(
                index="epoch", columns="place", values="mrr_star_entity"
            )
            curve = by_draw.ffill().mean(axis=1)  # some draws stop earlier
            tried.append(
                (curve.max(), config, int(curve.index.to_numpy()[curve.to_numpy().argmax()]))
            )
        except NotFinite as error:
            failed = error
    if failed and not tried:
        raise InputError("argument 'learning_rate'", "", failed.message) from failed
    return max(tried, key=itemgetter(0))[1:]


def test_measures(
    graph: Graph, groups: np.ndarray, splits: Tensor, theta: Embedding
) -> dict[str, Any]:
    """The last fields of a ``TrainingSummary``, for an embedding trained on splits, (1, T).

    Triples of a group, (T,), count as one where errors are estimated.
    """
    names, number = ("mrr", "frequency", "chance"), int((splits == TEST).sum())
    if not number:
        nothing = (
            "no triple can leave training, since each entity and relation needs one: "
            "quality is unknown"
        )
        return {"test_triples": 0, **dict.fromkeys(names), "warning": nothing}
    queries = end_queries(graph, padded_ids(splits == TEST))
    learned = reciprocal_ranks(queries, queries.scores(theta, theta.entity))
    others = (
        reciprocal_ranks(queries, frequencies(graph, splits[0] == TRAIN, queries)),
        random_ranks(~queries.right, queries),
    )
    measures = dict(zip(names, (ranks.mean().item() for ranks in (learned, *others)), strict=True))
    gains = torch.stack([learned - other for other in others])
    independent = gains.shape[1] * len(np.unique(groups[splits[0] == TEST])) / number
    clear = bool((gains.mean(1) > CLEARLY * gains.std(1) / independent**0.5).all())
    nothing = (
        "the model has learned nothing that shows: it ranks answers about as "
        "their frequency or chance does"
    )
    return {"test_triples": number, **measures, "warning": None if clear else nothing}


def reciprocal_ranks(queries: EndQueries, scores: Tensor) -> Tensor:
    """Filtered reciprocal ranks of the answers by scores of all entities, (2, M, Q, E);
    one number for each query.
    """
    return (1 / queries.ranks(scores))[:, queries.counted].double().flatten()


def frequencies(graph: Graph, trained: Tensor, queries: EndQueries) -> Tensor:
    """Each entity's number of triples in a mask, (T,), in the slot and relation of each query;
    shape (2, M, Q, E).
    """
    numbers = torch.zeros(2, len(graph.relations), len(graph.entities))
    for number, slot in zip(numbers, (HEAD, TAIL), strict=True):
        number.index_put_(
            tuple(graph.triples[trained][:, [RELATION, slot]].T), torch.ones(()), accumulate=True
        )
    return numbers[:, queries.triples[..., RELATION]]
