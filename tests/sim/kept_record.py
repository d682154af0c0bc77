"""A recorder for tests that need no log."""

from jenga_data.episode import Action, Frame, GripperSample, Phase, Result


class Kept:
    """A recorder that keeps what it is handed."""

    def __init__(self) -> None:
        self.frames: list[Frame] = []
        self.results: list[Result] = []
        self.phases: list[Phase] = []
        self.actions: list[Action] = []

    def frame(self, frame: Frame) -> None:
        self.frames.append(frame)

    def action(self, action: Action) -> None:
        self.actions.append(action)

    def gripper(self, sample: GripperSample) -> None:
        raise AssertionError("there is no gripper here")

    def phase(self, phase: Phase) -> None:
        self.phases.append(phase)

    def finish(self, result: Result) -> None:
        self.results.append(result)
