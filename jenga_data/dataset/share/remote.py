"""A place elsewhere that holds, or will hold, one dataset: any address that fsspec knows."""

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

import fsspec
from fsspec.implementations.local import LocalFileSystem

from jenga_data.errors import CheckFailed, JengaError

EXTRA = "share"
"""The optional part of the installation that brings the libraries of s3:// and hf://."""
BLOCK_BYTES = 4 * 2**20

_LIBRARIES = frozenset(
    {"aiobotocore", "aiohttp", "botocore", "fsspec", "httpx", "httpx2", "huggingface_hub", "requests"}
)
"""Whose exceptions tell of a network, a server or a missing right, and not of a bug here."""
_NO_FOLDERS = frozenset({"s3", "s3a", "gs", "gcs", "hf", "abfs", "az"})
"""Stores that know keys and no folders; s3fs would take a request for a folder as one for a new bucket."""


@dataclass(frozen=True, eq=False)
class Remote:
    """An address. `name` is how it may be shown: without user, password and query, which may hold a signature."""

    fs: fsspec.AbstractFileSystem
    root: str
    name: str
    secrets: tuple[str, ...]

    def size(self, file: str) -> int | None:
        """Bytes of a file, None if the server does not tell.

        Raises:
            FileNotFoundError: it is not there.
        """
        return self.fs.info(self._path(file))["size"]

    def files(self, folder: str) -> list[str]:
        """All files below a folder, relative to the address; none if it is not there."""
        found = self.fs.find(self._path(folder.rstrip("/")))
        start = len(self._path(""))
        return sorted(path[start:] for path in found)

    def read(self, file: str, limit: int) -> Iterator[bytes]:
        """The content, block by block, at most `limit` bytes whatever the server says of its size.

        Raises:
            FileNotFoundError: it is not there.
            CheckFailed: it goes on after `limit` bytes.
        """
        with self.fs.open(self._path(file), "rb") as stream:
            while block := stream.read(min(BLOCK_BYTES, limit + 1)):
                assert isinstance(block, bytes)
                limit -= len(block)
                if limit < 0:
                    raise CheckFailed(f"{file} at {self.name} is longer than it may be: get the dataset elsewhere")
                yield block

    def write(self, file: str, source: Path) -> None:
        """Copy a local file there. It appears whole, or is replaced by the next try."""
        path = self._path(file)
        if self._protocols.isdisjoint(_NO_FOLDERS):
            self.fs.makedirs(path.rpartition("/")[0], exist_ok=True)
        if not isinstance(self.fs, LocalFileSystem):
            self.fs.put_file(str(source), path)
            return
        partial = Path(path + ".partial")  # an object store shows no half of an object; a folder would
        self.fs.put_file(str(source), str(partial))
        partial.replace(path)

    @contextmanager
    def talking(self) -> Iterator[None]:
        """Turn what the network, the server or the disk refuses into one line.

        Raises:
            JengaError: the body failed for such a reason.
        """
        try:
            yield
        except Exception as error:
            libraries = {kind.__module__.partition(".")[0] for kind in type(error).__mro__}
            if not isinstance(error, OSError) and not libraries & _LIBRARIES:
                raise
            reason = (str(error) or type(error).__name__).splitlines()[0]
            for secret in self.secrets:
                reason = reason.replace(secret, "***")
            raise JengaError(
                f"{self.name}: {reason}; what was transferred is kept: run the same command again"
            ) from error

    @property
    def _protocols(self) -> set[str]:
        return {self.fs.protocol} if isinstance(self.fs.protocol, str) else set(self.fs.protocol)

    def _path(self, file: str) -> str:
        return f"{self.root.rstrip('/')}/{file}"


def connect(address: str) -> Remote:
    """The place that an address names. Credentials come from where its library looks for them (environment, files).

    Raises:
        JengaError: the address has no meaning, or the library of its protocol is not installed.
    """
    shown, secrets = _without_secrets(address)
    if not address or "::" in address:
        raise JengaError(f"bad address {shown!r}: use a folder or one URL, such as s3://bucket/path")
    try:
        # A new connection: listings that another one has kept may be out of date.
        fs, root = fsspec.core.url_to_fs(address, skip_instance_cache=True)
    except ImportError as error:
        protocol = address.partition("://")[0]
        raise JengaError(
            f"{protocol}:// needs a library that is not installed: run pip install 'jenga[{EXTRA}]' ({error})"
        ) from error
    except ValueError as error:
        reason = str(error).splitlines()[0]
        for secret in secrets:
            reason = reason.replace(secret, "***")
        raise JengaError(f"bad address {shown!r} ({reason}): use a folder, s3://..., hf://datasets/...") from error
    return Remote(fs, root, shown, secrets)


def _without_secrets(address: str) -> tuple[str, tuple[str, ...]]:
    """The address without user, password and query, and these as texts that must appear nowhere."""
    try:
        parts = urlsplit(address)
    except ValueError:
        return re.sub(r"//[^/]*@", "//", address), ()
    if not parts.scheme:
        return address, ()
    user, at, host = parts.netloc.rpartition("@")
    found = [user, *user.split(":"), parts.query] if at else [parts.query]
    shown = f"{parts.scheme}://{host}{parts.path}"
    return shown, tuple(sorted((s for s in found if s), key=len, reverse=True))
