"""The sections of the report that show one kind of result each: a table, the pictures beside it, and its command."""

import re
from collections.abc import Mapping, Sequence
from typing import Any

from jenga_control.page import Block, Cell, Code, Figure, Table
from jenga_control.selection.pulls import by_information
from jenga_control.summary.paper_tables import EXTRACTION_COMMAND, SELECTION_COMMAND, by_way
from jenga_control.summary.results import Result, Results
from jenga_data.report import in_points, number, with_interval


def datasets(results: Results) -> list[Block]:
    """What there is to learn from, by manifest."""
    found = results.of("dataset")
    if not found:
        return [_not("jenga convert LOGS --name NAME --version X.Y.Z --out DIR", "No manifest was given")]
    rows: list[Sequence[Cell]] = []
    for result in found:
        data, counts = result.data, result.data["counts"]
        outcomes = ", ".join(f"{name} {n:,}" for name, n in sorted((counts.get("outcome") or {}).items()))
        rows.append(
            (
                f"`{data['name']}@{data['version']}`",
                data.get("kind"),
                counts.get("rows"),
                counts.get("episodes"),
                counts.get("towers"),
                outcomes,
                f"`{str(data.get('hash', ''))[:12]}`",
            )
        )
    head = ("Dataset", "Kind", "Rows", "Episodes", "Towers", "Outcomes of episodes", "Hash")
    return [
        Table(head, rows, "Splits go by tower. Every version is checked by `jenga dataset verify`."),
        Code("jenga dataset info DATASET\njenga dataset verify DATASET --resim 20", "To see and to check one:"),
    ]


def calibration(results: Results) -> list[Block]:
    """How the simulated tower behaves, beside real ones or what is asked for."""
    rows: list[Sequence[Cell]] = []
    pictures: list[Block] = []
    for kind, make in _CALIBRATIONS.items():
        result = results.best(kind)
        if result is None:
            rows.append((kind, f"not measured: run `jenga calibrate {kind} --out DIR`", "", ""))
            continue
        rows += [(name, here, there, f"`jenga calibrate {kind}`") for name, here, there in make(result.data)]
        pictures += _pictures(result, {"": _DRAWN[kind]})
    head = ("Quantity", "Here", "Real towers, or what is asked for", "Command")
    return [Table(head, rows, "Seeds 800000 and up: towers that are in no dataset."), *pictures]


Measured = list[tuple[str, Cell, Cell]]


def _movable(data: dict[str, Any]) -> Measured:
    real = data["real"]
    return [
        (f"blocks that {data['force_limit_n']:g} N move, fresh tower", number(data["movable"]), f"{real['movable']:g}"),
        ("middle blocks", number(data["middle"]), f"{real['middle']:g} (loose by hand)"),
        ("side blocks", number(data["side"]), f"{real['side']:g} (loose by hand)"),
    ]


def _contacts(data: dict[str, Any]) -> Measured:
    drift = data["drift_mm_per_s"]
    return [
        ("fresh towers that fall untouched", number(data["fallen"]), "0"),
        ("drift of the worst block, median / worst tower [mm/s]", f"{drift['median']:.3f} / {drift['worst']:.3f}",
         "at most 0.03 / 0.1"),
        ("sag of an interface [mm]", number(data["sag_mm"]), "at most 0.08"),
    ]  # fmt: skip


def _ceiling(data: dict[str, Any]) -> Measured:
    low, high = data["accuracy_bounds"]
    return [
        (
            "two pulls of a block that end alike",
            number(data["agreement"]),
            f"the best accuracy: {low:.3f} to {high:.3f}",
        ),
        ("pulls that fail", number(data["failure"]), ""),
    ]


def _rounds(data: dict[str, Any]) -> Measured:
    stood = [entry["stood"] for entry in data["rounds"].values()]
    tries = max(entry["most_tries"] for entry in data["rounds"].values())
    hits = sum(round(entry["rate"] * entry["n"]) for entry in stood)
    return [
        ("towers of rounds 1 to 15 that came to stand", f"{hits} of {sum(entry['n'] for entry in stood)}", "95 %"),
        ("most tries for one", tries, "20"),
    ]


def _speed(data: dict[str, Any]) -> Measured:
    return [(f"pulls at {v} m/s that fail", number(entry["failure"]), "") for v, entry in data["speeds"].items()]


def _turntable(data: dict[str, Any]) -> Measured:
    return [
        ("round-15 towers that fall when turned", number(data["fallen"]), "0"),
        ("blocks' shift by a turn, largest [mm]", f"{data['displaced_mm']['largest']:.2g}", "0"),
    ]


