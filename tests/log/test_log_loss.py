"""`jenga log info | doctor | recover` on files that lost something: they say what, with exit code 1."""

import random
from dataclasses import asdict
from pathlib import Path

import msgspec
import pytest
from synthetic_log import SCENE, make_script, play, write

import cli
from jenga_data.errors import JengaError
from jenga_data.log.parse import HEAD
from jenga_data.log.reader import read_episode
from jenga_data.log.records import open_log, read_record
from jenga_data.log.recover import recover
from jenga_data.log.report import doctor, inspect
from jenga_data.log.writer import EpisodeWriter

SCRIPT = make_script(frames=12, state=1500)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("whole") / "e.mcap", SCRIPT)


def boundaries(path: Path) -> list[int]:
    """Where each record of a file begins, chunks among them, and where the last one ends."""
    size, found = path.stat().st_size, [8]
    with open_log(path) as stream:
        while found[-1] < size - 8:
            found.append(found[-1] + len(read_record(stream, found[-1], size)))
    return found


def run(capsys: pytest.CaptureFixture[str] | None, verb: str, path: Path, *out: Path) -> tuple[int, dict[str, object]]:
    """Exit code and JSON object of a command line, or of what it calls where nobody reads the terminal: that is faster.

    Of a refusal, its one line.
    """
    try:
        if capsys is not None:
            code = cli.run(["log", verb, str(path), *(x for to in out for x in ("--out", str(to))), "--json"])
            return code, msgspec.json.decode(capsys.readouterr().out)
        said = asdict({"info": inspect, "doctor": doctor, "recover": recover}[verb](path, *out))
        return int(bool(said.get("problems") or said.get("lost"))), said
    except JengaError as error:
        return error.exit_code, {"refusal": str(error)}


def says_what_is_lost(capsys: pytest.CaptureFixture[str] | None, path: Path, out: Path, problem: str = "") -> None:
    """All three verbs; what is recovered can be read, and doctor has nothing new to say of it."""
    for verb in ("info", "doctor"):
        code, said = run(capsys, verb, path)
        assert code == 1
        assert "refusal" in said or any(problem in line for line in msgspec.convert(said["problems"], list[str]))
    code, said = run(capsys, "recover", path, out)
    assert code == 1
    if "refusal" in said:
        assert "\n" not in str(said["refusal"])
        assert "nothing can be recovered" in str(said["refusal"]) or "is no jenga episode" in str(said["refusal"])
        assert not out.exists()
        return
    assert said["lost"]
    assert msgspec.convert(said["frames"], int) >= 1
    assert run(capsys, "info", out)[0] == 0
    out.unlink()


def test_a_whole_file_has_lost_nothing(whole, tmp_path, capsys):
    for verb, out in (("info", []), ("doctor", []), ("recover", [tmp_path / "out.mcap"])):
        code, said = run(capsys, verb, whole, *out)
        assert code == 0
        assert not said.get("problems") and not said.get("lost")  # noqa: PT018  (one of them is there)


def test_cut_off_between_any_two_records(whole, tmp_path):
    data = whole.read_bytes()
    assert len(boundaries(whole)) > 15
    for place in boundaries(whole):
        path = tmp_path / "cut.mcap"
        path.write_bytes(data[:place])
        says_what_is_lost(None, path, tmp_path / "out.mcap")


def test_cut_off_anywhere(whole, tmp_path):
    data, rng = whole.read_bytes(), random.Random(0)
    for _ in range(8):
        path = tmp_path / "cut.mcap"
        path.write_bytes(data[: rng.randrange(8, len(data))])
        says_what_is_lost(None, path, tmp_path / "out.mcap")


def test_a_flipped_bit_in_any_chunk(whole, tmp_path):
    data, rng = whole.read_bytes(), random.Random(1)
    for start in boundaries(whole)[:-1]:
        if HEAD.unpack(data[start : start + HEAD.size])[0] != 6:  # a chunk
            continue
        bad = bytearray(data)
        bad[start + 60] ^= 1 << rng.randrange(8)
        path = tmp_path / "bad.mcap"
        path.write_bytes(bad)
        code, said = run(None, "doctor", path)
        assert code == 1
        assert any(f"byte {start}: chunk" in line for line in msgspec.convert(said["problems"], list[str]))


def test_a_flipped_bit_anywhere_is_noticed(whole, tmp_path):
    data, rng = whole.read_bytes(), random.Random(2)
    for place in rng.sample(range(len(data)), 20):
        bad = bytearray(data)
        bad[place] ^= 1 << rng.randrange(8)
        path = tmp_path / "bad.mcap"
        path.write_bytes(bad)
        assert run(None, "doctor", path)[0] in (1, 2), place
        with pytest.raises(JengaError):
            read_episode(path)


def test_a_log_whose_writer_was_killed(tmp_path, capsys):
    with EpisodeWriter(tmp_path / "e.mcap", SCRIPT.header, SCENE) as writer:
        play(writer, SCRIPT)
    says_what_is_lost(capsys, tmp_path / "e.mcap.partial", tmp_path / "out.mcap", "the file ends without a footer")
