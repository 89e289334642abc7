"""The explorer of the page, in a real browser, against Python:
vectors, indicators, scores and MRR*.
"""

from __future__ import annotations

import base64
import json
import os
from collections.abc import Callable, Iterator
from contextlib import chdir
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import pytest
import torch
from numpy.random import Generator

from isi.evaluation.ranking import make_queries, padded_ids, rank_queries
from isi.experiment.grid import GridPoints
from isi.experiment.store import Store
from isi.graph.sessions import OUT, TEST, TRAIN, VALID, Session, membership, touches
from isi.initializers.api import INITIALIZERS, InitContext, InitResult
from isi.insertion.engine import context_in_session
from isi.models.stack import Embedding
from isi.params import Params
from isi.report import explorer, page
from isi.report.explorer import COMPUTED, Explored
from isi.report.section import ReportSection
from isi.tables import paths
from tests.browser import Opened, opened
from tests.reports import ROOT, of_experiment, part_of, small_results
from tests.small_explorer import NAMES, scores, small

if TYPE_CHECKING:
    from playwright.sync_api import Browser

#: A folder with the outputs of the pipeline: the explorer of its run is tested, too.
RUN = Path(os.environ.get("ISI_RUN", ROOT))
#: Of a run's known entities, each so-manyth is compared, and of small graphs all; 1: each one, in
#: about 80 seconds.
EVERY = int(os.environ.get("ISI_EVERY", 12))
#: Initializers that draw.
DRAWN = ("xavier", "iu")
CASES = """cases => cases.map(({entity, given, name, dial}) => {
  const {world, subjectOf, insertion} = window.explorer, subject = subjectOf(world, entity);
  const places = subject.facts.flatMap(({triple}, place) => given.includes(triple) ? [place] : []);
  const one = insertion(world, subject, places, name && {name, dial});
  const scores = world.relations.map((_, relation) =>
    [false, true].map((isTail) => [...one.scoreOf(relation, isTail)]));
  return {vector: [...one.vector], weights: one.weights && [...one.weights], mrrStar: one.mrrStar, \
scores};
})"""


def of_run() -> tuple[Explored, pd.Series, Params]:
    params = page_params()
    with chdir(RUN):
        found = explorer.read(params, "ai2thor")
        assert found is not None
        return found, Store("ai2thor").entities()["kind"], params


def page_params() -> Params:
    from isi import params

    return params.load(ROOT / paths.PARAMS)


@pytest.fixture(scope="module", params=["small", "run"])
def shown(request: pytest.FixtureRequest) -> tuple[Explored, pd.Series, Params]:
    if request.param == "small":
        return small()
    if not (RUN / "data/embeddings/ai2thor/joint.safetensors").exists():
        pytest.skip("the pipeline has not run")
    return of_run()


def written(folder: Path, explored: Explored, kinds: pd.Series, params: Params) -> Path:
    """A page whose only section is the explorer."""
    entities = pd.DataFrame({"entity": explored.points.graph.entities, "kind": kinds})
    results = of_experiment(
        small_results(["home"]), "home", entities=entities, analyses={"explorer": explored}
    )
    results = replace(results, params=params.model_copy(update={"plots": results.params.plots}))
    page.Page("report", [ReportSection.of("insertions.explorer")]).write(folder, results)
    return folder / "index.html"


@pytest.fixture
def found(
    chromium: Browser, shown: tuple[Explored, pd.Series, Params], tmp_path: Path
) -> Iterator[tuple[Opened, Explored, Params]]:
    path = written(tmp_path, *shown)
    with opened(chromium, path, fragment="explorer") as opened_page:
        yield opened_page, shown[0], shown[2]
        assert opened_page.errors == opened_page.requests == []


# Python's side: one entity is inserted, alone, into Θ⁰ without it


def alone(points: GridPoints, entity: int) -> tuple[Session, Session]:
    """The sessions before and after the insertion of one entity into D⁰ without it."""
    before = points.session(0).entities.clone()
    before[0, entity] = False
    after = before | membership(torch.tensor([[entity]]), before.shape[1])

    def session(entities: torch.Tensor) -> Session:
        inside = entities[:, points.graph.triples[:, 0]] & entities[:, points.graph.triples[:, 2]]
        return Session(
            points.graph, entities, torch.as_tensor(points.splits).masked_fill(~inside, OUT)
        )

    return session(before), session(after)


