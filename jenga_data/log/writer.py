"""Writing one episode as one MCAP file."""

from pathlib import Path
from types import TracebackType

from jenga_data.episode import Action, EpisodeHeader, Frame, GripperSample, Phase, Result
from jenga_data.log import codec, profile
from jenga_data.log.header import write_config, write_metadata
from jenga_data.log.output import Output
from jenga_data.log.proto import jenga_pb2 as pb
from jenga_data.log.urdf import block_link, gripper_urdf, robot_link, robot_urdf, tower_urdf
from jenga_data.log.viewer import GRIPPER_LINKS, Transforms, gripper_poses, log_text


class EpisodeWriter:
    """Writes `<path>.partial`; `finish` completes it and gives it its name.

    Left without `finish`, by an exception or not, the partial file holds all that was written, for
    `jenga log recover`. The same calls write the same bytes: what differs between runs (time, machine) belongs
    into the header's provenance, if anywhere.

    Raises:
        JengaError: on any call, the system refused (no space, no permission, no such folder).
    """

    def __init__(self, path: Path, header: EpisodeHeader, scene_xml: str) -> None:
        self._header = header
        self._transforms = Transforms([block_link(i) for i in range(len(header.blocks))])
        self._gripper_transforms = Transforms(GRIPPER_LINKS)
        links = header.robot.links if header.robot else ()
        self._robot_transforms = Transforms([robot_link(link.name) for link in links])
        self._gripper: GripperSample | None = None
        self._last_ns: int | None = None
        self._open = True
        self._out = Output(path, profile.PROFILE)
        try:
            self._out.metadata(profile.EPISODE_METADATA, write_metadata(header))
            self._out.metadata(profile.PROVENANCE_METADATA, header.provenance)
            self._out.attachment(profile.CONFIG, "application/json", write_config(header.config))
            if scene_xml:
                self._out.attachment(profile.SCENE, "application/xml", scene_xml.encode())
            self._out.flush()
        except BaseException:
            self._out.abandon()
            raise

    def __enter__(self) -> "EpisodeWriter":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._open:
            self._open = False
            self._out.abandon()

    def frame(self, frame: Frame) -> None:
        """Log one control step, and for viewers where blocks and robot, or else gripper, are.

        Raises:
            ValueError: the header has a robot and the frame none, or the other way round.
        """
        if (frame.robot is None) != (self._header.robot is None):
            raise ValueError(f"frame {frame.index} and the header differ in whether there is a robot")
        time_ns = self._at(frame.time_ns)
        self._out.packed(profile.STATE, pb.TowerState, codec.write_state(frame), time_ns)
        self._out.packed(profile.CONTACTS, pb.Contacts, codec.write_contacts(frame), time_ns)
        self._out.packed(profile.SIM, pb.SimState, codec.write_sim_state(frame), time_ns)
        if frame.robot is not None:
            data = codec.write_robot_state(frame.index, frame.robot)
            self._out.packed(profile.ROBOT_STATE, pb.RobotState, data, time_ns)
        self._out.message(profile.TF, self._transforms.fill(frame.pose, time_ns), time_ns)
        if frame.robot is not None:
            links = self._robot_transforms.fill(frame.robot.link_pose, time_ns)
            self._out.message(profile.TF, links, time_ns)
        elif self._gripper is not None:
            poses = gripper_poses(self._gripper.pose, self._gripper.width)
            self._out.message(profile.TF, self._gripper_transforms.fill(poses, time_ns), time_ns)

    def action(self, action: Action) -> None:
        self._out.message(profile.ACTION, codec.write_action(action), self._at(action.time_ns))

    def gripper(self, sample: GripperSample) -> None:
        """Log a sample at any rate; viewers get the last one at each frame."""
        time_ns = self._at(sample.time_ns)
        if self._gripper is None and self._header.robot is None:
            self._out.text(profile.GRIPPER_DESCRIPTION, gripper_urdf(), time_ns)
        self._gripper = sample
        self._out.message(profile.GRIPPER, codec.write_gripper(sample), time_ns)

    def phase(self, phase: Phase) -> None:
        time_ns = self._at(phase.time_ns)
        self._out.message(profile.PHASE, codec.write_phase(phase), time_ns)
        self._out.message(profile.TEXT, log_text(phase.name, "phase", time_ns), time_ns)

    def finish(self, result: Result) -> None:
        """Log the outcome, complete the file and rename it. Nothing can be written afterwards."""
        time_ns = self._at(self._last_ns or 0)
        # In a chunk of its own, as the tower: `read_header` unpacks no frame.
        self._out.flush()
        outcome = result.verdict.outcome.value
        text = f"{outcome}: {result.cause}" if result.cause else outcome
        self._out.message(profile.OUTCOME, codec.write_outcome(result), time_ns)
        self._out.message(profile.TEXT, log_text(text, "outcome", time_ns), time_ns)
        self._out.commit()
        self._open = False

    def _at(self, time_ns: int) -> int:
        """The time to stamp; before the first one, the tower, so that the log spans the episode and no more."""
        if not self._open:
            raise ValueError("the episode is finished or was left: nothing can be written to it")
        if self._last_ns is None:
            blocks, target, robot = self._header.blocks, self._header.target, self._header.robot
            self._out.message(profile.TOWER, codec.write_tower(self._header), time_ns)
            self._out.text(profile.ROBOT_DESCRIPTION, tower_urdf(blocks.size, target), time_ns)
            if robot is not None:
                self._out.message(profile.ROBOT, codec.write_robot(robot), time_ns)
                self._out.text(profile.LINKS_DESCRIPTION, robot_urdf(robot), time_ns)
            self._out.flush()
        self._last_ns = max(time_ns, self._last_ns or 0)
        return time_ns
