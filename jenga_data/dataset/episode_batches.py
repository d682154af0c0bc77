"""The rows of a file, episode by episode."""

from collections.abc import Iterator

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq


def episode_batches(file: pq.ParquetFile) -> Iterator[tuple[str, pa.RecordBatch]]:
    """The rows of each episode, in order; one whose rows cross the border of two row groups comes in two pieces."""
    for group in range(file.num_row_groups):
        for batch in file.read_row_group(group).combine_chunks().to_batches():
            keys = batch["episode"].to_numpy(zero_copy_only=False).astype(str)
            starts = np.flatnonzero(np.r_[True, keys[1:] != keys[:-1]])
            for start, end in zip(starts.tolist(), [*starts[1:].tolist(), len(keys)], strict=True):
                yield str(keys[start]), batch.slice(start, end - start)
