"""An entry of ``hidden`` in the params of the second pipeline, for tests to share."""

TRAINING = {"dimension": 4, "batch_size": 64, "learning_rate": 0.05, "negatives": 2, "valid": 0.1, "max_epochs": 4,
            "frequency": 2, "patience": 1}  # fmt: skip
ENTRY = {"title": "Ring", "source": "pykeen", "words": None, "seeds": 1, "fraction": 0.1, "fewest": 4, "queries": 0.25,
         "max_insert_triples": [1, 3, None], "initializers": ["mean"], "training": TRAINING, "epochs": 3}  # fmt: skip
