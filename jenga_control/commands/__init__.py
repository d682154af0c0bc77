"""The verbs that act and show. Heavy imports stay inside."""

from pathlib import Path

import tyro

from jenga_control.commands.bench import bench
from jenga_control.commands.evaluate import evaluate
from jenga_control.commands.report import report
from jenga_data.command_line import Json, MaybeFloat, MaybeInt, MaybePath, Shown

__all__ = ["bench", "demo", "evaluate", "replay", "report"]


def demo(
    out: MaybePath = None,
    workers: int = 2,
    seed: int = 0,
    selection_episodes: int = 12,
    extraction_episodes: int = 6,
    robot_episodes: int = 1,
    towers: int = 2,
    epochs: MaybeInt = None,
    json: Json = False,
) -> Shown:
    """The whole loop, small, in minutes: simulate, log, convert, train, evaluate, control, replay.

    Args:
        out: new folder for everything; by default the first free one of runs/demo-1, runs/demo-2, ...
        workers: processes that simulate.
        seed: decides every tower and pull.
        selection_episodes: rollouts that pull a block with a servo.
        extraction_episodes: rollouts that pull a block with a gripper without an arm.
        robot_episodes: rollouts of the whole robot.
        towers: held-out towers on which every controller pulls.
        epochs: of both trainings; by default those of the preset "fast".
    """
    from jenga_control.demo import DemoSize, closing_words, free_folder, run_demo

    size = DemoSize(selection_episodes, extraction_episodes, robot_episodes, towers, epochs)
    result = run_demo(out or free_folder(), workers, seed, size)
    return Shown(json, result, closing_words(result))


def replay(
    episode: tyro.conf.Positional[tuple[Path, ...]],
    model: tuple[Path, ...] = (),
    from_frame: MaybeInt = None,
    save: MaybePath = None,
    web: bool = False,
    png: MaybePath = None,
    time: MaybeFloat = None,
    frame: MaybeInt = None,
    strip: MaybePath = None,
    film: MaybePath = None,
    meshes: str = "",
    json: Json = False,
) -> Shown:
    """Show an episode in rerun, with models' predictions drawn over the truth; several of them side by side.

    Args:
        episode: an MCAP log, or up to six.
        model: folders of checkpoints. Where MPPI acted, its sampled plans are shown; if it had a learned model, that
            has to be among these.
        from_frame: every dynamics model predicts in an open loop from this frame on, besides every single step.
        save: write a recording for rerun instead of opening it.
        web: serve it to a browser.
        png: take a screenshot without a screen (needs a Vulkan driver, such as Debian's mesa-vulkan-drivers).
        time: moment at which the viewer opens, or that the screenshot shows, since the first frame [s]...
        frame: ...or the number of its frame, as `jenga dataset trace` prints it.
        strip: write six moments of the episode side by side as a PNG; needs neither rerun nor Vulkan.
        film: write the episode as an animated GIF or WebP, with what dynamics models predict as ghosts, their open loop
            with --from-frame; needs neither rerun nor Vulkan.
        meshes: draw the arm with its maker's look: a panda.xml of mujoco-menagerie, or "menagerie" to have
            robot_descriptions fetch it (needs that package and the network).
    """
    from jenga_control.replay import replay as run

    shown = run(
        episode, model, from_frame=from_frame, save=save, web=web, png=png, time=time, frame=frame, strip=strip,
        film=film, meshes=meshes,
    )  # fmt: skip
    data = {"episode": str(episode[0]), "episodes": [str(path) for path in episode], "written": list(map(str, shown))}
    return Shown(json, data, "\n".join(data["written"]))
