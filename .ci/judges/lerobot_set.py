"""LeRobot: its loader reads our set, two of its policies train on it, its writer
writes one.

    python .ci/judges/lerobot_set.py LOADER SET OURS

LOADER is the folder in which LeRobot was installed. Writes `OURS/lerobot`, a set of
the gripper's path, and `OURS/robot/set`, one of the arm's episodes there.
"""

import sys
from pathlib import Path

import numpy as np
import torch
from wanting import require

LOADER, SET, OURS = sys.argv[1], sys.argv[2], Path(sys.argv[3])
EVERY, LEVEL = 50, 6.0  # rows between compared images; most difference of their levels
QUANTILES = {"q01", "q10", "q50", "q90", "q99"}

sys.path.insert(0, LOADER)
# the loader needs none of torchvision's compiled functions, but their names
compiled = torch.library.Library("torchvision", "DEF")
for name in ("nms", "qnms"):
    compiled.define(
        f"{name}(Tensor dets, Tensor scores, float iou_threshold) -> Tensor"
    )

from lerobot.datasets.lerobot_dataset import LeRobotDataset  # noqa: E402
from lerobot.policies.act.configuration_act import ACTConfig  # noqa: E402
from lerobot.policies.diffusion.configuration_diffusion import (  # noqa: E402
    DiffusionConfig,
)
from lerobot.policies.factory import (  # noqa: E402
    make_policy,
    make_pre_post_processors,
)


def opened(steps: dict[str, list[int]]) -> LeRobotDataset:
    """Our set, each row with the values `steps` rows away."""
    return LeRobotDataset(
        "own/set",
        root=SET,
        video_backend="pyav",
        delta_timestamps={key: [n / 100 for n in rows] for key, rows in steps.items()},
    )


def read() -> None:
    """All states are finite, quantiles are there, images are those of their time."""
    data = opened({"action": [0, 1]})
    states = [name for name in data.meta.features if name.startswith("observation.")]
    rows = [data[number] for number in range(0, len(data), EVERY)]
    finite = [row[key].isfinite().all() for row in rows for key in (*states, "action")]
    require(all(finite), "numbers in each state and action")
    require({*data.meta.stats["action"]} >= QUANTILES, "quantiles of actions")
    stamps, levels = np.load(OURS / "frames.npy")
    seen = [255 * row["observation.images.camera"].mean().item() for row in rows]
    read = [row["stamp"].item() for row in rows]
    require(np.allclose(read, stamps), "the stamps of the run")
    off = np.abs(np.subtract(seen, levels)).max()
    require(off < LEVEL, f"the film's images within {LEVEL} levels, not {off}")
    print(f"{len(data)} rows; features {', '.join(data.meta.features)}")


def train(config: object, steps: dict[str, list[int]]) -> None:
    """One step of training on one row; the gradient is finite."""
    data = opened(steps)
    policy = make_policy(config, ds_meta=data.meta)
    prepare, _ = make_pre_post_processors(config, dataset_stats=data.meta.stats)
    batch = next(iter(torch.utils.data.DataLoader(data, batch_size=1)))
    loss, _ = policy.forward(prepare(batch))
    loss.backward()
    slopes = [each.grad for each in policy.parameters() if each.grad is not None]
    require(loss.isfinite(), "a finite loss")
    finite = [slope.isfinite().all() for slope in slopes]
    require(finite and all(finite), "a finite gradient")
    print(f"{type(policy).__name__}: loss {loss.item():.3f}")


def write(place: Path, rate: int, names: list[str], episodes: list[dict]) -> None:
    """Episodes, each with vectors (n, 2) by feature, by LeRobot's own writer."""
    vector = {"dtype": "float32", "shape": (2,), "names": names}
    features = dict.fromkeys(episodes[0], vector)
    data = LeRobotDataset.create(
        "own/set", rate, features, root=place, use_videos=False
    )
    for episode in episodes:
        for rows in zip(*episode.values(), strict=True):
            frame = dict(zip(episode, np.array(rows, np.float32), strict=True))
            data.add_frame({**frame, "task": "fold"})
        data.save_episode()
    data.finalize()


small = {"device": "cpu", "push_to_hub": False, "pretrained_backbone_weights": None}
read()
train(ACTConfig(chunk_size=8, n_action_steps=8, **small), {"action": [*range(8)]})
seen = ("observation.state", "observation.images.camera")
two = {key: [-1, 0] for key in seen}
diffusion = DiffusionConfig(horizon=16, n_action_steps=8, **small)
train(diffusion, {**two, "action": [*range(-1, 15)]})
path = np.load(OURS / "path.npy")[1:].T
moved = {"observation.state": path, "action": path}
write(OURS / "lerobot", 100, ["along.pos", "up.pos"], [moved, moved])
robot = OURS / "robot"
motions = [
    {"observation.state": rows[:, :2], "observation.current": rows[:, 2:]}
    for rows in np.load(robot / "episodes.npz").values()
]
write(robot / "set", 50, ["shoulder.pos", "elbow.pos"], motions)
