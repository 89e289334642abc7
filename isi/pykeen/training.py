"""Training of all rows of a model of PyKEEN that may have new entities."""

from pykeen.optimizers import optimizer_resolver
from pykeen.pipeline import PipelineResult
from pykeen.training import training_loop_resolver
from pykeen.triples import CoreTriplesFactory
from torch.optim import Optimizer

from isi.config import Count, check
from isi.pykeen.insertion import of_result, vocabularies_of
from isi.pykeen.reading import PykeenModel


def train_on(
    model: PykeenModel | PipelineResult,
    factory: CoreTriplesFactory | None = None,
    epochs: int = 5,
    *,
    training_loop: str = "slcwa",
    optimizer: str | Optimizer = "adam",
    learning_rate: float = 0.001,
    batch_size: int = 256,
    progress: bool = False,
) -> list[float]:
    """Continue PyKEEN's training of all vectors of a model, in place, without new random vectors.

    Args:
        model: with or without new entities; ``factory``: its triples factory.
        epochs: number of epochs, with the loss and the regularizers of the model.
        training_loop: slcwa (sampled negatives) or lcwa.
        optimizer: a name, with step size ``learning_rate``, or an optimizer of the model's
            parameters.

    Returns:
        the mean loss of each epoch.

    Example:
        >>> larger, more = isi.pykeen.insert(model, factory, [("mug", "in", "kitchen")])
        >>> len(isi.pykeen.train_on(larger, more, epochs=2))
        2
    """
    epochs = check(epochs, Count, "", "argument 'epochs'")
    batch_size = check(batch_size, Count, "", "argument 'batch_size'")
    model, factory, _ = of_result(model, factory, ())
    vocabularies_of(model, factory)
    if not isinstance(optimizer, Optimizer):
        optimizer = optimizer_resolver.make(
            optimizer, {"lr": learning_rate}, params=model.get_grad_params()
        )
    loop = training_loop_resolver.make(
        training_loop, model=model, triples_factory=factory, optimizer=warm(optimizer)
    )
    losses = loop.train(
        factory,
        epochs,
        batch_size,
        continue_training=True,
        use_tqdm=progress,
        use_tqdm_batch=progress,
        pin_memory=False,
    )
    return losses or []


def warm(optimizer: Optimizer) -> Optimizer:
    """Prepare an optimizer, in place, for PyKEEN's ``train(continue_training=True)``,
    which does not reset vectors.

    Example:
        >>> from torch.optim import Adam
        >>> len(isi.pykeen.warm(Adam(model.get_grad_params())).state)
        2
    """
    for group in optimizer.param_groups:
        for parameter in group["params"]:
            # creates an empty entry; PyKEEN refuses an optimizer without state
            optimizer.state[parameter]
    return optimizer
