"""The example of a policy that an exported set teaches, in small: what it learns of one
fold is what the set commands.

    python .ci/judges/taught.py SET

It reads the set by Parquet alone.
"""

import sys
from pathlib import Path

import numpy as np
from wanting import require

from cell.base.config.places import find_configs
from policies.policy import Observation

sys.path.insert(0, "runbooks/imitated")
from imitated import ENTRY, taught, train

WITHIN = 0.1  # rad, rms
data = Path(sys.argv[1])
weights = data.with_suffix(".npz")
train(data, weights)
policy = ENTRY.make(weights)

[(states, directions)] = taught(data)
strip = find_configs(None).strip("denim")
policy.reset(strip, 0.1, len(states))
x, z, contact = strip.length * states.T
unseen = np.full(len(states), np.nan)
decision = policy.decide(Observation(unseen, x, z, unseen, contact, unseen, unseen))
off = np.sqrt(np.mean((decision.direction - directions) ** 2))
require(off < WITHIN, f"the commanded directions within {WITHIN} rad, not {off:.3f}")