def other_end(points: GridPoints, entity: int, triple: int) -> int:
    head, _, tail = points.graph.triples[triple].tolist()
    return int(head if tail == entity else tail)


def inserted(
    explored: Explored,
    params: Params,
    entity: int,
    given: list[int],
    name: str,
    dial: int,
) -> InitResult:
    """An initializer's result, from the facts ``given``;
    ``dial``: k, or the number of the page's draw.
    """
    points, (before, _) = explored.points, alone(explored.points, entity)
    without = explored.theta0.entity.clone()
    without[0, entity] = 0
    rows = torch.tensor([[0, 0, triple] for triple in sorted(given)], dtype=torch.int64).reshape(
        -1, 3
    )
    context = context_in_session(
        replace(explored.theta0, entity=without),
        before,
        torch.tensor([[entity]]),
        rows,
        torch.as_tensor(explored.words),
        params.seed,
        points.keys(),
    )
    options = dict(params.initializers[name])
    if "k" in options:
        options["k"] = dial
    parts = {field.name: getattr(context, field.name) for field in fields(context)}
    drawn = DrawnByPage(**parts, entity=points.graph.entities[entity], number=dial)
    return INITIALIZERS.get(name, name).initialize(drawn, options)


@dataclass(frozen=True)
class DrawnByPage(InitContext):
    """A context whose random numbers are those of the page."""

    entity: str = ""
    number: int = 1

    def draw(
        self, purpose: str, distribution: Callable[[Generator, tuple[int, int]], np.ndarray]
    ) -> torch.Tensor:
        assert distribution is Generator.random
        size = self.theta0.entity.shape[-1]
        return torch.tensor([[uniform(purpose, self.entity, self.number, size)]]).float()


def uniform(initializer: str, entity: str, draw: int, size: int) -> list[float]:
    """The page's random numbers: mulberry32 from FNV-1a of a text."""
    bits = 0x811C9DC5
    for byte in f"{initializer} {draw} {entity}".encode():
        bits = (bits ^ byte) * 0x01000193 % 2**32
    numbers = []
    for _ in range(size):
        bits = (bits + 0x6D2B79F5) % 2**32
        mixed = (bits ^ bits >> 15) * (bits | 1) % 2**32
        mixed ^= (mixed + (mixed ^ mixed >> 7) * (mixed | 61)) % 2**32
        numbers.append((mixed ^ mixed >> 14) / 2**32)
    return numbers


def mrr_star(
    explored: Explored, embedding: Embedding, entity: int, given: list[int]
) -> float | None:
    """MRR* over the true triples that are not given,
    with the entity given and the other end hidden.
    """
    points, (before, after) = explored.points, alone(explored.points, entity)
    told = torch.zeros(1, len(points.graph.triples), dtype=torch.bool)
    told[0, given] = True
    of = touches(points.graph, membership(torch.tensor([[entity]]), len(points.graph.entities)))
    loop = points.graph.triples[:, 0] == points.graph.triples[:, 2]
    queried = after.members(TRAIN, VALID, TEST) & of & ~told & ~loop
    if not queried.any():
        return None
    filtered = (after.members(TRAIN, VALID) & ~of) | told
    queries = make_queries(after, padded_ids(queried), queried, filtered, before.entities)
    (ranked,) = rank_queries(embedding, {"all": queries})
    head, _, tail = ranked["all"].slots
    is_tail = ranked["all"].rows.ids[2] == entity
    closeness = torch.where(is_tail, head.closeness, tail.closeness)
    weight = 2 * ranked["all"].rows.entity_weight[:, : closeness.shape[1]]
    return float((weight * closeness).sum() / weight.sum())


