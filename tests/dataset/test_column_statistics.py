import numpy as np

from jenga_data.dataset.rows import Ragged
from jenga_data.dataset.schema import COLUMNS, Column
from jenga_data.dataset.statistics import ColumnStatistics, Moments


def test_batches_merge_to_the_moments_of_all():
    values = np.random.default_rng(0).normal(1e3, 1e-2, (500, 3))
    moments = Moments(3)
    for part in np.split(values, [0, 1, 7, 300]):
        moments.add(part)
    found = moments.statistic()
    assert found.count == 500
    np.testing.assert_allclose(found.mean, values.mean(0), rtol=1e-8)
    np.testing.assert_allclose(found.std, values.std(0), rtol=1e-8)
    np.testing.assert_allclose([found.min, found.max], [values.min(0), values.max(0)], rtol=1e-8)


def test_the_last_axis_is_kept_and_all_else_pooled():
    columns = [
        Column("pose", "float32", ("block", 7), "", "", ""),
        Column("mass", "float32", ("block",), "", "", ""),
        Column("force", "float32", ("edge",), "", "", ""),
        Column("name", "string", (), "", "", ""),
    ]
    pose = np.arange(2 * 3 * 7.0).reshape(2, 3, 7)
    statistics = ColumnStatistics(columns)
    statistics.add(
        {
            "episode": np.array(["a", "b"]),
            "name": np.array(["a", "b"]),
            "pose": pose,
            "mass": pose[:, :, 0],
            "force": Ragged(np.array([0, 0, 2]), np.array([1.0, 3.0])),
        }
    )
    found = statistics.summary()
    assert found.keys() == {"pose", "mass", "force"}
    np.testing.assert_allclose(found["pose"].mean, pose.mean((0, 1)))
    np.testing.assert_allclose(found["mass"].mean, [pose[:, :, 0].mean()])
    assert (found["force"].count, found["force"].mean, found["force"].std) == (2, [2.0], [1.0])
    assert statistics.rows == 2


def test_every_numeric_column_of_a_dataset_is_covered():
    names = {c.name for c in COLUMNS["dynamics"] if c.dtype not in ("bool", "string")}
    assert ColumnStatistics(COLUMNS["dynamics"]).summary().keys() == names
