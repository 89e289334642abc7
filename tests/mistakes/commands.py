"""Mistakes in what is typed: of embeddings (``isi insert``, ``ask``, ``nearest``, ``explain``)."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from safetensors.numpy import save

from tests.mistakes.calls import Typed, put
from tests.small_bundle import NAMES, edit, small, tamper, written

FACT = "insert x --fact atLocation bed"
LARGEST = "x" * 300


def large() -> None:
    """The embedding with vectors of which a score would overflow."""
    tensors = {"entities": small().entities * np.float32(1e30), "relations": small().relations}
    tamper(Path("home"), "vectors.safetensors", bytes(save(tensors)))


def distances() -> None:
    """An embedding of distances."""
    options = {"margin": 1.0, "squared": False}
    manifest = small().manifest.model_copy(update={"model_name": "transe", "model_options": options})
    written(Path("home"), small(manifest=manifest))


def twins() -> None:
    written(Path("home"), small(entity_names=[*NAMES[:-1], "turnOn"]))


def inserted(why: str, folder: str = "home", entity: str = NAMES[-1]) -> Callable[[], object]:
    """The last entity as if it had been inserted."""
    one = {"entity": entity, "told": [["bed", "hasAffordance", entity]], "definition": None, "asked": None,
           "options": {}, "seed": 0, "initializer": "mean", "why": why, "fallback": None}  # fmt: skip
    return lambda: edit(Path(folder), lambda about: about.update(inserted=[one]))


def inserted_elsewhere() -> None:
    """In another folder."""
    written(Path("other"), small(entity_names=[*NAMES[:-1], "wash"]))
    inserted("as asked", "other", "wash")()


ISI_CASES = [
    Typed("no command", "", "COMMAND", status=2),
]  # fmt: skip

INSERT_CASES = [
    Typed("nothing is known of it", "insert stove --embedding home", "'stove'"),
    Typed("a name that is known", "insert Kettle --fact atLocation kitchen --embedding home", "NAME"),
    Typed("a name that is too long", f"insert {'x' * 201} --fact atLocation bed --embedding home", "NAME"),
    Typed("a name with a tab", "insert 'a\tb' --embedding home", "NAME"),
    Typed("a blank name", "insert ' ' --embedding home", "NAME"),
    Typed("a definition of two lines", "insert x --definition 'a\nb' --embedding home", "--definition"),
    Typed("a misspelt entity", "insert x --fact atLocation kitchn --embedding home", "--fact"),
    Typed("an unknown relation", "insert x --fact hasColour bed --embedding home", "--fact"),
    Typed("an inverse fact the wrong way round", "insert x --inverse-fact atLocation bed --embedding home",
          "--inverse-fact"),
    Typed("half a fact", "insert x --fact atLocation --embedding home", "--fact", status=2),
    Typed("a name that is written in several ways", "insert x --fact atLocation 'TURN ON' --embedding home",
          "--fact", before=twins),
    Typed("an unknown kind", "insert x --kind rom --embedding home", "--kind"),
    Typed("an unknown initializer", f"{FACT} --initializer e --embedding home", "--initializer"),
    Typed("options of no initializer", f"{FACT} --set k=3 --embedding home", "--set"),
    Typed("an option twice", f"{FACT} --initializer rs --set k=3 --set k=4 --embedding home", "--set", status=2),
    Typed("an initializer that the family does not serve", f"{FACT} --initializer ridge --embedding home",
          "--initializer|ridge", before=distances),
    Typed("an option that the initializer does not have", f"{FACT} --initializer rs --set kk=3 --embedding home",
          "--initializer|kk"),
    Typed("a value that the option may not have", f"{FACT} --initializer rs --set k=0 --embedding home",
          "--initializer: k"),
    Typed("no file of word vectors", "insert x --vectors none.txt --embedding home", "none.txt"),
    Typed("word vectors of other words", "insert x --vectors words.txt --embedding home", "words.txt",
          before=put(words__txt="mug 1 2\ncup 2 1\n")),
    Typed("word vectors that are not compressed", "insert x --vectors words.txt.gz --embedding home",
          "words.txt.gz", before=put(words__txt__gz="mug 1 2\n")),
    Typed("a number with an underscore", "insert x --vectors words.txt --embedding home", "words.txt|line 1",
          before=put(words__txt="mug 1_0 2\n")),
    Typed("a seed that is none", f"{FACT} --seed -1 --embedding home", "--seed", status=2),
    Typed("no name of a folder", f"{FACT} --embedding home --out .", "--out", status=2),
    Typed("a name of a folder that is too long", f"{FACT} --embedding home --out {LARGEST}",
          "xxx...xxx"),
    Typed("a file where the folder is to be", f"{FACT} --embedding home --out log.csv", "log.csv"),
    Typed("a file where the folder's folder is to be", f"{FACT} --embedding home --out log.csv/x", "log.csv/x"),
    Typed("a folder with something else in it", f"{FACT} --embedding home --out home", "home|thesis.tex",
          before=lambda: Path("home/thesis.tex").write_text("all of it", encoding="utf-8")),
    Typed("a folder with an embedding that others were inserted into", f"{FACT} --embedding home --out other",
          "other", before=inserted_elsewhere),
    Typed("vectors that are too large to be inserted among", f"{FACT} --embedding home --out out",
          "home/vectors.safetensors|entities", before=large),
]  # fmt: skip

ASK_CASES = [
    Typed("half a question", "ask kettle --embedding home", "--relation"),
    Typed("both ends", "ask kettle atLocation --tail bed --embedding home", "--relation"),
    Typed("an end twice", "ask kettle atLocation --head bed --embedding home", "--head"),
    Typed("a misspelt entity", "ask ketle atLocation --embedding home", "ENTITY"),
    Typed("an unknown relation", "ask kettle located --embedding home", "RELATION"),
    Typed("a number of answers that is none", "ask kettle atLocation --top 0 --embedding home", "--top",
          status=2),
    Typed("numbers of which a score would be none", "ask kettle atLocation --embedding home",
          "home/vectors.safetensors|entities", before=large),
]  # fmt: skip

NEAREST_CASES = [
    Typed("an unknown entity", "nearest lamp --embedding home", "ENTITY"),
    Typed("no name", "nearest '' --embedding home", "ENTITY"),
    Typed("no such folder", "nearest bed --embedding nowhere", "nowhere"),
    Typed("a name of a folder that is too long", f"nearest bed --embedding {LARGEST}",
          "xxx...xxx"),
    Typed("the pipeline's embedding, which is not there yet", "nearest bed", "data/final_models/ai2thor"),
    Typed("a number that is none", "nearest bed --top many --embedding home", "--top", status=2),
]  # fmt: skip

EXPLAIN_CASES = [
    Typed("an entity that was not inserted", "explain bed --embedding home", "home"),
    Typed("what moves a terminal's cursor, in what the folder says of it", "explain 'lie on' --embedding home",
          "home/embedding.json|inserted.0.why", before=inserted("\x1b[2J")),
]  # fmt: skip
