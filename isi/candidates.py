"""The entities that another source of observations adds to a graph (section 6.3)."""

from __future__ import annotations

from collections.abc import Collection

import pandas as pd

from isi import paths
from isi.errors import InputError
from isi.graph import count_triples, name_entities
from isi.streams import stream


def unknown_objects(observations: pd.DataFrame, entities: pd.DataFrame, file: object) -> pd.Series[int]:
    """How often each object was observed that the entities do not hold, in alphabetical order.

    Raises:
        InputError: where something was observed in a room that they do not hold.
    """
    rooms = entities.loc[entities["kind"] == "room", "entity"]
    others = observations.loc[~observations["tail"].isin(rooms), "tail"]
    if len(others):
        raise InputError(file, f"room {others.iloc[0]!r}", "AI2-THOR's graph has no such room")
    totals = observations["count"].groupby(observations["head"].astype(str), sort=True).sum()
    return totals[~totals.index.isin(entities.loc[entities["kind"] == "object", "entity"])]


def frequent(observed: pd.Series[int], minimum: int, entities: pd.DataFrame, file: object) -> pd.Series[int]:
    """Those with at least a minimum of observations.

    Raises:
        InputError: where one bears the name of an entity that is no object, such as a material.
    """
    enough = observed[observed >= minimum]
    kinds = dict(zip(entities["entity"], entities["kind"].astype(str), strict=True))
    for name in enough.index:
        if name in kinds:
            also = f"is also the name of a {kinds[name]}; give the object another one (params.yaml: mp3d.same_as)"
            raise InputError(file, f"object {name!r}", also)
    return enough


def draw(enough: pd.Series[int], number: int, always: Collection[str], root: int) -> list[str]:
    """Draw entities at random (all where there are fewer), some of them always; in alphabetical order.

    Raises:
        InputError: where one that must be there cannot be drawn, or they are more than the number.
    """
    for name in always:
        if name not in enough.index:
            expected = "expected an object of Matterport3D that AI2-THOR lacks, with mp3d.min_observations or more"
            raise InputError(paths.PARAMS, "affordances.entities", f"{name!r}: {expected}")
    if len(always) > number:
        raise InputError(paths.PARAMS, "transfer.candidates", f"fewer than the {len(always)} of affordances.entities")
    others = [str(name) for name in enough.index if name not in always]
    free = min(number - len(always), len(others))
    drawn = stream(root, "transfer candidates").choice(len(others), free, replace=False)
    return sorted([*always, *(others[place] for place in drawn)])


def extend(
    entities: pd.DataFrame, triples: pd.DataFrame, observations: pd.DataFrame, added: Collection[str], source: str
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """A graph's tables with entities added behind its own, and their triples behind its own.

    Args:
        entities: of the graph (``tables.ENTITIES``).
        triples: of the graph (``tables.TRIPLES``).
        observations: of the other source, in rooms of the graph.
        added: names of the objects to add.
        source: name of the other source.
    """
    rooms = set(entities.loc[entities["kind"] == "room", "entity"])
    more = count_triples(observations[observations["head"].isin(added)], source)
    named = name_entities(more, rooms, source)
    new = named[~named["entity"].isin(entities["entity"])]
    return _behind(entities, new), _behind(triples, more)


def _behind(table: pd.DataFrame, more: pd.DataFrame) -> pd.DataFrame:
    encoded = table.select_dtypes("category").columns
    return pd.concat([table.astype(dict.fromkeys(encoded, str)), more[list(table.columns)]], ignore_index=True)