def test_vectors_indicators_scores_and_mrr_star_are_pythons(
    found: tuple[Opened, Explored, Params],
) -> None:
    opened_page, explored, params = found
    points, rng = explored.points, np.random.default_rng(0)
    everyone = np.flatnonzero(points.session(1).entities[0])
    cases: list[dict[str, Any]] = []
    step = EVERY if len(everyone) > len(NAMES) else 1
    for entity in (
        entity for entity in everyone.tolist() if entity in points.novel or entity % step == 0
    ):
        _, after = alone(points, entity)
        ends = points.graph.triples[:, [0, 2]] == entity
        facts = np.flatnonzero(
            (after.members(TRAIN)[0] & (ends[:, 0] ^ ends[:, 1])).numpy()
        ).tolist()
        some = sorted(rng.choice(facts, rng.integers(len(facts) + 1), replace=False).tolist())
        for number, name in enumerate(COMPUTED):
            usual = params.initializers[name].get("k", 1)
            for given, dial in ((facts, usual), (some, usual), (some, int(rng.integers(1, 6)))):
                if dial == usual or name in DRAWN or "k" in params.initializers[name]:
                    cases.append({"entity": entity, "given": given, "name": name, "dial": dial})
            if not number:
                cases.append({"entity": entity, "given": some, "name": None, "dial": 0})
    answers = opened_page.page.evaluate(CASES, cases)
    data = json.loads(opened_page.page.locator("#explorer-data").text_content() or "")
    rounded = np.frombuffer(base64.b64decode(data["joint"]), "<i2").reshape(
        explored.joint.entity.shape
    )
    joint = replace(
        explored.joint, entity=torch.as_tensor(rounded * data["jointScale"], dtype=torch.float32)
    )
    for case, answer in zip(cases, answers, strict=True):
        entity, given, name = case["entity"], case["given"], case["name"]
        embedding = joint
        if name:
            result = inserted(explored, params, entity, given, name, case["dial"])
            assert np.allclose(answer["vector"], result.vectors[0, 0], rtol=0, atol=1e-4), case
            assert (answer["weights"] is None) == (result.weights is None)
            if result.weights is not None:
                assert np.allclose(answer["weights"], result.weights[0, 0], rtol=0, atol=1e-4), case
            table = explored.theta0.entity.clone()
            table[0, entity] = result.vectors[0, 0]
            embedding = replace(explored.theta0, entity=table)
        assert np.allclose(answer["scores"], scores(embedding, entity), rtol=1e-4, atol=1e-4), case
        assert answer["mrrStar"] == pytest.approx(
            mrr_star(explored, embedding, entity, given), abs=1e-4
        ), case


def test_a_random_initializer_starts_at_its_median_draw(
    found: tuple[Opened, Explored, Params],
) -> None:
    """The median by Python: of an even number of draws the lower one."""
    opened_page, explored, params = found
    starts = """([id, name]) => {
      const {world, subjectOf, insertion} = explorer, subject = subjectOf(world, id);
      const {dial, mrrStar} = insertion(world, subject, subject.given, {name, dial: 0});
      return [subject.given.map((place) => subject.facts[place].triple), dial, mrrStar];
    }"""
    entities = explored.points.novel[0, 0].tolist()
    for entity in entities[:3]:
        for name in DRAWN:
            given, dial, value = opened_page.page.evaluate(starts, [entity, name])
            values = []
            for draw in range(1, 51):
                table = explored.theta0.entity.clone()
                result = inserted(explored, params, entity, given, name, draw)
                table[0, entity] = result.vectors[0, 0]
                embedding = replace(explored.theta0, entity=table)
                values.append(mrr_star(explored, embedding, entity, given))
            if None in values:
                assert dial == 1
                continue
            assert value == pytest.approx(sorted(values)[24], abs=1e-4)
            assert values[dial - 1] == pytest.approx(value, abs=1e-4)


def test_what_is_given_at_first_is_what_the_run_gives(
    found: tuple[Opened, Explored, Params],
) -> None:
    opened_page, explored, _ = found
    points = explored.points
    first = opened_page.page.evaluate("""() => explorer.world.novel.map((id) => {
      const {given, facts} = explorer.subjectOf(explorer.world, id);
      return [id, given.map((place) => facts[place].triple)];
    })""")
    rows = points.insert_triples_in(1)
    assert dict(first) == {
        int(entity): rows[rows[:, 1] == place, 2].tolist()
        for place, entity in enumerate(points.novel[0, 0])
    }


