"""The messages of the MCAP profile. In the root of the repository `jenga.proto` becomes `jenga_pb2.py` and `.pyi` by

    python -m grpc_tools.protoc -I . --python_out=. --pyi_out=. jenga_data/log/proto/jenga.proto

with grpcio-tools 1.73, whose protoc 31.0 makes modules that every declared protobuf (6.31 and up) takes.
"""
