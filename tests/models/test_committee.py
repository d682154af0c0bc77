"""A committee says the mean of what its members say, and calibration makes its probabilities honest."""

import pytest
import torch
from torch import Tensor, nn

from jenga_models.committee import Committee, MemberLinear
from jenga_models.graphs import Graphs


class Fixed(Committee):
    """Says the same whatever it is shown."""

    def __init__(self, logits: Tensor) -> None:
        super().__init__()
        self.logits = logits

    def each(self, graphs: Graphs) -> Tensor:
        return self.logits


NOTHING = Graphs(torch.zeros(1, 1), torch.zeros(2, 0, dtype=torch.long), torch.zeros(0, 1), torch.tensor([0]))


def test_the_committee_says_the_mean_probability():
    logits = torch.tensor([[[2.0, -1.0], [0.0, 0.5]], [[-3.0, 1.0], [0.0, 0.0]], [[0.0, 4.0], [1.0, 1.0]]])
    said = Fixed(logits)(NOTHING).softmax(-1)
    torch.testing.assert_close(said, logits.softmax(-1).mean(0))


def test_each_member_of_a_linear_layer_is_one_of_torch():
    torch.manual_seed(1)
    layer = MemberLinear(2, 5, 3)
    torch.manual_seed(1)
    alone = [nn.Linear(5, 3) for _ in range(2)]
    values = torch.randn(2, 4, 7, 5)
    expected = torch.stack([linear(v) for linear, v in zip(alone, values, strict=True)])
    torch.testing.assert_close(layer(values), expected)


@pytest.mark.parametrize("factor", [0.3, 1.0, 4.0])
def test_calibration_finds_by_what_logits_are_too_large(factor: float):
    generator = torch.Generator().manual_seed(0)
    honest = torch.randn(20_000, 2, generator=generator)
    wanted = (torch.rand(20_000, generator=generator) < honest.softmax(-1)[:, 1]).long()
    committee = Fixed((honest * factor)[None])
    for _ in range(2):  # what is calibrated already stays so
        committee.calibrate(committee(NOTHING), wanted)
        assert committee.temperature.item() == pytest.approx(factor, rel=0.05)