# What is shown


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("report"), *small())


def numbers(found: Opened) -> list[str]:
    return found.page.locator("#explorer-numbers strong").all_inner_texts()


def state(found: Opened) -> Any:
    return found.page.evaluate(
        "(({subject, given, choices}) => [subject.name, subject.facts.length, given, choices])"
        "(explorer.state())"
    )


def test_choices_stand_in_the_address_and_come_back_from_it(
    chromium: Browser, report: Path
) -> None:
    with opened(chromium, report, fragment="explorer") as found:
        control, started = found.page.get_by_label, numbers(found)
        control("New entity").select_option("50% / half")
        control("First initializer").select_option("RS")
        found.page.locator("#explorer-dial-0").focus()
        found.page.keyboard.press("ArrowLeft")
        control("Second initializer").select_option("Kind mean")
        found.page.locator("#explorer-facts input").first.click()
        before = state(found)
        assert (before[0], before[3]) == (
            "50% / half",
            [{"name": "rs", "dial": 3}, {"name": "kind_mean", "dial": 0}],
        )
        with opened(
            chromium, report, fragment=found.page.evaluate("location.hash").removeprefix("#")
        ) as again:
            assert state(again) == before
            assert numbers(again) == numbers(found) != started
            assert again.errors == []
        found.page.evaluate("location.hash = '#explorer/no such/thing/xavier~x/8.9.77/1.1.99'")
        found.page.evaluate("location.hash = '#else'")
        assert state(found)[0] == before[0]
        assert found.errors == []


def test_a_reader_inserts_an_entity_of_their_own(chromium: Browser, report: Path) -> None:
    with opened(chromium, report, fragment="explorer") as found:
        found.page.get_by_label("New entity").select_option("own")
        found.page.get_by_label("Its name").fill("wine bottle")
        about = found.page.locator("#explorer-about")
        assert "“bottle”" in about.inner_text()
        found.page.get_by_label("Its name").fill("zzz")
        assert "no word vector" in about.inner_text()
        other = found.page.get_by_label("Other entity")
        for direction, end in (("0", 1), ("1", 2), ("1", 2)):  # the last one is there already
            found.page.get_by_label("Direction").select_option(direction)
            other.select_option(index=end)
            found.page.get_by_role("button", name="Add").click()
        assert found.page.locator("#explorer-facts label").count() == 2
        found.page.locator("#explorer-facts input").first.uncheck()
        assert len(numbers(found)) == 2  # it is not in the joint model
        assert numbers(found) != ["–", "–"]
        before = state(found)
        with opened(
            chromium, report, fragment=found.page.evaluate("location.hash").removeprefix("#")
        ) as again:
            assert state(again) == before
        assert found.errors == []


def test_a_name_of_ones_own_shows_answers_and_claims_no_facts(
    chromium: Browser, report: Path
) -> None:
    with opened(chromium, report, fragment="explorer/+tea cup/es/xavier//") as found:
        assert found.page.locator("#explorer-answers li").first.is_visible()
        assert numbers(found) == []
        words = found.page.locator("#explorer-status").inner_text()
        assert "No fact of tea cup is known" in words
        assert found.errors == []


def test_facts_of_ones_own_stay_as_they_are_ticked_until_they_are_removed(
    chromium: Browser, report: Path
) -> None:
    with opened(chromium, report, fragment="explorer/+tea cup/es/xavier//") as found:
        add, ticks = (
            found.page.get_by_role("button", name="Add"),
            found.page.locator("#explorer-facts input"),
        )
        for end in (1, 2):
            found.page.get_by_label("Other entity").select_option(index=end)
            add.click()
        ticks.first.uncheck()
        marks = found.page.locator(".ex-first .ex-mark").all_inner_texts()
        assert sorted(marks) == ["given", "not given"]
        found.page.get_by_label("Its name").fill("tea cups")
        assert state(found)[1:3] == [2, [1]]
        found.page.get_by_label("Other entity").select_option(index=3)
        add.click()
        assert state(found)[1:3] == [3, [1, 2]]
        found.page.get_by_label("New entity").select_option("pan")
        found.page.get_by_label("New entity").select_option("own")
        assert state(found)[:3] == ["tea cups", 3, [1, 2]]
        found.page.get_by_role("button", name="Remove").nth(1).click()
        assert state(found)[1:3] == [2, [1]]
        assert ticks.evaluate_all("all => all.map(one => one.checked)") == [False, True]
        assert found.errors == []


