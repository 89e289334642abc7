"""Mistakes in command lines about embeddings
(``isi insert``, ``observe``, ``remove``, ``undo``, ``ask``, ...).
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from safetensors.numpy import save

import isi
from tests.mistakes.calls import Typed, put
from tests.small_bundle import NAMES, edit, small, tamper, written

FACT = "x --fact atLocation bed"
LARGEST = "x" * 300


def large() -> None:
    """Write the embedding with vectors so large that a score overflows."""
    tensors = {"entities": small().entities * np.float32(1e30), "relations": small().relations}
    tamper(Path("home"), "vectors.safetensors", bytes(save(tensors)))


def distances() -> None:
    """Write an embedding whose scoring function is a distance."""
    options = {"margin": 1.0, "squared": False}
    manifest = small().manifest.model_copy(
        update={"model_name": "transe", "model_options": options}
    )
    written(Path("home"), small(manifest=manifest))


def twins() -> None:
    written(Path("home"), small(entity_names=[*NAMES[:-1], "turnOn"]))


def inserted(why: str, folder: str = "home", entity: str = NAMES[-1]) -> Callable[[], object]:
    """A function that marks an entity (default: the last) of an embedding as inserted."""
    one = {
        "entity": entity,
        "told": [["bed", "hasAffordance", entity]],
        "definition": None,
        "asked": None,
        "options": {},
        "seed": 0,
        "initializer": "mean",
        "why": why,
        "fallback": None,
    }
    return lambda: edit(Path(folder), lambda about: about.update(inserted=[one]))


def inserted_elsewhere() -> None:
    """Insert an entity in another folder."""
    live = isi.open(written(Path("other")))
    live.insert("hob", [("hob", "atLocation", "kitchen")])
    live.save()


def changed() -> None:
    """Insert an entity, and give a fact of a known one."""
    live = isi.open("home")
    live.insert("hob", [("hob", "atLocation", "kitchen")])
    live.observe([("kettle", "atLocation", "bedroom")])
    live.save()


def journal(line: str) -> Callable[[], object]:
    """A function that writes a line into the journal."""
    return lambda: Path("home/journal.jsonl").write_text(f"{line}\n", encoding="utf-8")


#: Texts of the message, and the arguments between ``isi insert`` and ``--embedding home``.
INSERT = [
    ("'qxz'", "qxz"),
    ("'Kettle'", "Kettle --fact atLocation kitchen"),
    ("'Kettles'|--new", "Kettles --fact atLocation kitchen"),
    ("name", f"{'x' * 1001} --fact atLocation bed"),
    ("name", "'a\tb'"),
    ("name", "' '"),
    ("definition", "x --definition 'a\nb'"),
    ("kitchn|'kitchen'", "x --fact atLocation kitchn"),
    ("hasColour", "x --fact hasColour bed"),
    ("'atLocation'|'bed'", "x --inverse-fact atLocation bed"),
    ("kind|'rom'|'room'", "x --kind rom"),
    ("--initializer", f"{FACT} --initializer e"),
    ("--set", f"{FACT} --set k=3"),
    ("--initializer|kk", f"{FACT} --initializer rs --set kk=3"),
    ("--initializer: k", f"{FACT} --initializer rs --set k=0"),
    ("none.txt", "x --vectors none.txt --out out"),
    ("--vectors|--out", f"{FACT} --vectors words.txt"),
    ("NAME|--from", ""),
    ("NAME|--from", f"{FACT} --from log.csv"),
    ("NAME|--from", "--kind room --from log.csv"),
    ("none.csv", "--from none.csv"),
    ("--initializer", "--from log.csv --initializer e"),
    ("xxx...xxx", f"{FACT} --out {LARGEST}"),
    ("log.csv", f"{FACT} --out log.csv"),
    ("log.csv/x", f"{FACT} --out log.csv/x"),
    ("--out|data/final_models", f"{FACT} --out data/final_models/mine"),
]
#: Texts of the message, and another command, on an embedding into which ``hob`` was inserted.
CHANGES = [
    ("'keetle'|'kettle'", "observe --fact keetle atLocation kitchen"),
    ("'isAt'", "observe --fact kettle isAt kitchen"),
    ("'bed'|inserted|hob", "remove bed"),
    ("'hobb'|'hob'", "remove hobb"),
    ("bed atLocation kitchen|holds", "remove --fact bed atLocation kitchen"),
    ("hob hasAffordance turn on|holds", "remove --fact hob hasAffordance 'turn on'"),
    ("kettle atLocation bed|holds", "move kettle atLocation bedroom --instead-of bed"),
    ("'keetle'|'kettle'", "move keetle atLocation kitchen"),
    ("'bed'|inserted|hob", "interference bed"),
    ("'bed'|inserted|hob", "explain bed"),
    ("'hob'", "insert Hob --fact atLocation bedroom"),
]
COMMAND_CASES = [
    Typed("no command", "", "COMMAND", status=2),
    *(
        Typed(typed[:60] or "nothing to insert", f"insert {typed} --embedding home", names)
        for names, typed in INSERT
    ),
    *(
        Typed(typed, f"insert {typed} --embedding home", names, status=2)
        for names, typed in (
            ("--seed", f"{FACT} --seed -1"),
            ("--out", f"{FACT} --out ."),
            ("--set", f"{FACT} --initializer rs --set k=3 --set k=4"),
        )
    ),
    *(Typed(typed, f"{typed} --embedding home", names, before=changed) for names, typed in CHANGES),
    Typed(
        "a name of several words without quotes",
        "insert wine jug --fact atLocation bed --embedding home",
        "jug|quotes",
        status=2,
    ),
    Typed("half a fact", "observe --fact bed atLocation --embedding home", "--fact", status=2),
    Typed(
        "a fact of an unknown folder",
        "observe --fact bed atLocation kitchen --embedding nowhere",
        "nowhere",
    ),
    Typed("nothing to undo", "undo --embedding home", "undo"),
    Typed("no insertion that interferes", "interference --embedding home", "home"),
    *(
        Typed(f"a journal with {line}", command, "home/journal.jsonl|line 1", before=journal(line))
        for line, command in (
            ("{", "nearest bed --embedding home"),
            ('{"do": "forget"}', "undo --embedding home"),
            ('{"do": "observe", "facts": [["bed"]]}', "history --embedding home"),
        )
    ),
    Typed(
        "a name that is written in several ways",
        "insert x --fact atLocation 'TURN ON' --embedding home",
        "TURN ON",
        before=twins,
    ),
    Typed(
        "an initializer that the model does not serve",
        f"insert {FACT} --initializer ridge --embedding home",
        "--initializer|ridge",
        before=distances,
    ),
    Typed(
        "word vectors of other words",
        "insert x --vectors words.txt --embedding home --out out",
        "words.txt",
        before=put(words__txt="mug 1 2\ncup 2 1\n"),
    ),
    Typed(
        "a number with an underscore",
        "insert x --vectors words.txt --embedding home --out out",
        "words.txt|line 1",
        before=put(words__txt="mug 1_0 2\n"),
    ),
    Typed(
        "a folder with something else in it",
        f"insert {FACT} --embedding home --out other",
        "other|thesis.tex",
        before=lambda: (
            Path("other").mkdir(),
            Path("other/thesis.tex").write_text("all of it", encoding="utf-8"),
        ),
    ),
    Typed(
        "a folder into which others were inserted",
        f"insert {FACT} --embedding home --out other",
        "other",
        before=inserted_elsewhere,
    ),
    Typed(
        "vectors that are too large to be inserted among",
        f"insert {FACT} --embedding home --out out",
        "home/vectors.safetensors|entities",
        before=large,
    ),
    Typed("half a question", "ask kettle --embedding home", "relation"),
    Typed("both ends", "ask kettle atLocation --tail bed --embedding home", "relation"),
    Typed("an end twice", "ask kettle atLocation --head bed --embedding home", "--head", status=2),
    Typed("a misspelt entity", "ask ketle atLocation --embedding home", "ENTITY"),
    Typed("an unknown relation", "ask kettle located --embedding home", "RELATION"),
    Typed(
        "a number of answers that is none",
        "ask kettle atLocation --top 0 --embedding home",
        "--top",
        status=2,
    ),
    Typed("no name", "nearest '' --embedding home", "ENTITY"),
    Typed("no such folder", "nearest bed --embedding nowhere", "nowhere"),
    Typed("a name of a folder that is too long", f"nearest bed --embedding {LARGEST}", "xxx...xxx"),
    Typed(
        "the pipeline's embedding, which is not there yet",
        "nearest bed",
        "data/final_models/ai2thor",
    ),
    Typed("an entity that was not inserted", "explain bed --embedding home", "'bed'|inserted"),
    Typed(
        "what moves a terminal's cursor, in what the folder says of it",
        "explain 'lie on' --embedding home",
        "home/embedding.json|inserted.0.why",
        before=inserted("\x1b[2J"),
    ),
]
