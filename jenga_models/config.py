"""Every hyperparameter of training, and the presets. No torch here: the command line reads this for its help."""

from dataclasses import dataclass
from typing import Literal

from jenga_data.errors import JengaError
from jenga_data.graph_spec import graph_spec

Flow = Literal["down", "up", "both"]
Schedule = Literal["constant", "cosine"]
Accelerator = Literal["auto", "cpu", "cuda"]


LATER = frozenset({"motion"})
"""Fields that checkpoints of before lack: their default is what those were trained with."""


@dataclass(frozen=True, kw_only=True)
class Training:
    """What both kinds of training have in common."""

    graph: str
    """What nodes hold, see jenga_data.graph: G_s, G_sp (with poses), G_s+layout (with level and slot), G_e."""
    model: str
    """Architecture, see jenga_models.registry: "gcn", "interaction" or "sweep" select, "gns" simulates, or one of your
    own."""
    layers: int
    """Steps of message passing."""
    width: int
    """Numbers a node holds between layers."""
    flow: Flow = "down"
    """Which way messages go along an edge: from the upper block to the lower one ("down"), "up", or "both"."""
    edge_attributes: bool = False
    """Give edges the relative pose and gap of their blocks, as far as the graph's nodes hold poses and sizes."""
    scale_features: bool = True
    """Standardise lengths, masses, poses and actions by the training rows; flags stay 0 and 1."""
    learning_rate: float
    """Step size of Adam."""
    weight_decay: float = 0.0
    """Decoupled weight decay (AdamW); 0 is Adam."""
    schedule: Schedule = "constant"
    """Learning rate over the epochs: "constant", or half a "cosine" down to 0."""
    gradient_clip: float = 0.0
    """Largest norm of the gradient; 0 does not clip."""
    batch_size: int = 100
    """Graphs a step."""
    epochs: int = 150
    """Passes over the training rows, at most."""
    patience: int = 0
    """Stop after so many epochs without a better validation loss and keep the best; 0 keeps the last epoch."""
    train_on_validation: bool = False
    """Train on the validation towers as well, so that nothing is left to stop early by."""
    training_towers: int = 0
    """Train on so many of the training towers alone, for a learning curve; 0 takes all. More towers hold the fewer."""
    seed: int = 0
    """Decides the initial weights and the order of the rows."""
    accelerator: Accelerator = "auto"
    """Where to train: "auto" takes a GPU if there is one."""

    def __post_init__(self) -> None:
        for name in ("layers", "width", "batch_size", "epochs"):
            if getattr(self, name) < 1:
                raise JengaError(f"{name} is {getattr(self, name)}; allowed: 1 and more")
        for name in ("weight_decay", "gradient_clip", "patience", "training_towers", "seed"):
            if getattr(self, name) < 0:
                raise JengaError(f"{name} is {getattr(self, name)}; allowed: 0 and more")
        if not self.learning_rate > 0:
            raise JengaError(f"learning_rate is {self.learning_rate}; allowed: above 0")
        if self.patience and self.train_on_validation:
            raise JengaError("patience stops by the validation towers, train_on_validation trains on them; choose one")
        graph_spec(self.graph)