def _sleep(data: dict[str, Any]) -> Measured:
    return [("pulls that end alike with and without sleep", number(data["asleep_as_awake"]),
             f"started 1 µm apart: {number(data['nudged_as_awake'])}")]  # fmt: skip


_CALIBRATIONS = {
    "movable": _movable,
    "contacts": _contacts,
    "ceiling": _ceiling,
    "rounds": _rounds,
    "speed": _speed,
    "turntable": _turntable,
    "sleep": _sleep,
}


_DRAWN = {
    "movable": "Movable blocks by level, and the force at which they break away.",
    "contacts": "Contact settings: at rest, in play, under a pull, and what they cost.",
    "ceiling": "How often pulls fail and repeat, by round, and over repeats of one pull.",
    "rounds": "Tries until a tower stood, by round.",
    "speed": "Failures by the speed of the pull.",
    "turntable": "What a turn moves, and the friction that it takes.",
    "sleep": "Whether sleep, or a start 1 µm apart, changes how a pull ends.",
}


def selection(results: Results) -> list[Block]:
    """Models beside baselines with the same information, and the ceiling."""
    report = results.best("selection_report")
    if report is None:
        return [_not(SELECTION_COMMAND), *_single_selectors(results)]
    data = report.data
    rows: list[Sequence[Cell]] = []
    for name, row in by_information(data["rows"]):
        rival = row.get("minus_best_baseline")
        more = "" if rival is None else in_points(rival["difference"], rival["ci95"])
        accuracy = with_interval(row["accuracy"]["rate"], row["accuracy"].get("ci95_towers") or row["accuracy"]["ci95"])
        auroc = with_interval(row["auroc"], row["auroc_ci95"])
        rows.append((row["information"], f"`{name}`", row["kind"], accuracy, auroc, row["ece"], more))
    head = ("Is told", "Predictor", "Kind", "Accuracy", "AUROC", "Calibration error", "Beside the baseline [points]")
    ceiling = data.get("ceiling")
    words = (
        f"{data['n']:,} pulls of {data['towers']:,} test towers of `{data['dataset']}`; {data['failures']:.0%} fail."
    )
    if ceiling:
        low, high = ceiling["accuracy_bounds"]
        words += f" Nobody's accuracy can be above a value between {low:.3f} and {high:.3f}: pulls repeat so often."
    caption = "The last column: accuracy less that of the best baseline with the same information, on the same pulls."
    return [words, Table(head, rows, caption), *_pictures(report, _SELECTION), Code(SELECTION_COMMAND, "Made by:")]


_SELECTION = {
    "towers": "Every legal block in the colour of its predicted probability of failure, marked with what happened.",
    "table": "Accuracy of every predictor; the ticks below a model's are its seeds.",
    "curve": "Accuracy against the number of training towers.",
    "reliability": "How often pulls fail to which a probability was given; below, how many.",
    "rounds": "Accuracy by round of the game.",
}


def _single_selectors(results: Results) -> list[Block]:
    rows = [
        (r.data["model"], r.data.get("dataset"), number(r.data["accuracy"]), number(r.data["majority"]))
        for r in results.of("selection")
    ]
    head = ("Model", "Dataset", "Accuracy", "Majority")
    return [Table(head, rows, "Single evaluations by `jenga eval selection`.")] if rows else []


_HORIZONS = {"one_step": "one step", "rollout_5": "the controller's 5 steps", "rollout_51": "a pull's 51 steps"}


def dynamics(results: Results) -> list[Block]:
    """Skill by horizon, for the target and for the others."""
    command = "jenga eval dynamics --model CKPT --dataset DATASET --json > dynamics.json"
    found = results.of("dynamics")
    if not found:
        return [_not(command)]
    rows: list[Sequence[Cell]] = []
    for result in found:
        for key, words in _HORIZONS.items():
            entry = result.data[key]
            for who in ("others", "target"):
                skill = with_interval(entry[f"skill_{who}"], entry.get(f"skill_{who}_ci95"))
                trivial = entry.get(f"trivial_rmse_mm_{who}")
                model = str(result.data.get("model", ""))
                rows.append((model, words, who, skill, entry[f"rmse_mm_{who}"], trivial, entry.get("n")))
    head = ("Model", "Ahead", "Blocks", "Skill", "RMSE [mm]", "Trivial RMSE [mm]", "n")
    words = (
        "Skill is 1 - MSE / MSE of the trivial prediction, that the target moves by the action and nothing else moves: "
        "0 is as good as that, 1 is perfect, below 0 is worse."
    )
    ranks = [r.data.get("rank_correlation") for r in found]
    if any(rank is not None for rank in ranks):
        shown = ", ".join(number(rank) for rank in ranks)
        words += f" Rank correlation of the costs of candidate plans with the simulator's: {shown}."
    return [words, Table(head, rows), Code(command, "Made by:")]


