"""Push and pull: to a folder, to memory, and to a real S3 server on this machine."""

import itertools
import shutil
import socket
import threading
import uuid
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import fsspec
import msgspec
import pytest

from jenga_data.dataset.manifest import MANIFEST, canonical_bytes, load_manifest, sealed
from jenga_data.dataset.read import open_dataset
from jenga_data.dataset.share.pull import pull
from jenga_data.dataset.share.push import push
from jenga_data.dataset.share.remote import Remote, connect
from jenga_data.dataset.verify import verify
from jenga_data.errors import CheckFailed, JengaError


def contents(folder: Path) -> dict[str, bytes]:
    return {p.relative_to(folder).as_posix(): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


class Server:
    """An S3 server (moto) that refuses the next `faults` requests as a busy one does."""

    def __init__(self) -> None:
        from moto.moto_server.werkzeug_app import DomainDispatcherApplication, create_backend_app
        from werkzeug.serving import make_server

        self.faults = 0
        self.refused = 0
        self._app = DomainDispatcherApplication(create_backend_app)
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        self._server = make_server("127.0.0.1", port, self._answer, threaded=True)
        self._thread = threading.Thread(target=self._server.serve_forever)
        self._thread.start()
        self.url = f"http://127.0.0.1:{port}"

    def _answer(self, environ: dict[str, Any], start: Callable[..., Any]) -> Iterable[bytes]:
        if self.faults > 0:
            self.faults -= 1
            self.refused += 1
            environ["wsgi.input"].read(int(environ.get("CONTENT_LENGTH") or 0))
            start("503 Slow Down", [("Content-Type", "application/xml")])
            return [b"<Error><Code>SlowDown</Code><Message>Please reduce your request rate.</Message></Error>"]
        return self._app(environ, start)

    def stop(self) -> None:
        self._server.shutdown()
        self._thread.join()
        self._server.server_close()


@pytest.fixture(scope="module")
def server() -> Iterator[Server]:
    pytest.importorskip("moto", reason="the S3 server of the tests is not installed: pip install 'jenga[test]'")
    server = Server()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("AWS_ENDPOINT_URL", server.url)
        patch.setenv("AWS_ACCESS_KEY_ID", "tester")
        patch.setenv("AWS_SECRET_ACCESS_KEY", "not-to-be-told")
        patch.setenv("AWS_DEFAULT_REGION", "us-east-1")
        fsspec.filesystem("s3").mkdir("lab")
        yield server
    server.stop()


@pytest.fixture(params=["folder", "memory", "s3"])
def address(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """Somewhere where nothing is yet."""
    if request.param == "s3":
        request.getfixturevalue("server")
        return f"s3://lab/{uuid.uuid4().hex}/set"
    return {"folder": str(tmp_path / "there" / "set"), "memory": f"memory://{uuid.uuid4().hex}/set"}[request.param]


def put(address: str, file: str, content: bytes) -> None:
    remote = connect(address)
    if "://" not in address:
        (Path(remote.root) / file).parent.mkdir(parents=True, exist_ok=True)
    remote.fs.pipe_file(f"{remote.root}/{file}", content)


def test_what_was_pushed_comes_back_to_the_byte(dataset_folder, address, tmp_path):
    sent = push(dataset_folder, address)
    back = pull(address, tmp_path / "back")
    assert contents(tmp_path / "back") == contents(dataset_folder)
    files = load_manifest(dataset_folder).files
    assert (sent.sent, sent.kept, sent.sent_bytes) == (len(files), 0, sum(f.bytes for f in files))
    assert (back.fetched, back.kept, back.fetched_bytes) == (len(files), 0, sent.sent_bytes)
    assert back.hash == sent.hash == load_manifest(dataset_folder).hash
    assert [p.name for p in tmp_path.iterdir() if p.name != "there"] == ["back"]


def test_pushing_again_sends_nothing(selection, address):
    push(selection, address)
    again = push(selection, address)
    assert (again.sent, again.kept) == (0, len(load_manifest(selection).files))


def fail_at(monkeypatch: pytest.MonkeyPatch, method: str, call: int, error: BaseException) -> None:
    """Let one call of a method of `Remote` fail, halfway where it gives blocks."""
    original, calls = getattr(Remote, method), itertools.count(1)

    def failing(self: Remote, *args: Any) -> Any:
        if next(calls) != call:
            return original(self, *args)
        if method != "read":
            raise error
        return half(original(self, *args))

    def half(blocks: Iterator[bytes]) -> Iterator[bytes]:
        block = next(blocks)
        yield block[: len(block) // 2]
        raise error

    monkeypatch.setattr(Remote, method, failing)


@pytest.mark.parametrize("error", [KeyboardInterrupt(), ConnectionResetError(104, "Connection reset by peer")])
def test_a_push_that_was_stopped_goes_on(two_seeds, address, tmp_path, monkeypatch, error):
    folder = made_of_two(two_seeds, tmp_path)
    files = load_manifest(folder).files
    assert len(files) == 3
    with monkeypatch.context() as patch:
        fail_at(patch, "write", 3, error)
        with pytest.raises((KeyboardInterrupt, JengaError)) as caught:
            push(folder, address)
    if not isinstance(error, KeyboardInterrupt):
        assert "Connection reset by peer; what was transferred is kept: run the same command again" in str(caught.value)
    with pytest.raises(JengaError, match="there is no manifest"):
        pull(address, tmp_path / "early")
    again = push(folder, address)
    assert (again.sent, again.kept) == (1, 2)
    assert pull(address, tmp_path / "back").hash == again.hash


def made_of_two(logs: list[Path], tmp_path: Path) -> Path:
    from jenga_data.dataset.convert import convert

    convert(logs, tmp_path / "two", "two", "1.0.0")
    return tmp_path / "two"


@pytest.mark.parametrize("error", [KeyboardInterrupt(), ConnectionResetError(104, "Connection reset by peer")])
def test_a_pull_that_was_stopped_goes_on(two_seeds, address, tmp_path, monkeypatch, error):
    folder = made_of_two(two_seeds, tmp_path)
    push(folder, address)
    with monkeypatch.context() as patch:
        fail_at(patch, "read", 4, error)  # the manifest, two files, and half of the third
        with pytest.raises((KeyboardInterrupt, JengaError)):
            pull(address, tmp_path / "back")
    assert not (tmp_path / "back").exists()
    again = pull(address, tmp_path / "back")
    assert (again.fetched, again.kept) == (1, 2)
    assert contents(tmp_path / "back") == contents(folder)
    assert not (tmp_path / ".back.partial").exists()


def test_what_a_stopped_pull_of_another_version_left_is_not_mixed_in(selection, dynamics, tmp_path, monkeypatch):
    push(selection, str(tmp_path / "one"))
    push(dynamics, str(tmp_path / "other"))
    with monkeypatch.context() as patch:
        fail_at(patch, "read", 3, KeyboardInterrupt())
        with pytest.raises(KeyboardInterrupt):
            pull(str(tmp_path / "one"), tmp_path / "back")
    pull(str(tmp_path / "other"), tmp_path / "back")
    assert contents(tmp_path / "back") == contents(dynamics)


@pytest.mark.parametrize("damage", ["flipped", "short", "long", "missing"])
def test_a_file_that_is_damaged_there_is_refused_and_named(selection, tmp_path, damage):
    address = f"memory://{uuid.uuid4().hex}/set"
    push(selection, address)
    path = load_manifest(selection).data_files[0].path
    remote, content = connect(address), bytearray((selection / path).read_bytes())
    content[len(content) // 2] ^= 1
    if damage == "missing":
        remote.fs.rm_file(f"{remote.root}/{path}")
    else:
        put(address, path, {"flipped": bytes(content), "short": content[:-1], "long": content + b"x"}[damage])
    for split in ("", "train"):
        with pytest.raises(CheckFailed, match=path):
            pull(address, tmp_path / "back", split)
        assert not (tmp_path / "back").exists()
    assert push(selection, address).sent == 1
    assert pull(address, tmp_path / "back").kept == 1


def test_a_server_that_understates_a_size_cannot_fill_the_disk(selection, tmp_path, monkeypatch):
    path = load_manifest(selection).data_files[0].path
    push(selection, str(tmp_path / "there"))
    with (tmp_path / "there" / path).open("ab") as file:
        file.truncate(2**30)
    monkeypatch.setattr(Remote, "size", lambda *_: None)
    with pytest.raises(CheckFailed, match=f"{path} .* is longer than it may be"):
        pull(str(tmp_path / "there"), tmp_path / "back")
    assert sum(len(c) for c in contents(tmp_path / ".back.partial").values()) < 2**20


def test_more_than_the_disk_holds_is_refused_before_it_is_fetched(selection, tmp_path):
    manifest = load_manifest(selection)
    vast = [msgspec.structs.replace(f, bytes=2**40) for f in manifest.files]
    shutil.copytree(selection, tmp_path / "there")
    forged = canonical_bytes(sealed(msgspec.structs.replace(manifest, files=vast)))
    (tmp_path / "there" / MANIFEST).write_bytes(forged)
    with pytest.raises(JengaError, match=r"needs \d+ bytes and the disk has"):
        pull(str(tmp_path / "there"), tmp_path / "back")


def test_paths_that_leave_the_folder_are_refused(selection, tmp_path):
    manifest = load_manifest(selection)
    outside = msgspec.structs.replace(manifest.files[0], path="../outside")
    shutil.copytree(selection, tmp_path / "there")
    forged = canonical_bytes(sealed(msgspec.structs.replace(manifest, files=[*manifest.files, outside])))
    (tmp_path / "there" / MANIFEST).write_bytes(forged)
    with pytest.raises(JengaError, match=f"{MANIFEST} at .* lists '../outside'"):
        pull(str(tmp_path / "there"), tmp_path / "in" / "back")
    assert not (tmp_path / "in" / "outside").exists()


def test_another_version_is_never_overwritten(selection, dynamics, address, tmp_path):
    push(selection, address)
    with pytest.raises(JengaError, match=r"holds another dataset than test-dynamics@1\.0\.0"):
        push(dynamics, address)
    pull(address, tmp_path / "back")
    assert contents(tmp_path / "back") == contents(selection)
    with pytest.raises(JengaError, match="exists, and a dataset never changes"):
        pull(address, tmp_path / "back")


def test_what_arrives_damaged_gets_no_manifest(selection, tmp_path, monkeypatch):
    write = Remote.write

    def one_bit_off(self: Remote, file: str, source: Path) -> None:
        content = bytearray(source.read_bytes())
        content[len(content) // 2] ^= 1
        (tmp_path / "off").write_bytes(content)
        write(self, file, tmp_path / "off")

    monkeypatch.setattr(Remote, "write", one_bit_off)
    with pytest.raises(CheckFailed, match="arrived damaged at"):
        push(selection, str(tmp_path / "there"))
    assert not (tmp_path / "there" / MANIFEST).exists()


def test_files_of_something_else_at_the_address_are_not_mixed_in(selection, address):
    put(address, "data/old.parquet", b"old")
    with pytest.raises(JengaError, match=r"holds data/old.parquet, which is not of this dataset"):
        push(selection, address)


def test_a_damaged_dataset_is_not_pushed(selection, tmp_path):
    shutil.copytree(selection, tmp_path / "set")
    path = tmp_path / "set" / load_manifest(selection).data_files[0].path
    content = bytearray(path.read_bytes())
    content[99] ^= 1
    path.write_bytes(content)
    with pytest.raises(CheckFailed, match="a damaged dataset is not pushed"):
        push(tmp_path / "set", str(tmp_path / "there"))
    assert not (tmp_path / "there").exists()


def test_only_files_with_wanted_rows_are_fetched(two_seeds, address, tmp_path):
    folder = made_of_two(two_seeds, tmp_path)
    push(folder, address)
    whole = open_dataset(folder)
    keys = whole.column("episode")[: whole.manifest.data_files[0].rows][:2].tolist()
    done = pull(address, tmp_path / "part", episodes=keys)
    assert done.fetched == 2  # the table of episodes and one of two files
    assert verify(tmp_path / "part").ok
    assert open_dataset(tmp_path / "part").column("episode").tolist() == keys
    recipes = load_manifest(tmp_path / "part").provenance.recipes
    assert sum(last - first + 1 for r in recipes for first, last in r.numbers) == 2


def test_a_file_that_is_damaged_on_the_way_is_refused_and_named(selection, server, tmp_path):
    address, path = f"s3://lab/{uuid.uuid4().hex}", load_manifest(selection).data_files[0].path
    push(selection, address)
    put(address, path, bytes(reversed((selection / path).read_bytes())))
    with pytest.raises(CheckFailed, match=f"{path} at {address} has SHA-256"):
        pull(address, tmp_path / "back")


def test_a_busy_server_is_asked_again(selection, server, tmp_path):
    address = f"s3://lab/{uuid.uuid4().hex}"
    server.faults, server.refused = 3, 0
    push(selection, address)
    server.faults += 3
    pull(address, tmp_path / "back")
    assert server.refused == 6
    assert contents(tmp_path / "back") == contents(selection)


def test_two_pulls_into_one_folder_do_not_meet(selection, tmp_path):
    from filelock import FileLock

    push(selection, str(tmp_path / "there"))
    (tmp_path / ".back.partial").mkdir()
    with FileLock(tmp_path / ".back.partial" / "lock"), pytest.raises(JengaError, match="another process"):
        pull(str(tmp_path / "there"), tmp_path / "back")
