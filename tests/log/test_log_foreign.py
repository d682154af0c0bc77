"""Files by another writer: the mcap library and what protoc makes of the .proto, nothing of this package."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from google.protobuf import descriptor_pool, message_factory
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from mcap.writer import CompressionType, IndexType, Writer

from jenga_data.errors import CheckFailed, JengaError
from jenga_data.log.reader import read_episode, read_header
from jenga_data.log.report import doctor
from jenga_data.outcome import Outcome

ROOT = Path(__file__).parents[2]
HERE = {"PYTHONPATH": os.pathsep.join([str(ROOT), *sys.path])}
METADATA = {
    "version": "1.0",
    "key": "lab-42",
    "kind": "extraction",
    "seed": "0",
    "number": "42",
    "control_step_ns": "32000000",
}
START = 1_700_000_000_000_000_000
KINDS = {
    "/tower": "Tower",
    "/tower/state": "TowerState",
    "/tower/contacts": "Contacts",
    "/sim/state": "SimState",
    "/action": "Action",
    "/gripper": "Gripper",
    "/phase": "Phase",
    "/outcome": "Outcome",
}
TOWER = {
    "size": [0.075, 0.025, 0.015] * 3,
    "mass": [0.02] * 3,
    "level": [0, 0, 0],
    "slot": [0, 1, 2],
    "target": 1,
}
POSES = [[0.01 * i, 0.02 * b, 0.0075, 1, 0, 0, 0] for i in range(3) for b in range(3)]


def state(frame: int) -> dict[str, object]:
    return {"frame": frame, "pose": [x for pose in POSES[3 * frame : 3 * frame + 3] for x in pose], "twist": [0.0] * 18}


def messages() -> list[tuple[str, int, dict[str, object]]]:
    """Topic, time and fields of the smallest whole episode."""
    out: list[tuple[str, int, dict[str, object]]] = [("/tower", START, TOWER)]
    out += [("/tower/state", START + i * 32_000_000, state(i)) for i in range(3)]
    out += [("/action", START + i * 32_000_000, {"frame": i, "displacement": [-1, 0, 0], "reached": [0] * 3})
            for i in range(2)]  # fmt: skip
    return [*out, ("/outcome", START + 2 * 32_000_000, {"label": "extracted", "clear_frame": 2})]


@pytest.fixture(scope="session")
def schema(tmp_path_factory) -> bytes:
    out = tmp_path_factory.mktemp("proto") / "set"
    source = "jenga_data/log/proto/jenga.proto"
    command = [sys.executable, "-m", "grpc_tools.protoc", "-I", str(ROOT), f"--descriptor_set_out={out}", source]
    subprocess.run(command, check=True)
    return out.read_bytes()


@pytest.fixture
def build(schema, tmp_path):
    """A function that writes messages into a file; `names` overrides the schema's name of a topic."""
    pool = descriptor_pool.DescriptorPool()
    for file in FileDescriptorSet.FromString(schema).file:
        pool.Add(file)

    def encode(kind: str, fields: dict[str, object]) -> bytes:
        return message_factory.GetMessageClass(pool.FindMessageTypeByName(f"jenga.v1.{kind}"))(
            **fields
        ).SerializeToString()

    def build(content, metadata=METADATA, names=None, config=None, extra=True, **options) -> Path:
        path = tmp_path / "foreign.mcap"
        with path.open("wb") as stream:
            writer = Writer(stream, **options)
            writer.start()
            channels = {}
            if extra:
                camera = writer.register_channel("/camera", "json", 0)
                writer.add_message(camera, START, b"{}", START)
            for topic, time, fields in content:
                if topic not in channels:
                    kind = (names or {}).get(topic, f"jenga.v1.{KINDS[topic]}")
                    number = writer.register_schema(kind, "protobuf", schema)
                    channels[topic] = writer.register_channel(topic, "protobuf", number)
                data = fields if isinstance(fields, bytes) else encode(KINDS[topic], fields)
                writer.add_message(channels[topic], time, data, time)
            if config is not None:
                writer.add_attachment(0, 0, "config.json", "application/json", config)
            if metadata is not None:
                writer.add_metadata("jenga", metadata)
            writer.finish()
        return path

    return build


