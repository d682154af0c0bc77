"""The strategic start of a pull: the classifier picks the block that is safest to take, in place of chance."""

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

from jenga_control.selection.ranking import Selector, rank
from jenga_data.collect.config import ExtractionConfig
from jenga_data.collect.stage import Stage, set_stage
from jenga_data.tower import quarter_turns_for


def selected_stage(model: Path, config: ExtractionConfig, seed: int, number: int) -> Stage:
    """The tower of (seed, number) as collection would set it up, with the target that a checkpoint ranks safest.

    The face stays as it was drawn. For a robot, which finds the tower as it was grown.

    Raises:
        JengaError: the checkpoint is of another kind, or no tower stood.
    """
    return with_safest_target(set_stage(config, seed, number), _opened(model))


def with_safest_target(stage: Stage, selector: Selector) -> Stage:
    """Another target for a tower that is not turned yet."""
    (target, _), *_ = rank(stage.state, selector)
    return replace(stage, target=target, turn=quarter_turns_for(stage.layout, target, stage.face))


@lru_cache(maxsize=1)
def _opened(model: Path) -> Selector:
    from jenga_models.predict import Selector as Trained

    return Trained(model)
