import importlib.resources
import re
import subprocess
import sys
from pathlib import Path

import pytest
from google.protobuf.descriptor_pb2 import FileDescriptorSet

from jenga_data.log.profile import schema_of
from jenga_data.log.proto import jenga_pb2 as pb

ROOT = Path(__file__).parents[2]
PROTO = "jenga_data/log/proto/jenga.proto"


def compile_proto(out: Path) -> FileDescriptorSet:
    """The .proto as protoc understands it, without the generated module."""
    command = [sys.executable, "-m", "grpc_tools.protoc", "-I", str(ROOT), f"--descriptor_set_out={out}", PROTO]
    subprocess.run(command, check=True, cwd=ROOT)
    return FileDescriptorSet.FromString(out.read_bytes())


def test_generated_module_is_up_to_date(tmp_path):
    (fresh,) = compile_proto(tmp_path / "set").file
    (logged,) = FileDescriptorSet.FromString(schema_of(pb.Tower)).file
    for file in (fresh, logged):  # one compiler writes the default JSON names down, another leaves them out
        for message in file.message_type:
            for field in message.field:
                field.ClearField("json_name")
    assert fresh == logged


def test_generated_stub_names_every_field():
    stub = importlib.resources.files("jenga_data.log.proto").joinpath("jenga_pb2.pyi").read_text()
    for message in pb.DESCRIPTOR.message_types_by_name.values():
        fields = ", ".join(f'"{field.name}"' for field in message.fields)
        assert f"class {message.name}(_message.Message):\n    __slots__ = ({fields}" in stub


def test_generated_module_takes_every_declared_protobuf():
    """pyproject.toml declares protobuf >= 6.31: a newer protoc makes modules that refuse it."""
    source = Path(str(pb.__file__)).read_text()
    found = re.search(r"^# Protobuf Python Version: (\d+)\.(\d+)\.(\d+)$", source, re.MULTILINE)
    assert found
    assert tuple(map(int, found.groups())) <= (6, 31, 0)


@pytest.mark.parametrize("kind", list(pb.DESCRIPTOR.message_types_by_name))
def test_every_field_is_documented(kind):
    text = (ROOT / PROTO).read_text()
    body = text.split(f"message {kind} {{\n")[1].split("\n}\n")[0]
    lines = [line.strip() for line in body.splitlines()]
    fields = [i for i, line in enumerate(lines) if line.endswith(";") and not line.startswith("//")]
    assert len(fields) == len(pb.DESCRIPTOR.message_types_by_name[kind].fields)
    assert all(lines[i - 1].startswith("//") for i in fields)
