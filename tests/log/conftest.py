import pytest
from synthetic_log import Script, make_script, write


@pytest.fixture
def script() -> Script:
    return make_script()


@pytest.fixture
def log(tmp_path, script):
    """A finished episode on disk."""
    return write(tmp_path / "episode.mcap", script)