def test_answers_are_ranked_marked_and_never_the_entity_itself(
    chromium: Browser, report: Path
) -> None:
    with opened(chromium, report, fragment="explorer/pan/ers/xavier") as found:
        facts = found.page.evaluate("explorer.state().subject.facts")
        given = found.page.evaluate("explorer.state().given")
        for summary in found.page.locator("#explorer-others summary").all():
            summary.click()
        texts = found.page.locator(".ex-query li").all_inner_texts()
        assert not any(text.removeprefix("✓ ").startswith("pan") for text in texts)
        marks = found.page.locator(".ex-query .ex-first .ex-mark").all_inner_texts()
        expected = [
            "given" if place in given else "held out" if fact["split"] else "trained"
            for place, fact in enumerate(facts)
        ]
        assert sorted(marks) == sorted(expected)
        for text in found.page.locator(".ex-query ol").all():
            ranks = [int(item.get_attribute("value") or 0) for item in text.locator("li").all()]
            assert ranks == sorted(set(ranks))


def test_heads_of_answers_have_the_colours_of_the_vectors(chromium: Browser, report: Path) -> None:
    colours = "all => [...new Set(all.map(one => getComputedStyle(one).color))]"
    with opened(chromium, report, fragment="explorer/pan/es/xavier") as found:
        by_order = []
        for order in ("first", "second", "third"):
            heads = found.page.locator(f"#explorer-answers .ex-{order} .ex-by")
            (colour,) = heads.evaluate_all(colours)
            by_order.append(colour)
            if order != "third":
                mark = found.page.locator(f".ex-legend .ex-{order}")
                assert mark.evaluate_all(colours) == [colour]
        assert len({*by_order}) == 3


def test_an_indicator_is_marked_on_the_map_and_arrows_name_its_points(
    chromium: Browser, report: Path
) -> None:
    with opened(chromium, report, fragment="explorer/pan/es/xavier") as found:
        button = found.page.locator("#explorer-indicators button").first
        name = button.inner_text()
        button.focus()
        pointed = found.page.locator("#explorer-map-name")
        assert pointed.inner_text().startswith(name)
        assert found.page.locator(".ex-dot.ex-lit").count() == 1
        assert found.page.locator(".ex-lines .ex-first").count() == 3
        found.page.locator("#explorer-map").focus()
        found.page.keyboard.press("ArrowRight")
        first = pointed.inner_text()
        found.page.keyboard.press("ArrowRight")
        assert first
        assert pointed.inner_text() != first


def test_a_change_is_read_out(chromium: Browser, report: Path) -> None:
    with opened(chromium, report, fragment="explorer/pan/es/xavier") as found:
        live = found.page.locator("#explorer-changed[role=status]")
        assert live.inner_text() == ""
        found.page.locator("#explorer-dial-0").focus()
        found.page.keyboard.press("ArrowLeft")
        live.get_by_text("now ES, k 2").wait_for()
        for value in numbers(found)[:2]:
            assert value in live.inner_text()
        tick = found.page.locator("#explorer-facts input").first
        before = tick.is_checked()
        tick.click()
        live.get_by_text(": not given." if before else ": given.").wait_for()
        found.page.get_by_label("Second initializer").select_option("Mean")
        live.get_by_text("now Mean").wait_for()
        found.page.get_by_label("New entity").select_option("pot")
        live.get_by_text("pot, ").wait_for()


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("mugs", "nearest known phrase, “mug”"),
        ("frying-pan", "nearest known phrase, “pan”"),
        ("wooden shelves", "nearest known phrase, “shelf”"),
        ("top cup", "nearest known phrase, “cup”"),  # not table top: the last word counts first
        ("cup holder", "A guess: no known phrase ends in its last word"),
        ("scale", "no word vector"),
    ],
)
def test_the_nearest_name_is_said_and_a_guess_is_called_one(
    chromium: Browser, report: Path, name: str, words: str
) -> None:
    with opened(chromium, report, fragment=f"explorer/+{name}/es/xavier//") as found:
        assert words in found.page.locator("#explorer-about").inner_text()
        assert found.page.locator("#explorer-answers li").first.is_visible()
        assert found.errors == []


