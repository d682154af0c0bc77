"""The truth about columns: what every dataset holds, with unit, shape and frame of reference.

The same descriptions go into the Arrow fields of the Parquet files and into the manifest's `features`. All columns
are plain lists and fixed-size lists, without extension types, so that any Parquet reader can open them.
"""

from dataclasses import dataclass

import pyarrow as pa

from jenga_data.clock import MOMENTS

BLOCK = "block"
"""Stands in a shape for the number of blocks, which is the dataset's."""
EDGE = "edge"
"""Stands in a shape for a length that differs from row to row."""

FORMAT_VERSION = "1.2.0"
"""SemVer of this layout of columns, files and manifest. Readers refuse another major and a newer minor version.

1.0.0: the first. 1.1.0: `block_wedge`, without which the rows of wedge-shaped blocks were those of boxes; and poses,
velocities and forces in steps. 1.2.0: `block_moved`, what a pull does in its first moments.
"""

EPISODES = "episodes.parquet"
"""The table of episodes, beside the rows in `data/`."""

DATASET_KIND = {"selection": "selection", "extraction": "dynamics"}
"""Kind of the logs -> kind of the dataset that they make."""

_SCALARS = {
    "float32": pa.float32(),
    "int8": pa.int8(),
    "int16": pa.int16(),
    "int32": pa.int32(),
    "int64": pa.int64(),
    "bool": pa.bool_(),
    "string": pa.string(),
}


@dataclass(frozen=True)
class Column:
    """One column. `shape` is that of one row: numbers, `BLOCK`, or `EDGE` alone for a list column. `since` is the
    format (major, minor) that brought it."""

    name: str
    dtype: str
    shape: tuple[int | str, ...]
    unit: str
    frame: str
    description: str
    since: tuple[int, int] = (1, 0)

    def __post_init__(self) -> None:
        if self.dtype not in _SCALARS:
            raise ValueError(f"{self.name}: unknown dtype {self.dtype!r}; allowed: {', '.join(_SCALARS)}")
        if EDGE in self.shape and self.shape != (EDGE,):
            raise ValueError(f"{self.name}: a list column has one axis, got {self.shape}")

    @property
    def ragged(self) -> bool:
        return self.shape == (EDGE,)

    @property
    def numeric(self) -> bool:
        return self.dtype not in ("bool", "string")

    @property
    def parquet_path(self) -> str:
        """How Parquet calls the leaf, for options that are set leaf by leaf."""
        return self.name + ".list.element" * len(self.shape)

    def resolved(self, blocks: int) -> list[int | None]:
        """Shape of one row of a dataset of `blocks` blocks; None is a length that differs from row to row."""
        return [None if n == EDGE else blocks if n == BLOCK else int(n) for n in self.shape]

    def field(self, blocks: int) -> pa.Field:
        """The Arrow field. Parquet names list items "element": other names would not survive a round trip."""
        kind: pa.DataType = _SCALARS[self.dtype]
        shape = self.resolved(blocks)
        for length in reversed(shape):
            item = pa.field("element", kind, nullable=False)
            kind = pa.list_(item) if length is None else pa.list_(item, length)
        text = {"description": self.description, "unit": self.unit, "frame": self.frame}
        size = "x".join("?" if n is None else str(n) for n in shape)
        return pa.field(self.name, kind, nullable=False, metadata=text | {"shape": size})


def _scalar(name: str, dtype: str, description: str, unit: str = "") -> Column:
    return Column(name, dtype, (), unit, "", description)


POSE_STEP = 2.0**-23
"""Poses are whole multiples of it, 0.12 um: far below what a contact sinks, and a fifth fewer bytes compressed."""
TWIST_STEP = 2.0**-20
"""Likewise velocities, 1 um/s: a third fewer bytes."""
FORCE_STEP = 2.0**-14
"""Likewise forces of contacts, 0.06 mN."""

MOVED_STEP = 2.0**-16
"""Likewise how far blocks moved, 15 um: less is creep."""

_WORLD_POSE = "x y z of the centre and unit quaternion w x y z, in steps of 2^-23"
_WORLD_TWIST = "linear velocity of the centre, angular velocity, in steps of 2^-20"

KEYS = (
    _scalar("episode", "string", "Key of the episode: hash of its config, seed and number (and of a model that acts)"),
    _scalar("frame", "int32", "Frame of the episode that the row's state is; frames are one control step apart"),
    _scalar("tower", "string", "Hash of the set of blocks; splits go by it"),
    _scalar("round", "int16", "Round of the game: 1 for a fresh tower, one more after every move"),
    _scalar("target", "int16", "The block that is pulled, along -x of the world"),
    _scalar("turn", "int8", "Quarter turns of the table that brought the target along x", "90 deg"),
    _scalar("face", "int8", "Which end of the target is pulled: 0 its own -x end, 1 its own +x end"),
)

