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

ACTION_WIDTH = 9
"""Of what the decoder sees of an action: itself, its change, and how far the set point then is from the hand now."""
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

    A step moves a block by what it predicts on top of two guesses that it may take up in part: that the block goes
    on as it moves, and that it follows the hand.
    """

    def __init__(self, width: int, layers: int, decoder: int) -> None:
        super().__init__()
        self.encode = mlp(NODE_WIDTH, width, width, 1, norm=True)
        self.pair = nn.Sequential(nn.Linear(PAIR_WIDTH, width), nn.ReLU())
        self.steps = nn.ModuleList(Interaction(width, width) for _ in range(layers))
        self.plan = nn.GRU(ACTION_WIDTH, decoder, batch_first=True)
        self.plan_start = nn.Linear(width, decoder)
        self.block = nn.Linear(width, decoder)
        self.answer = nn.Linear(decoder, decoder)
        self.hidden = nn.Linear(decoder, decoder)
        self.motion = nn.Linear(decoder, 6 + 2 + 3)
        self.twist = nn.Linear(decoder, 6)
        self.unit: Tensor
        self.register_buffer("unit", torch.tensor(MOTION_UNIT), persistent=False)
        with torch.no_grad():  # at first, everything stays where it is
            self.motion.weight.mul_(0.1)
            self.motion.bias.zero_()

    def look(self, graphs: Graphs) -> Look:
        """The encoder, for towers in either form of `Graphs`."""
        bodies = Bodies.of(graphs.node)
        index, kind = pairs(graphs, bodies)
        target = graphs.spread(graphs.at_target(bodies.position))
        node = self.encode(node_features(bodies, target, graphs.graph))
        pair = self.pair(pair_features(bodies, index, kind))
        for step in self.steps:
            node = step(node, pair, index, graphs)
        moving = torch.cat([bodies.velocity, bodies.turning], dim=-1)
        lag = node.new_zeros(len(graphs), 3) if graphs.lag is None else graphs.lag
        return Look(node, graphs.at_target(node), moving, bodies.flag, graphs.at_target(bodies.velocity), lag)

    def answers(
        self, look: Look, plans: Float[Tensor, "plan horizon 3"], each: Tensor | None
    ) -> Float[Tensor, "*plan node horizon width"]:
        """The decoder's hidden state. `each` is None where one tower answers many plans, else the plan of each node."""
        before = torch.cat([look.hand[:, None].expand(len(plans), 1, 3), plans[:, :-1]], dim=1)
        ahead = look.lag[:, None] + plans.cumsum(1)
        seen = torch.cat([plans, plans - before, ahead / 3], dim=-1) / MILLIMETRE
        start = self.plan_start(look.target).expand(len(plans), -1)[None].contiguous()
        heard = self.answer(self.plan(seen, start)[0])
        heard = heard[:, None] if each is None else heard.index_select(0, each)
        block = self.block(look.node)
        return self.hidden((block[..., None, :] + heard).relu()).relu()

    def motion_of(
        self, look: Look, plans: Float[Tensor, "plan horizon 3"], hidden: Tensor, each: Tensor | None
    ) -> Float[Tensor, "*plan node horizon 6"]:
        """Displacement [m] and rotation [rad] in each step."""
        own, keep, follow = self.motion(hidden).split([6, 2, 3], dim=-1)
        moving = look.moving[..., None, :]
        keep = torch.cat([keep[..., :1].expand_as(follow), keep[..., 1:].expand_as(follow)], dim=-1)
        actions = plans[:, None] if each is None else plans.index_select(0, each)
        moved = own * self.unit + keep * moving
        follow = (follow + look.is_target[..., None, None]) * actions
        return torch.cat([moved[..., :3] + follow, moved[..., 3:]], dim=-1)

    def after(self, motion: Tensor, hidden: Tensor) -> Float[Tensor, "*plan node horizon 6"]:
        """Displacement [m] and rotation [rad] in a control step at the velocity after each step."""
        return motion + self.twist(hidden) * self.unit

    def forward(self, graphs: Graphs) -> Float[Tensor, "node horizon 12"]:
        """A flat batch of graphs, each with its own plan [m]: motion in each step, and at the speed after it."""
        assert graphs.action is not None, "this model needs plans"
        assert graphs.graph is not None, "this model needs a flat batch; a static one is for `look` and `answers`"
        look = self.look(graphs)
        hidden = self.answers(look, graphs.action, graphs.graph)
        motion = self.motion_of(look, graphs.action, hidden, graphs.graph)
        return torch.cat([motion, self.after(motion, hidden)], dim=-1)
