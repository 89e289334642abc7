"""What the report says of the transfer, and of the paper, against small tables worked out by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd
import pytest

from isi.report import cross_validation, paper, tables, transfer
from isi.report.results import Results
from tests.test_report import results

KINDS = ["object", "affordance", "affordance", "room", "object"]
ENTITIES = pd.DataFrame(
    {"entity": ["shelf", "open", "push", "kitchen", "fan"], "kind": KINDS, "source": ["ai2thor"] * 4 + ["mp3d"]}
)


def ranked(model: str, seed: int, order: list[int]) -> list[dict[str, Any]]:
    """Ranks of the answers about the fan, the first first."""
    return [
        {"model": model, "seed": seed, "entity": 4, "answer": answer, "rank": rank}
        for rank, answer in enumerate(order, 1)
    ]


def moved(rows: list[tuple[str, str, int, int, int, float]], *answers: list[dict[str, Any]]) -> Results:
    """Results whose transfer has these runs and these ranks."""
    there = results(rows, entities=ENTITIES)
    return results([], transfer=there, affordances=pd.DataFrame([row for rows in answers for row in rows]))


def test_the_drop_is_what_new_candidates_cost_at_once() -> None:
    rows = [
        ("xavier", "known", 10, 0, 0, 0.5), ("xavier", "known", 10, 1, 0, 0.4), ("xavier", "known", 10, 0, 9, 0.7),
        ("xavier", "known_closed", 10, 0, 0, 0.7), ("xavier", "known_closed", 10, 1, 0, 0.8),
        ("es", "known", 10, 0, 0, 0.75), ("es", "known_closed", 10, 0, 0, 0.75),
        ("joint", "known", 10, 0, 0, 0.1), ("joint", "known_closed", 10, 0, 0, 0.9),
    ]  # fmt: skip
    assert transfer.drop(moved(rows)) == pytest.approx({"es": 0, "xavier": 100 * (1 - 0.9 / 1.5)})


def test_answers_go_by_mean_rank_over_repeats_and_those_that_are_no_affordance_are_marked() -> None:
    found = moved(
        [], ranked("es", 0, [1, 0, 2, 3, 4]), ranked("es", 3, [2, 1, 4, 0, 3]), ranked("rs", 0, [3, 4, 2, 1, 0])
    )
    # means: open 1.5, push 2, shelf 3, kitchen 4.5; the fan itself is of Matterport3D and no answer here
    assert transfer.top_answers(found, "es", "fan") == [
        ("open", "affordance"),
        ("push", "affordance"),
        ("shelf", "object"),
        ("kitchen", "room"),
    ]
    assert transfer.top_answers(found, "rs", "fan")[0] == ("kitchen", "room")


def test_shares_count_affordances_among_the_first_four_of_every_inserted_entity() -> None:
    found = moved(
        [], ranked("es", 0, [1, 0, 2, 3, 4]), ranked("es", 3, [0, 3, 4, 2, 1]), ranked("rs", 0, [1, 2, 4, 0, 3])
    )
    assert transfer.shares(found) == pytest.approx({"es": 100 * 3 / 8, "rs": 50})


def test_a_definition_may_leak_triples_of_either_source() -> None:
    rows = [("ai2thor", "shelf", "hasAffordance", "open", 3), ("mp3d", "fan", "atLocation", "kitchen", 2),
            ("mp3d", "fan", "hasAffordance", "push", 1)]  # fmt: skip
    triples = pd.DataFrame(rows, columns=["source", "head", "relation", "tail", "count"])
    said = {"shelf": "a board that may be opened", "fan": "what cools the air of kitchens", "open": "to push a fan"}
    definitions = pd.DataFrame({"phrase": list(said), "definition": list(said.values())})
    there = results([], entities=ENTITIES.assign(phrase=ENTITIES["entity"]), triples=triples)
    table = tables.leaks(results([], transfer=there, definitions=definitions))
    assert table.frame[list(triples.columns)].to_numpy().tolist() == [list(row) for row in rows[:2]]
    assert "2 of 3 unique triples" in table.caption


def test_fewer_epochs_is_against_the_mean_of_xavier() -> None:
    rows = [("joint", "all", 1, seed, 0, 0.7) for seed in (0, 1)]
    for model, epochs in (("xavier", (8, 12)), ("es", (2, 3))):
        for seed, epoch in enumerate(epochs):
            rows += [(model, "all", 1, seed, 0, 0.1), (model, "all", 1, seed, epoch, 0.7)]
    assert paper.fewer_epochs(results(rows)) == pytest.approx({"xavier": 0, "es": 75})


@pytest.mark.parametrize(("value", "text"), [(15000.0, "15,000"), (41.4, "41.4"), (0.001, "0.001"), (3, "3")])
def test_numbers_of_all_sizes_are_shown_in_one_column(value: float, text: str) -> None:
    assert paper._shown(value) == text


def test_the_best_value_of_a_factor_has_the_others_as_chosen() -> None:
    made = results([])
    rows = [
        setting.model_dump() | {"fold": fold, "mrr_star": 0.5} for setting in made.params.settings for fold in (0, 1)
    ]
    table = pd.DataFrame(rows).sort_values(["dimension", "ratio", "learning_rate", "weight_decay"])
    table.loc[table["dimension"] == 40, "mrr_star"] = [0.9, 0.4]
    table.loc[table["learning_rate"] == 0.2, "mrr_star"] = [0.6, 0.6]
    found = results([], cross_validation=table)
    assert cross_validation.best(found, "dimension") == 40
    assert cross_validation.best(found, "learning_rate") == 0.2
    assert cross_validation.best(found, "ratio") == made.params.negatives.ratio  # equals: the choice, which is first
    assert "dimension 40" in cross_validation.sentence(found)
    assert "65.0" in cross_validation.sentence(found)
    table["mrr_star"] = np.where(table["learning_rate"] == 0.1, table["mrr_star"], 0.1)
    table.loc[table["dimension"] == 40, "mrr_star"] = 0.2
    assert "no other setting has more" in cross_validation.sentence(results([], cross_validation=table))
