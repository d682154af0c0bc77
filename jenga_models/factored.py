"""A simulator in two parts: a costly look at the tower, once a decision, and a cheap answer to every plan.

All plans of a decision start from one tower. The encoder passes messages between its blocks and leaves a state at
each; the decoder says from that state and a plan's actions alone how the block moves, so that 100 plans of 5 steps
cost a small network a block and step, and no graph.
"""

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn

from jenga_models.graphs import Graphs
from jenga_models.layers import mlp
from jenga_models.motion import LEVER, MILLIMETRE, NODE_WIDTH, PAIR_WIDTH, Bodies, node_features, pair_features, pairs

GUIDES = 4
"""Vectors that a block may follow in part, see `Factored.heard`."""
SIZES = (-8.0, 2.0)
"""Least and largest logarithm of how much a block moves on its own and with the hand."""
MOTION_UNIT = [MILLIMETRE] * 3 + [MILLIMETRE / LEVER] * 3
"""What an output of 1 stands for [m, rad]."""


@dataclass(frozen=True, eq=False)
class Look:
    """What the encoder leaves behind of a tower."""

    node: Float[Tensor, "*sample node width"]
    target: Float[Tensor, "graph width"]
    moving: Float[Tensor, "*sample node 6"]
    """Displacement [m] and rotation [rad] of each block in a control step, were it to go on as it does."""
    is_target: Float[Tensor, "*sample node"]
    hand: Float[Tensor, "graph 3"]
    """Displacement of the hand in a control step, were it to go on as it does [m]: the target's."""
    lag: Float[Tensor, "graph 3"]


class Interaction(nn.Module):
    """One step of message passing in which every block also hears the target.

    v' = v + MLP([v, sum of ReLU(W [v_r, v_s, e]), v_target]); the sum of messages has no layer of its own.
    """

    def __init__(self, width: int, pair_width: int) -> None:
        super().__init__()
        self.receiver = nn.Linear(width, width)
        self.sender = nn.Linear(width, width, bias=False)
        self.pair = nn.Linear(pair_width, width, bias=False)
        self.own = nn.Linear(width, width)
        self.heard = nn.Linear(width, width, bias=False)
        self.target = nn.Linear(width, width, bias=False)
        self.update = nn.Sequential(nn.ReLU(), nn.Linear(width, width), nn.LayerNorm(width))

    def forward(self, node: Tensor, pair: Tensor, index: Tensor, graphs: Graphs) -> Tensor:
        sender, receiver = index
        message = self.receiver(node).index_select(-2, receiver)
        message = (message + self.sender(node).index_select(-2, sender) + self.pair(pair)).relu()
        heard = torch.zeros_like(node).index_add(-2, receiver, message)
        target = graphs.spread(self.target(graphs.at_target(node)))
        return node + self.update(self.own(node) + self.heard(heard) / 4 + target)