@pytest.mark.parametrize(
    "options",
    [
        {"compression": CompressionType.ZSTD},
        {"compression": CompressionType.LZ4},
        {"compression": CompressionType.NONE, "enable_crcs": False},
        {"chunk_size": 1},
        {"use_chunking": False},
        {"index_types": IndexType.NONE},
        {"repeat_channels": False, "repeat_schemas": False, "use_statistics": False, "use_summary_offsets": False},
    ],
    ids=str,
)
@pytest.mark.parametrize("order", [1, -1])
def test_any_writers_file_is_read(build, options, order):
    path = build(messages()[::order], config=b'{"lab": "B"}', **options)
    episode = read_episode(path)
    assert episode.pose.reshape(-1, 7).tolist() == POSES
    assert episode.time_ns.tolist() == [START + i * 32_000_000 for i in range(3)]
    assert episode.action_frame.tolist() == [0, 1]
    assert episode.sim_state.shape == (3, 0)
    assert [len(contacts.first) for contacts in episode.contacts] == [0, 0, 0]
    assert episode.gripper.pose.shape == (0, 7)
    header, result = read_header(path)
    assert (header.key, header.number, header.round, header.target) == ("lab-42", 42, 1, 1)
    assert header.config == {"lab": "B"}
    assert result == episode.result
    assert result is not None
    assert result.verdict.outcome is Outcome.EXTRACTED


def test_doctor_finds_nothing_wrong_with_it(build):
    assert doctor(build(messages())).problems == []


WITHOUT_MUJOCO = """
import sys
for name in ("mujoco", "mink"):
    sys.modules[name] = None  # importing it fails
import cli
sys.exit(cli.run(sys.argv[1:]))
"""


def without_mujoco(*args: object) -> str:
    """What a command prints where the simulator cannot be imported."""
    command = [sys.executable, "-c", WITHOUT_MUJOCO, *map(str, args)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=os.environ | HERE)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_a_folder_of_such_logs_makes_a_dataset_without_mujoco(build, tmp_path):
    """A lab's own robot, here with forces at its fingertips and contacts, from the first byte to a checked dataset."""
    logs = tmp_path / "logs"
    logs.mkdir()
    steps = [START + i * 32_000_000 for i in range(3)]
    forces = {"pose": [0, 0, 0, 1, 0, 0, 0], "width": 0.025, "left_force": [0, 1, 2], "right_force": [0, -1, 2]}
    contacts = {"first": [0, 1, 2], "second": [-1, -1, -1], "force": [0, 0, 0.2] * 3}
    for number in range(8):
        content = [(topic, time, TOWER | {"mass": [0.02, 0.02, 0.02 + 0.001 * number]} if topic == "/tower" else fields)
                   for topic, time, fields in messages()]  # fmt: skip
        content += [("/gripper", time, forces) for time in steps]
        content += [("/tower/contacts", time, contacts | {"frame": frame}) for frame, time in enumerate(steps)]
        own = METADATA | {"key": f"lab-{number}", "number": str(number)}
        build(content, own).rename(logs / f"lab-{number}.mcap")
    for path in sorted(logs.iterdir())[:1]:
        assert "problems" not in without_mujoco("log", "doctor", path)
    out = tmp_path / "dataset"
    said = without_mujoco("convert", logs, "--name", "lab", "--version", "1.0.0", "--out", out)
    assert "lab@1.0.0" in said
    assert "16 rows, 8 towers" in said  # two actions an episode
    without_mujoco("dataset", "verify", out)


@pytest.mark.parametrize(
    ("version", "way_out"), [("2.0", "install a newer jenga"), ("0.9", "with the jenga that wrote it"), ("", "wrote")]
)
@pytest.mark.parametrize("read", [read_episode, read_header, doctor])
def test_another_major_version_is_refused(build, version, way_out, read):
    path = build(messages(), METADATA | {"version": version})
    with pytest.raises(JengaError, match=rf"profile version '{version}', this jenga reads 1.x; .*{way_out}"):
        read(path)


def test_a_newer_minor_version_is_read(build):
    assert len(read_episode(build(messages(), METADATA | {"version": "1.7", "new": "x"})).pose) == 3


def replaced(topic: str, fields: object, at: int = 0) -> list:
    """The messages with the fields of the `at`-th one of a topic replaced, or left out if None."""
    out, seen = [], 0
    for name, time, old in messages():
        new = fields if name == topic and seen == at else old
        seen += name == topic
        if new is not None:
            out.append((name, time, new))
    return out


DEEP = b'{"a":' + b"[" * 100_000 + b"]" * 100_000 + b"}"
END = ("/outcome", START, {"label": "stuck"})

