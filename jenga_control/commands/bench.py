"""The verb bench, as far as models act or are drawn."""

from pathlib import Path
from typing import Literal

from jenga_data.command_line import Json, MaybePath, Shown, Verb


def bench() -> dict[str, Verb]:
    def control(
        model: Path,
        towers: int = 2,
        threads: int = 2,
        simulator_samples: int = 4,
        preset: Literal["paper", "best"] = "best",
        device: str = "cpu",
        json: Json = False,
    ) -> Shown:
        """Decisions a second of the controller, beside graphs composed one by one and the simulator as the model.

        Args:
            model: folder of a dynamics checkpoint.
            towers: on which is timed, each at its grasp.
            threads: of the model and of the simulator.
            simulator_samples: samples that the simulator is given; its time grows with their number.
            preset: of the search.
            device: cpu or cuda.
        """
        from jenga_control.planning.bench import bench_control

        found = bench_control(model, towers, threads, simulator_samples, preset, device)
        return Shown(json, found, found.pop("text"))

    def replay(seconds: float = 60.0, model: MaybePath = None, repeats: int = 3, json: Json = False) -> Shown:
        """How long a recording for rerun of a long episode takes, without and with a model.

        Args:
            seconds: length of a made-up episode [s], with fingertip forces at 250 Hz.
            model: folder of a dynamics checkpoint; by default a network of the preset "best" with random weights.
            repeats: tries, of which the fastest counts.
        """
        from jenga_control.bench_replay import bench_replay

        report = bench_replay(seconds, model, repeats)
        return Shown(json, report, report.pop("text"))

    return {"control": control, "replay": replay}
