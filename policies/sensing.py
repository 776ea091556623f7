"""Simulated sensing for policies: late, noisy and incomplete observations, as by a
camera.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from drivers.base.settings import StudyResult
from drivers.base.types import Array
from drivers.strip.engine import Observables
from policies.policy import Observation
from policies.profile import POINTS, profiles

Range = tuple[float, float]
CONTACT, TIP_X, TIP_Z = range(3)
STATE_SIZE = 3


@dataclass(frozen=True, slots=True)
class Sensing:
    """Noise model of measurements in images; lengths in metres, times in seconds, noise
    as one standard deviation.

    Drawn for each image: noise of desk_contact, of the tip's x (and z, where
    `tip_z_sigma` differs), of each point of the profile; in a fraction `wild` of images
    the contact is off by about `wild_size`. Drawn once for each strip: biases of
    contact, tip and profile, the `delay` of images over a range, its error
    `delay_error` (stamps are corrected for the delay without it), the fraction of
    images lost over the range `dropped`, a factor on every noise, log-uniform over
    `factor`.
    """

    contact_sigma: float = 0.001
    tip_sigma: float = 0.001
    contact_bias: float = 0.001
    delay: Range = (0.0, 0.06)
    tip_z_sigma: float | None = None
    tip_bias: float = 0.0
    profile_sigma: float = 0.0003
    profile_bias: float = 0.0003
    wild: float = 0.0
    wild_size: float = 0.02
    dropped: Range = (0.0, 0.0)
    delay_error: float = 0.0
    factor: Range = (1.0, 1.0)

    @property
    def state_sigma(self) -> Array:
        """Standard deviations (STATE_SIZE,) [m] of contact x, tip x and tip z in an
        image.
        """
        tip_z = self.tip_sigma if self.tip_z_sigma is None else self.tip_z_sigma
        return np.array([self.contact_sigma, self.tip_sigma, tip_z])


EXACT_SENSING = Sensing(
    contact_sigma=0.0,
    tip_sigma=0.0,
    contact_bias=0.0,
    delay=(0.0, 0.0),
    profile_sigma=0.0,
    profile_bias=0.0,
)


class ImageNoise(StudyResult):
    """Content of `sensing.yaml`: measured noise and biases of the simulated cell's
    images.

    Fields are as in `Sensing`. Written by `python -m tests.lab study perception`.
    """

    FILE = Path(__file__).with_suffix(".yaml")
    contact_sigma: float
    contact_bias: float
    tip_sigma: float
    tip_z_sigma: float
    tip_bias: float
    profile_sigma: float
    profile_bias: float
    wild: float
    strips: int

    def sensing(self) -> Sensing:
        """Noise model of policies' measurements: this noise, a calibrated camera's
        delays.
        """
        sizes = self.model_dump(exclude={"schema_", "strips", "source", "belongs_to"})
        return Sensing(**sizes, delay=(0.02, 0.04), delay_error=0.002)


IMAGE_SENSING = ImageNoise.shipped().sensing()
TRAINING = replace(
    IMAGE_SENSING,
    delay=(0.0, 0.06),
    wild=0.01,
    dropped=(0.0, 0.5),
    delay_error=0.005,
    factor=(0.5, 6.0),
)
"""Images of the twin, and worse ones: later, with gaps, outliers, and up to six times
the noise.
"""


class Images(NamedTuple):
    """Measured `stamp` (n,) [s], `state` (n, STATE_SIZE) [m], `profile` (n, m, 2) [m]
    of strips.
    """

    stamp: Array
    state: Array
    profile: Array


@dataclass(frozen=True, slots=True)
class Draws:
    """Random numbers for the `size` strips of one group, repeated for each of `groups`
    groups.
    """

    groups: int
    size: int
    rng: np.random.Generator

    def normal(self, *shape: int) -> Array:
        """Draw standard normal values (n, *shape), equal in all groups."""
        return np.concatenate([self.rng.normal(size=(self.size, *shape))] * self.groups)

    def uniform(self, low: float, high: float) -> Array:
        """Draw uniform values (n,) in [low, high), equal in all groups."""
        return np.concatenate(
            [self.rng.uniform(low, high, size=self.size)] * self.groups
        )


class SimulatedCamera:
    """Simulated camera, which measures the states of n strips late and with noise.

    Each group of strips in `draws` gets the same noise and delays. `period` [s] lies
    between two decisions. Without `profile` no profiles are measured.
    """

    def __init__(
        self, sensing: Sensing, period: float, draws: Draws, *, profile: bool
    ) -> None:
        self._sensing = sensing
        self._draws = draws
        self._delay = draws.uniform(*sensing.delay)
        bias = np.array([sensing.contact_bias, sensing.tip_bias, sensing.tip_bias])
        self._bias = draws.normal(STATE_SIZE) * bias
        late = self._delay / period  # decisions
        if sensing.delay_error > 0:
            late = np.maximum(late + draws.normal() * sensing.delay_error / period, 0.0)

        self._factor = np.exp(draws.uniform(*np.log(sensing.factor)))
        self._dropped = draws.uniform(*sensing.dropped)
        self._profile_bias = draws.normal(1, 2) * sensing.profile_bias
        self._points = POINTS if profile else 0
        self._images: Images | None = None
        self._allocate(late)

    def _allocate(self, late: Array) -> None:
        """Allocate a ring of true states, of which images show those `late` (n,)
        decisions ago.
        """
        depth = int(np.ceil(late.max(initial=0.0))) + 2
        self._states: Array = np.full(
            (depth, len(late), STATE_SIZE + 2 * self._points), np.nan
        )
        self._newest = 0
        self._decisions_late = np.floor(late).astype(int)
        # an image lies between two
        self._share_late = (late - self._decisions_late)[:, None]
        self._strips = np.arange(len(late))

    def store(self, true: Observables, shapes: Array, arc: Array, grip: Array) -> None:
        """Store the strips' `true` states at the next decision time.

        Midlines `shapes` (n, nodes, 2) at `arc` (n, nodes) and the grippers (n, 2) [m]
        are used only where profiles are measured.
        """
        self._newest = (self._newest - 1) % len(self._states)
        newest = self._states[self._newest]
        newest[:, CONTACT] = true.contact_x
        newest[:, TIP_X : TIP_Z + 1] = true.tip
        if self._points:
            midlines = profiles(shapes, arc, true.contact_x, grip)
            newest[:, STATE_SIZE:] = midlines.reshape(len(midlines), -1)

    @property
    def wants_shapes(self) -> bool:
        """Whether the camera measures profiles, for which `store` needs midlines."""
        return self._points > 0

    def observe(self, time: float, points: Array) -> Observation:
        """Observation at `time` [s], with grippers known exactly to be at `points` (n,
        2) [m].
        """
        images = self._drop_images(self._add_noise(time))
        return Observation(
            time=np.full(len(points), time),
            x=points[:, 0],
            z=points[:, 1],
            stamp=images.stamp,
            contact_x=images.state[:, CONTACT],
            tip_x=images.state[:, TIP_X],
            tip_z=images.state[:, TIP_Z],
            profile=images.profile,
            profile_confidence=np.ones(len(points) if self._points else 0),
        )

    def _add_noise(self, time: float) -> Images:
        """Measurements in the strips' newest images at `time` [s], with noise."""
        states = self._states
        draws = self._draws
        sensing = self._sensing

        # as it was a delay ago, between two decisions
        after = (self._newest + self._decisions_late) % len(states)
        before = (after + 1) % len(states)
        true = (1 - self._share_late) * states[after, self._strips]
        true += self._share_late * states[before, self._strips]

        noise = draws.normal(STATE_SIZE) * sensing.state_sigma * self._factor[:, None]
        state = true[:, :STATE_SIZE] + self._bias + noise
        profile = true[:, STATE_SIZE:].reshape(len(true), self._points, 2)
        if self._points:
            profile = self._blur_profile(profile)
        if sensing.wild > 0:
            wild = draws.uniform(0.0, 1.0) < sensing.wild
            state[:, CONTACT] += wild * draws.normal() * sensing.wild_size
        return Images(time - self._delay, state, profile)

    def _blur_profile(self, profile: Array) -> Array:
        """Copy of `profile` (n, m, 2) with noise on all points but the last, the
        gripper's.
        """
        noise = self._draws.normal(self._points, 2) * self._sensing.profile_sigma
        noise = noise * self._factor[:, None, None] + self._profile_bias
        noise[:, -1] = 0.0
        return profile + noise

    def _drop_images(self, new: Images) -> Images:
        """Measurements in the strips' newest images that were not lost: `new`, or
        earlier ones.
        """
        if self._images is not None and self._sensing.dropped[1] > 0:
            lost = self._draws.uniform(0.0, 1.0) < self._dropped
            new = Images(
                np.where(lost, self._images.stamp, new.stamp),
                np.where(lost[:, None], self._images.state, new.state),
                np.where(lost[:, None, None], self._images.profile, new.profile),
            )
        self._images = new
        return new
