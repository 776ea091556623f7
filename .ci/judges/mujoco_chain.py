"""MuJoCo alone: the exported chains swing like our rod and fold like the twin's chain.

    python .ci/judges/mujoco_chain.py OURS STRIP

Writes `saved.xml`, a chain as MuJoCo saves it.
"""

import sys
from pathlib import Path

import mujoco
import numpy as np
from wanting import require

OURS, STRIP = Path(sys.argv[1]), sys.argv[2]
SWING_BOUND, FOLD_BOUND = 0.05, 1e-3  # of the swing; m
FOLD_STEP, STEPS = 0.005, 20  # s from pose to pose; of MuJoCo in it
STIFF = (0.9999, 0.9999, 0.001, 0.5, 2.0)


def swing() -> None:
    """Let the strip go from the flat, and save it."""
    model = mujoco.MjModel.from_xml_path(str(OURS / "mjcf/swing.xml"))
    data, tips, every = mujoco.MjData(model), [], round(0.01 / model.opt.timestep)
    for number in range(1, 100 * every + 1):
        mujoco.mj_step(model, data)
        if number % every == 0:
            tips.append(data.site("grasped_edge").xpos[::2].copy())
    rod = np.load(OURS / "swing.npy")
    apart = np.linalg.norm(np.array(tips) - rod, axis=1)
    off = apart.max() / np.ptp(rod, axis=0).max()
    print(f"one second of swing: off by {100 * off:.1f} % of it")
    require(off < SWING_BOUND, f"a swing within {SWING_BOUND:.0%}")
    mujoco.mj_saveLastXML(str(OURS / "saved.xml"), model)


def on_desk() -> mujoco.MjModel:
    """The exported chain on a desk, its grasped edge welded to a gripper."""
    spec = mujoco.MjSpec.from_file(str(OURS / f"mjcf/{STRIP}.xml"))
    spec.option.timestep = FOLD_STEP / STEPS
    soft = {"solref": [2 * spec.option.timestep, 1.0], "solimp": STIFF}
    spec.worldbody.add_geom(
        type=mujoco.mjtGeom.mjGEOM_PLANE,
        size=[2.0, 2.0, 0.1],
        pos=[0.0, 0.0, -spec.geoms[0].size[2]],  # the strip's half thickness
        condim=1,
        priority=1,
        **soft,
    )
    spec.worldbody.add_body(name="gripper", mocap=True).add_site(name="grip")
    spec.add_equality(
        type=mujoco.mjtEq.mjEQ_WELD,
        objtype=mujoco.mjtObj.mjOBJ_SITE,
        name1="grip",
        name2="grasped_edge",
        **soft,
    )
    return spec.compile()


def fold() -> None:
    """Move the gripper as in the recorded fold, and compare all nodes."""
    found, model = np.load(OURS / "fold.npz"), on_desk()
    data, apart = mujoco.MjData(model), []
    links = [i for i in range(model.nbody) if model.body(i).name.startswith("link")]
    poses = found["poses"]
    steps = zip(poses[:-1], poses[1:], found["shapes"][1:], strict=True)
    for before, after, nodes in steps:
        for step in range(1, STEPS + 1):
            x, z, pitch = before + (after - before) * step / STEPS
            data.mocap_pos[0] = x, 0.0, z
            data.mocap_quat[0] = np.cos(pitch / 2), 0.0, -np.sin(pitch / 2), 0.0
            mujoco.mj_step(model, data)
        mujoco.mj_kinematics(model, data)
        edge = data.site("grasped_edge").xpos[None, ::2]
        points = np.concatenate([data.xpos[links][:, ::2], edge])
        apart.append(np.linalg.norm(points - nodes, axis=1).max())
    print(f"a fold of {STRIP}: {1e3 * max(apart):.2f} mm from the twin's chain at most")
    require(max(apart) < FOLD_BOUND, f"a fold within {1e3 * FOLD_BOUND:g} mm")


swing()
fold()