class Factored(nn.Module):
    """Graphs of `G_e+motion`, raw (SI), and plans -> how each block moves, step by step.

    A step moves a block by what it predicts on top of guesses that it may take up in part: that the block goes on as it
    moves, that it follows the hand, and that it lags behind it.
    """

    def __init__(self, width: int, layers: int, decoder: int) -> None:
        super().__init__()
        self.encode = mlp(NODE_WIDTH, width, width, 1, norm=True)
        self.pair = nn.Sequential(nn.Linear(PAIR_WIDTH, width), nn.ReLU())
        self.steps = nn.ModuleList(Interaction(width, width) for _ in range(layers))
        self.plan = nn.Linear(3 * GUIDES + 1, decoder)
        self.plan_start = nn.Linear(width, decoder)
        self.block = nn.Linear(width, decoder)
        self.answer = nn.Linear(decoder, decoder)
        self.hidden = nn.Linear(decoder, decoder)
        self.motion = nn.Linear(decoder, 6 + 2 + 3 * GUIDES)
        self.twist = nn.Linear(decoder, 6)
        self.size = nn.Linear(width, 2)
        self.unit: Tensor
        self.register_buffer("unit", torch.tensor(MOTION_UNIT), persistent=False)
        with torch.no_grad():  # at first, the target follows the hand and everything else goes on as it moves
            self.motion.weight.mul_(0.1)
            self.motion.bias.zero_()

    def look(self, graphs: Graphs) -> Look:
        """The encoder, for towers in either form of `Graphs`."""
        bodies = Bodies.of(graphs.node)
        index, kind = pairs(graphs, bodies)
        target = graphs.spread(graphs.at_target(bodies.position))
        lag = graphs.node.new_zeros(len(graphs), 3) if graphs.lag is None else graphs.lag
        node = self.encode(node_features(bodies, target, graphs.spread(lag), graphs.graph))
        pair = self.pair(pair_features(bodies, index, kind))
        for step in self.steps:
            node = step(node, pair, index, graphs)
        moving = torch.cat([bodies.velocity, bodies.turning], dim=-1)
        return Look(node, graphs.at_target(node), moving, bodies.flag, graphs.at_target(bodies.velocity), lag)

    def heard(self, look: Look, plans: Float[Tensor, "plan horizon 3"]) -> Float[Tensor, "plan horizon guide 3"]:
        """What a step of a plan is to the hand [m]: the action, its change from the one before and from the present
        velocity, and how far the set point then is from where the hand is now."""
        hand = look.hand[:, None].expand(len(plans), 1, 3)
        before = torch.cat([hand, plans[:, :-1]], dim=1)
        return torch.stack([plans, plans - before, plans - hand, look.lag[:, None] + plans.cumsum(1)], dim=-2)

    def answers(
        self, look: Look, plans: Float[Tensor, "plan horizon 3"], each: Tensor | None
    ) -> tuple[Float[Tensor, "*plan node horizon 6"], Float[Tensor, "*plan node horizon width"]]:
        """Displacement [m] and rotation [rad] in each step, and the hidden state that they were made of.

        `each` is None where one tower answers many plans, else the plan of each node.
        """
        heard = self.heard(look, plans)
        number = torch.arange(plans.shape[1], device=plans.device, dtype=plans.dtype)[:, None]
        seen = torch.cat(
            [heard.flatten(-2) / (3 * MILLIMETRE), (number / 2).expand(len(plans), -1, 1)], dim=-1
        )  # no gate that saturates: a millimetre counts at 17 of them as well
        plan = self.answer((self.plan(seen) + self.plan_start(look.target)[:, None]).relu())
        plan, heard = (values[:, None] if each is None else values.index_select(0, each) for values in (plan, heard))
        hidden = self.hidden((self.block(look.node)[..., None, :] + plan).relu()).relu()
        own, keep, follow = self.motion(hidden).split([6, 2, 3 * GUIDES], dim=-1)
        # Blocks far from the target move a thousand times less: how much, in powers of e, is a matter of the tower.
        size = self.size(look.node).clamp(*SIZES).exp()[..., None, :]
        own, follow = own * size[..., :1], follow * size[..., 1:]
        is_target = look.is_target[..., None, None]
        keep = (keep + 1 - is_target).repeat_interleave(3, dim=-1)
        moved = own * self.unit + keep * look.moving[..., None, :]
        guided = (follow.unflatten(-1, (GUIDES, 3)) * heard).sum(-2) + is_target * heard[..., 0, :]
        return torch.cat([moved[..., :3] + guided, moved[..., 3:]], dim=-1), hidden

    def after(self, motion: Tensor, hidden: Tensor) -> Float[Tensor, "*plan node horizon 6"]:
        """Displacement [m] and rotation [rad] in a control step at the velocity after each step."""
        return motion + self.twist(hidden) * self.unit

    def forward(self, graphs: Graphs) -> Float[Tensor, "node horizon 12"]:
        """A flat batch of graphs, each with its own plan [m]: motion in each step, and at the speed after it."""
        assert graphs.action is not None, "this model needs plans"
        assert graphs.graph is not None, "this model needs a flat batch; a static one is for `look` and `answers`"
        motion, hidden = self.answers(self.look(graphs), graphs.action, graphs.graph)
        return torch.cat([motion, self.after(motion, hidden)], dim=-1)