def test_facts_and_map_stay_beside_the_answers_on_a_desktop(
    chromium: Browser, report: Path
) -> None:
    with opened(chromium, report, fragment="explorer/pan/es/ers") as found:
        found.page.locator("#explorer-answers .ex-query").last.scroll_into_view_if_needed()
        answers = found.page.locator("#explorer-answers").bounding_box()
        assert answers
        for part in ("#explorer-facts", "#explorer-map", "#explorer-by-0"):
            box = found.page.locator(part).bounding_box()
            assert box
            assert box["x"] + box["width"] <= answers["x"]
            assert 0 <= box["y"] < box["y"] + box["height"] <= 900
        names = found.page.locator("#explorer-indicators th button").all_inner_texts()
        assert set(found.page.locator(".ex-labels text").all_text_contents()) == {*names}
        place = found.page.locator("#explorer-facts").bounding_box()
        found.page.get_by_label("First initializer").select_option("Mean")  # it has no dial
        assert found.page.locator("#explorer-facts").bounding_box() == place


def test_what_has_the_focus_is_not_under_the_facts_on_a_phone(
    chromium: Browser, report: Path
) -> None:
    with opened(chromium, report, width=390, fragment="explorer/pan/es/xavier") as found:
        found.page.locator("#explorer-others summary").focus()
        for _ in range(8):
            found.page.keyboard.press("Shift+Tab")
            covered = found.page.evaluate("""() => {
              const box = document.activeElement.getBoundingClientRect();
              const facts = document.querySelector(".ex-facts");
              const inside = facts.contains(document.activeElement);
              return !inside && box.top < facts.getBoundingClientRect().bottom
                && box.bottom > facts.getBoundingClientRect().top;
            }""")
            assert not covered


@pytest.mark.parametrize(("width", "scheme"), [(390, "light"), (1280, "dark")])
def test_nothing_sticks_out_and_nothing_is_requested(
    chromium: Browser, report: Path, width: int, scheme: str
) -> None:
    with opened(chromium, report, width=width, scheme=scheme, fragment="explorer") as found:
        assert found.overflow == 0
        assert found.page.locator("#explorer-box").is_visible()
        assert found.errors == found.requests == []


def test_paper_and_readers_without_scripts_have_a_sentence(chromium: Browser, report: Path) -> None:
    with opened(chromium, report, fragment="explorer") as found:
        found.page.emulate_media(media="print")
        assert found.page.locator(".ex-paper").is_visible()
        assert not found.page.locator("#explorer-box").is_visible()
    with opened(chromium, report, script=False) as found:
        assert found.page.locator(".ex-paper").is_visible()
        assert not found.page.locator("#explorer-box").is_visible()


# The data, and the modules


def test_a_turned_scaled_and_moved_joint_model_lies_on_theta0() -> None:
    rng = np.random.default_rng(1)
    onto, known = rng.normal(size=(9, 4)), np.arange(9) < 6
    rotation = np.linalg.qr(rng.normal(size=(4, 4)))[0]
    turned, fitted = explorer.procrustes(0.3 * onto @ rotation + 7, onto, known)
    assert turned == pytest.approx(onto)
    assert fitted == pytest.approx(1)


def test_another_model_leaves_the_explorer_out() -> None:
    results = of_experiment(small_results(["home"]), "home", analyses={"explorer": None})
    section = part_of("explorer", results)
    assert section is not None
    assert [block.kind for block in section.blocks] == ["prose"]
