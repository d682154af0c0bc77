"""Croissant 1.1, the description of a dataset that search engines and loaders of machine learning read.

https://docs.mlcommons.org/croissant/docs/croissant-spec-1.1.html
"""

from pathlib import Path
from typing import Any

from jenga_data.dataset.export.splits import write_splits
from jenga_data.dataset.manifest import File, Manifest
from jenga_data.dataset.read import Dataset
from jenga_data.dataset.schema import COLUMNS, EPISODE_COLUMNS, Column
from jenga_data.report import to_json

CROISSANT = "croissant.json"
PARQUET = "application/x-parquet"
"""The name that mlcroissant knows; the registered one, application/vnd.apache.parquet, it does not."""
CONFORMS_TO = "http://mlcommons.org/croissant/1.1"
LICENCES = {"CC-BY-4.0": "https://creativecommons.org/licenses/by/4.0/"}
"""Addresses of licences by their SPDX name; another one is written as it stands."""

_TYPES = {
    "float32": "cr:Float32",
    "int8": "cr:Int8",
    "int16": "cr:Int16",
    "int32": "cr:Int32",
    "int64": "cr:Int64",
    "bool": "sc:Boolean",
    "string": "sc:Text",
}

_CONTEXT: dict[str, Any] = {
    "@language": "en",
    "@vocab": "https://schema.org/",
    "arrayShape": "cr:arrayShape",
    "citeAs": "cr:citeAs",
    "column": "cr:column",
    "conformsTo": "dct:conformsTo",
    "containedIn": "cr:containedIn",
    "cr": "http://mlcommons.org/croissant/",
    "data": {"@id": "cr:data", "@type": "@json"},
    "dataType": {"@id": "cr:dataType", "@type": "@vocab"},
    "dct": "http://purl.org/dc/terms/",
    "description": {"@container": "@language"},
    "equivalentProperty": "cr:equivalentProperty",
    "examples": {"@id": "cr:examples", "@type": "@json"},
    "extract": "cr:extract",
    "field": "cr:field",
    "fileObject": "cr:fileObject",
    "fileProperty": "cr:fileProperty",
    "fileSet": "cr:fileSet",
    "format": "cr:format",
    "includes": "cr:includes",
    "isArray": "cr:isArray",
    "isLiveDataset": "cr:isLiveDataset",
    "jsonPath": "cr:jsonPath",
    "key": "cr:key",
    "md5": "cr:md5",
    "name": {"@container": "@language"},
    "parentField": "cr:parentField",
    "path": "cr:path",
    "rai": "http://mlcommons.org/croissant/RAI/",
    "recordSet": "cr:recordSet",
    "references": "cr:references",
    "regex": "cr:regex",
    "repeated": "cr:repeated",
    "replace": "cr:replace",
    "samplingRate": "cr:samplingRate",
    "sc": "https://schema.org/",
    "separator": "cr:separator",
    "source": "cr:source",
    "subField": "cr:subField",
    "transform": "cr:transform",
}
"""The standard context, which the specification wants repeated in every file."""


def export_croissant(dataset: Dataset, folder: Path) -> None:
    """Write `croissant.json` with a Parquet file a split and the table of episodes into an empty folder.

    Raises:
        CheckFailed: a file of the dataset is damaged.
    """
    files = write_splits(dataset, folder)
    (folder / CROISSANT).write_text(to_json(describe(dataset.manifest, files)), encoding="utf-8")


def describe(manifest: Manifest, files: dict[str, File]) -> dict[str, Any]:
    """The JSON-LD object. Every file has its SHA-256, and every split is a set of records of its own."""
    return {
        "@context": _CONTEXT,
        "@type": "sc:Dataset",
        "conformsTo": CONFORMS_TO,
        "name": manifest.name,
        "description": manifest.description,
        "version": manifest.version,
        "license": LICENCES.get(manifest.licence, manifest.licence),
        "citeAs": " ".join(manifest.citation),
        "keywords": ["robotics", "contact-rich manipulation", "graph neural networks", "jenga", manifest.kind],
        "identifier": f"{manifest.identifier} sha256:{manifest.hash}",
        "isLiveDataset": False,
        "distribution": [_file(file) for file in files.values()],
        "recordSet": [_records(name, file, manifest) for name, file in files.items()],
    }


def _file(file: File) -> dict[str, Any]:
    return {
        "@type": "cr:FileObject",
        "@id": file.path,
        "name": file.path,
        "contentUrl": file.path,
        "contentSize": f"{file.bytes} B",
        "encodingFormat": PARQUET,
        "sha256": file.sha256,
    }


def _records(name: str, file: File, manifest: Manifest) -> dict[str, Any]:
    columns = EPISODE_COLUMNS if name == "episodes" else COLUMNS[manifest.kind]
    what = "Episodes with their provenance" if name == "episodes" else f"Rows of the split {name}"
    keys = ["episode"] if name == "episodes" else ["episode", "frame"]
    return {
        "@type": "cr:RecordSet",
        "@id": name,
        "name": name,
        "description": f"{what}: {file.rows} records.",
        "key": [{"@id": f"{name}/{key}"} for key in keys],
        "field": [_field(name, file, column, manifest.blocks) for column in columns],
    }


def _field(name: str, file: File, column: Column, blocks: int) -> dict[str, Any]:
    unit = f" [{column.unit}]" if column.unit else ""
    frame = f", in the frame of the {column.frame}" if column.frame else ""
    field: dict[str, Any] = {
        "@type": "cr:Field",
        "@id": f"{name}/{column.name}",
        "name": column.name,
        "description": f"{column.description}{unit}{frame}",
        "dataType": _TYPES[column.dtype],
        "source": {"fileObject": {"@id": file.path}, "extract": {"column": column.name}},
    }
    if column.shape:
        shape = ",".join(str(-1 if n is None else n) for n in column.resolved(blocks))
        field |= {"isArray": True, "arrayShape": shape}
    return field
