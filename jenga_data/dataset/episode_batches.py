"""The rows of a file, episode by episode."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa

from jenga_data.dataset.tables import open_parquet


def episode_batches(path: Path) -> Iterator[tuple[str, pa.RecordBatch]]:
    """The rows of each episode, in order; one whose rows cross the border of two row groups comes in two pieces."""
    with open_parquet(path) as file:
        for group in range(file.num_row_groups):
            (batch,) = file.read_row_group(group).combine_chunks().to_batches()
            keys = batch["episode"].to_numpy(zero_copy_only=False).astype(str)
            starts = np.flatnonzero(np.r_[True, keys[1:] != keys[:-1]])
            for start, end in zip(starts.tolist(), [*starts[1:].tolist(), len(keys)], strict=True):
                yield str(keys[start]), batch.slice(start, end - start)
