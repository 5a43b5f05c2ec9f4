"""The pull of an actor towards its page: a loss beside PPO's."""

import torch
from rsl_rl.models import MLPModel
from rsl_rl.storage import RolloutStorage
from torch import nn

from glassgait.studies.training.environment import observed_by_actor


class PagePull:
    """A loss: the mean squared difference of an actor's mean actions from its page's.

    PPO of rsl-rl adds one loss of an actor's means to its own, that of its `symmetry`. This one
    stands in its place, by the names that PPO asks for.

    Attributes:
        page: Maps observations (n, n_observations) to actions (n, 12); None while there is none.
        weight: Weight of the loss beside PPO's.
    """

    use_mirror_loss = True

    def __init__(self) -> None:
        self.page: nn.Module | None = None
        self.weight = 0.0

    @property
    def mirror_loss_coeff(self) -> float:
        """The weight."""
        return self.weight

    def augment_batch(self, batch: RolloutStorage.Batch, original_batch_size: int) -> None:
        """Leaves the batch as it is."""

    def compute_loss(
        self, actor: MLPModel, batch: RolloutStorage.Batch, original_batch_size: int
    ) -> torch.Tensor:
        """Returns the loss on a mini-batch, whose actions' means the actor holds."""
        if self.page is None:
            return torch.zeros(())
        with torch.no_grad():
            asked = self.page(observed_by_actor(batch.observations))
        means = actor.output_distribution_params[0]
        return (means - asked).square().mean()
