"""A selector whose messages go through the whole tower, level by level, down and up again.

Weight comes down from the top, and what gives way below tilts all that stands on it: both reach through 20 levels,
farther than a handful of graph convolutions can look. A sweep updates the blocks of one level from those of the last
one, as networks on directed acyclic graphs do (Thost and Chen 2021, arXiv 2101.07965), at the cost of one layer.
"""

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn
from torch.nn import functional

from jenga_models import verdicts
from jenga_models.committee import Committee, MemberLinear
from jenga_models.gns import CLASSES, Widths
from jenga_models.graphs import Graphs
from jenga_models.levels import Levels
from jenga_models.relations import relations, relations_width
from jenga_models.verdicts import Judgement

FARTHEST = 20
"""Levels between a block and the target that are told apart."""


class Sweep(nn.Module):
    """One pass through the tower, from the top down or from the bottom up. Places without a block hold anything:
    nobody listens to them.

    h' = norm(h + MLP([h, sum of ReLU(W [h, h_m]) over level mates m, sum of ReLU(U [h, h'_n]) over the blocks n of
    the level before that touch it])).
    """

    def __init__(self, members: int, width: int, down: bool) -> None:
        super().__init__()
        self.down = down
        self.own = MemberLinear(members, width, 4 * width)
        """Of a block: its part of the messages from mates, from the level before and to mates, and of the MLP."""
        self.from_before = MemberLinear(members, width, width)
        self.mates = MemberLinear(members, width, width)
        self.before = MemberLinear(members, width, width)
        self.last = MemberLinear(members, width, width)

    def forward(
        self, state: Float[Tensor, "member graph level place width"], levels: Levels
    ) -> Float[Tensor, "member graph level place width"]:
        # What does not wait for the level before is computed for all levels at once.
        by_mate, by_before, to_mate, own = self.own(state).chunk(4, dim=-1)
        mates = _sum(by_mate[..., :, None, :] + to_mate[..., None, :, :], levels.mates)
        known = own + self.mates(mates)
        rests = levels.on.transpose(-1, -2).roll(-1, 1) if self.down else levels.on
        order = range(state.shape[2])[::-1] if self.down else range(state.shape[2])
        done: list[Tensor] = []
        for k in order:
            hidden = known[:, :, k]
            if done:
                message = by_before[:, :, k, :, None] + self.from_before(done[-1])[..., None, :, :]
                hidden = hidden + self.before(_sum(message, rests[:, k]))
            after = state[:, :, k] + self.last(hidden.relu())
            done.append(functional.layer_norm(after, after.shape[-1:]))
        return torch.stack(done[::-1] if self.down else done, dim=2)


def _sum(message: Float[Tensor, "*batch place other width"], from_: Float[Tensor, "*#batch place other"]) -> Tensor:
    return (message.relu() * from_[..., None]).sum(-2)


class MotionHead(nn.Module):
    """How every block moves under the pull, from its own state, the target's, and how many levels are between them."""

    def __init__(self, members: int, width: int) -> None:
        super().__init__()
        self.block = MemberLinear(members, width, width)
        self.target = MemberLinear(members, width, width)
        self.apart = MemberLinear(members, 2 * FARTHEST + 1, width)
        self.last = MemberLinear(members, width, verdicts.MOTION)

    def forward(
        self, block: Float[Tensor, "member node width"], graphs: Graphs, level: Int[Tensor, " node"]
    ) -> Float[Tensor, "member node motion"]:
        assert graphs.graph is not None, "only flat batches are trained on"
        target = self.target(torch.stack([graphs.at_target(member) for member in block]))
        apart = (level - level[graphs.target][graphs.graph]).clamp(-FARTHEST, FARTHEST) + FARTHEST
        one_hot = functional.one_hot(apart, 2 * FARTHEST + 1).to(block.dtype).expand(len(block), -1, -1)
        return self.last((self.block(block) + target[:, graphs.graph] + self.apart(one_hot)).relu())


class SweepClassifier(Committee):
    """Relations between blocks, sweeps down, up, down, ... and a readout -> logits of (holds, fails).

    Neither the relations nor the sweeps look at the target's flag: one pass through a tower serves all its targets,
    where the readout is taken. It sees the target as it came out of the sweeps, and as it went in.
    """

    def __init__(self, widths: Widths, *, width: int, sweeps: int, members: int, dropout: float) -> None:
        super().__init__()
        self.members, self.at = members, widths.at
        self.encode = MemberLinear(members, widths.node + relations_width(widths.at), width)
        self.sweeps = nn.ModuleList(Sweep(members, width, down=k % 2 == 0) for k in range(sweeps))
        self.dropout = nn.Dropout(dropout)
        self.hidden = MemberLinear(members, 2 * width, width)
        self.readout = MemberLinear(members, width, CLASSES)
        self.verdict = MemberLinear(members, width, verdicts.WIDTH)
        self.motion = MotionHead(members, width)

    def each(self, graphs: Graphs) -> Float[Tensor, "member graph 2"]:
        return self.readout(self._of_target(graphs, *self._swept(graphs)))

    def judge(self, graphs: Graphs) -> Judgement:
        levels, start, state = self._swept(graphs)
        hidden = self._of_target(graphs, levels, start, state)
        block = torch.stack([levels.gathered(member, graphs.node) for member in state])
        return Judgement(self.readout(hidden), self.verdict(hidden), self.motion(block, graphs, levels.level))

    def _swept(self, graphs: Graphs) -> tuple[Levels, Tensor, Tensor]:
        """States of all blocks at their places, before the sweeps and after them."""
        levels = Levels.of(graphs)
        node = graphs.node.clone()
        node[..., self.at["target_flag"]] = 0.0
        placed = levels.spread(node)
        known = torch.cat([placed, relations(levels, placed, self.at)], dim=-1)
        start = state = self.encode(known.expand(self.members, -1, -1, -1, -1))
        for sweep in self.sweeps:
            state = sweep(state, levels)
        return levels, start, state

    def _of_target(
        self, graphs: Graphs, levels: Levels, start: Tensor, state: Tensor
    ) -> Float[Tensor, "member graph width"]:
        both = torch.cat([state, start], dim=-1)
        target = torch.stack([graphs.at_target(levels.gathered(member, graphs.node)) for member in both])
        return self.dropout(self.hidden(self.dropout(target)).relu())