STATE = (
    Column("block_size", "float32", (BLOCK, 3), "m", "block", "Edge lengths along the block's own x, y, z"),
    Column("block_mass", "float32", (BLOCK,), "kg", "", "Mass"),
    Column(
        "block_wedge",
        "float32",
        (BLOCK,),
        "m",
        "block",
        "How much higher the block is at its +x end than at its -x end, 0 for a box; block_size has its mean height",
        since=(1, 1),
    ),
    Column("block_pose", "float32", (BLOCK, 7), "m, 1", "world", f"Pose: {_WORLD_POSE}"),
    Column("block_twist", "float32", (BLOCK, 6), "m/s, rad/s", "world", f"Velocity: {_WORLD_TWIST}"),
    Column("level", "int16", (BLOCK,), "", "", "Level, counted from 0 at the bottom"),
    Column("slot", "int8", (BLOCK,), "", "", "Slot 0, 1, 2 across the level; 1 is the centre"),
    Column("edge_upper", "int16", (EDGE,), "", "", "Edges of the support graph: the upper block"),
    Column("edge_lower", "int16", (EDGE,), "", "", "Edges of the support graph: the block right below it"),
    Column(
        "edge_force",
        "float32",
        (EDGE,),
        "N",
        "world",
        "Upward component of the force that the lower block exerts on the upper one, 0 where they do not touch, "
        "in steps of 2^-14",
    ),
)

LABELS = (
    _scalar("failure", "bool", "The paper's f: the block is stuck or the tower collapsed"),
    _scalar("strict_failure", "bool", "A failure, or dragged"),
    _scalar("dragged", "bool", "Another block moved sideways by more than a block's height"),
    _scalar("outcome", "string", "extracted, stuck or collapsed"),
    _scalar("moved", "float32", "Largest displacement of a block other than the target over the episode", "m"),
)

MOTION = (
    Column(
        "block_moved",
        "float32",
        (len(MOMENTS), BLOCK, 3),
        "m",
        "world",
        "How far the centre of each block has moved 4, 8 and 16 control steps (32 ms each) after the row's frame, or "
        "by the episode's last frame if that is earlier, in steps of 2^-16",
        since=(1, 2),
    ),
)

TRANSITION = (
    Column("action", "float32", (3,), "m", "world", "Commanded displacement of the gripper until the next frame"),
    Column("action_reached", "float32", (3,), "m", "world", "Displacement that the gripper reached"),
    Column("next_pose", "float32", (BLOCK, 7), "m, 1", "world", f"Pose at the next frame: {_WORLD_POSE}"),
    Column("next_twist", "float32", (BLOCK, 6), "m/s, rad/s", "world", f"Velocity at the next frame: {_WORLD_TWIST}"),
    Column(
        "left_force", "float32", (3,), "N", "gripper", "Mean force on the left fingertip over the step, 0 if unknown"
    ),
    Column("right_force", "float32", (3,), "N", "gripper", "Mean force on the right fingertip over the step, likewise"),
    _scalar("target_clear", "bool", "The target is clear of the tower from this frame on"),
    _scalar("collapsed", "bool", "By the next frame a block but the target has dropped by more than the threshold"),
)

COLUMNS = {"selection": KEYS + STATE + LABELS + MOTION, "dynamics": KEYS + STATE + TRANSITION}
"""Columns of `data/*.parquet` by kind of dataset: one row a (J, b, f), one row a (J_t, b, a_t, J_t+1)."""

EPISODE_COLUMNS = (
    KEYS[0],
    _scalar("kind", "string", "Kind of the log: selection or extraction"),
    _scalar("seed", "int64", "Seed of the collection"),
    _scalar("number", "int64", "Number of the episode in its collection"),
    _scalar("config", "string", "Hash of the collection's config, which stands in the manifest"),
    _scalar("checkpoint", "string", "Hash of the model that acted, empty if none did"),
    *KEYS[2:],
    *LABELS,
    _scalar("cause", "string", "What went wrong on the robot's side, empty if nothing did"),
    _scalar("clear_frame", "int32", "First frame from which on the target stays clear of the tower, -1 if none"),
    _scalar("frames", "int32", "Frames of the episode"),
    _scalar("rows", "int32", "Rows of the episode in data/"),
    _scalar("control_step_ns", "int64", "Time between two frames", "ns"),
    _scalar("log_sha256", "string", "SHA-256 of the log"),
    _scalar("log_bytes", "int64", "Size of the log", "byte"),
    _scalar("commit", "string", "Commit of the code that wrote the log"),
    _scalar("versions", "string", "Versions of the packages that wrote the log, as JSON"),
)
"""Columns of `episodes.parquet`: one row an episode."""


def format_of(version: str) -> tuple[int, int]:
    """Major and minor number of a format version: what a reader must know."""
    major, minor, _ = map(int, version.split("."))
    return major, minor


def columns_of(kind: str, format_version: str) -> tuple[Column, ...]:
    """Columns of `data/*.parquet` in a format that may be older than the present one."""
    return tuple(c for c in COLUMNS[kind] if c.since <= format_of(format_version))


def arrow_schema(columns: tuple[Column, ...], blocks: int, format_version: str = FORMAT_VERSION) -> pa.Schema:
    """The exact schema, metadata included, that a file of these columns has."""
    return pa.schema([c.field(blocks) for c in columns], metadata={"jenga.format_version": format_version})