REFUSALS = {
    "no tower": ({"content": replaced("/tower", None)}, "0 messages on /tower; needed: 1"),
    "two towers": ({"content": [*messages(), messages()[0]]}, "2 messages on /tower; needed: 1"),
    "no states": ({"content": [m for m in messages() if m[0] == "/tower"]}, "no messages on /tower/state"),
    "gap": ({"content": replaced("/tower/state", None, 1)}, "/tower/state lacks frame 1 "),
    "twice": ({"content": replaced("/tower/state", state(1), 2)}, "/tower/state has frame 1 twice"),
    "far frame": ({"content": replaced("/tower/state", state(0) | {"frame": 2**32 - 1})}, "lacks frame 0"),
    "short pose": ({"content": replaced("/tower/state", state(1) | {"pose": [0] * 20}, 1)}, "20 numbers where 3 x 7"),
    "no message": ({"content": replaced("/tower/state", b"\xff\xff", 1)}, "2 bytes that are no jenga.v1.TowerState"),
    "late action": ({"content": replaced("/action", {"frame": 9, "displacement": [0] * 3, "reached": [0] * 3})},
                    "/action has frame 9, the last frame of /tower/state is 2"),
    "some contacts": ({"content": [*messages(), ("/tower/contacts", START, {"frame": 0})]}, "contacts lacks frame 1"),
    "ragged": ({"content": [*messages(), *[("/sim/state", START, {"frame": i, "state": [0.0] * i}) for i in range(3)]]},
               "states of different lengths"),
    "outcome": ({"content": replaced("/outcome", {"label": "fine"})}, "outcome 'fine'; allowed: invalid, collapsed"),
    "two outcomes": ({"content": [*messages(), END]}, "2 messages on /outcome; allowed: 1"),
    "target": ({"content": replaced("/tower", TOWER | {"target": 3})}, "target is 3; allowed: 0 to 2"),
    "turn": ({"content": replaced("/tower", TOWER | {"turn": 4})}, "turn is 4; allowed: 0 to 3"),
    "far level": ({"content": replaced("/tower", TOWER | {"level": [0, 0, 2**31 - 1]})}, "level or slot out of range"),
    "one place": ({"content": replaced("/tower", TOWER | {"slot": [0, 0, 1]})}, "two blocks lie at one place"),
    "no mass": ({"content": replaced("/tower", TOWER | {"mass": [0.0] * 3})}, "must be positive"),
    "nan size": ({"content": replaced("/tower", TOWER | {"size": [float("nan")] * 9})}, "no finite numbers"),
    "no blocks": ({"content": replaced("/tower", {})}, "a tower of 0 blocks"),
    "schema": ({"content": messages(), "names": {"/tower/state": "foxglove.Pose"}},
               r"/tower/state holds foxglove.Pose \(protobuf\), not jenga.v1.TowerState"),
    "time": ({"content": [("/tower/state", 2**63, state(0)), *messages()]}, "a log time of 9223372036854775808 ns"),
    "no key": ({"content": messages(), "metadata": {"version": "1.0"}}, "lacks key, kind, seed, number, control_"),
    "seed": ({"content": messages(), "metadata": METADATA | {"seed": "x"}}, "seed is 'x'; allowed: a whole number"),
    "step": ({"content": messages(), "metadata": METADATA | {"control_step_ns": "0"}}, "control_step_ns is 0"),
    "contradiction": ({"content": messages(), "metadata": METADATA | {"target": "2"}}, "metadata says target = '2', "),
    "no config": ({"content": messages(), "config": b"{"}, "config.json is no JSON"),
    "list config": ({"content": messages(), "config": b"[]"}, "config.json is no JSON object"),
    "deep config": ({"content": messages(), "config": DEEP}, "config.json is no JSON"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSALS)
def test_what_does_not_fit_is_refused_in_one_line(build, name):
    options, message = REFUSALS[name]
    path = build(**options)
    with pytest.raises(CheckFailed, match=message) as refused:
        read_episode(path)
    assert str(path) in str(refused.value)
    assert "\n" not in str(refused.value)
    assert doctor_complains(path)


def doctor_complains(path: Path) -> bool:
    try:
        return not doctor(path).ok
    except CheckFailed:
        return True


def test_no_episode_is_refused(build):
    path = build(messages(), None)
    for read in (read_episode, read_header, doctor):
        with pytest.raises(JengaError, match="is no jenga episode: it has no metadata record 'jenga'"):
            read(path)