def control(results: Results) -> list[Block]:
    """Every way to pull, on the same towers and targets."""
    found = results.best("extraction_report") or results.best("extraction")
    if found is None:
        return [_not(EXTRACTION_COMMAND)]
    ways = by_way(found.data)
    rows: list[Sequence[Cell]] = []
    for name, own in ways.items():
        paired = own.get("above_best_straight") or own.get("paired")
        against = with_interval(paired["difference"], paired["ci95"]) if paired else ""
        clean, moved = own.get("success_without_dragging"), own.get("median_disturbance_mm")
        rows.append((name, number(own["success"]), number(clean), against, moved, own.get("control_hz")))
    compared = "Above the best straight pull" if "ways" in found.data else "First one minus this, paired"
    head = ("Way to pull", "Extracted", "and none dragged", compared, "Others moved, median [mm]", "Decisions/s")
    if all(row[-1] is None for row in rows):
        head, rows = head[:-1], [row[:-1] for row in rows]
    causes = [(name, _most_first(own["causes"])) for name, own in ways.items()]
    return [
        "Every tower that was started counts. The straight pull is the trivial baseline; hindsight, the best of "
        "several pulls of the same block, is the ceiling.",
        Table(head, rows, "full: O_a + O_d with the learned model; naive: O_a alone; the same towers and targets."),
        Table(("Way to pull", "Causes of failures"), causes),
        *_pictures(found, _CONTROL),
        Code(f"{EXTRACTION_COMMAND}\njenga report extraction DIR... --out REPORT", "Made by:"),
    ]


def _most_first(causes: Mapping[str, int]) -> str:
    return ", ".join(f"{cause} {n}" for cause, n in sorted(causes.items(), key=lambda item: -item[1])) or "none"


_CONTROL = {
    "speed": "Success against the speed of the pull.",
    "causes": "What went wrong, by way.",
    "rounds": "Success by round of the game.",
}


def touch(results: Results) -> list[Block]:
    """Whether failures feel more erratic, beside what is simpler."""
    command = "jenga report touch LOGS --out DIR"
    found = results.best("touch")
    if found is None:
        return [_not(command)]
    data = found.data
    scores = {
        "erraticness": data["auroc"],
        "erraticness, pulls of the same speed": data["auroc_same_speed"],
        "baseline: mean force": data["baselines"]["mean_force"]["auroc"],
        "baseline: speed of the pull": data["baselines"]["speed"]["auroc"],
    }
    rows = [(name, with_interval(score["value"], score["ci95"]), score["n"]) for name, score in scores.items()]
    head = ("A failure has more", "AUROC, 95 % over towers", "n")
    pictures = _pictures(found, {"": "Forces on the fingertips in a success and a failure near their medians."})
    return [Table(head, rows, "0.5 is no difference."), *pictures, Code(command, "Made by:")]


_BENCHES = ("sim", "robot", "log", "loader", "convert", "replay")


def speed(results: Results) -> list[Block]:
    """Every figure of every bench."""
    found = results.of("bench")
    rows: list[Sequence[Cell]] = []
    for result in found:
        bench = re.sub(r"^bench[-_]", "", result.path.stem)
        for name, figure in result.speeds.items():
            limit = figure.get("limit")
            kept = "" if limit is None else f"{'kept' if figure.get('met') else 'missed'} ({number(limit)})"
            value = f"{with_interval(figure['value'], figure.get('ci95'))} {figure['unit']}"
            ratio = with_interval(figure["ratio"], figure.get("ratio_ci95"))
            rows.append((bench, name.replace("_", " "), value, figure["reference"], ratio, kept, figure.get("n")))
    command = "\n".join(f"jenga bench {name} --json > bench-{name}.json" for name in _BENCHES)
    if not rows:
        return [_not("jenga bench sim --json > bench-sim.json"), Code(command, "All of them:")]
    head = ("Bench", "Figure", "Value", "Reference", "Value / reference", "Limit of the ratio", "n")
    return [Table(head, rows, "What the reference is, `jenga bench NAME` says."), Code(command, "Made by:")]


def _not(command: str, what: str = "Not measured") -> str:
    return f"{what}: run `{command}`."


def _pictures(result: Result, captions: Mapping[str, str]) -> list[Block]:
    """What a command drew beside its JSON, by what its name ends in, as far as it is there."""
    stem = result.path.stem
    paths = {result.path.with_name(f"{stem}-{name}.png" if name else f"{stem}.png"): name for name in captions}
    return [
        Figure(path, path.stem.replace("-", " "), captions[name], embed=True, small=True)
        for path, name in paths.items()
        if path.exists()
    ]