@dataclass(frozen=True, kw_only=True)
class SelectionTraining(Training):
    """Training of the selector: does pulling this block fail? Defaults are the paper's (section II-B).

    The paper gives the graph, 6 graph convolutions, cross-entropy, Adam, learning rate, batch and epochs. It leaves
    open, and we chose: 64 numbers a node, ReLU, the mean over all blocks and one linear layer as readout, features
    standardised (raw SI sizes differ in the fourth decimal and teach nothing), messages along the edges as drawn,
    from a block to those below it.
    """

    graph: str = "G_s"
    model: str = "gcn"
    layers: int = 6
    width: int = 64
    learning_rate: float = 1e-3
    label: Literal["failure", "strict_failure"] = "failure"
    """What to predict: the paper's failure (stuck or collapsed), or failure or dragged."""
    shared_layers: bool = False
    """Use one layer's weights in every step (interaction only): recurrent message passing."""
    residual: bool = False
    """Add each layer's input to its output (gcn; the interaction model always does)."""
    readout: Literal["mean", "target"] = "mean"
    """Classify by the mean over all blocks, or by what the target has gathered (sweep always does that)."""
    dropout: float = 0.0
    """Part of the readout's hidden numbers that a training step leaves out (sweep only)."""
    mirror: bool = False
    """Show towers mirrored at random, even and odd levels each for itself: a mirrored pull ends alike. Not for graphs
    with poses; one without slots looks the same in the mirror."""
    members: int = 1
    """Networks in one checkpoint, each with its own initial weights (sweep only); it says the mean of their
    probabilities."""
    verdict: float = 0.0
    """Weight in the loss of what else became of a pull: how it ended, whether it dragged a block along, how far others
    moved (sweep only; `jenga_models.verdicts`)."""
    motion: float = 0.0
    """Likewise of how far every block had moved in the first moments of the pull."""
    calibrate: bool = False
    """Divide the logits by the number that gives the least loss on the validation towers, so that probabilities are
    honest (sweep only; temperature scaling, Guo 2017, arXiv 1706.04599)."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.members < 1:
            raise JengaError(f"members is {self.members}; allowed: 1 and more")
        for name in ("verdict", "motion"):
            if not getattr(self, name) >= 0:
                raise JengaError(f"{name} is {getattr(self, name)}; allowed: 0 and more")
        if not 0 <= self.dropout < 1:
            raise JengaError(f"dropout is {self.dropout}; allowed: 0 to below 1")
        if self.calibrate and self.train_on_validation:
            raise JengaError("calibrate needs validation towers, train_on_validation trains on them; choose one")
        if self.mirror and "block_pose" in graph_spec(self.graph).node_features:
            raise JengaError(f"graph {self.graph!r} holds poses, which mirror does not turn; leave mirror off")

    @property
    def learns_verdicts(self) -> bool:
        """Whether it learns more of a pull than its label."""
        return self.verdict > 0 or self.motion > 0


@dataclass(frozen=True, kw_only=True)
class DynamicsTraining(Training):
    """Training of the simulator: how does the tower move under this action? Defaults are the paper's (section II-C).

    The paper gives the graph, 4 processing layers, mean squared error, Adam, learning rate, batch and epochs. It
    leaves open, and we chose after the GNS that it cites (Sanchez-Gonzalez 2020, arXiv 2002.09405): 128 numbers a
    node and an edge, MLPs with two hidden layers and a layer norm, residual nodes and edges, features and
    displacements standardised; messages along the edges as drawn, from a block to those below it. That model adds
    training noise, the paper mentions none: no noise.
    """

    graph: str = "G_e"
    model: str = "gns"
    layers: int = 4
    width: int = 128
    learning_rate: float = 1e-4
    hidden_layers: int = 2
    """Hidden layers of each MLP (of encoder and decoder; with edge_memory of the processing layers too)."""
    edge_memory: bool = True
    """Edges keep a state from layer to layer, as in the GNS. Without, a message has one hidden layer and is summed
    before its linear part: several times faster, which is what the controller needs."""
    scale_targets: Literal["none", "all", "role"] = "all"
    """Standardise displacements not at all, over all blocks, or the target and the others each for itself: others move
    a hundred times less, so that one scale for all hides them from the loss."""
    residual_to_action: bool = False
    """Predict what comes on top of the trivial prediction: the target moves by the action, nothing else moves."""
    loss: Literal["mse", "huber"] = "mse"
    """Squared error, or squared up to huber_delta and linear beyond: collapses do not drown small motions."""
    huber_delta: float = 3.0
    """Where the Huber loss turns linear, in units of the displacement's scale."""
    decoder_width: int = 48
    """Numbers that the answer to a plan holds for a block and step (factored only)."""
    horizon: int = 5
    """Steps of the plans that it learns from and answers at a time (factored only)."""
    mirror: bool = True
    """See half of the batches in a mirror (factored only)."""
    softness: float = 0.03
    """The factored model's loss is the length of each error, squared below so many mm (a rotation 25 mm from the
    centre): small motions count, and a falling block does not drown them."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if not graph_spec(self.graph).action:
            raise JengaError(f"graph {self.graph!r} holds no action; dynamics needs one that does, such as G_e")
        if self.hidden_layers < 1:
            raise JengaError(f"hidden_layers is {self.hidden_layers}; allowed: 1 and more")
        for name in ("huber_delta", "softness"):
            if not getattr(self, name) > 0:
                raise JengaError(f"{name} is {getattr(self, name)}; allowed: above 0")
        for name in ("decoder_width", "horizon"):
            if getattr(self, name) < 1:
                raise JengaError(f"{name} is {getattr(self, name)}; allowed: 1 and more")
        if self.model == "factored":
            self._check_factored()
        elif self.model == "gns" and "block_twist" in graph_spec(self.graph).node_features:
            raise JengaError(f"graph {self.graph!r} holds velocities, which gns does not predict; allowed: G_e")

    def _check_factored(self) -> None:
        given = (self.graph, self.flow, self.edge_attributes, self.scale_features)
        if given != ("G_e+motion", "down", False, False):
            raise JengaError(
                f"the factored model makes its own features: graph {given[0]!r}, flow {given[1]!r}, edge_attributes "
                f"{given[2]}, scale_features {given[3]}; allowed: 'G_e+motion', 'down', False, False"
            )


SELECTION_PRESETS: dict[str, SelectionTraining] = {
    "paper": SelectionTraining(train_on_validation=True),
    "best": SelectionTraining(
        graph="G_s+layout",
        model="sweep",
        layers=3,
        width=48,
        readout="target",
        dropout=0.2,
        mirror=True,
        members=4,
        verdict=1.0,
        motion=3.0,
        calibrate=True,
        learning_rate=2e-3,
        weight_decay=1e-2,
        schedule="cosine",
        gradient_clip=1.0,
        batch_size=50,
        epochs=12,
        # No patience: in folds over training towers the epoch that a few validation towers like best had a Brier score
        # 0.006 above that of the last one.
    ),
    "fast": SelectionTraining(
        graph="G_s+layout",
        model="interaction",
        layers=4,
        width=32,
        shared_layers=True,
        flow="both",
        readout="target",
        learning_rate=3e-3,
        schedule="cosine",
        gradient_clip=1.0,
        batch_size=32,
        epochs=30,
        train_on_validation=True,
    ),
}

DYNAMICS_PRESETS: dict[str, DynamicsTraining] = {
    "paper": DynamicsTraining(train_on_validation=True),
    "best": DynamicsTraining(
        graph="G_e+motion",
        model="factored",
        width=64,
        scale_features=False,
        learning_rate=2e-3,
        weight_decay=1e-4,
        schedule="cosine",
        gradient_clip=1.0,
        batch_size=32,
        epochs=60,
        patience=60,
    ),
    "fast": DynamicsTraining(
        width=32,
        hidden_layers=1,
        edge_memory=False,
        flow="both",
        edge_attributes=True,
        scale_targets="role",
        residual_to_action=True,
        loss="huber",
        learning_rate=2e-3,
        schedule="cosine",
        gradient_clip=1.0,
        batch_size=32,
        epochs=15,
        train_on_validation=True,
    ),
}

PRESETS: dict[str, dict[str, SelectionTraining] | dict[str, DynamicsTraining]] = {
    "selection": SELECTION_PRESETS,
    "dynamics": DYNAMICS_PRESETS,
}
"""Presets by kind: "paper" as published, "best" our considered choice, "fast" for a first look on two cores."""
