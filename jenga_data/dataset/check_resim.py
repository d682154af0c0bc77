"""The check of `jenga dataset verify --resim`: episodes are made again from their seeds."""

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from jenga_data.dataset.read import open_dataset
from jenga_data.dataset.remade import resim
from jenga_data.dataset.verify import Check, VerifyReport
from jenga_data.errors import JengaError

NAME = "resim"


def with_resim(report: VerifyReport, where: str | Path, episodes: int, workers: int) -> VerifyReport:
    """A report of `verify` with the check "resim", and what it found in numbers under the same name.

    It is not run on a dataset that failed another check.

    Raises:
        JengaError: a count that is none, or a worker died.
    """
    if episodes < 1:
        raise JengaError(f"--resim is {episodes}; allowed: 1 and more")
    if not report.ok:
        return replace(report, checks=report.checks | {NAME: Check(False, "not run, for what failed before")})
    with TemporaryDirectory(prefix="jenga-resim-") as folder:
        found = resim(open_dataset(where), episodes, workers, Path(folder))
    beyond = found.beyond
    check = Check(not beyond, "; ".join([*beyond, *found.lines]))
    return replace(report, checks=report.checks | {NAME: check}, resim=found.as_dict())
