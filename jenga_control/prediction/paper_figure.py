"""Truth against prediction (paper, figure gt_vs_pred): a tower before a pull, after it, and as the model expects it."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from jenga_data.episode import Episode, Prediction
from jenga_data.figures.scenes import Row, Scene, rows_figure
from jenga_data.palette import block_colours, error_colours
from jenga_data.replay.measures import (
    MM,
    others,
    position_error,
    root_mean_square,
    round_scale,
    standing_still_error,
)
from jenga_data.replay.summary import target_words


def prediction_figure(pairs: Sequence[tuple[Episode, Prediction]]) -> Figure:
    """A row an episode: where the open loop starts, the truth after its last step, and the prediction in the colours
    of its error. Call it with the project's style applied."""
    last = [np.percentile(position_error(episode, prediction)[-1], 98) for episode, prediction in pairs]
    scale = round_scale(max(*last, 1e-4))
    return rows_figure([_row(episode, prediction, scale) for episode, prediction in pairs], scale)


def until_decided(episode: Episode, prediction: Prediction) -> Prediction:
    """The open loop as far as the tower's fate is open: until the target is clear; what falls then is no pull."""
    clear = episode.result.verdict.clear_frame if episode.result else -1
    kept = prediction.frame <= clear if clear > prediction.frame[0] else np.ones(len(prediction.frame), bool)
    return replace(prediction, frame=prediction.frame[kept], pose=prediction.pose[kept])


def errors(episode: Episode, prediction: Prediction) -> dict[str, float]:
    """Of the last predicted frame, in mm: of the others (RMS) and of the target, and if nothing had moved."""
    rest, target = others(episode), [episode.header.target]
    error, still = position_error(episode, prediction)[-1:], standing_still_error(episode, prediction)[-1:]
    return {
        "others_mm": MM * float(root_mean_square(error[:, rest])[0]),
        "target_mm": MM * float(error[0, target[0]]),
        "others_if_nothing_moved_mm": MM * float(root_mean_square(still[:, rest])[0]),
        "target_if_nothing_moved_mm": MM * float(still[0, target[0]]),
        "steps": len(prediction.frame),
    }


def _row(episode: Episode, prediction: Prediction, scale: float) -> Row:
    colours = block_colours(episode.header.layout.level, episode.header.target)
    start, end = int(prediction.frame[0]) - 1, int(prediction.frame[-1])
    found = errors(episode, prediction)
    by_error = error_colours(position_error(episode, prediction)[-1], scale)
    words = f"prediction: others {found['others_mm']:.1f} mm,\ntarget {found['target_mm']:.1f} mm off"
    still = f"truth: others {found['others_if_nothing_moved_mm']:.1f} mm,\n"
    still += f"target {found['target_if_nothing_moved_mm']:.1f} mm from the start"
    scenes = [
        Scene(episode.pose[start], colours, "before"),
        Scene(episode.pose[end], colours, still),
        Scene(prediction.pose[-1], by_error, words),
    ]
    header = episode.header
    outcome = episode.result.verdict.outcome if episode.result else "unknown"
    title = f"{outcome}; {target_words(header)}, round {header.round}; {len(prediction.frame)} steps ahead"
    return Row(title, header.blocks.size, scenes)
