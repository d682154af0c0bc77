"""Addresses: which are understood, what they may tell, and what they need."""

import sys

import pytest

from jenga_data.dataset.share.remote import Remote, connect
from jenga_data.errors import JengaError


def test_no_credential_is_told(selection, tmp_path, monkeypatch):
    monkeypatch.setattr(Remote, "size", lambda *_: 1 / 0)
    for address in ("s3://key:pass-word@lab/set?X-Signature=sesame", "memory://key:pass-word@lab/set?token=sesame"):
        remote = connect(address)
        with pytest.raises(JengaError) as caught, remote.talking():
            raise PermissionError(f"{address} is forbidden, says pass-word")
        assert not any(secret in str(caught.value) + remote.name for secret in ("pass-word", "sesame", "key:"))


def test_an_address_without_meaning_is_refused(monkeypatch):
    for address in ("", "nowhere://x", "simplecache::memory://x"):
        with pytest.raises(JengaError, match="bad address"):
            connect(address)


@pytest.mark.parametrize(
    ("address", "module"), [("s3://lab/set", "s3fs"), ("hf://datasets/lab/set", "huggingface_hub")]
)
def test_a_library_that_is_missing_is_named_with_its_extra(address, module, monkeypatch):
    monkeypatch.delitem(sys.modules["fsspec.registry"].__dict__["_registry"], address.partition(":")[0], raising=False)
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(JengaError, match=r"pip install 'jenga\[share\]'") as caught:
        connect(address)
    assert "\n" not in str(caught.value)
