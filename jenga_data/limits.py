"""How much a file from elsewhere may ask for. What asks for more is refused before anything is allocated for it."""

from typing import Final

MAX_RECORD_BYTES: Final = 256 * 2**20
"""No record or unpacked chunk of a log is larger."""
MAX_PACKING: Final = 1000
"""A chunk unpacks to at most so many times its size (real ones to ten times)..."""
MAX_SMALL_CHUNK_BYTES: Final = 2**20
"""...unless it stays below this size."""
MAX_UNPACKED_BYTES: Final = 8 * 2**30
"""Most that the chunks of one log unpack to."""
MAX_EPISODE_BYTES: Final = 2 * 2**30
"""Most that is kept in memory of one episode: 60,000 frames of a full tower."""
MESSAGE_BYTES: Final = 200
"""What a message takes in memory beside its data: empty ones are not free."""
MAX_DAMAGES: Final = 1000
"""After so many damaged places the rest of a log is not looked at."""
MAX_READING: Final = 8
"""A damaged log is read at most so many times over, in search of what is whole."""
MAX_BLOCKS: Final = 1024
"""Most blocks in a tower, and with it most levels."""
MAX_PARTS: Final = 256
"""Most joints and most links of a robot, and most solids of a link."""
MAX_CONFIG_BYTES: Final = 2**20
"""Largest config.json of a log."""
MAX_DEPTH: Final = 32
"""Deepest nesting of a config."""
MAX_NAME: Final = 128
"""Longest key of an episode, which names files."""
MAX_MANIFEST_BYTES: Final = 16 * 2**20
"""Larger manifests are refused unread: 100,000 towers take 3 MB."""
MAX_COUNT: Final = 2**40
"""Largest count in a manifest."""
MAX_ROW_BYTES: Final = 2**20
"""Most that a row of a Parquet file claims to unpack to, on average: 1,024 blocks with all their edges take half."""
MAX_GROUP_BYTES: Final = 2**30
"""Most that a row group of a Parquet file claims to unpack to."""
MAX_THRIFT_STRING: Final = 2**20
"""Longest string in what a Parquet file says of itself..."""
MAX_THRIFT_CONTAINER: Final = 10**6
"""...and longest list in it."""
