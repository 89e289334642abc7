"""The mean of classes: by hand, and along a timeline that has classes."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from isi.continual import Timeline
from isi.continual.chain import Growth, extended
from isi.continual.classes import class_means
from isi.continual.timeline import Timeline as PlainTimeline
from isi.errors import InputError
from isi.insertion.inverses import InverseRelations
from isi.models.bilinear import ComplEx
from isi.models.stack import Embedding

#: Three known entities; 0 and 1 have class 0, 1 and 2 class 1, nobody known class 2.
KNOWN = np.array([[2.0, 0.0], [4.0, 2.0], [0.0, 6.0]], np.float32)
CLASSES = np.array([[0, 0], [1, 0], [1, 1], [2, 1], [3, 0], [3, 1], [3, 2], [4, 2], [6, 1]])
BY_HAND = [[2.5, 2.5], [2.0, 8 / 3]]  # of (3, 1) and (2, 4); of all rows
HOME = [("cup", "in", "hall"), ("bed", "in", "den"), ("cup", "on", "bed")]
LATER = [("mug", "in", "hall"), ("mug", "near", "cup")]


def test_a_vector_is_the_mean_of_its_classes_means() -> None:
    vectors = class_means(KNOWN, CLASSES, 2)
    assert vectors.dtype == np.float32
    np.testing.assert_allclose(vectors, BY_HAND, rtol=1e-6)
    none = np.empty((0, 2), np.int64)
    np.testing.assert_allclose(class_means(KNOWN, none, 1), [KNOWN.mean(0)], rtol=1e-6)


def test_a_snapshot_is_inserted_by_classes_with_relations_as_by_the_mean() -> None:
    timeline: PlainTimeline = Timeline.of([(HOME, [], []), (LATER, [], [])])
    with_classes = replace(timeline, classes=np.array([[0, 0], [2, 1], [4, 0]]))
    tables = torch.randn(1, 4, 4), torch.randn(1, 2, 8)
    theta = Embedding(*tables, InverseRelations(ComplEx()))
    grown = {
        name: extended(with_classes, theta, Growth(name), 1, None, 0)[0]
        for name in ("class_mean", "mean")
    }
    torch.testing.assert_close(grown["class_mean"].entity[0, 4], theta.entity[0, 0])
    torch.testing.assert_close(grown["class_mean"].relation, grown["mean"].relation)
    assert grown["class_mean"].relation.shape == (1, 3, 8)
    with pytest.raises(InputError, match="the timeline has no classes"):
        timeline.run("complex", dimension=4, initializer="class_mean")


def test_benchmarks_have_the_classes_of_their_entities() -> None:
    timeline = PlainTimeline.benchmark("FBinc-S")
    assert timeline.classes is not None
    entity, of = timeline.classes.T
    assert entity.max() < len(timeline.entity_names)
    assert len(np.unique(timeline.classes, axis=0)) == len(timeline.classes)
    assert 0.9 < len(np.unique(entity)) / len(timeline.entity_names) < 1
    assert (entity == timeline.entity_names.index("/m/0gbwp")).sum() == 6
    assert of.max() < 232
