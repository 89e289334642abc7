"""Mistakes in what is typed: of embeddings (``isi insert``, ``ask``, ``nearest``, ``explain``)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

from tests.kept import NAMES, edit, small, written
from tests.said.calls import Typed, put

FACT = "insert x --fact atLocation bed"
LARGEST = "x" * 300


def times(factor: float) -> Callable[[], object]:
    """The embedding with larger vectors."""
    return lambda: written(Path("home"), replace(small(), entities=small().entities * np.float32(factor)))


def distances() -> None:
    """An embedding of distances."""
    about = small().about.model_copy(update={"family": "transe", "family_options": {"margin": 1.0, "squared": False}})
    written(Path("home"), small(about=about))


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
    Typed("no command", "",
          "the following arguments are required: COMMAND; see --help", status=2),
]  # fmt: skip

INSERT_CASES = [
    Typed("nothing is known of it", "insert stove --embedding home",
          "'stove': expected a --fact, an --inverse-fact or a word vector, and it has none: this embedding has no "
          "word vectors (--vectors FILE gives it some)"),
    Typed("a name that is known", "insert Kettle --fact atLocation kitchen --embedding home",
          "NAME: expected a new name: 'kettle' is known (see isi ask, isi nearest)"),
    Typed("a name that is too long", f"insert {'x' * 201} --fact atLocation bed --embedding home",
          "NAME: expected at most 200 characters, got 201"),
    Typed("a name with a tab", "insert 'a\tb' --embedding home",
          "NAME: expected text without tabs, line breaks or other control characters, got 'a\\tb'"),
    Typed("a blank name", "insert ' ' --embedding home",
          "NAME: expected a name, got none"),
    Typed("a definition of two lines", "insert x --definition 'a\nb' --embedding home",
          "--definition: expected text without tabs, line breaks or other control characters, got 'a\\nb'"),
    Typed("a misspelt entity", "insert x --fact atLocation kitchn --embedding home",
          "--fact: expected an entity of this embedding, got 'kitchn' (did you mean 'kitchen'?)"),
    Typed("an unknown relation", "insert x --fact hasColour bed --embedding home",
          "--fact: expected a relation of this embedding, got 'hasColour' (there are 'atLocation', 'hasAffordance')"),
    Typed("an inverse fact the wrong way round", "insert x --inverse-fact atLocation bed --embedding home",
          "--inverse-fact: expected a relation of this embedding, got 'bed' (there are 'atLocation', "
          "'hasAffordance')"),
    Typed("half a fact", "insert x --fact atLocation --embedding home",
          "argument --fact: expected 2 arguments; see --help", status=2),
    Typed("a name that is written in several ways", "insert x --fact atLocation 'TURN ON' --embedding home",
          "--fact: expected an entity of this embedding as it is written: 'turn on', 'turnOn'; got 'TURN ON'",
          before=twins),
    Typed("an unknown kind", "insert x --kind rom --embedding home",
          "--kind: expected a kind of this embedding, got 'rom' (did you mean 'room'?)"),
    Typed("an unknown initializer", f"{FACT} --initializer e --embedding home",
          "--initializer: expected one of class_noise, er_avg, ers, es, es_permuted, es_permuted_kinds, gaussian, "
          "gaussian_centred, iu, kind_mean, map_ers, map_mean, map_soft_hybrid, mean, neigh...ge, rs, rs_alive, "
          "soft_es, soft_hybrid, soft_rs, xavier, got 'e'; did you mean 'es'?"),
    Typed("options of no initializer", f"{FACT} --set k=3 --embedding home",
          "--set: expected an --initializer, whose options these are"),
    Typed("an option twice", f"{FACT} --initializer rs --set k=3 --set k=4 --embedding home",
          "--set: expected each option once"),
    Typed("an initializer that the family does not serve", f"{FACT} --initializer ridge --embedding home",
          "--initializer: ridge: needs a score that is linear in a vector; TransE's is not", before=distances),
    Typed("an option that the initializer does not have", f"{FACT} --initializer rs --set kk=3 --embedding home",
          "--set kk: unknown key; did you mean 'k'?"),
    Typed("a value that the option may not have", f"{FACT} --initializer rs --set k=0 --embedding home",
          "--set k: Input should be greater than or equal to 1, got 0"),
    Typed("no file of word vectors", "insert x --vectors none.txt --embedding home",
          "none.txt: expected a file of word vectors, but there is no such file"),
    Typed("word vectors of other words", "insert x --vectors words.txt --embedding home",
          "words.txt: expected word vectors of this embedding's phrases, got none of any",
          before=put(words__txt="mug 1 2\ncup 2 1\n")),
    Typed("word vectors that are not compressed", "insert x --vectors words.txt.gz --embedding home",
          "words.txt.gz: expected word vectors in word2vec or GloVe format (Not a gzipped file (b'mu'))",
          before=put(words__txt__gz="mug 1 2\n")),
    Typed("a number with an underscore", "insert x --vectors words.txt --embedding home",
          "words.txt: line 1: expected a token and numbers (Python takes 1_0 for ten)",
          before=put(words__txt="mug 1_0 2\n")),
    Typed("a seed that is none", f"{FACT} --seed -1 --embedding home",
          "argument --seed: expected a whole number, got '-1'; see --help", status=2),
    Typed("no name of a folder", f"{FACT} --embedding home --out .",
          "argument --out: expected a folder by its name, got '.'; see --help", status=2),
    Typed("a name of a folder that is too long", f"{FACT} --embedding home --out {LARGEST}",
          "xxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxx"
          "xxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxx...xxxxxxxxxxxxxxxxxxxxxxxxxx"
          "xxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxx: File name too long"),
    Typed("a file where the folder is to be", f"{FACT} --embedding home --out log.csv",
          "log.csv: expected a folder, or a name that nothing has"),
    Typed("a file where the folder's folder is to be", f"{FACT} --embedding home --out log.csv/x",
          "log.csv/x: cannot be written (its folder is a file)"),
    Typed("a folder with something else in it", f"{FACT} --embedding home --out home",
          "home: thesis.tex: expected an empty folder, or one with an embedding alone",
          before=lambda: Path("home/thesis.tex").write_text("all of it", encoding="utf-8")),
    Typed("a folder with an embedding that others were inserted into", f"{FACT} --embedding home --out other",
          "--out: other: expected another folder: there, wash would be lost (`isi insert --embedding` adds to it)",
          before=inserted_elsewhere),
    Typed("vectors that are too large to be inserted among", f"{FACT} --embedding home --out out",
          "home/vectors.safetensors: entities: row 2: expected numbers up to 1e+11, got 3e+30", before=times(1e30)),
]  # fmt: skip

ASK_CASES = [
    Typed("half a question", "ask kettle --embedding home",
          "expected ENTITY RELATION, or --relation RELATION --tail ENTITY"),
    Typed("both ends", "ask kettle atLocation --tail bed --embedding home",
          "expected ENTITY RELATION, or --relation RELATION --tail ENTITY"),
    Typed("an end twice", "ask kettle atLocation --head bed --embedding home",
          "--head: expected it once: it is given twice"),
    Typed("a misspelt entity", "ask ketle atLocation --embedding home",
          "ENTITY: expected an entity of this embedding, got 'ketle' (did you mean 'kettle'?)"),
    Typed("an unknown relation", "ask kettle located --embedding home",
          "RELATION: expected a relation of this embedding, got 'located' (there are 'atLocation', 'hasAffordance')"),
    Typed("a number of answers that is none", "ask kettle atLocation --top 0 --embedding home",
          "argument --top: expected a whole number from 1, got '0'; see --help", status=2),
    Typed("numbers of which a score would be none", "ask kettle atLocation --embedding home",
          "home/vectors.safetensors: entities: row 2: expected numbers up to 1e+11, got 3e+30", before=times(1e30)),
]  # fmt: skip

NEAREST_CASES = [
    Typed("an unknown entity", "nearest lamp --embedding home",
          "ENTITY: expected an entity of this embedding, got 'lamp' (there are 'kitchen', 'bedroom', 'kettle', "
          "'bed', 'turn on', 'lie on')"),
    Typed("no name", "nearest '' --embedding home",
          "ENTITY: expected an entity of this embedding, got '' (there are 'kitchen', 'bedroom', 'kettle', 'bed', "
          "'turn on', 'lie on')"),
    Typed("no such folder", "nearest bed --embedding nowhere",
          "nowhere: expected the folder of an embedding, but there is no such folder"),
    Typed("a name of a folder that is too long", f"nearest bed --embedding {LARGEST}",
          "xxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxx"
          "xxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxx...xxxxxxxxxxxxxxxxxxxxxxxxxx"
          "xxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxxx: File name too long"),
    Typed("the pipeline's embedding, which is not there yet", "nearest bed",
          "data/kept/ai2thor: the pipeline has not kept it yet (dvc repro keep): run it, or name another by "
          "--embedding DIR"),
    Typed("a number that is none", "nearest bed --top many --embedding home",
          "argument --top: expected a whole number from 1, got 'many'; see --help", status=2),
]  # fmt: skip

EXPLAIN_CASES = [
    Typed("an entity that was not inserted", "explain bed --embedding home",
          "home: expected an entity that was inserted (none), got 'bed'"),
    Typed("what moves a terminal's cursor, in what the folder says of it", "explain 'lie on' --embedding home",
          "home/embedding.json: inserted.0.why: expected text without tabs, line breaks or other control "
          "characters, got '\\x1b[2J'", before=inserted("\x1b[2J")),
]  # fmt: skip
