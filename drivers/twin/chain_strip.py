"""One strip as a MuJoCo chain: its state, and a step in which the tip lands on its path."""

from dataclasses import dataclass

import mujoco
import numpy as np

from drivers.errors import SimulationNotFinite
from drivers.strip.model import StripModel
from drivers.strip.shape import Gap, Touch, desk_contact, fold_tip, layer_gap, touch_between
from drivers.twin.chain_spec import GRIP_SOLREF, STIFF, Lumps, compiled
from drivers.types import Array

OPENING = 2.0  # touch gaps by which the layers must have opened before they can touch
STATE = mujoco.mjtState.mjSTATE_INTEGRATION
BAD = (
    mujoco.mjtWarning.mjWARN_BADQPOS,
    mujoco.mjtWarning.mjWARN_BADQVEL,
    mujoco.mjtWarning.mjWARN_BADQACC,
)


@dataclass(frozen=True, slots=True)
class Sight:
    """What one strip shows: see Observables."""

    contact_x: float
    tip: tuple[float, float]
    holding_force: float
    touch: Touch | None


class ChainStrip:
    """A chain of `links` links, flat and still at time 0."""

    def __init__(self, model: StripModel, links: int) -> None:
        self._description = model
        self._links = links
        lumps = Lumps.of(model, links)
        self._spacing, self._scale = lumps.spacing, lumps.scale
        self.arc = np.linspace(0.0, model.mechanics.length, links + 1)
        self._model = compiled(model, links)
        self._data = mujoco.MjData(self._model)
        self._held = True
        self._time = 0.0
        self._pose = np.array([model.stated_length, 0.0, 0.0])
        self._commanded, self._velocity = self._pose, np.zeros(3)
        self._gap: Gap | None = None
        self.touch: Touch | None = None
        self.points = self._nodes()

    def release(self) -> None:
        """Let the grasped edge go."""
        self._held = False
        self._data.eq_active[0] = 0

    def advance(self, pose: Array, dt: float, parts: int) -> None:
        """Step to gripper `pose` (3,) after `dt` [s], in equal `parts` on a straight line."""
        start = self._pose
        self._model.opt.timestep = dt / parts
        for part in range(1, parts + 1):
            self._step(start + (pose - start) * (part / parts), dt / parts)
        self._pose = np.array(pose, dtype=np.float64)

    def observe(self) -> Sight:
        """What the strip shows now."""
        holding = -float(self._data.sensordata[0]) / self._scale
        return Sight(
            contact_x=desk_contact(self.points, self._description.observation.contact_height),
            tip=fold_tip(self.points),
            holding_force=holding,
            touch=self.touch,
        )

    def _step(self, pose: Array, h: float) -> None:
        before = None if self.touch else self._state()
        gap_before, time_before = self._gap, self._time
        grip = self._commanded, self._velocity
        self._integrate(pose, h)
        if before is None:
            return
        strip = self._description.mechanics
        self._gap = layer_gap(self.points, self.arc, OPENING * strip.touch_gap)
        self.touch = touch_between(
            (time_before, gap_before), (self._time, self._gap), strip.touch_gap, strip.length
        )
        if self.touch:
            fold = int(np.argmax(self.points[:, 0]))
            self._meet(fold, before)
            self._time = time_before
            self._commanded, self._velocity = grip
            self._integrate(pose, h)

    def _integrate(self, pose: Array, h: float) -> None:
        if self._held:
            self._lead(pose, h)
        mujoco.mj_step(self._model, self._data)
        self._time += h
        self.points = self._nodes()
        warned = any(self._data.warning[w].number for w in BAD)
        if warned or not np.isfinite(self.points).all():
            raise SimulationNotFinite("chain", self._time)

    def _lead(self, pose: Array, h: float) -> None:
        """Place the weld's target so that the tip stands on `pose` at the end of the step.

        The weld pulls with a + b v + k r = 0, a, v and r (tip less target) at the step's end,
        so a tip that moves as commanded needs the target pose + (a + b v) / k: nothing trails.
        """
        velocity = (pose - self._commanded) / h
        time_constant, ratio = GRIP_SOLREF
        b = 2 / (STIFF[1] * time_constant)
        k = 1 / (STIFF[1] * (time_constant * ratio) ** 2)
        target = pose + ((velocity - self._velocity) / h + b * velocity) / k
        self._commanded, self._velocity = pose, velocity
        self._data.mocap_pos[0] = target[0], 0.0, target[1]
        half = -0.5 * target[2]
        self._data.mocap_quat[0] = np.cos(half), 0.0, np.sin(half), 0.0

    def _nodes(self) -> Array:
        angle = np.cumsum(self._data.qpos[:-1])
        nodes = np.zeros((self._links + 1, 2))
        np.cumsum(self._spacing * np.cos(angle), out=nodes[1:, 0])
        np.cumsum(self._spacing * np.sin(angle), out=nodes[1:, 1])
        return nodes

    def _state(self) -> Array:
        state = np.empty(mujoco.mj_stateSize(self._model, STATE))
        mujoco.mj_getState(self._model, self._data, state, STATE)
        return state

    def _meet(self, fold: int, state: Array) -> None:
        """Take up `state` in a model whose layers rest on each other."""
        timestep = self._model.opt.timestep
        self._model = compiled(self._description, self._links, fold)
        self._model.opt.timestep = timestep
        self._data = mujoco.MjData(self._model)
        mujoco.mj_setState(self._model, self._data, state, STATE)
        self.points = self._nodes()
