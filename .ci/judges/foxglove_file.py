"""Foxglove's reader: the exported MCAP has the fold's rows, film, strip and gripper.

python .ci/judges/foxglove_file.py FILE.mcap OURS
"""

import json
import sys
from collections import Counter
from pathlib import Path

import numpy as np
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from wanting import require

FILE, OURS = Path(sys.argv[1]), Path(sys.argv[2])
OF_FOXGLOVE = {
    "/camera/film": "foxglove.CompressedVideo",
    "/camera/image": "foxglove.CompressedImage",
    "/strip": "foxglove.SceneUpdate",
    "/tf": "foxglove.FrameTransform",
    "/log": "foxglove.Log",
}

counts, rows, gripper, lines = Counter(), [], [], []
with FILE.open("rb") as file:
    factories = [DecoderFactory()]
    reader = make_reader(file, validate_crcs=True, decoder_factories=factories)
    schemas = {each.name for each in reader.get_summary().schemas.values()}
    for _, channel, message in reader.iter_messages(["/ticks"]):
        counts[channel.topic] += 1
        rows.append(json.loads(message.data))
    for _, channel, _, drawn in reader.iter_decoded_messages([*OF_FOXGLOVE]):
        counts[channel.topic] += 1
        match channel.topic:
            case "/tf":
                gripper.append((drawn.translation.x, drawn.translation.z))
            case "/strip":
                lines.append(len(drawn.entities[0].lines[0].points))
print(dict(counts))
require({*OF_FOXGLOVE.values()} <= schemas, f"schemas of Foxglove in {schemas}")
require(all(counts[topic] for topic in OF_FOXGLOVE), "messages on each topic")
require(min(lines) > 2, "more than two points in each midline")
t, x, z = np.load(OURS / "path.npy")
stored = [[row[name] for row in rows[: len(t)]] for name in "txz"]
require(np.allclose(stored, [t, x, z]), "the path of the run in its ticks")
require(np.allclose(gripper[: len(t)], np.transpose([x, z])), "the path as frames")
