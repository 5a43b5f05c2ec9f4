"""Networks that treat left and right alike while they learn."""

import torch
from torch import nn

from glassgait.models.task.symmetry import Reflection


class Mirrored(nn.Module):
    """The mean of f(x) and M f(M x), M the mirror: equivariant whatever f has learned.

    Both halves go through f in one batch.
    """

    input_index: torch.Tensor
    input_sign: torch.Tensor
    output_index: torch.Tensor
    output_sign: torch.Tensor

    def __init__(
        self, network: nn.Module, reflect_input: Reflection, reflect_output: Reflection
    ) -> None:
        """
        Args:
            network: f.
            reflect_input: M of its inputs.
            reflect_output: M of its outputs.
        """
        super().__init__()
        self.network = network
        for name, reflection in (("input", reflect_input), ("output", reflect_output)):
            index, sign = torch.from_numpy(reflection.index), torch.from_numpy(reflection.sign)
            self.register_buffer(f"{name}_index", index, persistent=False)
            self.register_buffer(f"{name}_sign", sign.float(), persistent=False)

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        """Maps inputs (n, n_in) to outputs (n, n_out)."""
        image = x[:, self.input_index] * self.input_sign
        own, mirrored = self.network(torch.cat([x, image])).chunk(2)
        return 0.5 * (own + mirrored[:, self.output_index] * self.output_sign)
