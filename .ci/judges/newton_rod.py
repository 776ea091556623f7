"""Newton: the exported rod is one that `add_rod` takes, and swings like ours.

python .ci/judges/newton_rod.py OURS
"""

import json
import sys
from pathlib import Path

import newton
import numpy as np
import warp as wp
from wanting import require

OURS = Path(sys.argv[1])
STEP, STEPS, EVERY = 5e-4, 2000, 20  # s; of a second; to the next compared tip
BOUND = 0.05  # of the swing

wp.config.quiet = True
found = json.loads((OURS / "newton/swing.json").read_text())
FORMAT = "folding-cell rod for newton"
require(found["format"] == FORMAT, f"format {FORMAT}, not {found['format']}")
builder = newton.ModelBuilder()
shape = builder.ShapeConfig(
    has_shape_collision=False, has_particle_collision=False, **found["shape"]
)
bodies, _ = builder.add_rod(
    rod=newton.Rod(**found["rod"]), cfg=shape, **found["add_rod"]
)

# the clamp holds the first body
clamped = bodies[0]
builder.body_mass[clamped] = builder.body_inv_mass[clamped] = 0.0
builder.body_inertia[clamped] = builder.body_inv_inertia[clamped] = wp.mat33(0.0)
builder.color()
model = builder.finalize(device="cpu")
solver = newton.solvers.SolverVBD(model, iterations=20)

now, then, control, tips = model.state(), model.state(), model.control(), []
half = np.diff(found["rod"]["points"][:2], axis=0)[0, 0] / 2
for number in range(1, STEPS + 1):
    now.clear_forces()
    solver.step(now, then, control, None, STEP)
    now, then = then, now
    if number % EVERY == 0:
        pose = now.body_q.numpy()[bodies[-1]]
        turned = wp.quat_rotate(wp.quat(*pose[3:]), wp.vec3(0.0, 0.0, half))
        tips.append(pose[:3] + np.array(turned))

rod = np.load(OURS / "swing.npy")
apart = np.linalg.norm(np.array(tips)[:, ::2] - rod, axis=1)
off = apart.max() / np.ptp(rod, axis=0).max()
print(f"one second of swing: off by {100 * off:.1f} % of it")
require(off < BOUND, f"a swing within {BOUND:.0%}")
