"""One tower simulated up to the grasp, and any number of pulls that go on from there.

What comes before the pull takes most of an episode's time and is the same whoever pulls. Here it is simulated once;
every pull starts from a copy of the whole state, to the same bytes as if it had had the tower to itself.
"""

from copy import deepcopy
from dataclasses import dataclass, field

from jenga_data.collect.attempt import attempt_of
from jenga_data.collect.config import NOBODY, Actor, ExtractionConfig
from jenga_data.collect.extraction import Policy, Pull, View
from jenga_data.collect.recording import Recorder
from jenga_data.collect.rollout import OpenLog, header_of
from jenga_data.collect.stage import Stage, set_stage
from jenga_data.episode import Action, Frame, GripperSample, Phase, Result

Message = Frame | Action | GripperSample | Phase | Result


class Tape:
    """A recorder that keeps what it is told, to tell it again to others."""

    def __init__(self, before: tuple[Message, ...] = ()) -> None:
        self.messages: list[Message] = list(before)

    def frame(self, frame: Frame) -> None:
        self.messages.append(frame)

    def action(self, action: Action) -> None:
        self.messages.append(action)

    def gripper(self, sample: GripperSample) -> None:
        self.messages.append(sample)

    def phase(self, phase: Phase) -> None:
        self.messages.append(phase)

    def finish(self, result: Result) -> None:
        self.messages.append(result)

    def play(self, recorder: Recorder) -> None:
        """Tell all of it to another recorder."""
        tell = {
            Frame: recorder.frame,
            Action: recorder.action,
            GripperSample: recorder.gripper,
            Phase: recorder.phase,
            Result: recorder.finish,
        }
        for message in self.messages:
            tell[type(message)](message)


@dataclass(frozen=True, eq=False)
class Branch:
    """A whole rollout in memory: what its log will say, and its result. `logged` writes it as often as needed."""

    tape: Tape
    result: Result
    notes: dict[str, str] = field(default_factory=dict)
    """What else its log shall say of where it comes from, beside its provenance."""


class Trunk:
    """The part of an episode that all pulls share. The tower's number and the configuration decide it.

    Raises:
        JengaError: no tower stood.
    """

    def __init__(
        self, config: ExtractionConfig, seed: int, number: int, stage: Stage | None = None, careful: bool = False
    ) -> None:
        """Simulates up to the grasp. `stage` is by default the one that collection would set; `careful` is the push."""
        self.config, self.seed, self.number = config, seed, number
        self.stage = stage or set_stage(config, seed, number)
        self._tape = Tape()
        self._attempt = attempt_of(config, self.stage, careful)
        self._attempt.to_grasp(self._tape)
        self._failed: Branch | None = None

    @property
    def grasped(self) -> bool:
        """Whether it came to a pull; without one, all branches are the same."""
        return self._attempt.grasped

    def branch(self, policy: Policy, all_actions: bool = False) -> Branch:
        """What becomes of the tower when `policy` pulls."""
        if self._failed is not None:
            return self._failed
        tape = Tape(tuple(self._tape.messages))
        # The copy's recorder is the new tape: it goes on where the shared part ended.
        twin = deepcopy(self._attempt, {id(self._tape): tape})
        branch = Branch(tape, twin.finish(Pull(policy, all_actions)))
        if not self.grasped:
            self._failed = branch
        return branch

    @property
    def view(self) -> View:
        """The world at the grasp, for who only wants to look."""
        return self._attempt.view

    def log(self, branch: Branch, open_log: OpenLog, actor: Actor = NOBODY) -> Result:
        """Write a branch as the complete log of `actor`'s episode."""
        header = header_of(self.config, self.seed, self.number, self.stage, actor, self._attempt.robot_model)
        header.provenance.update(branch.notes)
        with open_log(header, self._attempt.scene) as log:
            branch.tape.play(log)
        return branch.result
