"""True and predicted towers beside each other, as in the figure of the paper's appendix."""

from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from jenga_control.prediction.evaluate import HORIZONS
from jenga_data.blocks import Blocks
from jenga_data.replay import style
from jenga_data.replay.measures import MM
from jenga_data.replay.side_by_side import tower_grid
from jenga_data.tower import Layout, TowerState
from jenga_models.checkpoint import Checkpoint
from jenga_models.columns import Rows
from jenga_models.metrics import rollout_dynamics, windows
from jenga_models.predict import opened

TOWERS = 4


def draw_towers(
    checkpoint: Checkpoint | Path | str, dataset: Rows, out: Path, steps: int = HORIZONS["rollout_5"]
) -> Path:
    """Held-out towers some steps on: above the truth, below the prediction from the tower before, in a PNG.

    Below them stands how far the other blocks moved in those steps, and how far off they were predicted (root mean
    squares).

    They are spread evenly over how far the other blocks move, from the median to the most, one a tower.

    Raises:
        JengaError: no test episode is so long, or the checkpoint is no simulator.
    """
    model = opened(checkpoint, "dynamics")
    window = windows(dataset, dataset.rows("test"), steps)
    first, last = window[:, 0], window[:, -1]
    moved = _moved(
        dataset.column("block_pose")[first], dataset.column("next_pose")[last], dataset.column("target")[first]
    )
    chosen = telling(moved, dataset.column("tower")[first], TOWERS)
    predicted = rollout_dynamics(model, dataset, window[chosen])[:, -1]
    truth = dataset.column("next_pose")[last[chosen]]
    rows, target = first[chosen], dataset.column("target")[first[chosen]].astype(int)
    error = _moved(truth, predicted, target)
    states = [*_states(dataset, rows, truth), *_states(dataset, rows, predicted)]
    titles = [f"truth\nmoved {value * MM:.1f} mm" for value in moved[chosen]]
    titles += [f"predicted\n{value * MM:.1f} mm off" for value in error]
    figure = tower_grid(states, titles, targets=[*target.tolist()] * 2, columns=len(chosen))
    with style.applied():
        style.save(figure, out)
    return out


def _moved(
    before: Float[np.ndarray, "row block 7"], after: Float[np.ndarray, "row block 7"], target: Int[np.ndarray, " row"]
) -> Float[np.ndarray, " row"]:
    """Root mean square over all blocks but the target of how far they are apart [m]."""
    apart = np.linalg.norm(after[..., :3].astype(float) - before[..., :3], axis=-1)
    others = np.arange(before.shape[1]) != np.asarray(target)[:, None]
    return np.sqrt((apart**2 * others).sum(1) / others.sum(1))


def telling(moved: Float[np.ndarray, " row"], tower: np.ndarray, count: int) -> Int[np.ndarray, " chosen"]:
    """Rows of different towers, spread evenly from the median motion to the largest."""
    order = np.argsort(moved)
    each = [order[tower[order] == name][-1] for name in np.unique(tower)]  # of each tower, where it moves most
    ranked = np.array(each)[np.argsort(moved[each])]
    return ranked[np.unique(np.linspace((len(ranked) - 1) // 2, len(ranked) - 1, count).round().astype(int))]


def _states(dataset: Rows, rows: Int[np.ndarray, " row"], pose: Float[np.ndarray, "row block 7"]) -> list[TowerState]:
    names = ("block_size", "block_mass", "level", "slot")
    size, mass, level, slot = (dataset.column(name)[rows] for name in names)
    return [
        TowerState(
            Blocks(size[i].astype(float), mass[i].astype(float)),
            Layout.from_places(level[i].astype(int), slot[i].astype(int)),
            pose[i].astype(float),
            np.zeros((pose.shape[1], 6)),
        )
        for i in range(len(rows))
    ]
