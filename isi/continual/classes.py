"""Classes of entities, and vectors of new entities by them.

This is the schema initialization of KGE-InfInit (Pons, Bilalli and Queralt 2025, arXiv 2511.11118),
the method that FBinc was published with, without its noise (its scripts try 0, 0.1 and 0.5 standard
deviations of a class); a class that its list has twice counts once.
"""

from __future__ import annotations

import numpy as np

#: In place of the name of an initializer: for timelines with classes alone.
CLASS_MEAN = "class_mean"
#: The initializer that gives new relations their rows then.
FOR_RELATIONS = "mean"


def class_means(known: np.ndarray, classes: np.ndarray, new: int) -> np.ndarray:
    """A vector for each new entity: the mean, over its classes that known entities have, of the
    mean of a class's known vectors. An entity without such a class gets the mean of all known ones.

    Args:
        known: vectors of the known entities, (E, d).
        classes: pairs of an entity and the number of a class of it, each once, (P, 2); other
            entities than the first E + n are ignored.
        new: number n of new entities, whose ids are E, E + 1, ...

    Returns:
        vectors, shape (n, d), of the type of ``known``.

    Example:
        >>> import numpy as np
        >>> from isi.continual.classes import class_means
        >>> cup_bed_mug = np.array([[0, 0], [1, 1], [2, 0]])  # dish, furniture, dish
        >>> class_means(np.array([[1.0, 0.0], [0.0, 1.0]]), cup_bed_mug, 2).tolist()
        [[1.0, 0.0], [0.5, 0.5]]
    """
    entities, dimension = known.shape
    entity, of = classes.T
    is_known, is_new = entity < entities, (entity >= entities) & (entity < entities + new)
    sums = np.zeros((int(of.max(initial=-1)) + 1, dimension))
    np.add.at(sums, of[is_known], known[entity[is_known]])
    members = np.bincount(of[is_known], minlength=len(sums))
    means = sums / np.maximum(members, 1)[:, None]
    serves = is_new & (members[of] > 0)
    vectors = np.zeros((new, dimension))
    np.add.at(vectors, entity[serves] - entities, means[of[serves]])
    number = np.bincount(entity[serves] - entities, minlength=new)[:, None]
    overall = known.mean(0, dtype=float)
    result: np.ndarray = np.where(number, vectors / np.maximum(number, 1), overall)
    return result.astype(known.dtype)
